#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| plumbline::fuzzing::map_file(data));
