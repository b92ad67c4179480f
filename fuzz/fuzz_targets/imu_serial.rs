#![no_main]

libfuzzer_sys::fuzz_target!(|data: &[u8]| plumbline_drivers::fuzzing::imu_serial(data));
