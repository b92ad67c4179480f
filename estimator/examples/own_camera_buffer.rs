//! The estimator on the buffers of a camera of one's own, without a copy: rows are padded, as a DMA engine writes
//! them (752 pixels in rows of 768 bytes).
//!
//! The camera here is played from a data set in the EuRoC layout:
//!
//! ```text
//! cargo run --release -p plumbline-estimator --example own_camera_buffer -- ../shared/euroc/V1_01_easy_clip
//! ```

use plumbline_drivers::{EurocDataset, EurocOptions, ImuSource, StereoFrame, StereoSource};
use plumbline_estimator::config::{Config, import};
use plumbline_estimator::{
    Estimate, Estimator, FrameInput, ImageError, ImageView, ImuSample, Timestamp, ValidSetup,
};
use std::error::Error;
use std::path::Path;

/// Rows begin at multiples of so many bytes.
const ALIGNMENT: usize = 256;

fn main() -> Result<(), Box<dyn Error>> {
    let directory = std::env::args().nth(1).ok_or("give the directory of a EuRoC data set")?;
    let (setup, shots) = record(directory.as_ref(), usize::MAX)?;
    let mut estimator = Estimator::new(&setup);
    for shot in &shots {
        let estimate = shot.feed(&mut estimator)?;
        match estimate.pose() {
            Some(pose_o_b) => println!("{} {:?} {pose_o_b}", estimate.stamp, estimate.state),
            None => println!("{} {:?}", estimate.stamp, estimate.state),
        }
    }
    Ok(())
}

/// A camera's buffer after an exposure.
pub struct DmaBuffer {
    /// Width of the image, px.
    pub width: usize,
    /// Height of the image, px.
    pub height: usize,
    /// Bytes from row to row.
    pub stride: usize,
    /// Rows with their padding.
    pub bytes: Vec<u8>,
}

impl DmaBuffer {
    /// View for the estimator: no byte is copied.
    fn view(&self) -> Result<ImageView<'_>, ImageError> {
        ImageView::new(self.width, self.height, self.stride, &self.bytes)
    }
}

/// One exposure of both cameras, and the inertial samples up to it.
pub struct Shot {
    /// Time of both images, by the cameras' clock.
    pub stamp: Timestamp,
    /// Image of the left camera.
    pub left: DmaBuffer,
    /// Image of the right camera.
    pub right: DmaBuffer,
    /// Samples since the shot before, a little beyond the exposure.
    pub samples: Vec<ImuSample>,
}

impl Shot {
    /// This is all that a driver of one's own has to do.
    pub fn feed(&self, estimator: &mut Estimator) -> Result<Estimate, ImageError> {
        for sample in &self.samples {
            estimator.add_imu(sample);
        }
        let frame = FrameInput::stereo(self.stamp, self.left.view()?, self.right.view()?);
        Ok(estimator.add_frame(&frame))
    }
}

/// Stands for the cameras: the first `count` frames of a data set as buffers with padded rows.
pub fn record(directory: &Path, count: usize) -> Result<(ValidSetup, Vec<Shot>), Box<dyn Error>> {
    let config = import::euroc_into(Config::preset("euroc")?, directory)?;
    let dataset = EurocDataset::open(directory, &EurocOptions::for_config(&config))?;
    let (mut imu, mut cameras, mut frame) = (dataset.imu(), dataset.stereo(), dataset.new_frame());
    let mut shots = Vec::new();
    while shots.len() < count && cameras.next_frame(&mut frame)? {
        let mut samples = Vec::new();
        // A camera's time offset is at most a few milliseconds: samples of 50 ms more are enough for any.
        let until = frame.stamp.plus_seconds(0.05);
        while samples.last().is_none_or(|last: &ImuSample| last.stamp < until) {
            let Some(reading) = imu.next_reading()? else { break };
            samples.push(reading.sample);
        }
        let [left, right] = [0, 1].map(|camera| exposed(&frame, camera));
        shots.push(Shot { stamp: frame.stamp, left, right, samples });
    }
    Ok((config.setup().clone(), shots))
}

/// Buffer as the DMA engine leaves it: image rows, and rubbish in the padding.
fn exposed(frame: &StereoFrame, camera: usize) -> DmaBuffer {
    let image = &frame.images[camera];
    let (width, height) = (image.width(), image.height());
    let stride = width.next_multiple_of(ALIGNMENT);
    let mut bytes = vec![0xA5; stride * height];
    for (row, pixels) in bytes.chunks_exact_mut(stride).zip(image.view().rows()) {
        row[..width].copy_from_slice(pixels);
    }
    DmaBuffer { width, height, stride, bytes }
}
