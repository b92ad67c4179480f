//! Memory of the caller: read and written here alone. What a pointer has to be stands in the header of the crate.
#![allow(unsafe_code)]

use crate::status::{CallFailure, Error, Status};
use crate::types::{Image, Numbers};
use plumbline_config::ImageView;
use std::ffi::{CStr, c_char};
use std::path::Path;

/// The text at `text`, by its name in the header.
pub(crate) fn text<'a>(text: *const c_char, what: &str) -> Result<&'a str, CallFailure> {
    if text.is_null() {
        return Err(CallFailure::null(what));
    }
    // SAFETY: not null, and by the contract a string that ends with a zero, which lives during the call.
    let text = unsafe { CStr::from_ptr(text) };
    text.to_str().map_err(|_| CallFailure::new(Status::BadArgument, format!("{what} is not UTF-8")))
}

/// The path at `path`.
pub(crate) fn path<'a>(path: *const c_char) -> Result<&'a Path, CallFailure> {
    text(path, "the path").map(Path::new)
}

/// A copy of the structure at `from`, by its name in the header. Alignment does not matter.
pub(crate) fn read<T: Copy>(from: *const T, what: &str) -> Result<T, CallFailure> {
    if from.is_null() {
        return Err(CallFailure::null(what));
    }
    // SAFETY: not null, and by the contract a structure of this type, of numbers and pointers alone.
    Ok(unsafe { from.read_unaligned() })
}

/// A place for the caller's result, by its name in the header: refused before any work is done.
pub(crate) fn out<T>(to: *mut T, what: &str) -> Result<Out<T>, CallFailure> {
    if to.is_null() { Err(CallFailure::null(what)) } else { Ok(Out(to)) }
}

/// Memory of the caller for a result.
#[derive(Clone, Copy)]
pub(crate) struct Out<T>(*mut T);

impl<T> Out<T> {
    /// A place, if the caller wants the result.
    pub(crate) fn wanted(to: *mut T) -> Option<Self> {
        (!to.is_null()).then_some(Self(to))
    }

    pub(crate) fn write(self, value: T) {
        // SAFETY: not null, and by the contract memory for this type. Alignment does not matter.
        unsafe { self.0.write_unaligned(value) };
    }
}

impl<T: Numbers> Out<T> {
    /// Writes the structure that is a record of these bytes, if they are as many.
    pub(crate) fn write_record(self, bytes: &[u8]) {
        if let Some(record) = from_record(bytes) {
            self.write(record);
        }
    }
}

/// A structure of the header that is a record of the local socket, from the bytes of the record.
pub(crate) fn from_record<T: Numbers>(bytes: &[u8]) -> Option<T> {
    let bytes = bytes.get(..size_of::<T>())?;
    // SAFETY: there are as many bytes, and whatever they are they are a value of the type (`Numbers`).
    Some(unsafe { bytes.as_ptr().cast::<T>().read_unaligned() })
}

/// Writes a text that ends with a zero into `size` bytes at `to`, cut at a character where it is longer; its whole length.
pub(crate) fn write_text(to: *mut c_char, size: usize, text: &str) -> usize {
    let Some(room) = size.checked_sub(1) else { return text.len() };
    if !to.is_null() {
        let count = text.floor_char_boundary(room);
        // SAFETY: `count` + 1 is at most `size`, the bytes that the caller has there by the contract.
        unsafe {
            to.cast::<u8>().copy_from_nonoverlapping(text.as_ptr(), count);
            to.add(count).write(0);
        }
    }
    text.len()
}

/// Writes the error of a call, if the caller wants it.
pub(crate) fn write_error(to: *mut Error, failure: &CallFailure) {
    if to.is_null() {
        return;
    }
    // SAFETY: not null, and by the contract memory for an error.
    let (status, text) = unsafe { (&raw mut (*to).status, &raw mut (*to).text) };
    // SAFETY: a field of that memory.
    unsafe { status.write_unaligned(failure.status) };
    write_text(text.cast(), size_of::<[c_char; 1020]>(), &failure.text);
}

/// Views the image that a caller lends; `None` for one that did not arrive. `side` names it in messages.
pub(crate) fn image<'a>(image: &Image, side: &str) -> Result<Option<ImageView<'a>>, CallFailure> {
    if image.pixels.is_null() {
        return Ok(None);
    }
    let refused = |text: String| CallFailure::new(Status::ImageSize, format!("the {side} image: {text}"));
    let (width, height) = (image.width as usize, image.height as usize);
    if width == 0 || height == 0 {
        return Err(refused(format!(
            "{width} x {height} px have no pixels; for an image that did not arrive give no pixels"
        )));
    }
    let bytes = (height - 1).checked_mul(image.stride).and_then(|bytes| bytes.checked_add(width));
    let bytes = bytes.filter(|bytes| *bytes <= isize::MAX as usize);
    let bytes = bytes.ok_or_else(|| refused("longer than memory; check its stride".into()))?;
    // SAFETY: not null, and by the contract that many bytes, which nobody writes during the call.
    let pixels = unsafe { std::slice::from_raw_parts(image.pixels, bytes) };
    ImageView::new(width, height, image.stride, pixels).map(Some).map_err(|error| refused(error.to_string()))
}
