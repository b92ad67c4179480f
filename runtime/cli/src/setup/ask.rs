//! Questions on a terminal; elsewhere the option that answers them is required.

use super::super::Usage;
use anyhow::{Context, Result, bail};
use std::io::{BufRead as _, IsTerminal as _, Write as _};

/// Answers that are not understood before the command gives up.
const ATTEMPTS: usize = 3;
/// Longest answer, bytes.
const MAX_ANSWER_BYTES: u64 = 4096;

/// Asks until the answer is understood by `parse`.
///
/// # Errors
/// When stdin is no terminal: the error names `option`. When the terminal is closed, or no answer is understood.
pub fn ask<T>(option: &str, question: &str, parse: impl Fn(&str) -> Result<T, String>) -> Result<T> {
    if !std::io::stdin().is_terminal() {
        let question = question.replace('\n', " ");
        return Err(Usage(format!("{option}: is required without a terminal. {question}")).into());
    }
    for _ in 0..ATTEMPTS {
        let mut answer = String::new();
        eprint!("{question}: ");
        let _ = std::io::stderr().flush();
        let mut stdin = std::io::Read::take(std::io::stdin().lock(), MAX_ANSWER_BYTES);
        let length = stdin.read_line(&mut answer).context("the terminal cannot be read")?;
        if length == 0 {
            break;
        }
        match parse(answer.trim()) {
            Ok(value) => return Ok(value),
            Err(why) => eprintln!("{why}"),
        }
    }
    bail!("{option}: no usable answer; give the option instead")
}
