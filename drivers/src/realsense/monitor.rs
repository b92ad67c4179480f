//! Commands to the firmware of the camera, over the first control of its extension unit.
//!
//! The layout is that of librealsense (`src/hw-monitor.cpp`): a request is its length without the first four bytes, a
//! magic number, the number of the command and four parameters, padded to the length of the control. The response
//! repeats the command, its data follow, and its last four bytes are the number of bytes of data.

use thiserror::Error;

/// Reads a calibration table.
pub const GET_CALIBRATION: u32 = 0x15;

/// Length of the control, bytes.
pub const CONTROL_BYTES: usize = 1024;
const MAGIC: u16 = 0xcdab;
/// Bytes of a request that its length does not count.
const UNCOUNTED_BYTES: usize = 4;
/// Bytes of the command that a response repeats.
const COMMAND_BYTES: usize = 4;

/// Reason why a response cannot be used.
#[derive(Clone, Debug, Error, PartialEq, Eq)]
#[non_exhaustive]
pub enum MonitorError {
    /// The firmware refuses: it answers with a negative number.
    #[error("the firmware refuses command {command:#x} (error {code})")]
    Refused {
        /// Number of the command.
        command: u32,
        /// Number of the error.
        code: i32,
    },
    /// It answers another command.
    #[error("the firmware answers command {0:#x} instead; another program talks to it")]
    Other(u32),
    /// It states more data than the control holds.
    #[error("the firmware states {0} bytes, more than its response holds")]
    Length(usize),
}

/// Request of a command with one parameter.
#[must_use]
pub fn request(command: u32, parameter: u32) -> [u8; CONTROL_BYTES] {
    let mut bytes = [0; CONTROL_BYTES];
    let words = [command, parameter, 0, 0, 0];
    let length = UNCOUNTED_BYTES + 4 * words.len();
    bytes[..2].copy_from_slice(&((length - UNCOUNTED_BYTES) as u16).to_le_bytes());
    bytes[2..4].copy_from_slice(&MAGIC.to_le_bytes());
    for (place, word) in bytes[UNCOUNTED_BYTES..].chunks_exact_mut(4).zip(words) {
        place.copy_from_slice(&word.to_le_bytes());
    }
    bytes
}

/// Data of a response to `command`.
///
/// # Errors
/// When it is an error of the firmware, the response to another command, or longer than the control.
pub fn response(bytes: &[u8; CONTROL_BYTES], command: u32) -> Result<&[u8], MonitorError> {
    let (data, length) = bytes.split_at(CONTROL_BYTES - 4);
    let word = |bytes: &[u8]| bytes.first_chunk().map_or(0, |word| u32::from_le_bytes(*word));
    let (repeated, data) = data.split_at(COMMAND_BYTES);
    let repeated = word(repeated);
    if repeated != command {
        return match repeated.cast_signed() {
            code @ ..0 => Err(MonitorError::Refused { command, code }),
            _ => Err(MonitorError::Other(repeated)),
        };
    }
    let length = word(length) as usize;
    data.get(..length).ok_or(MonitorError::Length(length))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Response as a firmware makes it.
    pub(crate) fn answer(command: u32, data: &[u8]) -> [u8; CONTROL_BYTES] {
        let mut bytes = [0; CONTROL_BYTES];
        bytes[..4].copy_from_slice(&command.to_le_bytes());
        bytes[4..4 + data.len()].copy_from_slice(data);
        bytes[CONTROL_BYTES - 4..].copy_from_slice(&(data.len() as u32).to_le_bytes());
        bytes
    }

    #[test]
    fn a_request_has_length_magic_command_and_parameters() {
        let bytes = request(GET_CALIBRATION, 25);
        assert_eq!(bytes[..12], [20, 0, 0xab, 0xcd, 0x15, 0, 0, 0, 25, 0, 0, 0]);
        assert!(bytes[12..].iter().all(|byte| *byte == 0));
    }

    #[test]
    fn data_of_a_response_stand_behind_its_command() {
        assert_eq!(response(&answer(GET_CALIBRATION, &[1, 2, 3]), GET_CALIBRATION), Ok(&[1, 2, 3][..]));
    }

    #[test]
    fn errors_and_lengths_beyond_the_control_are_refused() {
        let bytes = answer((-6i32).cast_unsigned(), &[]);
        let refused = response(&bytes, GET_CALIBRATION);
        assert_eq!(refused, Err(MonitorError::Refused { command: GET_CALIBRATION, code: -6 }));
        assert_eq!(response(&answer(0x10, &[]), GET_CALIBRATION), Err(MonitorError::Other(0x10)));
        let mut bytes = answer(GET_CALIBRATION, &[]);
        bytes[CONTROL_BYTES - 4..].copy_from_slice(&1017u32.to_le_bytes());
        assert_eq!(response(&bytes, GET_CALIBRATION), Err(MonitorError::Length(1017)));
    }
}
