//! Camera pictures for people: the left image with what is tracked in it, reduced and compressed.

use super::{now_ns, proto};
use jpeg_encoder::{ColorType, Encoder};
use plumbline_config::{GrayImage, Timestamp, ValidConfig};
use plumbline_drivers::StereoFrame;
use plumbline_estimator::Tracked;
use prost::Message;

/// A point in a picture: place, px, and the number of frames it has been tracked.
pub type ShotPoint = [f32; 3];
/// A line in a picture: both ends, px.
pub type ShotLine = [f32; 4];

/// A left image with what was tracked in it, at full resolution.
#[derive(Clone, Debug)]
pub struct Shot {
    /// Sequence number of the frame.
    pub frame: u64,
    /// When it was taken, on the IMU's time axis.
    pub stamp: Timestamp,
    image: GrayImage,
    has_image: bool,
    points: Vec<ShotPoint>,
    lines: Vec<ShotLine>,
}

impl Shot {
    /// Room for any frame of the configuration.
    #[must_use]
    pub fn new(config: &ValidConfig) -> Self {
        let (width_px, height_px) = config.camera.first().map_or((0, 0), |c| (c.width_px, c.height_px));
        Self {
            frame: 0,
            stamp: Timestamp::default(),
            image: GrayImage::new(width_px, height_px),
            has_image: false,
            points: Vec::with_capacity(config.estimator.points.max_points),
            lines: Vec::with_capacity(2 * config.estimator.lines.max_segments),
        }
    }

    /// Notes what was tracked; allocates nothing.
    pub fn note(&mut self, tracked: &Tracked) {
        (self.frame, self.stamp, self.has_image) = (tracked.sequence, tracked.time.stamp, false);
        let points = tracked.points.iter().filter_map(|o| o.px[0].map(|px| (px, o.age)));
        self.points.clear();
        self.points.extend(points.map(|(px, age)| [px.x as f32, px.y as f32, age.saturating_sub(1) as f32]));
        let segments = tracked.lines.iter().filter_map(|o| o.segments[0]);
        self.lines.clear();
        self.lines.extend(segments.map(|s| [s.start.x, s.start.y, s.end.x, s.end.y]));
    }

    /// Copies the left image, if the frame is that of the notes and has one of the right size; says whether.
    pub fn expose(&mut self, frame: &StereoFrame) -> bool {
        let image = &frame.images[0];
        let fits = (image.width(), image.height()) == (self.image.width(), self.image.height());
        self.has_image = frame.sequence == self.frame && frame.valid[0] && fits;
        if self.has_image {
            self.image.pixels_mut().copy_from_slice(image.pixels());
        }
        self.has_image
    }

    /// The message: at most `max_width_px` wide, compressed with `quality` (1 to 100). `None` without image.
    #[must_use]
    pub fn message(&self, max_width_px: usize, quality: u8, sequence: u64) -> Option<Vec<u8>> {
        let factor = self.image.width().div_ceil(max_width_px.max(1)).max(1);
        let (width, height) = (self.image.width() / factor, self.image.height() / factor);
        if !self.has_image || width == 0 || height == 0 {
            return None;
        }
        let (columns, rows) = (u16::try_from(width).ok()?, u16::try_from(height).ok()?);
        let mut jpeg = Vec::new();
        let pixels = reduced(&self.image, factor);
        Encoder::new(&mut jpeg, quality.clamp(1, 100))
            .encode(&pixels, columns, rows, ColorType::Luma)
            .ok()?;
        let scale = 1.0 / factor as f32;
        // The centre of pixel 0 is at 0: the reduced one's lies in the middle of its block.
        let place = |x: f32| (x + 0.5) * scale - 0.5;
        let header = proto::Header {
            stamp_ns: self.stamp.as_nanos(),
            published_ns: now_ns(),
            sequence,
            ..proto::Header::default()
        };
        let message = proto::Picture {
            header: Some(header),
            jpeg,
            width_px: u32::from(columns),
            height_px: u32::from(rows),
            points: self.points.iter().flat_map(|[x, y, age]| [place(*x), place(*y), *age]).collect(),
            lines: self.lines.iter().flatten().map(|x| place(*x)).collect(),
        };
        Some(message.encode_to_vec())
    }
}

/// Means of blocks of `factor` x `factor` pixels; what is left over at the right and at the bottom is cut.
fn reduced(image: &GrayImage, factor: usize) -> Vec<u8> {
    let (width, height) = (image.width() / factor, image.height() / factor);
    let area = (factor * factor) as u32;
    let mut pixels = Vec::with_capacity(width * height);
    for y in 0..height {
        for x in 0..width {
            let rows = (y * factor..(y + 1) * factor).map(|row| {
                let start = row * image.width() + x * factor;
                image.pixels()[start..start + factor].iter().map(|p| u32::from(*p)).sum::<u32>()
            });
            pixels.push(((rows.sum::<u32>() + area / 2) / area) as u8);
        }
    }
    pixels
}

#[cfg(test)]
mod tests {
    use super::super::read;
    use super::*;
    use plumbline_config::Config;
    use plumbline_estimator::FrontEnd;

    fn shot() -> (Shot, StereoFrame) {
        let config = Config::preset("sim").unwrap();
        let _ = FrontEnd::new(config.setup());
        let (width, height) = (config.camera[0].width_px, config.camera[0].height_px);
        let mut frame = StereoFrame::new([(width, height); 2]);
        for (k, pixel) in frame.images[0].pixels_mut().iter_mut().enumerate() {
            *pixel = (k % width * 255 / width) as u8;
        }
        let mut shot = Shot::new(&config);
        shot.points.push([101.5, 201.5, 7.0]);
        (shot, frame)
    }

    #[test]
    fn a_picture_is_reduced_and_its_points_with_it() {
        let (mut shot, mut frame) = shot();
        frame.valid[0] = true;
        assert!(shot.expose(&frame));
        let message: proto::Picture = read::decode(&shot.message(376, 70, 3).unwrap()).unwrap();
        assert_eq!((message.width_px, message.height_px), (376, 240));
        assert_eq!(message.points, [50.5, 100.5, 7.0]);
        assert!(message.jpeg.len() < 20_000);
    }

    #[test]
    fn without_an_image_there_is_no_picture() {
        let (mut shot, mut frame) = shot();
        assert!(!shot.expose(&frame));
        frame.valid[0] = true;
        frame.sequence = 5;
        assert!(!shot.expose(&frame));
        assert!(shot.message(376, 70, 0).is_none());
    }

    #[test]
    fn blocks_are_averaged() {
        let mut image = GrayImage::new(5, 2);
        image.pixels_mut().copy_from_slice(&[0, 10, 20, 30, 99, 10, 20, 30, 40, 99]);
        assert_eq!(reduced(&image, 2), [10, 30]);
    }
}
