//! Options of the flight recorder: what it keeps, and how much of it.

use serde::{Deserialize, Serialize};

/// Flight recorder. The command line enables it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct RecorderConfig {
    /// How images are kept.
    pub images: ImageRecording,
    /// Part of the flight that is kept at `max_total_mb`.
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
    /// Beginning of the flight: recording stops at the limit, and the recording can be re-executed.
    Beginning,
    /// End of the flight: the oldest files are deleted, and the rest cannot be re-executed.
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
