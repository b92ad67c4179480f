//! States and health as text.
#![allow(unsafe_code)]

use crate::pointers::write_text;
use plumbline_estimator::HealthBits;
use std::ffi::{CStr, CString, c_char};
use std::ptr::null;
use std::sync::OnceLock;

/// Returns the name of a plumbline_state, such as "tracking"; null for a number that is none.
#[unsafe(no_mangle)]
pub extern "C" fn plumbline_state_name(state: u8) -> *const c_char {
    const NAMES: [&CStr; 4] = [c"initialising", c"tracking", c"blind", c"failed"];
    NAMES.get(usize::from(state)).map_or(null(), |name| name.as_ptr())
}

/// Returns the name of health bit number `bit`, from 0, such as "few features"; null for a bit that has none.
#[unsafe(no_mangle)]
pub extern "C" fn plumbline_health_name(bit: u32) -> *const c_char {
    static NAMES: OnceLock<Vec<CString>> = OnceLock::new();
    let names = NAMES.get_or_init(|| {
        HealthBits::NAMES.iter().map(|(_, name)| CString::new(*name).unwrap_or_default()).collect()
    });
    let place =
        1u32.checked_shl(bit).and_then(|mask| HealthBits::NAMES.iter().position(|(b, _)| b.0 == mask));
    place.map_or(null(), |place| names[place].as_ptr())
}

/// Writes the names of all health bits that are set, with commas between them, into `size` bytes at `text`, and returns the
/// length of the whole text: it was cut where that is not less than `size`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plumbline_health_text(health: u32, text: *mut c_char, size: usize) -> usize {
    write_text(text, size, &HealthBits(health).names().collect::<Vec<_>>().join(", "))
}
