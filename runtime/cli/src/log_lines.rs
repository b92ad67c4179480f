//! Lines of the log on their way to stderr: written by a thread of their own, so that a terminal or a journal that stands still
//! holds up nobody. What finds no room is counted, and told when there is room again.

use parking_lot::Mutex;
use plumbline_flight::schedule::queue::Queue;
use std::io::{self, Write};
use std::sync::OnceLock;
use std::sync::atomic::{AtomicU64, Ordering};
use std::thread::Thread;
use std::time::{Duration, Instant};
use tracing_subscriber::fmt::MakeWriter;

/// Lines that wait, at most.
const LINES: usize = 512;
/// The end of the process waits so long for its last lines.
const PATIENCE: Duration = Duration::from_millis(300);

/// Lines that wait, and those who were counted.
struct Waiting {
    lines: Queue<Vec<u8>>,
    offered: AtomicU64,
    lost: AtomicU64,
    written: AtomicU64,
    writer: OnceLock<Thread>,
}

static WAITING: OnceLock<Waiting> = OnceLock::new();

fn waiting() -> &'static Waiting {
    WAITING.get_or_init(|| Waiting {
        lines: Queue::new(LINES),
        offered: AtomicU64::new(0),
        lost: AtomicU64::new(0),
        written: AtomicU64::new(0),
        writer: OnceLock::new(),
    })
}

/// Takes lines in the place of stderr.
type Reader = Box<dyn Fn(&[u8]) + Send>;

static READER: Mutex<Option<Reader>> = Mutex::new(None);

/// Redirection of the lines to a reader; dropping it sends them to stderr again.
#[derive(Debug)]
pub struct Redirected(());

/// Hands lines over to `reader` where stderr is a terminal, which something else draws on meanwhile. A file or a pipe goes
/// on taking them.
pub fn redirect(lines_to: impl Fn(&[u8]) + Send + 'static) -> Redirected {
    if io::IsTerminal::is_terminal(&io::stderr()) {
        flush();
        *READER.lock() = Some(Box::new(lines_to));
    }
    Redirected(())
}

impl Drop for Redirected {
    fn drop(&mut self) {
        flush();
        *READER.lock() = None;
    }
}

/// Makes the lines of the log; [`start`] has them written.
#[derive(Clone, Copy, Debug, Default)]
pub struct LogLines;

/// Starts the thread that writes. Without one, which the system may refuse, lines are lost and nothing else.
pub fn start() {
    let spawned = std::thread::Builder::new().name("log-lines".into()).spawn(write_all);
    if let Ok(thread) = spawned {
        let _ = waiting().writer.set(thread.thread().clone());
    }
}

/// Waits until what was said so far is written, but not for long.
pub fn flush() {
    let (waiting, end) = (waiting(), Instant::now() + PATIENCE);
    if waiting.writer.get().is_none() {
        return;
    }
    while waiting.written.load(Ordering::Acquire) < waiting.offered.load(Ordering::Acquire)
        && Instant::now() < end
    {
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn write_all() {
    let waiting = waiting();
    let mut told = 0;
    loop {
        while let Some(line) = waiting.lines.pop() {
            let lost = waiting.lost.load(Ordering::Relaxed);
            if lost > told {
                write(format!("({} lines of the log are missing here)\n", lost - told).as_bytes());
                told = lost;
            }
            write(&line);
            waiting.written.fetch_add(1, Ordering::Release);
        }
        std::thread::park();
    }
}

/// Writes a line to stderr, or to the reader in its place.
fn write(line: &[u8]) {
    if let Some(reader) = &*READER.lock() {
        return reader(line);
    }
    // Without the lock: a terminal may stand still.
    let _ = io::stderr().write_all(line);
}

impl<'a> MakeWriter<'a> for LogLines {
    type Writer = LogLine;

    fn make_writer(&'a self) -> LogLine {
        LogLine(Vec::new())
    }
}

/// A line in the making, handed over when it goes.
#[derive(Debug)]
pub struct LogLine(Vec<u8>);

impl Write for LogLine {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Drop for LogLine {
    fn drop(&mut self) {
        let (waiting, line) = (waiting(), std::mem::take(&mut self.0));
        if line.is_empty() {
            return;
        }
        match waiting.lines.push(line) {
            Ok(()) => waiting.offered.fetch_add(1, Ordering::Release),
            Err(_) => waiting.lost.fetch_add(1, Ordering::Relaxed),
        };
        if let Some(writer) = waiting.writer.get() {
            writer.unpark();
        }
    }
}

/// A panic is a line of the log too: what prints it must not wait for a terminal.
pub fn take_panics() {
    std::panic::set_hook(Box::new(|info| {
        let thread = std::thread::current();
        let name = thread.name().unwrap_or("without a name");
        let words = info.to_string();
        tracing::error!("thread '{name}' {}", words.replace('\n', " "));
        if name == "main" {
            flush();
        }
    }));
}

/// Ends the process with this status after the line of a panic, on whatever thread it was: what a library leaves behind there
/// cannot be trusted, and whoever started the process starts it again.
pub fn end_on_panic(status: u8) {
    let say = std::panic::take_hook();
    std::panic::set_hook(Box::new(move |info| {
        // What draws on the terminal ends with the process: its line is for stderr.
        if let Some(mut reader) = READER.try_lock() {
            reader.take();
        }
        say(info);
        flush();
        std::process::exit(status.into());
    }));
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_panic_on_any_thread_ends_the_process() {
        const ENDS: &str = "PLUMBLINE_TEST_ENDS_ON_PANIC";
        if std::env::var_os(ENDS).is_some() {
            end_on_panic(3);
            let _ = std::thread::spawn(|| panic!("as a library does")).join();
            // The process that goes on would pass.
            return;
        }
        let mut itself = std::process::Command::new(std::env::current_exe().unwrap());
        itself.args(["--exact", "log_lines::tests::a_panic_on_any_thread_ends_the_process"]).env(ENDS, "1");
        assert_eq!(itself.output().unwrap().status.code(), Some(3));
    }

    #[test]
    fn without_anybody_to_write_them_lines_are_counted_and_nobody_waits() {
        let begun = Instant::now();
        (0..3 * LINES).for_each(|k| drop(writeln!(LogLines.make_writer(), "line {k}")));
        assert!(begun.elapsed() < Duration::from_secs(5));
        assert!(waiting().lost.load(Ordering::Relaxed) >= 2 * LINES as u64);
        flush();
    }
}
