//! Records that wait for one reader: bounded in bytes; a slow reader loses the oldest whole ones, and is told how many.

use super::record::{Kind, encoded};
use std::collections::VecDeque;
use std::io::{self, ErrorKind, Write};
use std::sync::Arc;

/// Answers and greetings that wait, bytes: beyond this no further request of the reader is read.
const MAX_KEPT_BYTES: usize = 64 * 1024;

#[derive(Debug)]
struct Waiting {
    record: Arc<[u8]>,
    /// Never dropped: greeting, answer, configuration, end.
    is_kept: bool,
}

/// Records that wait for one reader.
#[derive(Debug)]
pub struct Outbox {
    waiting: VecDeque<Waiting>,
    max_bytes: usize,
    bytes: usize,
    kept_bytes: usize,
    /// Bytes of the first that were written.
    written: usize,
    /// Bytes that the reader's socket took in all.
    taken: u64,
    lost: u64,
    lost_told: u64,
}

impl Outbox {
    /// Empty, for at most `max_bytes` beside what is never dropped.
    pub fn new(max_bytes: usize) -> Self {
        Self {
            waiting: VecDeque::new(),
            max_bytes,
            bytes: 0,
            kept_bytes: 0,
            written: 0,
            taken: 0,
            lost: 0,
            lost_told: 0,
        }
    }

    /// Sets the bound from the next record on.
    pub fn bound(&mut self, max_bytes: usize) {
        self.max_bytes = max_bytes;
    }

    /// Adds a record; the oldest ones make room for it.
    pub fn push(&mut self, record: &Arc<[u8]>) {
        self.bytes += record.len();
        self.waiting.push_back(Waiting { record: Arc::clone(record), is_kept: false });
        while self.bytes > self.max_bytes {
            // One whose beginning is on its way has to be sent whole.
            let first = usize::from(self.written > 0);
            let oldest = self.waiting.iter().enumerate().skip(first).find(|(_, waiting)| !waiting.is_kept);
            let Some((oldest, _)) = oldest else { return };
            if let Some(dropped) = self.waiting.remove(oldest) {
                self.bytes -= dropped.record.len();
                self.lost += 1;
            }
        }
    }

    /// Adds a record that is never dropped.
    pub fn push_kept(&mut self, record: impl Into<Arc<[u8]>>) {
        let record = record.into();
        self.kept_bytes += record.len();
        self.waiting.push_back(Waiting { record, is_kept: true });
    }

    /// True if the reader leaves its answers unread: it gets no more of them.
    pub fn is_unread(&self) -> bool {
        self.kept_bytes > MAX_KEPT_BYTES
    }

    /// Bytes that the reader's socket took in all.
    pub fn taken(&self) -> u64 {
        self.taken
    }

    /// True if nothing waits.
    pub fn is_empty(&self) -> bool {
        self.waiting.is_empty()
    }

    /// Writes what the reader takes; `upstream` records were lost before they came here. Returns whether everything was
    /// taken.
    ///
    /// # Errors
    /// When the reader has gone.
    pub fn flush(&mut self, to: &mut impl Write, upstream: u64) -> io::Result<bool> {
        while !self.waiting.is_empty() {
            self.tell_losses(upstream);
            let Some(first) = self.waiting.front() else { break };
            match to.write(&first.record[self.written..]) {
                Ok(0) => return Err(ErrorKind::WriteZero.into()),
                Ok(count) => {
                    self.written += count;
                    self.taken += count as u64;
                }
                Err(error) if error.kind() == ErrorKind::WouldBlock => return Ok(false),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(error),
            }
            if self.written == first.record.len() {
                self.written = 0;
                let length = first.record.len();
                *(if first.is_kept { &mut self.kept_bytes } else { &mut self.bytes }) -= length;
                self.waiting.pop_front();
            }
        }
        Ok(true)
    }

    /// Puts the count of losses before the next whole record, where it has grown.
    fn tell_losses(&mut self, upstream: u64) {
        let lost = self.lost + upstream;
        if self.written > 0 || lost == self.lost_told {
            return;
        }
        self.lost_told = lost;
        let record = encoded(Kind::Lost.kind(), lost, |to| to.extend(lost.to_le_bytes()));
        self.kept_bytes += record.len();
        self.waiting.push_front(Waiting { record: record.into(), is_kept: true });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn record(k: u8) -> Arc<[u8]> {
        vec![k; 10].into()
    }

    /// Takes so many bytes, then none.
    struct Narrow(usize, Vec<u8>);

    impl Write for Narrow {
        fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
            let count = bytes.len().min(self.0);
            if count == 0 {
                return Err(ErrorKind::WouldBlock.into());
            }
            self.0 -= count;
            self.1.extend(&bytes[..count]);
            Ok(count)
        }

        fn flush(&mut self) -> io::Result<()> {
            Ok(())
        }
    }

    #[test]
    fn a_slow_reader_loses_whole_records_and_is_told_how_many() {
        let mut outbox = Outbox::new(30);
        let mut narrow = Narrow(4, Vec::new());
        outbox.push(&record(0));
        assert!(!outbox.flush(&mut narrow, 0).unwrap());
        (1..6).for_each(|k| outbox.push(&record(k)));
        outbox.push_kept(&b"kept"[..]);
        narrow.0 = usize::MAX;
        assert!(outbox.flush(&mut narrow, 0).unwrap());
        let lost = encoded(Kind::Lost.kind(), 3, |to| to.extend(3u64.to_le_bytes()));
        let expected = [&[0; 10][..], &lost, &[4; 10], &[5; 10], b"kept"].concat();
        assert_eq!(narrow.1, expected);
        assert!(outbox.is_empty() && outbox.bytes == 0 && outbox.kept_bytes == 0);
    }

    #[test]
    fn losses_before_the_socket_are_told_too() {
        let mut outbox = Outbox::new(30);
        let mut all = Narrow(usize::MAX, Vec::new());
        outbox.push(&record(1));
        assert!(outbox.flush(&mut all, 2).unwrap());
        outbox.push(&record(2));
        assert!(outbox.flush(&mut all, 2).unwrap());
        let lost = encoded(Kind::Lost.kind(), 2, |to| to.extend(2u64.to_le_bytes()));
        assert_eq!(all.1, [&lost[..], &[1; 10], &[2; 10]].concat());
    }
}
