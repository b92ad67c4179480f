//! Memory asked for ahead of its use.

/// Brings the line of `bytes[at]` into the nearest cache, on processors that Rust has a word for it on; wherever `at` is,
/// nothing else happens.
#[inline]
#[allow(unsafe_code, unused_variables)]
pub(super) fn prefetch(bytes: &[u8], at: usize) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        // SAFETY: PREFETCHT0 is a hint that neither reads nor faults, so that every address will do, and SSE is part of
        // x86-64; the address is reckoned without `unsafe`.
        unsafe { _mm_prefetch::<_MM_HINT_T0>(bytes.as_ptr().wrapping_add(at).cast()) };
    }
}
