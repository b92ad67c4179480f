//! The firmware in C (examples/firmware): compiled for ARM without a warning, and run on the host as a device.

use plumbline_protocol::{Hello, Message, Receiver, Settings, Trigger, encode};
use plumbline_test_support::{Need, skip};
use std::io::{Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

const STRICT: [&str; 4] = ["-Wall", "-Wextra", "-Werror", "-O2"];

fn project(path: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(path)
}

/// True if a compiler is installed; reports the skipped test otherwise.
fn has(compiler: &str, need: Need) -> bool {
    let is_here =
        Command::new(compiler).arg("--version").output().is_ok_and(|output| output.status.success());
    if !is_here {
        skip(need, format_args!("{compiler} is not installed (scripts/setup programs)"));
    }
    is_here
}

/// Compiles, and checks that nothing was said.
fn compiles(command: &mut Command) {
    let output = command.output().unwrap();
    assert!(
        output.status.success() && output.stderr.is_empty(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
}

/// The firmware on a board that is this host; `None` without a compiler.
pub fn on_host(folder: &Path) -> Option<PathBuf> {
    let program = folder.join("firmware");
    has("cc", Need::Compiler).then(|| {
        let sources = [project("examples/firmware/firmware.c"), project("tests/c/firmware_board.c")];
        let mut cc = Command::new("cc");
        cc.args(STRICT).args(["-std=c99", "-Wconversion", "-fsanitize=undefined,address", "-I"]);
        compiles(cc.arg(project("examples/firmware")).args(sources).arg("-o").arg(&program));
        program
    })
}

#[test]
fn the_firmware_compiles_for_arm_without_a_warning() {
    if !has("arm-none-eabi-gcc", Need::ArmCompiler) {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let (headers, object) = (project("examples/firmware"), folder.path().join("firmware.o"));
    for processor in ["-mcpu=cortex-m0plus", "-mcpu=cortex-m4", "-mcpu=cortex-m7"] {
        let arm = |compiler: &str| {
            let mut command = Command::new(compiler);
            command
                .args(STRICT)
                .args([processor, "-mthumb", "-I"])
                .arg(&headers)
                .arg("-o")
                .arg(&object)
                .arg("-c");
            command
        };
        compiles(arm("arm-none-eabi-gcc").args(["-std=c99", "-Wconversion"]).arg(headers.join("firmware.c")));
        let sketch = ["-std=c++14", "-fno-exceptions", "-fno-rtti", "-x", "c++", "-include"];
        let arduino = project("tests/c/Arduino.h");
        compiles(arm("arm-none-eabi-g++").args(sketch).arg(arduino).arg(headers.join("teensy.ino")));
    }
}

#[test]
fn the_firmware_and_its_board_are_at_most_250_lines() {
    let lines = ["firmware.c", "teensy.ino"].map(|name| {
        std::fs::read_to_string(project("examples/firmware").join(name)).unwrap().lines().count()
    });
    assert!(lines.iter().sum::<usize>() <= 250, "{lines:?}");
}

/// Answers of the firmware to these messages within `seconds`.
fn answers(program: &Path, messages: &[Message], seconds: &str) -> Vec<Message> {
    let mut child = Command::new(program)
        .args(["/dev/null", seconds])
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let mut line = child.stdin.take().unwrap();
    for message in messages {
        line.write_all(encode(message, &mut [0; plumbline_protocol::MAX_FRAME])).unwrap();
    }
    let mut said = Vec::new();
    child.stdout.take().unwrap().read_to_end(&mut said).unwrap();
    assert!(child.wait().unwrap().success());
    let mut receiver = Receiver::new();
    said.iter().filter_map(|byte| receiver.push(*byte)).map(|message| message.unwrap()).collect()
}

#[test]
fn triggers_follow_one_another_without_drift_and_settings_are_those_in_force() {
    let folder = tempfile::tempdir().unwrap();
    let Some(program) = on_host(folder.path()) else { return };
    let wanted =
        Settings { imu_rate_mhz: 1_000_000, trigger_rate_mhz: 50_000, trigger_pulse_us: 4000, cameras: 3 };
    let said = answers(&program, &[Message::AskTime { asked_ns: 77 }, Message::Set(wanted)], "1.1");
    assert!(
        matches!(said[0], Message::Hello(Hello { device_id: 0x4711, imu_rate_mhz: 200_000, .. })),
        "{:?}",
        said[0]
    );
    assert!(
        matches!(said[1], Message::Time(time) if time.asked_ns == 77 && time.sent_ns >= time.received_ns)
    );
    // The sensor has its own rate, and the host is told.
    assert_eq!(said[2], Message::Settings(Settings { imu_rate_mhz: 200_000, ..wanted }));
    let triggers: Vec<Trigger> = said[3..]
        .iter()
        .map(|m| if let Message::Trigger(trigger) = m { *trigger } else { panic!("{m:?}") })
        .collect();
    assert!((48..=54).contains(&triggers.len()), "{}", triggers.len());
    let first = triggers[0];
    let mut late_us: Vec<i64> = triggers
        .iter()
        .enumerate()
        .map(|(k, trigger)| {
            assert_eq!((trigger.counter as usize, trigger.pulse_ns, trigger.cameras), (k, 4_000_000, 3));
            (trigger.time_ns as i64 - first.time_ns as i64 - 20_000_000 * k as i64) / 1000
        })
        .collect();
    late_us.sort_unstable();
    // A busy host may delay some, the first one too; periods do not add up.
    assert!(late_us[late_us.len() / 2] - late_us[0] < 2000, "{late_us:?}");
    let none = answers(&program, &[Message::Set(Settings { trigger_rate_mhz: 0, ..wanted })], "0.3");
    assert!(none.iter().all(|message| !matches!(message, Message::Trigger(_))), "{none:?}");
    // More than can be is brought down to what can.
    let fast = answers(
        &program,
        &[Message::Set(Settings { trigger_rate_mhz: 5_000_000, trigger_pulse_us: 5000, ..wanted })],
        "0.3",
    );
    let in_force =
        Settings { imu_rate_mhz: 200_000, trigger_rate_mhz: 1_000_000, trigger_pulse_us: 900, cameras: 3 };
    assert!(fast.contains(&Message::Settings(in_force)), "{:?}", &fast[..2]);
}
