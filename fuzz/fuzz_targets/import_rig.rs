#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| plumbline_config::fuzzing::import_rig(data));
