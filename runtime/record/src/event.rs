//! Events of a flight: what people want to know, as text of fixed size, made without allocation.

use plumbline_config::Timestamp;
use serde::Serialize;
use std::fmt::{self, Write as _};

/// Longest text of an event, bytes.
pub const MAX_EVENT_BYTES: usize = 120;

/// Severity of an event.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// Good to know.
    Info,
    /// Something is less than it should be.
    Warning,
    /// Something failed.
    Error,
}

/// Something that people want to know.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Event {
    /// When it happened, in data time.
    pub stamp: Timestamp,
    /// Severity.
    pub severity: Severity,
    /// Description.
    pub text: heapless::String<MAX_EVENT_BYTES>,
    /// Cure of what failed, for who listens in this process.
    pub cure: &'static str,
}

impl Event {
    /// An event; a text that is too long is cut off.
    pub fn new(stamp: Timestamp, severity: Severity, text: fmt::Arguments<'_>) -> Self {
        let mut kept = CutOff(heapless::String::new());
        // Never fails: what has no room is cut off.
        let _ = kept.write_fmt(text);
        Self { stamp, severity, text: kept.0, cure: "" }
    }
}

struct CutOff(heapless::String<MAX_EVENT_BYTES>);

impl fmt::Write for CutOff {
    fn write_str(&mut self, text: &str) -> fmt::Result {
        for letter in text.chars() {
            if self.0.push(letter).is_err() {
                break;
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_long_text_is_cut_off_at_a_letter() {
        let event = Event::new(Timestamp::default(), Severity::Info, format_args!("a{}", "ö".repeat(100)));
        assert_eq!(event.text.len(), 119);
        assert!(event.text.starts_with("aö") && event.text.ends_with('ö'));
    }
}
