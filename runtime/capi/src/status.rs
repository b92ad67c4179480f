//! Outcomes of calls.

use plumbline_client::ClientError;
use std::ffi::c_char;

/// Outcome of a call: 0 done; above 0 done, and nothing to hand out; below 0 an error.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(i32)]
pub enum Status {
    /// Done.
    Ok = 0,
    /// Done; there is no pose yet.
    NoPose = 1,
    /// No record came in time.
    Timeout = 2,
    /// The flight has ended.
    FlightEnded = 3,
    /// A pointer is null that may not be.
    NullPointer = -1,
    /// The handle was freed, is of another type, or never was one.
    BadHandle = -2,
    /// Another thread uses the handle.
    Busy = -3,
    /// An earlier call failed within the library (PLUMBLINE_STATUS_PANIC): free the handle.
    Poisoned = -4,
    /// A fault of the library itself; please report it. The handle is poisoned.
    Panic = -5,
    /// An argument is out of range.
    BadArgument = -6,
    /// The configuration cannot be read, or is refused.
    Configuration = -7,
    /// An image has not the size of the configuration, or a stride shorter than its width.
    ImageSize = -8,
    /// A value is not a finite number; the sample was refused.
    NotFinite = -9,
    /// The stamp is not later than that of the sample or frame before; it was refused.
    OutOfOrder = -10,
    /// The stamp is far later than that of the sample before; the sample was refused.
    FarAhead = -11,
    /// A value is far beyond the sensor's range; the sample was refused.
    OutOfRange = -12,
    /// No flight listens at the path, or it may not be connected to.
    Connect = -13,
    /// The flight has closed the connection, or takes nothing: free the handle, and connect again.
    Disconnected = -14,
    /// The other end is no flight of this version.
    Foreign = -15,
    /// The flight has refused the command, or could not do it.
    Refused = -16,
}

/// Error of a call, in memory of the caller: the last argument of every function that can fail. It is written where the
/// call fails, and may be null.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct Error {
    /// Outcome of the call.
    pub status: Status,
    /// Failure, cause and cure: UTF-8, ends with a zero.
    pub text: [c_char; 1020],
}

/// Reason why a call fails.
#[derive(Debug)]
pub struct CallFailure {
    pub(crate) status: Status,
    pub(crate) text: String,
}

impl CallFailure {
    pub(crate) fn new(status: Status, text: impl Into<String>) -> Self {
        Self { status, text: text.into() }
    }

    pub(crate) fn null(what: &str) -> Self {
        Self::new(Status::NullPointer, format!("{what} is a null pointer"))
    }
}

impl From<ClientError> for CallFailure {
    fn from(error: ClientError) -> Self {
        let status = match error {
            ClientError::Connect { .. } | ClientError::Line { .. } => Status::Connect,
            ClientError::Foreign(_) => Status::Foreign,
            ClientError::NoImage => Status::BadArgument,
            ClientError::NotFinite => Status::NotFinite,
            _ => Status::Disconnected,
        };
        Self::new(status, error.to_string())
    }
}
