//! Against what a reader of the kernel's documentation would write, pixel by pixel.

use super::*;
use proptest::prelude::*;

const ALL: [PixelFormat; 8] = [
    PixelFormat::Grey,
    PixelFormat::Y8i,
    PixelFormat::Wide(10),
    PixelFormat::Wide(12),
    PixelFormat::Wide(16),
    PixelFormat::Yuyv,
    PixelFormat::Uyvy,
    PixelFormat::Nv12,
];

/// Luma of the pixel of column `x` and row `y` of the device's image; of the right sensor where pixels are interleaved.
fn pixel(layout: &RawLayout, bytes: &[u8], x: usize, y: usize, right: bool) -> u8 {
    let at = |per_pixel: usize, byte: usize| bytes[y * layout.stride + x * per_pixel + byte];
    match layout.format {
        PixelFormat::Grey | PixelFormat::Nv12 => at(1, 0),
        PixelFormat::Y8i => at(2, usize::from(right)),
        PixelFormat::Yuyv => at(2, 0),
        PixelFormat::Uyvy => at(2, 1),
        PixelFormat::Wide(bits) => {
            let value = u32::from(at(2, 0)) + 256 * u32::from(at(2, 1));
            (value / (1 << (bits - 8))).min(255) as u8
        }
        PixelFormat::Mjpeg => unreachable!("has no pixels"),
    }
}

/// The images that a reader would make of a buffer.
fn reference(layout: &RawLayout, bytes: &[u8]) -> Vec<GrayImage> {
    let count = if layout.arrangement == Arrangement::Single { 1 } else { 2 };
    (0..count)
        .map(|camera| {
            let shift =
                if layout.arrangement == Arrangement::SideBySide { camera * layout.width_px } else { 0 };
            let pixels = (0..layout.height_px)
                .flat_map(|y| (0..layout.width_px).map(move |x| (x, y)))
                .map(|(x, y)| pixel(layout, bytes, x + shift, y, camera == 1))
                .collect();
            GrayImage::from_pixels(layout.width_px, layout.height_px, pixels).unwrap()
        })
        .collect()
}

fn layouts() -> impl Strategy<Value = RawLayout> {
    (prop::sample::select(&ALL[..]), any::<bool>(), 1..70usize, 1..9usize, 0..40usize).prop_map(
        |(format, both, width_px, height_px, padding)| {
            let both = both || format == PixelFormat::Y8i;
            let arrangement = Arrangement::of(format, both).unwrap();
            let row = arrangement.device_width_px(width_px) * format.bytes_per_pixel().unwrap();
            RawLayout { format, arrangement, width_px, height_px, stride: row + padding }
        },
    )
}

proptest! {
    #[test]
    fn images_are_those_of_the_documentation(layout in layouts(), seed in any::<u64>()) {
        let mut state = seed | 1;
        let bytes: Vec<u8> = (0..layout.needed())
            .map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (state >> 56) as u8
            })
            .collect();
        let expected = reference(&layout, &bytes);
        let mut images = vec![GrayImage::new(layout.width_px, layout.height_px); expected.len()];
        prop_assert_eq!(Converter::new(layout).convert(&bytes, &mut images), Some(()));
        prop_assert_eq!(images, expected);
        // One byte less is no image.
        let short = Converter::new(layout).convert(&bytes[..bytes.len() - 1], &mut [(); 2].map(|()| {
            GrayImage::new(layout.width_px, layout.height_px)
        })[..if layout.arrangement == Arrangement::Single { 1 } else { 2 }]);
        prop_assert_eq!(short, None);
    }
}

#[test]
fn strides_and_sizes_beyond_reason_are_damage() {
    let layout = RawLayout {
        format: PixelFormat::Yuyv,
        arrangement: Arrangement::Single,
        width_px: 64,
        height_px: 2,
        stride: 127,
    };
    let mut images = [GrayImage::new(64, 2)];
    let refused = Converter::new(layout).convert(&[0; 512], &mut images);
    assert_eq!(refused, None);
    let endless = RawLayout { stride: usize::MAX, ..layout };
    let refused = Converter::new(endless).convert(&[0; 512], &mut images);
    assert_eq!(refused, None);
}

#[test]
fn an_image_of_another_size_is_made_anew() {
    let layout = RawLayout {
        format: PixelFormat::Grey,
        arrangement: Arrangement::Single,
        width_px: 3,
        height_px: 2,
        stride: 3,
    };
    let mut images = [GrayImage::new(0, 0)];
    assert_eq!(Converter::new(layout).convert(&[1, 2, 3, 4, 5, 6, 7], &mut images), Some(()));
    assert_eq!(images[0].pixels(), [1, 2, 3, 4, 5, 6]);
}

#[test]
fn bits_that_a_driver_leaves_above_its_ten_are_bright_and_do_not_wrap() {
    let layout = RawLayout {
        format: PixelFormat::Wide(10),
        arrangement: Arrangement::Single,
        width_px: 3,
        height_px: 1,
        stride: 6,
    };
    let mut images = [GrayImage::new(3, 1)];
    assert_eq!(Converter::new(layout).convert(&[0xff, 0x03, 0x04, 0x00, 0x00, 0x04], &mut images), Some(()));
    assert_eq!(images[0].pixels(), [255, 1, 255]);
}

#[test]
fn the_halves_of_a_jpeg_image_are_left_and_right() {
    use jpeg_encoder::{ColorType, Encoder};
    // Each half is even; an odd width puts the seam within a block.
    let (width_px, height_px) = (45, 24);
    let pixels: Vec<u8> = (0..height_px).flat_map(|_| [[60u8; 45], [200; 45]].concat()).collect();
    let mut bytes = Vec::new();
    Encoder::new(&mut bytes, 95).encode(&pixels, 90, 24, ColorType::Luma).unwrap();
    let layout = RawLayout {
        format: PixelFormat::Mjpeg,
        arrangement: Arrangement::SideBySide,
        width_px,
        height_px,
        stride: 0,
    };
    let mut images = [GrayImage::new(width_px, height_px), GrayImage::new(width_px, height_px)];
    assert_eq!(Converter::new(layout).convert(&bytes, &mut images), Some(()));
    for (image, grey) in images.iter().zip([60u8, 200]) {
        assert!(image.pixels().iter().all(|pixel| pixel.abs_diff(grey) <= 12), "{grey}");
    }
    let short = Converter::new(layout).convert(&bytes[..bytes.len() / 2], &mut images);
    assert_eq!(short, None);
}

#[test]
fn converting_allocates_nothing() {
    for format in ALL {
        for both in [false, true] {
            let Some(arrangement) = Arrangement::of(format, both) else { continue };
            let stride = arrangement.device_width_px(64) * format.bytes_per_pixel().unwrap();
            let layout = RawLayout { format, arrangement, width_px: 64, height_px: 48, stride };
            let bytes = vec![77; layout.needed()];
            let mut converter = Converter::new(layout);
            let mut images = vec![GrayImage::new(64, 48); if both { 2 } else { 1 }];
            let counted = allocation_counter::measure(|| {
                converter.convert(&bytes, &mut images).unwrap();
                assert!(converter.convert(&bytes[1..], &mut images).is_none());
            });
            assert_eq!(counted.count_total, 0, "{layout:?} {counted:?}");
        }
    }
}
