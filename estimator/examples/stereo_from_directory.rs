//! Poses of a stereo data set in the EuRoC layout, calibration included, as lines of a TUM trajectory:
//!
//! ```text
//! cargo run --release -p plumbline-estimator --example stereo_from_directory -- ../shared/euroc/V1_01_easy_clip
//! ```

use plumbline_drivers::{EurocDataset, EurocOptions, ImuSource, StereoSource};
use plumbline_estimator::config::{Config, import};
use plumbline_estimator::{Estimate, Estimator, FrameInput};
use std::error::Error;
use std::path::Path;

fn main() -> Result<(), Box<dyn Error>> {
    let directory = std::env::args().nth(1).ok_or("give the directory of a EuRoC data set")?;
    estimate(directory.as_ref(), |estimate| {
        if let Some(pose_o_b) = estimate.pose() {
            let (p, q) = (pose_o_b.translation, pose_o_b.rotation.coords);
            println!(
                "{} {:.6} {:.6} {:.6} {:.6} {:.6} {:.6} {:.6}",
                estimate.stamp, p.x, p.y, p.z, q.x, q.y, q.z, q.w
            );
        }
    })
}

/// Hands the estimate of every frame to `found`.
pub fn estimate(directory: &Path, mut found: impl FnMut(&Estimate)) -> Result<(), Box<dyn Error>> {
    // Cameras and rates are those of the data set; the noise model, which is inflated for flight, is the preset's.
    let config = import::euroc_into(Config::preset("euroc")?, directory)?;
    let dataset = EurocDataset::open(directory, &EurocOptions::for_config(&config))?;
    let (mut imu, mut cameras, mut frame) = (dataset.imu(), dataset.stereo(), dataset.new_frame());
    let mut estimator = Estimator::new(config.setup());
    while cameras.next_frame(&mut frame)? {
        let needed = estimator.imu_needed_until(frame.stamp);
        while let Some(reading) = imu.next_reading()? {
            estimator.add_imu(&reading.sample);
            if reading.sample.stamp >= needed {
                break;
            }
        }
        let images = [frame.image(0), frame.image(1)];
        found(&estimator.add_frame(&FrameInput::new(frame.stamp, images)));
    }
    Ok(())
}
