//! Against another decoder, on images of another encoder.

use super::*;
use jpeg_decoder::ColorTransform;
use jpeg_encoder::{ColorType, Encoder, SamplingFactor};

/// A coloured picture with edges, slopes and noise.
pub(super) fn picture(width: usize, height: usize) -> Vec<u8> {
    let mut noise = 1u32;
    let mut pixels = Vec::with_capacity(3 * width * height);
    for (y, x) in (0..height).flat_map(|y| (0..width).map(move |x| (y, x))) {
        noise = noise.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let edge = if (x / 9 + y / 7) % 2 == 0 { 70 } else { 150 };
        let slope = (x * 60 / width + y * 40 / height) as u32;
        let grey = edge + slope + (noise >> 29);
        pixels.extend([grey.min(255) as u8, (grey / 2 + 60) as u8, 255 - grey.min(255) as u8]);
    }
    pixels
}

/// The picture as a camera might send it.
pub(super) fn jpeg(
    (width, height): (usize, usize),
    color: ColorType,
    set: impl Fn(&mut Encoder<&mut Vec<u8>>),
) -> Vec<u8> {
    let mut pixels = picture(width, height);
    if color == ColorType::Luma {
        pixels = pixels.chunks_exact(3).map(|rgb| rgb[0]).collect();
    }
    let mut bytes = Vec::new();
    let mut encoder = Encoder::new(&mut bytes, 85);
    set(&mut encoder);
    encoder.encode(&pixels, width as u16, height as u16, color).unwrap();
    bytes
}

fn decoded(bytes: &[u8], (width, height): (usize, usize)) -> Option<Vec<u8>> {
    let mut decoder = LumaDecoder::new(width, height);
    let luma = decoder.decode(bytes)?;
    assert_eq!(luma.len(), width * height);
    Some(luma.to_vec())
}

/// The other decoder's.
fn expected(bytes: &[u8]) -> Vec<u8> {
    let mut decoder = jpeg_decoder::Decoder::new(bytes);
    decoder.read_info().unwrap();
    let channels = decoder.info().unwrap().pixel_format.pixel_bytes();
    if channels == 3 {
        // Taken for RGB: as it is.
        decoder.set_color_transform(ColorTransform::RGB);
    }
    let samples = decoder.decode().unwrap();
    samples.into_iter().step_by(channels).collect()
}

fn assert_alike(bytes: &[u8], size: (usize, usize), what: &str) {
    let ours = decoded(bytes, size).unwrap_or_else(|| panic!("{what}"));
    let theirs = expected(bytes);
    assert_eq!(ours.len(), theirs.len(), "{what}");
    let apart = ours.iter().zip(&theirs).map(|(a, b)| a.abs_diff(*b));
    let (most, sum) = apart.fold((0, 0u64), |(most, sum), d| (most.max(d), sum + u64::from(d)));
    assert!(most <= 2 && sum as f64 <= 0.1 * theirs.len() as f64, "{what}: {most} at most, {sum} in all");
}

const SIZES: [(usize, usize); 5] = [(64, 48), (65, 49), (8, 8), (1, 1), (131, 37)];

#[test]
fn luma_is_that_of_another_decoder_for_every_sampling_of_chroma() {
    use SamplingFactor as S;
    for sampling in [S::F_1_1, S::F_2_1, S::F_1_2, S::F_2_2, S::F_4_1] {
        for size in SIZES {
            let bytes = jpeg(size, ColorType::Rgb, |e| e.set_sampling_factor(sampling));
            assert_alike(&bytes, size, &format!("{sampling:?} {size:?}"));
        }
    }
}

#[test]
fn grey_images_and_restarts_are_read() {
    for size in SIZES {
        assert_alike(&jpeg(size, ColorType::Luma, |_| {}), size, "grey");
        assert_alike(&jpeg(size, ColorType::Rgb, |e| e.set_restart_interval(3)), size, "restarts");
    }
}

/// The encoder puts each component into a scan of its own then: luma is the same whichever way it is sent.
#[test]
fn tables_of_their_own_and_scans_of_luma_alone_are_read() {
    for size in SIZES {
        let luma = decoded(&jpeg(size, ColorType::Rgb, |_| {}), size);
        assert!(luma.is_some());
        assert_eq!(
            decoded(&jpeg(size, ColorType::Rgb, |e| e.set_optimized_huffman_tables(true)), size),
            luma
        );
        let tall = jpeg(size, ColorType::Rgb, |e| e.set_sampling_factor(SamplingFactor::F_1_4));
        assert_eq!(decoded(&tall, size), luma);
    }
}

/// The image without its tables of codes, as many cameras send it.
pub(super) fn without_tables(bytes: &[u8]) -> Vec<u8> {
    let mut out = bytes[..2].to_vec();
    let mut at = 2;
    while bytes[at + 1] != SCAN {
        let end = at + 2 + usize::from(u16::from_be_bytes([bytes[at + 2], bytes[at + 3]]));
        if bytes[at + 1] != HUFFMAN {
            out.extend_from_slice(&bytes[at..end]);
        }
        at = end;
    }
    out.extend_from_slice(&bytes[at..]);
    out
}

#[test]
fn tables_that_a_camera_leaves_out_are_those_of_the_standard() {
    let size = (96, 40);
    let whole = jpeg(size, ColorType::Rgb, |_| {});
    let sent = without_tables(&whole);
    assert!(sent.len() + 400 < whole.len());
    // Also after an image that brought others.
    let mut decoder = LumaDecoder::new(size.0, size.1);
    let other = jpeg(size, ColorType::Rgb, |e| e.set_optimized_huffman_tables(true));
    decoder.decode(&other).unwrap();
    assert_eq!(decoder.decode(&sent).unwrap(), decoded(&whole, size).unwrap());
}

#[test]
fn what_is_no_whole_image_of_the_size_is_refused() {
    let size = (64, 48);
    let bytes = jpeg(size, ColorType::Rgb, |_| {});
    assert_eq!(decoded(&bytes, (64, 47)), None);
    assert_eq!(decoded(&bytes[1..], size), None);
    let progressive = jpeg(size, ColorType::Rgb, |e| e.set_progressive(true));
    assert_eq!(decoded(&progressive, size), None);
    for length in (0..bytes.len() - 200).step_by(7) {
        assert!(decoded(&bytes[..length], size).is_none(), "{length} of {} bytes", bytes.len());
        // Closed as if it were whole, and with what a buffer may hold behind it.
        for rest in [&[0xff, 0xd9][..], &[0xff, 0xd9, 0, 0, 0, 0, 0, 0, 0, 0]] {
            assert!(decoded(&[&bytes[..length], rest].concat(), size).is_none(), "{length} bytes, closed");
        }
    }
    assert!(decoded(&bytes, size).is_some());
}

/// Rows of an even picture cost a few bits: none may be taken for missing, whatever follows them.
#[test]
fn short_images_are_whole_with_or_without_what_follows() {
    let (width, height) = (16, 480);
    let mut bytes = Vec::new();
    let encoder = Encoder::new(&mut bytes, 85);
    encoder.encode(&vec![90; width * height], width as u16, height as u16, ColorType::Luma).unwrap();
    let luma = decoded(&bytes, (width, height)).unwrap();
    assert!(luma.iter().all(|pixel| pixel.abs_diff(90) <= 1));
    assert_eq!(decoded(&bytes[..bytes.len() - 2], (width, height)).unwrap(), luma);
    assert_eq!(decoded(&[&bytes[..], &[0; 100]].concat(), (width, height)).unwrap(), luma);
}

/// Factors that no camera has, on data that are of other ones.
#[test]
fn no_sampling_of_components_ends_the_program() {
    let size = (40, 24);
    for color in [ColorType::Rgb, ColorType::Luma] {
        let mut bytes = jpeg(size, color, |_| {});
        let frame = bytes.windows(2).position(|two| two == [0xff, 0xc0]).unwrap();
        let components = usize::from(bytes[frame + 9]);
        let factors: Vec<u8> = (0..=5).flat_map(|h| (0..=5).map(move |v| h << 4 | v)).collect();
        for k in 0..factors.len().pow(components.min(2) as u32) {
            let of = [factors[k % factors.len()], factors[k / factors.len()], 0x11];
            (0..components).for_each(|c| bytes[frame + 11 + 3 * c] = of[c]);
            let _ = decoded(&bytes, size);
        }
    }
}

#[test]
fn what_is_allocated_follows_from_the_size_of_the_camera_and_not_from_the_image() {
    let size = (320, 96);
    let image = jpeg(size, ColorType::Rgb, |_| {});
    let mut decoder = LumaDecoder::new(size.0, size.1);
    let whole = allocation_counter::measure(|| assert!(decoder.decode(&image).is_some()));
    assert!(whole.bytes_max < 200_000, "{whole:?}");
    let again = allocation_counter::measure(|| assert!(decoder.decode(&image).is_some()));
    assert!(again.bytes_max < 64_000, "{again:?}");
    // An image of 320 x 96 px that says it has 16000 x 16000.
    let mut claim = image.clone();
    let frame = claim.windows(2).position(|two| two == [0xff, 0xc0]).unwrap();
    claim[frame + 5..frame + 9].copy_from_slice(&[0x3e, 0x80, 0x3e, 0x80]);
    let refused = allocation_counter::measure(|| {
        assert_eq!(decoder.decode(&claim), None);
        assert_eq!(size_of(&claim), Some((16000, 16000)));
    });
    assert!(refused.bytes_max < 20_000, "{refused:?}");
}

/// Pixels are pinned: what a log holds is decoded again on other processors.
#[test]
fn pixels_are_the_same_on_every_processor() {
    let read = |name: &str| std::fs::read(seeds().join(name)).unwrap();
    let crc = crc::Crc::<u32>::new(&crc::CRC_32_ISO_HDLC);
    let of = |name: &str| crc.checksum(&decoded(&read(name), (40, 24)).unwrap());
    assert_eq!(["420", "444", "no-tables"].map(of), [593_527_592; 3]);
}

fn seeds() -> std::path::PathBuf {
    plumbline_test_support::workspace().join("fuzz/seeds/mjpeg")
}
