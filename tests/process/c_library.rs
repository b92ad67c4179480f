//! The C library as its user meets it: examples and programs in C and C++, compiled by the compilers of the system against
//! what `scripts/c-library` installs.
//!
//! `PLUMBLINE_C_LIBRARY` names another library than the one just built, `PLUMBLINE_C_COMPILER` its compiler, and
//! `PLUMBLINE_C_RUNNER` what starts its programs, an emulator or valgrind: `make capi-valgrind`, `make arm64`.

use super::hardware::Recording;
use super::vehicle::{PLUMBLINE, Running, eventually};
use plumbline_test_support::{Need, shared, skip, workspace};
use serde_json::Value;
use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::time::Duration;

/// Longest wait.
const PATIENCE: Duration = Duration::from_secs(15);
/// A compiler and its language.
type Compiler = (&'static str, &'static str);
const GCC: Compiler = ("gcc", "-std=c11");
const CLANG: Compiler = ("clang", "-std=c11");
const GXX: Compiler = ("g++", "-std=c++17");
const CLANGXX: Compiler = ("clang++", "-std=c++17");
const WARNINGS: [&str; 5] = ["-Wall", "-Wextra", "-Werror", "-pedantic", "-O1"];
/// Sanitizers that find errors of memory, leaks and undefined behaviour in the programs and their use of the library.
const SANITIZERS: &[&str] = &["-fsanitize=address,undefined", "-fno-sanitize-recover=all", "-g"];

fn said(output: &Output) -> String {
    [&output.stdout, &output.stderr].map(|bytes| String::from_utf8_lossy(bytes).into_owned()).concat()
}

fn succeeds(mut command: Command) -> String {
    let output = command.output().unwrap_or_else(|error| panic!("{command:?}: {error}"));
    assert!(output.status.success(), "{command:?}: {}\n{}", output.status, said(&output));
    String::from_utf8(output.stdout).unwrap()
}

fn preset() -> PathBuf {
    workspace().join("config/presets/euroc.toml")
}

/// The library, installed in a folder of its own.
struct Installed {
    folder: tempfile::TempDir,
    compiler: Option<String>,
    runner: Vec<String>,
}

impl Installed {
    /// `None`, and the test is skipped, where there is no compiler for C.
    fn new() -> Option<Self> {
        let variable = |name: &str| std::env::var(name).ok();
        let built = || std::env::current_exe().unwrap().with_file_name("libplumbline_capi.so");
        let library = variable("PLUMBLINE_C_LIBRARY").map_or_else(built, |path| workspace().join(path));
        let compiler = variable("PLUMBLINE_C_COMPILER");
        if Command::new(compiler.as_deref().unwrap_or("cc")).arg("--version").output().is_err() {
            skip(Need::Compiler, "no compiler for C");
            return None;
        }
        let folder = tempfile::tempdir().unwrap();
        let mut script = Command::new(workspace().join("scripts/c-library"));
        script.arg(folder.path().join("usr")).arg(&library);
        if let Some(prefix) = compiler.as_deref().and_then(|name| name.strip_suffix("gcc")) {
            script.env("STRIP", format!("{prefix}strip"));
        }
        succeeds(script);
        let runner = variable("PLUMBLINE_C_RUNNER").unwrap_or_default();
        Some(Self { folder, compiler, runner: runner.split_whitespace().map(str::to_owned).collect() })
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Flags of these packages by pkg-config, each other's headers without their warnings.
    fn flags(&self, packages: &[&str]) -> Vec<String> {
        let mut config = Command::new("pkg-config");
        config.args(["--cflags", "--libs"]).args(packages);
        config.env("PKG_CONFIG_PATH", self.path("usr/lib/pkgconfig"));
        let flags = succeeds(config);
        let system = |flag: &str| match flag.strip_prefix("-I") {
            Some(folder) if folder.contains("opencv") => format!("-isystem{folder}"),
            _ => flag.to_owned(),
        };
        flags.split_whitespace().map(system).collect()
    }

    /// Compiles a program; every warning is an error.
    fn compile(
        &self,
        (compiler, language): Compiler,
        source: &str,
        packages: &[&str],
        more: &[&str],
    ) -> PathBuf {
        let compiler = self.compiler.as_deref().unwrap_or(compiler);
        let name = Path::new(source).file_stem().and_then(OsStr::to_str).unwrap();
        let program = self.path(&format!("{name}-{compiler}"));
        let mut command = Command::new(compiler);
        command.arg(language).args(WARNINGS).args(more).arg("-o").arg(&program).arg(workspace().join(source));
        command.args(self.flags(&[&["plumbline"], packages].concat())).args(["-pthread", "-lm"]);
        succeeds(command);
        program
    }

    /// A command that starts a program, which finds the library.
    fn command(&self, program: &Path) -> Command {
        let mut words = self.runner.iter().map(OsStr::new).chain([program.as_os_str()]);
        let mut command = Command::new(words.next().unwrap());
        command.args(words).env("LD_LIBRARY_PATH", self.path("usr/lib"));
        // An emulator hands this to its program alone.
        command.env("QEMU_SET_ENV", format!("LD_LIBRARY_PATH={}", self.path("usr/lib").display()));
        if self.compiler.is_some() {
            command.env_remove("LD_LIBRARY_PATH");
        }
        command
    }
}

/// Digest of all estimates that a program prints.
fn digest(printed: &str) -> &str {
    printed.lines().find_map(|line| line.strip_prefix("digest ")).expect("a digest")
}

/// Digest of all estimates of `plumbline replay`.
fn replayed(arguments: &[&OsStr]) -> String {
    let mut replay = Command::new(PLUMBLINE);
    replay.arg("replay").args(arguments).arg("--config").arg(preset()).arg("--json");
    let report: Value = serde_json::from_str(&succeeds(replay)).unwrap();
    report["estimate_digest"].as_str().unwrap().to_owned()
}

/// Writes the first frames of a recording, with what comes before them, as `tests/c/fly_raw.c` reads them.
fn write_stream(recording: &Recording, frames: usize, to: &Path) {
    let mut readings = recording.readings.iter().peekable();
    let mut bytes = Vec::new();
    for frame in recording.frames.iter().take(frames) {
        // As far as any setup needs.
        let until = frame.stamp.plus_nanos(50_000_000);
        while let Some(reading) = readings.next_if(|reading| reading.sample.stamp <= until) {
            bytes.push(b'I');
            bytes.extend(reading.sample.stamp.as_nanos().to_le_bytes());
            let values = reading.sample.gyro.iter().chain(reading.sample.accel.iter());
            values.for_each(|value| bytes.extend(value.to_le_bytes()));
        }
        bytes.push(b'F');
        bytes.extend(frame.sequence.to_le_bytes());
        bytes.extend(frame.stamp.as_nanos().to_le_bytes());
        for (image, is_valid) in frame.images.iter().zip(frame.valid) {
            let sides = if is_valid { [image.width() as u32, image.height() as u32] } else { [0; 2] };
            sides.iter().for_each(|side| bytes.extend(side.to_le_bytes()));
            bytes.extend(if is_valid { image.pixels() } else { &[] });
        }
    }
    std::fs::write(to, bytes).unwrap();
}

#[test]
fn programs_in_c_compile_with_gcc_and_clang_without_a_warning() {
    let Some(installed) = Installed::new() else { return };
    let programs: [(&str, &[&str]); 5] = [
        ("examples/c/read_odometry.c", &[]),
        ("examples/c/fly_euroc.c", &["libpng"]),
        ("examples/c/replay_euroc.c", &["libpng"]),
        ("tests/c/misuse.c", &[]),
        ("tests/c/fly_raw.c", &[]),
    ];
    for (source, packages) in programs {
        for compiler in [GCC, CLANG] {
            installed.compile(compiler, source, packages, &[]);
        }
    }
}

#[test]
fn programs_in_cpp_compile_with_gcc_and_clang_without_a_warning() {
    let Some(installed) = Installed::new() else { return };
    // The example that replays is compiled by clang where its estimates are compared.
    installed.compile(CLANGXX, "examples/cpp/fly_camera.cpp", &["opencv4"], &[]);
    installed.compile(GXX, "examples/cpp/replay_euroc.cpp", &["opencv4"], &[]);
}

#[test]
fn misuse_is_an_error_value_as_the_guide_lists_it() {
    let Some(installed) = Installed::new() else { return };
    let program = installed.compile(GCC, "tests/c/misuse.c", &[], SANITIZERS);
    let mut command = installed.command(&program);
    let printed = succeeds_with(&mut command, [preset().as_os_str(), installed.folder.path().as_os_str()]);
    let guide = std::fs::read_to_string(workspace().join("docs/c-library.md")).unwrap();
    for line in printed.lines() {
        let (misuse, status) = line.trim_matches(['|', ' ']).split_once(" | ").unwrap();
        let row = guide.lines().find_map(|row| row.strip_prefix(&format!("| {status} | ")));
        let mut misuses = row.into_iter().flat_map(|row| row.trim_end_matches([' ', '|']).split("; "));
        assert!(misuses.any(|listed| listed == misuse), "docs/c-library.md has not, at {status}: {misuse}");
    }
    assert!(printed.lines().count() > 35);
}

fn succeeds_with<'a>(command: &mut Command, arguments: impl IntoIterator<Item = &'a OsStr>) -> String {
    let mut all = Command::new(command.get_program());
    all.args(command.get_args()).args(arguments);
    for (name, value) in command.get_envs() {
        match value {
            Some(value) => all.env(name, value),
            None => all.env_remove(name),
        };
    }
    succeeds(all)
}

#[test]
fn estimates_through_c_and_cpp_have_the_bits_of_replay() {
    let (Some(installed), Some(clip)) = (Installed::new(), shared("euroc/V1_01_easy_clip")) else { return };
    let expected = replayed(&[clip.as_os_str()]);
    let preset = preset();
    let arguments = [preset.as_os_str(), clip.as_os_str()];
    shown_in("docs/c-library.md", "examples/c/replay_euroc.c");
    let in_c = installed.compile(GCC, "examples/c/replay_euroc.c", &["libpng"], SANITIZERS);
    let printed = succeeds_with(&mut installed.command(&in_c), arguments);
    assert_eq!(digest(&printed), expected);
    assert!(printed.lines().count() > 60, "{printed}");
    let in_cpp = installed.compile(CLANGXX, "examples/cpp/replay_euroc.cpp", &["opencv4"], &[]);
    assert_eq!(digest(&succeeds_with(&mut installed.command(&in_cpp), arguments)), expected);
}

/// Asserts that the C code that a page shows stands in an example.
fn shown_in(page: &str, example: &str) {
    let page_text = std::fs::read_to_string(workspace().join(page)).unwrap();
    let text = std::fs::read_to_string(workspace().join(example)).unwrap();
    let blocks: Vec<&str> =
        page_text.split("\n```c\n").skip(1).filter_map(|rest| rest.split("```").next()).collect();
    assert!(!blocks.is_empty(), "{page} shows no C");
    assert!(blocks.iter().all(|block| text.contains(block)), "{page} shows another {example}");
}

#[test]
fn odometry_is_read_and_a_flight_reset_by_a_program_in_c() {
    const FLIGHT_S: u32 = 8;
    let Some(installed) = Installed::new() else { return };
    super::vehicle::render(FLIGHT_S);
    let program = installed.compile(GCC, "examples/c/read_odometry.c", &[], SANITIZERS);
    let socket = installed.path("local");
    let mut flight = Command::new(PLUMBLINE);
    flight.args(["replay", "sim:room", "--start", "2", "--scale", "0.5", "--no-lines", "--speed", "1"]);
    flight.args(["--duration", &FLIGHT_S.to_string(), "--cache"]).arg(super::vehicle::cache());
    flight.args(["--set", &format!("local.path=\"{}\"", socket.display())]);
    let mut flight = Running::start(flight);
    let printed = succeeds_with(&mut installed.command(&program), [socket.as_os_str(), OsStr::new("reset")]);
    assert!(flight.child.wait().unwrap().success(), "{}", flight.words());
    let last = printed.lines().rfind(|line| line.contains("tracking  quality")).unwrap();
    assert!(last.ends_with("resets 1"), "{last}");
    assert!(!printed.contains("lost"), "{printed}");
    assert!(printed.lines().any(|line| line.starts_with("health: ")), "{printed}");
}

/// The digest of a clip, flown by `tests/c/fly_raw.c`.
fn clip_has_the_bits_of_replay(clip: &str, frames: usize) {
    let (Some(installed), Some(path)) = (Installed::new(), shared(clip)) else { return };
    let program = installed.compile(GCC, "tests/c/fly_raw.c", &[], &[]);
    let stream = installed.path("stream");
    write_stream(&Recording::read(&path), frames, &stream);
    let printed = succeeds_with(&mut installed.command(&program), [preset().as_os_str(), stream.as_os_str()]);
    let range = format!("0..{frames}");
    assert_eq!(digest(&printed), replayed(&[path.as_os_str(), OsStr::new("--frames"), OsStr::new(&range)]));
}

/// Sensors come in real time: see `.config/nextest.toml`.
mod realtime {
    use super::*;

    /// A flight whose IMU is at the line `imu`, and whose frames come over the socket `frames`.
    fn flight(installed: &Installed) -> Running {
        let set = |key: &str, value: String| ["--set".to_owned(), format!("{key}=\"{value}\"")];
        let at = |name: &str| installed.path(name).display().to_string();
        let mut fly = Command::new(PLUMBLINE);
        fly.args(["fly", "--duration", "60", "--config"])
            .arg(preset())
            .arg("--report")
            .arg(at("report.json"));
        fly.args(set("driver.imu.connect", format!("serial://{}:921600", at("imu"))));
        fly.args(set("driver.frames.listen", at("frames"))).args(set("local.path", at("local")));
        Running::start(fly)
    }

    /// Ends a flight; its report.
    fn ended(installed: &Installed, mut flight: Running) -> Value {
        flight.interrupt();
        let report = std::fs::read_to_string(installed.path("report.json")).unwrap();
        let report: Value = serde_json::from_str(&report).unwrap();
        println!("{}{:#}", flight.words(), report["sensors"]);
        assert_eq!(report["hot_path_allocations"], 0);
        report
    }

    #[test]
    fn a_flight_takes_the_samples_and_frames_of_a_program_in_c() {
        let (Some(installed), Some(clip)) = (Installed::new(), shared("euroc/V1_01_easy_clip")) else {
            return;
        };
        let program = installed.compile(GCC, "examples/c/fly_euroc.c", &["libpng"], SANITIZERS);
        let flight = flight(&installed);
        let paths = ["imu", "frames"].map(|name| installed.path(name));
        let words = [clip.as_os_str(), paths[0].as_os_str(), paths[1].as_os_str()];
        assert!(succeeds_with(&mut installed.command(&program), words).contains("95 frames sent"));
        assert!(!installed.path("imu").is_symlink(), "the line is gone with its device");
        let report = ended(&installed, flight);
        assert_eq!(report["sensors"]["cameras"]["pairs"], 95);
        // The first second of samples finds the offset of the sensor's clock, the next frames gravity.
        assert!(report["sensors"]["imu"]["count"].as_u64().unwrap() >= 600);
        assert!(report["completion"].as_f64().unwrap() > 0.5, "{report:#}");
    }

    #[test]
    fn a_flight_takes_the_frames_that_opencv_reads() {
        let (Some(installed), Some(clip)) = (Installed::new(), shared("euroc/V1_01_easy_clip")) else {
            return;
        };
        for (camera, name) in ["left", "right"].into_iter().enumerate() {
            let folder = clip.join(format!("mav0/cam{camera}/data"));
            let mut images: Vec<_> = folder.read_dir().unwrap().map(|entry| entry.unwrap().path()).collect();
            images.sort();
            for (k, image) in images.iter().enumerate() {
                let link = installed.path(&format!("{name}_{k:03}.png"));
                std::os::unix::fs::symlink(image.canonicalize().unwrap(), link).unwrap();
            }
        }
        let program = installed.compile(GXX, "examples/cpp/fly_camera.cpp", &["opencv4"], &[]);
        let flight = flight(&installed);
        eventually("the flight listens", PATIENCE, || installed.path("frames").exists());
        let words =
            ["frames", "left_%03d.png", "right_%03d.png"].map(|name| installed.path(name).into_os_string());
        succeeds_with(&mut installed.command(&program), words.iter().map(|word| word.as_os_str()));
        assert!(ended(&installed, flight)["sensors"]["cameras"]["pairs"].as_u64().unwrap() >= 90);
    }
}

/// By another library, compiler and runner.
mod elsewhere {
    use super::*;

    #[test]
    #[ignore = "needs another build of the library: `make arm64`, `make capi-valgrind`"]
    fn estimates_through_c_have_the_bits_of_replay() {
        clip_has_the_bits_of_replay("euroc/V1_01_easy_clip", 40);
    }

    #[test]
    #[ignore = "needs another build of the library: `make arm64`, `make capi-valgrind`"]
    fn misuse_is_an_error_value() {
        let Some(installed) = Installed::new() else { return };
        let program = installed.compile(GCC, "tests/c/misuse.c", &[], &["-g"]);
        let paths = [preset(), installed.folder.path().to_owned()];
        let more = installed.compiler.is_some().then_some(OsStr::new("no-terminals"));
        let arguments = paths.iter().map(|path| path.as_os_str()).chain(more);
        succeeds_with(&mut installed.command(&program), arguments);
    }
}

/// Long: see `make soak`.
mod soak {
    use super::*;

    #[test]
    #[ignore = "takes minutes: `make soak`"]
    fn memory_stays_flat_over_ten_thousand_frames_through_c() {
        const FRAMES: usize = 40;
        const TIMES: usize = 250;
        let (Some(installed), Some(clip)) = (Installed::new(), shared("euroc/V1_01_easy_clip")) else {
            return;
        };
        let program = installed.compile(GCC, "tests/c/fly_raw.c", &[], &[]);
        let (stream, times) = (installed.path("stream"), TIMES.to_string());
        write_stream(&Recording::read(&clip), FRAMES, &stream);
        let arguments = [preset().into_os_string(), stream.into_os_string(), times.into()];
        let printed =
            succeeds_with(&mut installed.command(&program), arguments.iter().map(|word| word.as_os_str()));
        let kb: Vec<i64> = printed
            .lines()
            .filter_map(|line| line.strip_prefix("resident ")?.strip_suffix(" kB")?.parse().ok())
            .collect();
        println!(
            "resident after {FRAMES} frames {} kB, after {} frames {} kB",
            kb[0],
            FRAMES * kb.len(),
            kb[kb.len() - 1]
        );
        assert_eq!(kb.len(), TIMES);
        assert!(kb[TIMES - 1] - kb[1] <= 256, "{kb:?}");
    }
}

/// Counted by valgrind: see `make capi-valgrind`.
mod counted {
    use super::*;

    /// Instructions within a function and what it calls, for a program that flies the stream.
    fn instructions(installed: &Installed, program: &Path, stream: &Path, function: &str) -> u64 {
        let mut valgrind = Command::new("valgrind");
        valgrind.args(["--tool=callgrind", "--callgrind-out-file=/dev/null"]);
        valgrind.arg(format!("--toggle-collect={function}")).arg(program).arg(preset()).arg(stream);
        let output = crate::done(valgrind.env("LD_LIBRARY_PATH", installed.path("usr/lib")));
        let text = said(&output);
        let count = text.lines().find_map(|line| line.split_once("Collected : ")).expect("a count").1;
        count.trim().parse().unwrap()
    }

    #[test]
    #[ignore = "needs valgrind, and another build of the library: `make capi-valgrind`"]
    fn a_frame_through_c_costs_at_most_one_percent_more() {
        let (Some(installed), Some(clip)) = (Installed::new(), shared("euroc/V1_01_easy_clip")) else {
            return;
        };
        let library = std::env::var("PLUMBLINE_C_LIBRARY").expect("`make capi-valgrind` names the library");
        let program = installed.compile(GCC, "tests/c/fly_raw.c", &[], &[]);
        // With the names of its functions.
        std::fs::copy(workspace().join(library), installed.path("usr/lib/libplumbline.so.0")).unwrap();
        let stream = installed.path("stream");
        write_stream(&Recording::read(&clip), 20, &stream);
        let count = |function| instructions(&installed, &program, &stream, function);
        let through_c = count("plumbline_estimator_add_frame");
        let in_rust = count("*facade::Estimator::add_frame");
        let share = through_c as f64 / in_rust as f64 - 1.0;
        println!(
            "{through_c} instructions through C, {in_rust} of the estimator: {:.4} % more",
            100.0 * share
        );
        assert!(in_rust > 20 * 1_000_000 && (0.0..0.01).contains(&share));
    }
}
