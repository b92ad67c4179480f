//! The first thing that runs: does this processor have what the program was compiled for?
//!
//! `.cargo/config.toml` lets the compiler use AVX2 and its like everywhere, also in what runs before `main`, such as the
//! global allocator. So this is no module of the crate: `build.rs` compiles it for the oldest x86-64 and links it into
//! the command, where `.preinit_array` has the loader call it before every initializer. Without it a processor that is too old
//! would end the program by an illegal instruction, and without a word.
//!
//! Bits: Intel, Software Developer's Manual, volume 2, CPUID; volume 1, 13.3 and 14.3 (XCR0).

#![no_std]

use core::arch::x86_64::{__cpuid, __cpuid_count, _xgetbv};
use core::ffi::c_int;

/// The exit status of what cannot help when it is asked for in the same way again (`cli/exit_status.rs`).
const USAGE: c_int = 2;
const STDERR: c_int = 2;

/// The features that the rest was compiled with, with commas between them.
const COMPILED_WITH: &str = env!("PLUMBLINE_TARGET_FEATURES");

const BEFORE: &str = "plumbline: this processor cannot run this program; it lacks";
const AFTER: &str = ". Take a computer with x86-64-v3 (Intel since Haswell, AMD since Excavator); in a virtual machine, give it \
the processor of its host; or build for this one from source: RUSTFLAGS='-C target-cpu=x86-64' make build\n";

/// Registers of CPUID that name features.
#[derive(Clone, Copy)]
enum Register {
    /// Leaf 1, ECX.
    Basic,
    /// Leaf 7, EBX.
    Extended,
    /// Leaf 0x8000_0001, ECX.
    Amd,
}

/// Registers that the system has to keep when it switches threads (XCR0): none, 256-bit or 512-bit ones.
const NONE: u64 = 0;
const YMM: u64 = 0b110;
const ZMM: u64 = 0b1110_0110;

struct Feature {
    name: &'static str,
    register: Register,
    bit: u32,
    state: u64,
}

const fn feature(name: &'static str, register: Register, bit: u32, state: u64) -> Feature {
    Feature { name, register, bit, state }
}

/// Processor features of the levels x86-64-v2, v3 and v4.
static FEATURES: [Feature; 20] = [
    feature("sse3", Register::Basic, 0, NONE),
    feature("ssse3", Register::Basic, 9, NONE),
    feature("sse4.1", Register::Basic, 19, NONE),
    feature("sse4.2", Register::Basic, 20, NONE),
    feature("cmpxchg16b", Register::Basic, 13, NONE),
    feature("popcnt", Register::Basic, 23, NONE),
    feature("movbe", Register::Basic, 22, NONE),
    // The system has it switched on.
    feature("xsave", Register::Basic, 27, NONE),
    feature("avx", Register::Basic, 28, YMM),
    feature("f16c", Register::Basic, 29, YMM),
    feature("fma", Register::Basic, 12, YMM),
    feature("avx2", Register::Extended, 5, YMM),
    feature("bmi1", Register::Extended, 3, NONE),
    feature("bmi2", Register::Extended, 8, NONE),
    feature("lzcnt", Register::Amd, 5, NONE),
    feature("avx512f", Register::Extended, 16, ZMM),
    feature("avx512dq", Register::Extended, 17, ZMM),
    feature("avx512cd", Register::Extended, 28, ZMM),
    feature("avx512bw", Register::Extended, 30, ZMM),
    feature("avx512vl", Register::Extended, 31, ZMM),
];

/// Which of [`FEATURES`] the rest was compiled with.
static IS_NEEDED: [bool; FEATURES.len()] = {
    let mut needed = [false; FEATURES.len()];
    let mut i = 0;
    while i < needed.len() {
        needed[i] = is_in_list(FEATURES[i].name.as_bytes(), COMPILED_WITH.as_bytes());
        i += 1;
    }
    needed
};

/// True if `word` stands in `list` between commas.
const fn is_in_list(word: &[u8], list: &[u8]) -> bool {
    let mut start = 0;
    while start + word.len() <= list.len() {
        let mut same = 0;
        while same < word.len() && list[start + same] == word[same] {
            same += 1;
        }
        let end = start + word.len();
        if same == word.len()
            && (end == list.len() || list[end] == b',')
            && (start == 0 || list[start - 1] == b',')
        {
            return true;
        }
        start += 1;
    }
    false
}

/// Features of this processor, and of the system on it.
struct Processor {
    basic: u32,
    extended: u32,
    amd: u32,
    state: u64,
}

impl Processor {
    fn read() -> Self {
        let basic = __cpuid(1).ecx;
        let extended = if __cpuid(0).eax >= 7 { __cpuid_count(7, 0).ebx } else { 0 };
        let amd = if __cpuid(0x8000_0000).eax > 0x8000_0000 { __cpuid(0x8000_0001).ecx } else { 0 };
        let is_state_told = basic & (1 << 27) != 0;
        // SAFETY: XGETBV exists where OSXSAVE is set, and register 0 exists where XGETBV does.
        let state = if is_state_told { unsafe { state() } } else { 0 };
        Self { basic, extended, amd, state }
    }

    fn has(&self, feature: &Feature) -> bool {
        let register = match feature.register {
            Register::Basic => self.basic,
            Register::Extended => self.extended,
            Register::Amd => self.amd,
        };
        register & (1 << feature.bit) != 0 && self.state & feature.state == feature.state
    }
}

/// XCR0.
///
/// # Safety
/// The processor has XGETBV, and the system has switched it on.
#[target_feature(enable = "xsave")]
unsafe fn state() -> u64 {
    // SAFETY: as of this function.
    unsafe { _xgetbv(0) }
}

unsafe extern "C" {
    fn write(file: c_int, bytes: *const u8, length: usize) -> isize;
    safe fn _exit(status: c_int) -> !;
}

fn say(words: &str) {
    // SAFETY: pointer and length are of one string. The C library is linked and relocated before initializers run.
    let _ = unsafe { write(STDERR, words.as_ptr(), words.len()) };
}

extern "C" fn look() {
    let processor = Processor::read();
    let mut is_fit = true;
    for (feature, is_needed) in FEATURES.iter().zip(&IS_NEEDED) {
        if *is_needed && !processor.has(feature) {
            if is_fit {
                say(BEFORE);
            }
            is_fit = false;
            say(" ");
            say(feature.name);
        }
    }
    if !is_fit {
        say(AFTER);
        _exit(USAGE);
    }
}

// SAFETY: the section holds pointers to C functions, as this one is; the loader passes arguments that it does not look at.
#[used]
#[unsafe(link_section = ".preinit_array")]
static FIRST: extern "C" fn() = look;
