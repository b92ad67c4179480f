//! Output on stdout and stderr that no reader can hold up.

use std::fmt::Display;
use std::io::Write as _;
use std::time::Duration;

/// Writes a line to stdout. A reader that has gone, as `head` does, ends the process: nobody listens, which is no failure.
pub fn say(line: impl Display) {
    say_unless_closed(false, line);
}

/// Writes a line to stdout. A closed pipe ends the process, as in [`say`], unless it `goes_on`: there are files to write.
pub fn say_unless_closed(goes_on: bool, line: impl Display) {
    match writeln!(std::io::stdout(), "{line}") {
        Err(error) if goes_on && error.kind() == std::io::ErrorKind::BrokenPipe => {}
        Err(error) => std::process::exit(i32::from(error.kind() != std::io::ErrorKind::BrokenPipe)),
        Ok(()) => {}
    }
}

/// Writes a line to stdout, waiting at most `patience` for a stalled terminal or a reader that does not read.
pub fn say_within(patience: Duration, line: String) {
    within(patience, move || say(line));
}

/// Waits for `speak`, but not for longer than `patience`: the process ends, whoever reads it.
pub fn within(patience: Duration, speak: impl FnOnce() + Send + 'static) {
    let (tell, told) = std::sync::mpsc::channel();
    let speak = move || {
        speak();
        let _ = tell.send(());
    };
    if std::thread::Builder::new().name("last-words".into()).spawn(speak).is_ok() {
        let _ = told.recv_timeout(patience);
    }
}

/// The error and its causes on one line.
pub fn one_line(error: &anyhow::Error) -> String {
    let mut line = String::new();
    for cause in error.chain().map(ToString::to_string) {
        // A cause that its context already quotes says nothing new.
        if !line.contains(&cause) {
            if !line.is_empty() {
                line.push_str(": ");
            }
            line.push_str(&cause);
        }
    }
    line.split('\n').map(str::trim).filter(|part| !part.is_empty()).collect::<Vec<_>>().join("; ")
}
