//! Options of the flight recorder: what it keeps, and how much of it.

use serde::{Deserialize, Serialize};

/// The flight recorder. Whether there is a recording at all the command line says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RecorderConfig {
    /// How images are kept.
    pub images: ImageRecording,
    /// What is kept when the recording has reached `max_total_mb`.
    pub keep: KeepPolicy,
    /// Size at which a new file is started, MB (10^6 bytes).
    pub max_file_mb: usize,
    /// Largest size of all files of a flight together, MB (10^6 bytes).
    pub max_total_mb: usize,
    /// Length of the recorder's queue, entries; more are dropped and counted. 0 means room for two and a half seconds,
    /// so that the disk may stall for two.
    pub queue_entries: usize,
    /// Length of the recorder's queue, stereo frames; more are dropped and counted. 0 means room for two and a half
    /// seconds.
    pub queue_frames: usize,
}

/// How images are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ImageRecording {
    /// Not at all, but for the hash of their pixels: a re-execution takes them from the data set.
    None,
    /// Compressed without loss.
    Png,
    /// Uncompressed.
    Raw,
}

/// Part of a flight that is kept when the size limit is reached.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum KeepPolicy {
    /// The beginning: recording stops at the limit, and what there is can be re-executed.
    Beginning,
    /// The newest: the oldest files are deleted, and what is left can be looked at but not re-executed.
    Newest,
}

impl Default for RecorderConfig {
    fn default() -> Self {
        Self {
            images: ImageRecording::Png,
            keep: KeepPolicy::Beginning,
            max_file_mb: 1024,
            max_total_mb: 16_384,
            queue_entries: 0,
            queue_frames: 0,
        }
    }
}
