//! Python programs beside a real vehicle. The packages are those of `scripts/requirements.txt`.

use plumbline_test_support::{Need, skip};
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};

/// A vehicle that flies at real time and publishes; its `--duration` is to be added.
pub const FLIGHT: [&str; 6] = ["replay", "sim:room", "--start=2", "--scale=0.5", "--speed=1", "--publish"];

/// The interpreter, where it can import `packages`; else the test is to skip itself.
pub fn interpreter(packages: &str) -> Option<PathBuf> {
    let python = plumbline_test_support::python();
    let import = format!("import {packages}");
    let imported = Command::new(&python).args(["-c", &import]).stderr(Stdio::null()).status();
    let has_all = imported.is_ok_and(|status| status.success());
    if !has_all {
        skip(Need::Python, format_args!("{} lacks some of: {packages}", python.display()));
    }
    has_all.then_some(python)
}

/// A place to listen on that was free a moment ago.
pub fn free_endpoint() -> String {
    format!("tcp/127.0.0.1:{}", super::vehicle::free_port())
}

/// A running program; it is killed when the test ends before it.
pub struct Program {
    child: Child,
    stdout: BufReader<ChildStdout>,
}

impl Program {
    pub fn start(python: &Path, script: &str, arguments: &[&str]) -> Self {
        let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").join(script);
        let mut child =
            Command::new(python).arg(script).args(arguments).stdout(Stdio::piped()).spawn().unwrap();
        let stdout = BufReader::new(child.stdout.take().unwrap());
        Self { child, stdout }
    }

    /// Next line; an empty one when it has ended.
    pub fn line(&mut self) -> String {
        let mut line = String::new();
        self.stdout.read_line(&mut line).unwrap();
        line.trim_end().to_owned()
    }

    /// All that it still prints; it must succeed.
    pub fn rest(mut self) -> String {
        let mut text = String::new();
        self.stdout.read_to_string(&mut text).unwrap();
        let status = self.child.wait().unwrap();
        assert!(status.success(), "{status}: {text}");
        text
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// Writes the preset `sim` with other values of some keys: `key = value` lines, which must exist.
pub fn configuration(file: &Path, changes: &[(&str, String)]) {
    let preset = super::plumbline(&["config", "sim"]).stdout;
    let mut text = String::from_utf8(preset).unwrap();
    for (key, value) in changes {
        let (table, key) = key.split_once('.').unwrap();
        let start = text.find(&format!("\n[{table}]\n")).unwrap();
        let at = start + text[start..].find(&format!("\n{key} = ")).unwrap() + 1;
        let end = at + text[at..].find('\n').unwrap();
        text.replace_range(at..end, &format!("{key} = {value}"));
    }
    std::fs::write(file, text).unwrap();
}
