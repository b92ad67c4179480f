//! The frame of every function of the header: no panic leaves it, and a failure reaches the caller's error.

use crate::pointers;
use crate::status::{CallFailure, Error, Status};
use std::any::Any;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Does the work of a call: a failure or panic becomes its status, and the text of `error`.
pub(crate) fn call(error: *mut Error, work: impl FnOnce() -> Result<Status, CallFailure>) -> Status {
    // What a panic leaves half done is behind the mutex of its handle, which is poisoned then.
    let outcome = catch_unwind(AssertUnwindSafe(work)).unwrap_or_else(|payload| Err(panicked(&*payload)));
    outcome.unwrap_or_else(|failure| {
        pointers::write_error(error, &failure);
        failure.status
    })
}

fn panicked(payload: &(dyn Any + Send)) -> CallFailure {
    let words = payload.downcast_ref::<String>().map(String::as_str);
    let words = words.or_else(|| payload.downcast_ref::<&str>().copied()).unwrap_or("no message");
    CallFailure::new(
        Status::Panic,
        format!("a fault of the library: {words}; free the handle, and please report it"),
    )
}
