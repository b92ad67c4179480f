//! In place of the crate stabby, whose types have the same layout with every compiler: Zenoh describes plugins with one of them,
//! and loads none in this build (its feature `plugins` is off). See `../README.md`.

#![no_std]
#![forbid(unsafe_code)]

/// Strings.
pub mod str {
    /// A string in the compiler's own layout.
    pub type Str<'a> = &'a core::primitive::str;
}
