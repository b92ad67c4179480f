//! Contents of a log, without executing it.

use super::LogError;
use super::channel::Channel;
use super::reader::{Ending, LogReader};
use plumbline_record::Dropped;

/// Messages of one channel.
#[derive(Clone, Copy, Debug, Default)]
pub struct ChannelContent {
    /// Number of messages.
    pub messages: u64,
    /// Bytes of their payloads.
    pub bytes: u64,
}

/// Contents of a log.
#[derive(Clone, Debug)]
pub struct Inventory {
    /// By channel, in their order.
    pub contents: [ChannelContent; Channel::LOGGED.len()],
    /// From the first to the last inertial sample or frame, s.
    pub duration_s: f64,
    /// End of the log.
    pub ending: Ending,
    /// Number of entries that were dropped, by the log itself.
    pub dropped: Dropped,
    /// An input is not the one that was recorded.
    pub inputs_changed: bool,
}

/// Reads a log to its end and counts.
///
/// # Errors
/// When it cannot be read or is damaged.
pub fn take(reader: &mut LogReader) -> Result<Inventory, LogError> {
    let mut contents = [ChannelContent::default(); Channel::LOGGED.len()];
    let mut span_ns: Option<(u64, u64)> = None;
    while let Some(message) = reader.next_message()? {
        let content = &mut contents[message.channel as usize];
        content.messages += 1;
        content.bytes += message.payload.len() as u64;
        if matches!(message.channel, Channel::Imu | Channel::Frame) {
            let (first, last) = span_ns.unwrap_or((message.time_ns, message.time_ns));
            span_ns = Some((first.min(message.time_ns), last.max(message.time_ns)));
        }
    }
    let duration_s = span_ns.map_or(0.0, |(first, last)| (last - first) as f64 * 1e-9);
    let inputs_changed = reader.is_seal_broken();
    Ok(Inventory { contents, duration_s, ending: reader.ending(), dropped: reader.dropped(), inputs_changed })
}
