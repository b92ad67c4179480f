//! Options of the flight recorder: what it keeps, and how much of it.

use plumbline_keys::keys;

/// Flight recorder. The command line enables it.
#[keys]
pub struct RecorderConfig {
    /// Images: "png" compresses them without loss, "raw" does not, "none" keeps only a hash of their pixels.
    #[key(default)]
    pub images: ImageRecording,
    /// Action at max_total_mb: "beginning" stops recording, "newest" deletes the oldest files. A re-execution needs the
    /// beginning of the flight.
    #[key(default)]
    pub keep: KeepPolicy,
    /// Size at which a new file is started (MB: 10^6 bytes).
    #[key(default = 1024, range = 32..=65_536, unit = MEGABYTES)]
    pub max_file_mb: usize,
    /// Largest size of all files of a flight (MB: 10^6 bytes).
    #[key(default = 16_384, range = 32..=16_777_216, unit = MEGABYTES)]
    pub max_total_mb: usize,
    /// Length of the recorder's queue, entries. If it is full, further entries are dropped and counted. 0 sizes it for two and
    /// a half seconds, so that the disk may stall for two.
    #[key(default = 0, range = 0..=65_536)]
    pub queue_entries: usize,
    /// Length of the recorder's queue, stereo frames. If it is full, further frames are dropped and counted. 0 sizes it for two
    /// and a half seconds.
    #[key(default = 0, range = 0..=256)]
    pub queue_frames: usize,
}

/// Form in which images are kept.
#[keys("lowercase")]
pub enum ImageRecording {
    /// Not at all, but for the hash of their pixels: a re-execution takes them from the data set.
    None,
    /// Compressed without loss.
    #[default]
    Png,
    /// Uncompressed.
    Raw,
}

/// Part of a flight that is kept when the size limit is reached.
#[keys("lowercase")]
pub enum KeepPolicy {
    /// Beginning of the flight: recording stops at the limit, and the recording can be re-executed.
    #[default]
    Beginning,
    /// End of the flight: the oldest files are deleted, and the rest cannot be re-executed.
    Newest,
}
