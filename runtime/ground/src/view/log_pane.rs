//! Lines of the log beside the view: while it has the terminal, they would tear it.

use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::Line;
use ratatui::widgets::{Block, Paragraph};
use std::collections::VecDeque;
use std::sync::{Mutex, MutexGuard, PoisonError};

/// Lines that are kept.
const MAX_LINES: usize = 200;
/// Characters of a line that are kept.
const MAX_CHARS: usize = 2_000;
/// Most rows of the pane, border included: a quarter of the terminal, but within these.
const ROWS: (u16, u16) = (4, 10);
/// Rows and columns of the border.
const BORDER: u16 = 2;
/// Columns by which what does not fit into a row is set in.
const INDENT: &str = "  ";

/// The newest lines of the log, bounded.
#[derive(Debug, Default)]
pub struct LogPane(Mutex<VecDeque<String>>);

impl LogPane {
    /// An empty pane.
    #[must_use]
    pub const fn new() -> Self {
        Self(Mutex::new(VecDeque::new()))
    }

    fn locked(&self) -> MutexGuard<'_, VecDeque<String>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Adds what was written for a terminal: colours and control characters are left out.
    pub fn push(&self, written: &[u8]) {
        let text = plain(&String::from_utf8_lossy(written));
        let mut lines = self.locked();
        for line in text.lines().filter(|line| !line.trim().is_empty()) {
            if lines.len() == MAX_LINES {
                lines.pop_front();
            }
            lines.push_back(line.chars().take(MAX_CHARS).collect());
        }
    }

    /// Takes all lines, oldest first.
    pub fn take(&self) -> Vec<String> {
        self.locked().drain(..).collect()
    }

    /// Rows that the pane takes of a terminal: as many as it has to show, up to a quarter; none without a line.
    #[must_use]
    pub fn rows(&self, terminal: Rect) -> u16 {
        let most = (terminal.height / 4).clamp(ROWS.0, ROWS.1);
        let width = usize::from(terminal.width.saturating_sub(BORDER));
        let lines = self.locked();
        // Each line has a row at least.
        let shown = lines.iter().rev().take(most.into());
        match shown.map(|line| wrapped(line, width).len()).sum() {
            0 => 0,
            rows => u16::try_from(rows).unwrap_or(most).saturating_add(BORDER).min(most),
        }
    }

    /// Draws the newest lines, as many as fit.
    pub fn draw(&self, frame: &mut Frame<'_>, area: Rect) {
        let block = Block::bordered().title(" log ");
        let inner = block.inner(area);
        let (width, height) = (usize::from(inner.width), usize::from(inner.height));
        let mut rows: Vec<Line<'static>> = Vec::new();
        for line in self.locked().iter().rev() {
            rows.extend(wrapped(line, width).into_iter().rev().map(|row| Line::styled(row, style(line))));
            if rows.len() >= height {
                break;
            }
        }
        rows.truncate(height);
        rows.reverse();
        frame.render_widget(Paragraph::new(rows).block(block), area);
    }
}

/// A line by its severity, which is its first word.
fn style(line: &str) -> Style {
    match line.split_whitespace().next() {
        Some("ERROR") => Style::new().fg(Color::Red),
        Some("WARN") => Style::new().fg(Color::Yellow),
        _ => Style::new().add_modifier(Modifier::DIM),
    }
}

/// Rows of at most `width` characters, broken between words where there are any.
fn wrapped(line: &str, width: usize) -> Vec<String> {
    let (mut rows, mut row) = (Vec::new(), String::new());
    if width <= INDENT.len() {
        return rows;
    }
    for word in line.split_whitespace() {
        let mut rest: Vec<char> = word.chars().collect();
        if !row.trim().is_empty() && row.chars().count() + 1 + rest.len() > width {
            rows.push(std::mem::replace(&mut row, INDENT.to_owned()));
        } else if !row.trim().is_empty() {
            row.push(' ');
        }
        // A word that is longer than a row.
        while row.chars().count() + rest.len() > width {
            let tail = rest.split_off(width - row.chars().count());
            row.extend(rest);
            rows.push(std::mem::replace(&mut row, INDENT.to_owned()));
            rest = tail;
        }
        row.extend(rest);
    }
    rows.push(row);
    rows
}

/// Text without control sequences (ECMA-48: `ESC [`, parameters, a final character) and control characters.
fn plain(text: &str) -> String {
    let (mut out, mut chars) = (String::new(), text.chars());
    while let Some(c) = chars.next() {
        match c {
            '\u{1b}' => skip_sequence(&mut chars),
            '\n' => out.push('\n'),
            '\t' => out.push(' '),
            c if !c.is_control() => out.push(c),
            _ => {}
        }
    }
    out
}

/// Takes what follows the escape of a control sequence.
fn skip_sequence(chars: &mut std::str::Chars<'_>) {
    if chars.next() == Some('[') {
        chars.find(|c| ('@'..='~').contains(c));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_and_control_characters_are_left_out() {
        let pane = LogPane::default();
        pane.push(b"\x1b[33m WARN\x1b[0m nobody\x07 listens\x1b[2Jthere\n\nsecond\r\n");
        assert_eq!(pane.take(), [" WARN nobody listensthere", "second"]);
    }

    #[test]
    fn long_lines_are_wrapped_and_no_character_is_lost() {
        assert_eq!(wrapped("WARN one two three", 9), ["WARN one", "  two", "  three"]);
        assert_eq!(wrapped("abcdefghij", 4), ["abcd", "  ef", "  gh", "  ij"]);
        assert_eq!(wrapped("anything", 2), [""; 0]);
    }

    #[test]
    fn lines_are_bounded_and_the_newest_stay() {
        let pane = LogPane::default();
        (0..2 * MAX_LINES).for_each(|k| pane.push(format!("line {k}\n").as_bytes()));
        let lines = pane.take();
        assert_eq!((lines.len(), lines[0].as_str()), (MAX_LINES, "line 200"));
        let terminal = Rect::new(0, 0, 80, 40);
        assert_eq!(pane.rows(terminal), 0, "without lines there is no pane");
        pane.push(b"one");
        assert_eq!(pane.rows(terminal), 3);
        (0..20).for_each(|_| pane.push(b"more"));
        assert_eq!(pane.rows(terminal), 10);
    }
}
