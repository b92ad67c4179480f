//! Version of the library, and of its binary interface.

use std::ffi::{CStr, c_char};

/// Version of the binary interface that this header describes: the number in the library's soname. It changes with every
/// change of a structure or of a function that a compiled program could not survive.
pub const PLUMBLINE_ABI: u32 = 0;

const VERSION: &CStr = match CStr::from_bytes_with_nul(concat!(env!("CARGO_PKG_VERSION"), "\0").as_bytes()) {
    Ok(version) => version,
    Err(_) => panic!("a version without zeros"),
};

/// Returns the version of the binary interface of the loaded library. A program that loads it by dlopen compares it with
/// PLUMBLINE_ABI.
#[allow(unsafe_code)]
#[unsafe(no_mangle)]
pub extern "C" fn plumbline_abi() -> u32 {
    PLUMBLINE_ABI
}

/// Returns the version of the library, such as "0.1.0".
#[allow(unsafe_code)]
#[unsafe(no_mangle)]
pub extern "C" fn plumbline_version() -> *const c_char {
    VERSION.as_ptr()
}
