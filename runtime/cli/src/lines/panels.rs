//! Segments drawn over the image they were found in.

use super::Layer;
use plumbline_config::ImageView;
use plumbline_estimator::lines::Segment;
use plumbline_lab::picture::{Rgb, RgbImage};
use plumbline_lab::plot::Caption;

/// The image is darkened to this share of its light.
const BRIGHTNESS: f32 = 0.45;
/// Images of this width have lines of one unit.
const UNIT_WIDTH_PX: f32 = 752.0;
const LINE_UNITS: f32 = 1.6;
const DOT_UNITS: f32 = 1.6;
const BACKGROUND: Rgb = [24, 26, 30];
const CAPTION: Rgb = [236, 236, 236];
const DOT: Rgb = [255, 255, 255];

/// Colours of Okabe and Ito, which the colour-blind tell apart too, by hue and by light.
fn colour(layer: Layer) -> Rgb {
    match layer {
        Layer::Raw => [86, 180, 233],
        Layer::Kept => [230, 159, 0],
        Layer::Merged => [240, 228, 66],
    }
}

/// The darkened image with the segments of one layer, at the image's own size.
pub(super) fn panel(image: &ImageView<'_>, layer: Layer, segments: &[Segment]) -> RgbImage {
    let mut picture = RgbImage::new(image.width(), image.height(), BACKGROUND);
    picture.gray(image, 0, 0, BRIGHTNESS);
    let unit = (image.width().max(image.height()) as f32 / UNIT_WIDTH_PX).max(0.7);
    for segment in segments {
        picture.line(segment.start, segment.end, LINE_UNITS * unit, colour(layer));
    }
    // Above all lines, so that none hides where another one ends.
    for end in segments.iter().flat_map(|s| [s.start, s.end]) {
        picture.disc(end, DOT_UNITS * unit, DOT);
    }
    picture
}

/// A panel of each layer with its name and number above.
pub(super) fn side_by_side(image: &ImageView<'_>, layers: [(Layer, &[Segment]); 3]) -> RgbImage {
    let sizes = Sizes::of(image);
    let mut picture = RgbImage::new(
        layers.len() * (image.width() + sizes.gap) - sizes.gap,
        sizes.strip + image.height(),
        BACKGROUND,
    );
    for (k, (layer, segments)) in layers.into_iter().enumerate() {
        let left = k * (image.width() + sizes.gap);
        sizes.caption(&mut picture, left, image.width(), layer, segments.len());
        picture.paste(&panel(image, layer, segments), left, sizes.strip);
    }
    picture
}

/// Sizes of what surrounds the images, px.
struct Sizes {
    /// A tenth of the letters.
    unit: usize,
    /// Between panels.
    gap: usize,
    /// Height of the caption.
    strip: usize,
}

impl Sizes {
    fn of(image: &ImageView<'_>) -> Self {
        let unit = (image.width() / 320).max(1);
        Self { unit, gap: 4 * unit, strip: 15 * unit }
    }

    fn caption(&self, picture: &mut RgbImage, left: usize, width: usize, layer: Layer, count: usize) {
        let things = if count == 1 { "segment" } else { "segments" };
        let mut at = left + 2 * self.unit;
        for (words, colour) in
            [(layer.name(), colour(layer)), (&count.to_string(), CAPTION), (things, CAPTION)]
        {
            let caption = Caption::new(words, 10 * self.unit, colour);
            if at + caption.width() > left + width {
                return;
            }
            caption.draw(picture, at, self.strip / 2);
            at += caption.width() + 6 * self.unit;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;
    use plumbline_config::GrayImage;

    fn segment() -> Segment {
        let (start, end) = (Vector2::new(10.0, 20.0), Vector2::new(50.0, 20.0));
        Segment { start, end, nodes: Default::default(), strength: 20.0, support: 40.0 }
    }

    #[test]
    fn a_panel_shows_the_segment_its_ends_and_the_darkened_image() {
        let image = GrayImage::from_pixels(64, 64, vec![100; 64 * 64]).unwrap();
        let picture = panel(&image.view(), Layer::Raw, &[segment()]);
        assert_eq!((picture.width(), picture.height()), (64, 64));
        assert_eq!(picture.pixel(30, 20), Some(colour(Layer::Raw)));
        assert_eq!((picture.pixel(10, 20), picture.pixel(50, 20)), (Some(DOT), Some(DOT)));
        assert_eq!(picture.pixel(30, 40), Some([45; 3]));
    }

    #[test]
    fn captions_stay_in_their_panels_at_any_size() {
        for (width, height) in [(64, 64), (65, 300), (752, 480), (2000, 64)] {
            let image = GrayImage::new(width, height);
            let sizes = Sizes::of(&image.view());
            let segments = vec![segment(); 120];
            let layers = Layer::ALL.map(|layer| (layer, segments.as_slice()));
            let picture = side_by_side(&image.view(), layers);
            let size = (3 * width + 2 * sizes.gap, height + sizes.strip);
            assert_eq!((picture.width(), picture.height()), size);
            for x in [width, 2 * width + sizes.gap] {
                for (x, y) in (x..x + sizes.gap).flat_map(|x| (0..size.1).map(move |y| (x, y))) {
                    assert_eq!(picture.pixel(x, y), Some(BACKGROUND), "{width}x{height}: ({x} {y})");
                }
            }
        }
    }
}
