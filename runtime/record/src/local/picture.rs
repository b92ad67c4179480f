//! Camera pictures for people: the left image with what is tracked in it.

use crate::messages::Picture;
use plumbline_config::{GrayImage, StereoFrame, Timestamp, ValidConfig};
use plumbline_estimator::Tracked;

/// A point in a picture: place, px, and the number of frames it has been tracked.
pub type ShotPoint = [f32; 3];
/// A line in a picture: both ends, px.
pub type ShotLine = [f32; 4];

/// A left image with what was tracked in it, at full resolution.
#[derive(Clone, Debug, PartialEq)]
pub struct Shot {
    /// Sequence number of the frame.
    pub frame: u64,
    /// Time of the frame, on the IMU's time axis.
    pub stamp: Timestamp,
    /// The image.
    pub image: GrayImage,
    /// True if the image is that of the frame.
    pub has_image: bool,
    /// Points.
    pub points: Vec<ShotPoint>,
    /// Lines.
    pub lines: Vec<ShotLine>,
}

impl From<&Shot> for Picture {
    fn from(shot: &Shot) -> Self {
        let side = |length: usize| u32::try_from(length).unwrap_or(0);
        Self {
            frame: shot.frame,
            stamp_ns: shot.stamp,
            width_px: side(shot.image.width()),
            height_px: side(shot.image.height()),
            pixels: shot.image.pixels().to_vec(),
            points: shot.points.clone(),
            lines: shot.lines.clone(),
            jpeg: Vec::new(),
        }
    }
}

/// A picture whose pixels are not those of its size is refused.
impl TryFrom<Picture> for Shot {
    type Error = &'static str;

    fn try_from(picture: Picture) -> Result<Self, &'static str> {
        let (width, height) = (picture.width_px as usize, picture.height_px as usize);
        let fits = width.checked_mul(height) == Some(picture.pixels.len());
        let image = GrayImage::from_pixels(width, height, if fits { picture.pixels } else { Vec::new() });
        Ok(Self {
            frame: picture.frame,
            stamp: picture.stamp_ns,
            image: image.filter(|_| fits).ok_or("pixels of another size")?,
            has_image: true,
            points: picture.points,
            lines: picture.lines,
        })
    }
}

impl Shot {
    /// Room for any frame of the configuration.
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

    /// Copies the left image, if the frame is that of the notes and has one of the right size; returns whether.
    pub fn expose(&mut self, frame: &StereoFrame) -> bool {
        let image = &frame.images[0];
        let fits = (image.width(), image.height()) == (self.image.width(), self.image.height());
        self.has_image = frame.sequence == self.frame && frame.valid[0] && fits;
        if self.has_image {
            self.image.pixels_mut().copy_from_slice(image.pixels());
        }
        self.has_image
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::Config;

    #[test]
    fn a_frame_without_its_image_makes_no_picture() {
        let config = Config::preset("sim").unwrap();
        let (width, height) = (config.camera[0].width_px, config.camera[0].height_px);
        let (mut shot, mut frame) = (Shot::new(&config), StereoFrame::new([(width, height); 2]));
        assert!(!shot.expose(&frame));
        frame.valid[0] = true;
        assert!(shot.expose(&frame));
        frame.sequence = 5;
        assert!(!shot.expose(&frame));
    }
}
