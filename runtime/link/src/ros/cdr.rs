//! Bytes of a ROS 2 message: plain CDR (XCDR1), little-endian, behind the four bytes that say so.

use byteorder::LittleEndian;
use serde::Serialize;

/// Representation identifier `CDR_LE` and no options (DDSI-RTPS 2.3, section 10.5).
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

/// The serialized message. Alignment counts from behind the encapsulation.
///
/// # Errors
/// Only for types that CDR has no form for, such as sequences of unknown length: none of ours.
pub fn encode<T: Serialize>(message: &T) -> Result<Vec<u8>, cdr_encoding::Error> {
    let mut bytes = Vec::with_capacity(1024);
    bytes.extend_from_slice(&ENCAPSULATION);
    cdr_encoding::to_writer::<T, LittleEndian, &mut Vec<u8>>(&mut bytes, message)?;
    Ok(bytes)
}
