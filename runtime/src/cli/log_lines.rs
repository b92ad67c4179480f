//! Lines of the log on their way to stderr: written by a thread of their own, so that a terminal or a journal that stands still
//! holds up nobody. What finds no room is counted, and told when there is room again.

use crossbeam_queue::ArrayQueue;
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
struct Queue {
    lines: ArrayQueue<Vec<u8>>,
    offered: AtomicU64,
    lost: AtomicU64,
    written: AtomicU64,
    writer: OnceLock<Thread>,
}

static QUEUE: OnceLock<Queue> = OnceLock::new();

fn queue() -> &'static Queue {
    QUEUE.get_or_init(|| Queue {
        lines: ArrayQueue::new(LINES),
        offered: AtomicU64::new(0),
        lost: AtomicU64::new(0),
        written: AtomicU64::new(0),
        writer: OnceLock::new(),
    })
}

/// Makes the lines of the log; [`start`] has them written.
#[derive(Clone, Copy, Debug, Default)]
pub struct LogLines;

/// Starts the thread that writes. Without one, which the system may refuse, lines are lost and nothing else.
pub fn start() {
    let spawned = std::thread::Builder::new().name("log-lines".into()).spawn(write_all);
    if let Ok(thread) = spawned {
        let _ = queue().writer.set(thread.thread().clone());
    }
}

/// Waits until what was said so far is written, but not for long.
pub fn flush() {
    let (queue, end) = (queue(), Instant::now() + PATIENCE);
    if queue.writer.get().is_none() {
        return;
    }
    while queue.written.load(Ordering::Acquire) < queue.offered.load(Ordering::Acquire)
        && Instant::now() < end
    {
        std::thread::sleep(Duration::from_millis(1));
    }
}

fn write_all() {
    let queue = queue();
    let mut told = 0;
    loop {
        while let Some(line) = queue.lines.pop() {
            let lost = queue.lost.load(Ordering::Relaxed);
            let mut stderr = io::stderr().lock();
            if lost > told {
                let _ = writeln!(stderr, "({} lines of the log are missing here)", lost - told);
                told = lost;
            }
            let _ = stderr.write_all(&line);
            queue.written.fetch_add(1, Ordering::Release);
        }
        std::thread::park();
    }
}

impl<'a> MakeWriter<'a> for LogLines {
    type Writer = Line;

    fn make_writer(&'a self) -> Line {
        Line(Vec::new())
    }
}

/// A line in the making, handed over when it goes.
#[derive(Debug)]
pub struct Line(Vec<u8>);

impl Write for Line {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.0.extend_from_slice(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Drop for Line {
    fn drop(&mut self) {
        let (queue, line) = (queue(), std::mem::take(&mut self.0));
        if line.is_empty() {
            return;
        }
        match queue.lines.push(line) {
            Ok(()) => queue.offered.fetch_add(1, Ordering::Release),
            Err(_) => queue.lost.fetch_add(1, Ordering::Relaxed),
        };
        if let Some(writer) = queue.writer.get() {
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_anybody_to_write_them_lines_are_counted_and_nobody_waits() {
        let begun = Instant::now();
        (0..3 * LINES).for_each(|k| drop(writeln!(LogLines.make_writer(), "line {k}")));
        assert!(begun.elapsed() < Duration::from_secs(5));
        assert!(queue().lost.load(Ordering::Relaxed) >= 2 * LINES as u64);
        flush();
    }
}
