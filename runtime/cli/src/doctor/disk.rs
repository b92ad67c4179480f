//! Check that a folder has room for recordings, and takes them as fast as they come.

use super::Verdict;
use plumbline_checkup::Fitness;
use plumbline_config::Config;
use plumbline_config::options::{CameraConfig, ImageRecording};
use std::fs::OpenOptions;
use std::io::Write as _;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Written to find the speed, MB: more than a card takes into its own memory.
const TRIAL_MB: usize = 64;
const MB: usize = 1_000_000;
/// Size of a camera's compressed image relative to the plain one: noise does not compress.
const PNG_SHARE: f64 = 0.7;
/// All but images, MB/s.
const REST_MB_S: f64 = 0.3;
/// A recording shorter than this is none, s.
const LEAST_S: f64 = 60.0;
/// The disk should be so many times as fast as the recording: cards stall.
const RESERVE: f64 = 2.0;

/// Data rate of a recording, MB/s.
fn rate_mb_s(config: &Config) -> f64 {
    let of_camera = |camera: &CameraConfig| (camera.width_px * camera.height_px) as f64 * camera.rate_hz;
    let images = config.camera.iter().map(of_camera).sum::<f64>() / MB as f64;
    REST_MB_S
        + match config.recorder.images {
            ImageRecording::None => 0.0,
            ImageRecording::Png => PNG_SHARE * images,
            ImageRecording::Raw => images,
        }
}

/// Tries the folder.
pub(super) fn check(config: &Config, folder: &Path) -> Verdict {
    let named = folder.display();
    let room_mb = match rustix::fs::statvfs(folder) {
        Ok(fs) => fs.f_bavail as f64 * fs.f_frsize as f64 / MB as f64,
        Err(error) => return (Fitness::NotFit, format!("{named}: {error}; name a folder that is there")),
    };
    let speed_mb_s = if room_mb > (2 * TRIAL_MB) as f64 {
        match speed_mb_s(folder) {
            Ok(speed) => speed,
            Err(error) => return (Fitness::NotFit, format!("{named}: cannot be written ({error})")),
        }
    } else {
        f64::NAN
    };
    judge(rate_mb_s(config), config.recorder.max_total_mb as f64, room_mb, speed_mb_s)
}

/// `limit_mb` is what a recording takes at most; the speed is not a number where there was no room to try it.
fn judge(rate_mb_s: f64, limit_mb: f64, room_mb: f64, speed_mb_s: f64) -> Verdict {
    let minutes = room_mb / rate_mb_s / 60.0;
    let words = format!(
        "room for {minutes:.0} minutes ({:.1} GB), takes {speed_mb_s:.0} MB/s, a recording needs {rate_mb_s:.1}",
        room_mb * 1e-3
    );
    let (fitness, cure) = if room_mb < LEAST_S * rate_mb_s {
        (Fitness::NotFit, "; make room".to_owned())
    } else if speed_mb_s < rate_mb_s {
        let cure = ": frames would be lost; take a faster disk, or recorder.images = \"none\"";
        (Fitness::NotFit, cure.to_owned())
    } else if speed_mb_s < RESERVE * rate_mb_s {
        (Fitness::Mind, ": little reserve; a faster disk loses nothing when it stalls".to_owned())
    } else if room_mb < limit_mb {
        (Fitness::Mind, format!("; recorder.max_total_mb = {limit_mb:.0} is more than there is room for"))
    } else {
        (Fitness::Good, String::new())
    };
    (fitness, words + &cure)
}

/// Speed at which what is written reaches the disk, MB/s.
fn speed_mb_s(folder: &Path) -> std::io::Result<f64> {
    let trial = Trial(folder.join(format!(".plumbline-doctor-{}", std::process::id())));
    let mut file = OpenOptions::new().write(true).create_new(true).mode(0o600).open(&trial.0)?;
    // Nothing that a file system could compress.
    let mut state = 1_u32;
    let block: Vec<u8> = (0..MB)
        .map(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        })
        .collect();
    let began = Instant::now();
    for _ in 0..TRIAL_MB {
        file.write_all(&block)?;
    }
    file.sync_data()?;
    Ok(TRIAL_MB as f64 / began.elapsed().as_secs_f64())
}

/// A file that goes when it is no longer needed.
struct Trial(PathBuf);

impl Drop for Trial {
    fn drop(&mut self) {
        // Where it cannot be removed it could not be made either.
        let _ = std::fs::remove_file(&self.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_is_tried_and_left_as_it_was() {
        let folder = tempfile::tempdir().unwrap();
        let verdict = check(&Config::preset("sim").unwrap(), folder.path());
        assert!(verdict.1.contains("room for"), "{verdict:?}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0);
        let nowhere = check(&Config::preset("sim").unwrap(), Path::new("/nowhere/at-all"));
        assert!(matches!(&nowhere, (Fitness::NotFit, words) if words.contains("/nowhere/at-all")));
    }

    #[test]
    fn room_and_speed_are_judged_by_what_a_recording_needs() {
        let verdict = |room_mb: f64, speed: f64| judge(10.0, 16_000.0, room_mb, speed);
        assert!(matches!(verdict(20_000.0, 100.0), (Fitness::Good, _)));
        assert!(matches!(verdict(5_000.0, 100.0), (Fitness::Mind, words) if words.contains("max_total_mb")));
        assert!(matches!(verdict(20_000.0, 15.0), (Fitness::Mind, words) if words.contains("reserve")));
        assert!(matches!(verdict(20_000.0, 9.0), (Fitness::NotFit, words) if words.contains("faster disk")));
        assert!(matches!(verdict(500.0, 100.0), (Fitness::NotFit, words) if words.contains("make room")));
        assert!(matches!(verdict(100.0, f64::NAN), (Fitness::NotFit, _)));
    }
}
