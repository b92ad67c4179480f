//! Hands out the messages of a log kind by kind, though they stand in it as the threads of the run came.
//!
//! Messages read on the way to another one wait in a queue of their kind. In a log of one run the kinds are never further apart
//! than the recorder's queue was long; a log in which they are is refused.

use super::channel::Channel;
use super::reader::LogReader;
use super::{LogError, image};
use plumbline_drivers::StereoFrame;
use plumbline_record::fields::Record;
use plumbline_record::parts::FrameAbout;
use plumbline_record::protobuf::decode;
use plumbline_record::{FrameOrder, Verdict};
use std::collections::VecDeque;
use std::path::Path;

/// Messages that may wait, bytes: a minute of raw images would be more.
const MAX_WAITING_BYTES: usize = 512 << 20;

/// Frames that may be refused before one that was lost is told of: a second of them, and more.
const MAX_ORDERS_AHEAD: usize = 64;

/// A place in a log for each kind of message.
pub struct Cursor {
    reader: LogReader,
    wanted: &'static [Channel],
    waiting: [VecDeque<Vec<u8>>; Channel::LOGGED.len()],
    waiting_bytes: usize,
    /// Damage of the log, at the place where it ceases to be whole.
    damage: Option<String>,
}

impl Cursor {
    /// At the beginning of the log at `path`; only the `wanted` channels can be asked for.
    ///
    /// # Errors
    /// When it cannot be read or is no flight log.
    pub fn open(path: &Path, wanted: &'static [Channel]) -> Result<Self, LogError> {
        let reader = LogReader::open(path)?;
        Ok(Self { reader, wanted, waiting: Default::default(), waiting_bytes: 0, damage: None })
    }

    /// Damage of the log where it ceased to be whole, if it did: nothing after that is handed out.
    pub fn damage(&self) -> Option<&str> {
        self.damage.as_deref()
    }

    /// The log.
    pub fn reader(&self) -> &LogReader {
        &self.reader
    }

    /// The next value of `channel`, or `None` when the log holds no more.
    ///
    /// # Errors
    /// When the log cannot be read, or holds what is no such value.
    pub fn next<T: Record>(&mut self, channel: Channel) -> Result<Option<T>, LogError> {
        while self.waiting[channel as usize].is_empty() {
            if !self.read_on()? {
                return Ok(None);
            }
        }
        self.next_waiting(channel)
    }

    /// The next value of `channel` among those that were read already.
    ///
    /// # Errors
    /// When it is no such value.
    pub fn next_waiting<T: Record>(&mut self, channel: Channel) -> Result<Option<T>, LogError> {
        match self.take(channel) {
            None => Ok(None),
            Some(bytes) => decode(&bytes).map(Some).map_err(|e| self.bad(channel, e)),
        }
    }

    /// The next order of a frame among those that were read already; it stays.
    ///
    /// # Errors
    /// When it is no such order.
    pub fn peek_order(&self) -> Result<Option<FrameOrder>, LogError> {
        let bytes = self.waiting[Channel::FrameOrder as usize].front();
        bytes.map(|b| decode::<FrameOrder>(b).map_err(|e| self.bad(Channel::FrameOrder, e))).transpose()
    }

    /// True if a later order says that `frame`, whose order was just handed out, was lost by a fault. At most one more frame is
    /// taken before it says so.
    ///
    /// # Errors
    /// When the log cannot be read, or holds what is no order.
    pub fn is_lost(&mut self, frame: u64) -> Result<bool, LogError> {
        let (mut place, mut taken) = (0, 0);
        loop {
            while self.waiting[Channel::FrameOrder as usize].len() <= place {
                if !self.read_on()? {
                    return Ok(false);
                }
            }
            let bytes = &self.waiting[Channel::FrameOrder as usize][place];
            let order = decode::<FrameOrder>(bytes).map_err(|e| self.bad(Channel::FrameOrder, e))?;
            match order.verdict {
                Verdict::Lost if order.frame == frame => return Ok(true),
                Verdict::Taken { .. } => taken += 1,
                Verdict::Lost | Verdict::Refused => {}
            }
            place += 1;
            if taken == 2 || place == MAX_ORDERS_AHEAD {
                return Ok(false);
            }
        }
    }

    /// Writes the next frame into `frame`, with those of its images whose channels are wanted; its
    /// description, or `None` when there are no more.
    ///
    /// # Errors
    /// When the log cannot be read, or an image is not the one that was recorded.
    pub fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<Option<FrameAbout>, LogError> {
        while self.waiting[Channel::Frame as usize].is_empty() {
            if !self.read_on()? {
                return Ok(None);
            }
        }
        let Some(bytes) = self.take(Channel::Frame) else { return Ok(None) };
        let description: FrameAbout = decode(&bytes).map_err(|e| self.bad(Channel::Frame, e))?;
        frame.sequence = description.sequence;
        frame.stamp = description.stamp;
        frame.valid = [false; 2];
        let images = self.reader.about().images;
        let cameras = [(Channel::Left, &description.left), (Channel::Right, &description.right)];
        for (camera, (channel, image)) in cameras.into_iter().enumerate() {
            let (Some(image), true) = (image, self.wanted.contains(&channel)) else { continue };
            frame.valid[camera] = true;
            let sound = match self.take(channel) {
                Some(bytes) => image::decode(&bytes, images, image, &mut frame.images[camera]),
                None => Err("its image is missing"),
            };
            sound.map_err(|e| {
                LogError::unusable(self.reader.path(), format!("frame {}: {e}", description.sequence))
            })?;
        }
        Ok(Some(description))
    }

    /// Passes over all that is left, for what the end says of the log as a whole.
    ///
    /// # Errors
    /// When the log cannot be read.
    pub fn read_to_end(&mut self) -> Result<(), LogError> {
        while self.damage.is_none() {
            match self.reader.next_message() {
                Ok(Some(_)) => {}
                Ok(None) => break,
                Err(error) => self.damage = Some(damage(error)?),
            }
        }
        Ok(())
    }

    /// Reads one message; `false` at the end.
    fn read_on(&mut self) -> Result<bool, LogError> {
        if self.damage.is_some() {
            return Ok(false);
        }
        let message = match self.reader.next_message() {
            Ok(Some(message)) => message,
            Ok(None) => return Ok(false),
            Err(error) => {
                self.damage = Some(damage(error)?);
                return Ok(false);
            }
        };
        if self.wanted.contains(&message.channel) {
            self.waiting_bytes += message.payload.len();
            self.waiting[message.channel as usize].push_back(message.payload.to_vec());
        }
        if self.waiting_bytes > MAX_WAITING_BYTES {
            let reason = "its inputs and orders are too far apart to belong to one run; it was not written \
                          by a recorder";
            return Err(LogError::unusable(self.reader.path(), reason));
        }
        Ok(true)
    }

    fn take(&mut self, channel: Channel) -> Option<Vec<u8>> {
        let bytes = self.waiting[channel as usize].pop_front()?;
        self.waiting_bytes -= bytes.len();
        Some(bytes)
    }

    fn bad(&self, channel: Channel, what: &str) -> LogError {
        let reason = format!("{} holds {what}; it was not written by a recorder", channel.channel());
        LogError::unusable(self.reader.path(), reason)
    }
}

/// The words of a damage; any other error is returned as it is.
fn damage(error: LogError) -> Result<String, LogError> {
    match error {
        LogError::Damaged { .. } => Ok(error.to_string()),
        other => Err(other),
    }
}
