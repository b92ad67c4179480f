//! A test that lacks what it needs says so, and never passes in silence.
//!
//! It prints one line, `skipped: WHAT, because WHY`, and adds it to the file that `PLUMBLINE_SKIPPED` names, which
//! `make test` prints at its end. On a build server (`CI` is set) the test fails, unless its need is on the list
//! `tests/allowed-skips.txt`, each with its reason, or in `PLUMBLINE_ALLOW_SKIP`, separated by commas.

use std::fmt::{self, Display};
use std::io::Write as _;

macro_rules! needs {
    ($($(#[$doc:meta])* $need:ident = $name:literal,)*) => {
        /// Requirements of a test that a host may not meet.
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum Need {
            $($(#[$doc])* $need,)*
        }

        impl Need {
            /// All of them.
            pub const ALL: &[Self] = &[$(Self::$need),*];

            /// Name on the list of allowed skips.
            #[must_use]
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$need => $name,)*
                }
            }
        }
    };
}

needs! {
    /// The folder of shared data: clips of EuRoC, trajectories, York Urban.
    SharedData = "shared-data",
    /// Python with the packages of `scripts/requirements.txt`.
    Python = "python",
    /// Chromium and its driver.
    Chromium = "chromium",
    /// Node.js.
    Node = "node",
    /// A control group with a quota of processor time.
    CgroupQuota = "cgroup-quota",
    /// A control group that can be frozen.
    CgroupFreezer = "cgroup-freezer",
    /// The unified hierarchy of control groups (version 2).
    CgroupV2 = "cgroup-v2",
    /// Network namespaces: root and iproute2.
    NetworkNamespaces = "network-namespaces",
    /// The processor family that digests are promised for.
    ReferenceProcessor = "reference-processor",
    /// qemu, and Debian's kernel for it (`scripts/vm setup`).
    VirtualMachine = "virtual-machine",
    /// qemu for programs of other processors (`qemu-user-static`).
    UserEmulation = "user-emulation",
    /// systemd, and root to boot it in namespaces.
    Systemd = "systemd",
    /// Root to mount file systems.
    Mounts = "mounts",
    /// Real-time priorities, by root or a limit.
    RealtimePriority = "realtime-priority",
    /// Root, to start a process as another user.
    OtherUser = "other-user",
    /// A compiler for C (`cc`).
    Compiler = "compiler",
    /// A compiler for microcontrollers (`gcc-arm-none-eabi` with newlib).
    ArmCompiler = "arm-compiler",
    /// Fast DDS 2 (`libfastrtps-dev` of Debian 12 and Ubuntu 22.04) and a compiler for C++.
    FastDds = "fast-dds",
}

impl Display for Need {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

/// The list of allowed skips of this repository.
const ALLOWED: &str = include_str!("../../allowed-skips.txt");

/// Says that the test on this thread is skipped for want of `need`; the test is to return then.
///
/// # Panics
/// On a build server, unless the skip is allowed.
pub fn skip(need: Need, because: impl Display) {
    let test = std::thread::current().name().unwrap_or("a test").to_owned();
    let line = format!("skipped: {test} (needs {need}), because {because}");
    println!("{line}");
    if let Some(file) = std::env::var_os("PLUMBLINE_SKIPPED") {
        // One write a line: tests append to it at the same time.
        let appended = std::fs::OpenOptions::new().append(true).create(true).open(&file);
        let written = appended.and_then(|mut file| file.write_all(format!("{line}\n").as_bytes()));
        written.unwrap_or_else(|error| panic!("{}: {error}", file.display()));
    }
    let variable = |name| std::env::var(name).unwrap_or_default();
    if let Err(refusal) = verdict(need, &variable("CI"), &variable("PLUMBLINE_ALLOW_SKIP"), ALLOWED) {
        panic!("{line}; {refusal}");
    }
}

/// Checks that a skip for want of `need` may pass: `ci` and `named` as the variables say, `list` as the file.
fn verdict(need: Need, ci: &str, named: &str, list: &str) -> Result<(), String> {
    let is_build_server = !matches!(ci, "" | "0" | "false");
    let is_named = named.split(',').any(|name| name.trim() == need.name());
    if !is_build_server || is_named || allowed(list).any(|(name, _)| name == need.name()) {
        return Ok(());
    }
    Err(format!(
        "on a build server nothing is skipped in silence: provide it, or list '{need}: REASON' in \
         tests/allowed-skips.txt, or name it in PLUMBLINE_ALLOW_SKIP"
    ))
}

/// Names and reasons of a list: `NAME: REASON` a line, `#` begins a comment.
fn allowed(list: &str) -> impl Iterator<Item = (&str, &str)> {
    let lines = list.lines().map(str::trim).filter(|line| !line.is_empty() && !line.starts_with('#'));
    lines.map(|line| line.split_once(':').map_or((line, ""), |(name, reason)| (name.trim(), reason.trim())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_skip_that_is_listed_or_named_passes_on_a_build_server() {
        assert_eq!(verdict(Need::Python, "true", "", "# why\n\npython: no registry here\n"), Ok(()));
        assert_eq!(verdict(Need::Python, "true", "node, python", ""), Ok(()));
        assert!(verdict(Need::Python, "true", "", "# python: a comment").is_err());
    }

    #[test]
    fn the_list_of_this_repository_names_needs_and_reasons() {
        for (name, reason) in allowed(ALLOWED) {
            assert!(Need::ALL.iter().any(|need| need.name() == name), "'{name}' is no need that tests have");
            assert!(reason.split_whitespace().count() >= 3, "'{name}' is listed without a reason");
        }
    }

    /// The process that [`a_skip_prints_its_line_and_adds_it_to_the_file`] looks at.
    #[test]
    #[ignore = "a process of another test"]
    fn skips_itself() {
        skip(Need::Node, "this test was told to");
    }

    #[test]
    fn a_skip_prints_its_line_and_adds_it_to_the_file() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("skipped.txt");
        let run = |ci: &str, allow: &str| {
            let mut command = std::process::Command::new(std::env::current_exe().unwrap());
            command.args(["--exact", "skip::tests::skips_itself", "--ignored", "--nocapture"]);
            command.env("CI", ci).env("PLUMBLINE_ALLOW_SKIP", allow).env("PLUMBLINE_SKIPPED", &file);
            let output = command.output().unwrap();
            (output.status.success(), String::from_utf8_lossy(&output.stdout).into_owned())
        };
        let line = "skipped: skip::tests::skips_itself (needs node), because this test was told to";
        let (passed, text) = run("", "");
        assert!(passed && text.contains(line), "{text}");
        assert!(run("true", "node").0);
        assert!(!run("true", "").0, "a skip that nobody allowed passes on a build server");
        let kept = std::fs::read_to_string(&file).unwrap();
        assert_eq!(kept, format!("{line}\n").repeat(3));
    }
}
