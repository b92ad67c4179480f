//! Cameras and inertial sensors behind the real kernel, in a virtual machine: `scripts/vm` boots it, and runs this very
//! program in it.
//!
//! The kernel's virtual cameras (`vivid`) stand for real ones: they stream, stamp, lose images and are unplugged as the
//! kernel's rules say; so does a hub of HID sensors that the program plays to the kernel ([`hid`]). What they cannot show, clocks and buses of real hardware, is told by the figures of a flight.

mod guest;
mod guest_iio;
mod hid;

/// Alone on its host: emulation takes what there is of it.
mod realtime {
    use plumbline_test_support::{Need, skip, workspace};
    use std::process::Command;

    #[test]
    #[ignore = "a minute of a virtual machine, of which a flight in it shows the most in every run: make vm"]
    fn cameras_stream_pair_stamp_and_come_back() {
        let script = workspace().join("scripts/vm");
        let check = Command::new(&script).arg("check").output().expect("the script is there");
        if !check.status.success() {
            return skip(Need::VirtualMachine, String::from_utf8_lossy(&check.stderr).trim());
        }
        let program = std::env::current_exe().unwrap();
        let output = Command::new(&script)
            .arg("run")
            .arg(program)
            .args(["guest", "--ignored", "--nocapture", "--test-threads=1"])
            .output()
            .expect("the script runs");
        let (said, console) =
            (String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr));
        println!("{said}");
        assert!(output.status.success(), "{console}");
        // All of them ran.
        let guests = [include_str!("guest.rs"), include_str!("guest_iio.rs")];
        let tests: usize = guests.iter().map(|guest| guest.matches("#[ignore = ").count()).sum();
        assert!(said.contains(&format!("{tests} passed; 0 failed")), "{console}");
    }
}
