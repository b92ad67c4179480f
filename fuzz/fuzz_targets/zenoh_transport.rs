#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| plumbline_link::fuzzing::zenoh_transport(data));
