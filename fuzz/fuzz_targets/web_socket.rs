#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| plumbline_ground::fuzzing::web_socket(data));
