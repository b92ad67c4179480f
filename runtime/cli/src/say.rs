//! Output on stdout and stderr that no reader can hold up.

use plumbline_link::net::plain;
use std::fmt::Display;
use std::io::Write as _;
use std::time::Duration;

/// Writes lines to stdout, without what controls a terminal. A reader that has gone, as `head` does, ends the process: nobody
/// listens, which is no failure.
pub fn say(lines: impl Display) {
    if let Err(error) = writeln!(std::io::stdout(), "{}", plain_lines(&lines.to_string())) {
        std::process::exit(i32::from(error.kind() != std::io::ErrorKind::BrokenPipe));
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

/// Lines as a terminal may show them, whoever wrote what they quote.
fn plain_lines(lines: &str) -> String {
    lines.split_inclusive(['\n', '\t']).fold(String::with_capacity(lines.len()), |mut text, part| {
        let content = part.trim_end_matches(['\n', '\t']);
        text.push_str(&plain(content));
        text.push_str(&part[content.len()..]);
        text
    })
}

/// The error and its causes on one line.
pub fn one_line(error: &anyhow::Error) -> String {
    let text = with_causes(error);
    text.split('\n').map(str::trim).filter(|part| !part.is_empty()).collect::<Vec<_>>().join("; ")
}

/// As [`one_line`], but each of several refused keys has a line of its own.
pub fn last_words(error: &anyhow::Error) -> String {
    let text = with_causes(error);
    plain_lines(&if text.contains("\n  `") { text } else { one_line(error) })
}

fn with_causes(error: &anyhow::Error) -> String {
    let mut line = String::new();
    for cause in error.chain().map(ToString::to_string) {
        // A cause that begins with its context says all of it.
        if cause.starts_with(&line) {
            line = cause;
        // A cause that its context already quotes says nothing new.
        } else if !line.contains(&cause) {
            if !line.is_empty() {
                line.push_str(": ");
            }
            line.push_str(&cause);
        }
    }
    line
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::Config;

    #[test]
    fn what_others_wrote_controls_no_terminal() {
        assert_eq!(plain_lines("a\tb\n\u{1b}]0;c\u{7}\u{202e}\n"), "a\tb\n?]0;c??\n");
        let refused = Config::from_toml_str("\"\\u001b[2J\" = 1\n", "\u{1b}.toml").unwrap_err();
        assert!(!last_words(&refused.into()).contains('\u{1b}'));
    }

    #[test]
    fn several_refused_keys_have_a_line_each_and_all_else_one() {
        let refused = |text: &str| anyhow::Error::from(Config::from_toml_str(text, "a.toml").unwrap_err());
        let several =
            refused("base = \"sim\"\n[imu]\nrate_hz = 5000.0\ngravity_m_s2 = 9.95\n").context("a.toml");
        let words = last_words(&several);
        let lines: Vec<&str> = words.lines().collect();
        assert_eq!((lines.len(), lines[0]), (3, "a.toml: 2 keys refused"), "{words}");
        assert!(
            lines[1].starts_with("  `imu.rate_hz` (line 3): ")
                && lines[2].starts_with("  `imu.gravity_m_s2` (line 4): "),
            "{words}"
        );
        assert_eq!(one_line(&several).lines().count(), 1);
        let one = refused("base = \"sim\"\n[imu]\nrate = 1\n").context("fly");
        assert_eq!(last_words(&one), one_line(&one));
        assert!(last_words(&one).starts_with("fly: a.toml: `imu.rate` (line 3): "), "{one:?}");
        assert_eq!(last_words(&anyhow::anyhow!("first\n  second")), "first; second");
    }
}
