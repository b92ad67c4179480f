#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| plumbline::fuzzing::network_messages(data));
