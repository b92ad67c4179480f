//! Tests of whole data sets: sound, damaged, hopeless, real, and written by ourselves.

mod damaged;
mod real;
mod refused;
mod written;

use super::fixture::*;
use super::*;
use crate::{ImuSource, StereoSource};

#[test]
fn a_sound_data_set_is_read_completely() {
    let sample = Sample::new();
    let dataset = sample.open().unwrap();
    assert_eq!((dataset.cameras(), dataset.frame_count()), (2, FRAMES as usize));
    assert_eq!(dataset.sizes_px(), [SIZE, SIZE]);
    let mut stereo = dataset.stereo();
    assert_eq!(stereo.expected_frames(), Some(FRAMES as u64));
    for (i, frame) in all_frames(&mut stereo, dataset.sizes_px()).iter().enumerate() {
        assert_eq!((frame.sequence, frame.stamp.as_nanos()), (i as u64, frame_ns(i as i64)));
        assert_eq!(frame.valid, [true, true]);
        assert_eq!(frame.images.each_ref().map(|image| image.pixels()[7]), [i as u8, 100 + i as u8]);
    }
    assert_eq!(stereo.faults(), Faults::default());
    let mut imu = dataset.imu();
    let readings = all_readings(&mut imu);
    assert_eq!(readings.len(), FRAMES as usize * 10);
    assert_eq!(readings[25].sequence, 25);
    assert_eq!(readings[25].sample.gyro.x, 0.025);
    assert_eq!(readings[25].sample.accel.z, -3.69);
    assert_eq!(imu.faults(), Faults::default());
    assert_eq!(dataset.ground_truth().unwrap(), None);
}

#[test]
fn mav0_itself_may_be_named() {
    let sample = Sample::new();
    assert!(EurocDataset::open(&sample.path(""), &EurocOptions::default()).is_ok());
}

#[test]
fn a_range_of_frames_takes_its_inertial_samples_along() {
    let sample = Sample::new();
    let options = EurocOptions { frames: Some(3..5), ..EurocOptions::default() };
    let dataset = EurocDataset::open(sample.dir.path(), &options).unwrap();
    let frames = all_frames(&mut dataset.stereo(), dataset.sizes_px());
    assert_eq!(frames.iter().map(|f| f.sequence).collect::<Vec<_>>(), [3, 4]);
    assert_eq!(dataset.span().0.as_nanos(), frame_ns(3));
    let last = all_readings(&mut dataset.imu()).last().unwrap().sample.stamp;
    assert_eq!(last.as_nanos(), frame_ns(4) + 100_000_000);
    let beyond = EurocOptions { frames: Some(10..99), ..EurocOptions::default() };
    assert_eq!(EurocDataset::open(sample.dir.path(), &beyond).unwrap().frame_count(), 2);
    #[expect(clippy::reversed_empty_ranges)]
    for nothing in [5..5, 7..3, 12..20] {
        let options = EurocOptions { frames: Some(nothing), ..EurocOptions::default() };
        let message = EurocDataset::open(sample.dir.path(), &options).unwrap_err().to_string();
        assert!(message.contains("has frames 0..12"), "{message}");
    }
}

#[test]
fn a_range_of_seconds_counts_from_the_first_frame() {
    let sample = Sample::new();
    let sequences = |seconds: Range<f64>, frames: Option<Range<usize>>| {
        let options = EurocOptions { frames, seconds, ..EurocOptions::default() };
        let dataset = EurocDataset::open(sample.dir.path(), &options).unwrap();
        let frames = all_frames(&mut dataset.stereo(), dataset.sizes_px());
        frames.iter().map(|f| f.sequence).collect::<Vec<_>>()
    };
    assert_eq!(sequences(0.1..0.2, None), [2, 3]);
    assert_eq!(sequences(0.5..f64::INFINITY, None), [10, 11]);
    assert_eq!(sequences(0.1..0.3, Some(3..99)), [3, 4, 5]);
}

#[test]
fn the_right_camera_is_left_alone_where_one_is_configured() {
    let sample = Sample::new();
    let options = EurocOptions { sizes_px: vec![SIZE], ..EurocOptions::default() };
    let dataset = EurocDataset::open(sample.dir.path(), &options).unwrap();
    assert_eq!(dataset.sizes_px(), [SIZE, (0, 0)]);
    let mut stereo = dataset.stereo();
    assert!(all_frames(&mut stereo, dataset.sizes_px()).iter().all(|f| f.valid == [true, false]));
    assert_eq!(stereo.faults(), Faults::default());
}

#[test]
fn a_data_set_without_right_camera_is_monocular() {
    let sample = Sample::new();
    std::fs::remove_dir_all(sample.path("cam1")).unwrap();
    let dataset = sample.open().unwrap();
    assert_eq!((dataset.cameras(), dataset.sizes_px()[1]), (1, (0, 0)));
    assert_eq!(all_frames(&mut dataset.stereo(), dataset.sizes_px()).len(), FRAMES as usize);
}

/// The picture of frame `i` of a camera as a JPEG, which takes the place of its PNG under another ending.
fn as_jpeg(sample: &Sample, camera: usize, i: i64, ending: &str) {
    let mut file = Vec::new();
    let encoder = jpeg_encoder::Encoder::new(&mut file, 100);
    let pixels = vec![(100 * camera as i64 + i) as u8; SIZE.0 * SIZE.1];
    encoder.encode(&pixels, SIZE.0 as u16, SIZE.1 as u16, jpeg_encoder::ColorType::Luma).unwrap();
    std::fs::remove_file(sample.image(camera, i)).unwrap();
    std::fs::write(sample.image(camera, i).with_extension(ending), file).unwrap();
}

#[test]
fn jpeg_images_are_read_whatever_the_table_calls_them() {
    for (ending, named) in [("jpg", "jpg"), ("JPG", "png"), ("jpeg", ""), ("jpg", "JPEG")] {
        let sample = Sample::new();
        // Every third image stays a PNG.
        for i in (0..FRAMES).filter(|i| i % 3 != 0) {
            (0..2).for_each(|camera| as_jpeg(&sample, camera, i, ending));
        }
        for table in ["cam0/data.csv", "cam1/data.csv"] {
            sample.edit(table, |lines| {
                lines.iter_mut().for_each(|line| {
                    *line = line.replace(".png", &format!(".{named}")).trim_end_matches('.').into()
                });
            });
        }
        let dataset = sample.open().unwrap();
        let mut stereo = dataset.stereo();
        for (i, frame) in all_frames(&mut stereo, dataset.sizes_px()).iter().enumerate() {
            let greys = frame.images.each_ref().map(|image| image.pixels()[7]);
            assert_eq!((frame.valid, greys), ([true, true], [i as u8, 100 + i as u8]), "{ending} {named}");
        }
        assert_eq!(stereo.faults(), Faults::default());
    }
}

#[test]
fn lower_bits_in_use_are_scaled_alike() {
    let sample = Sample::new();
    let wide = |value: u16| {
        let mut file = Vec::new();
        let mut encoder = png::Encoder::new(&mut file, SIZE.0 as u32, SIZE.1 as u32);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.set_depth(png::BitDepth::Sixteen);
        let data = value.to_be_bytes().repeat(SIZE.0 * SIZE.1);
        encoder.write_header().unwrap().write_image_data(&data).unwrap();
        file
    };
    // The right camera is darker: by itself it would seem to have 10 bits.
    for i in 0..FRAMES {
        std::fs::write(sample.image(0, i), wide(340 * i as u16)).unwrap();
        std::fs::write(sample.image(1, i), wide(80 * i as u16)).unwrap();
    }
    let dataset = sample.open().unwrap();
    let greys: Vec<[u8; 2]> = all_frames(&mut dataset.stereo(), dataset.sizes_px())
        .iter()
        .map(|frame| frame.images.each_ref().map(|image| image.pixels()[0]))
        .collect();
    assert_eq!(greys[..3], [[0, 0], [21, 5], [42, 10]]);
    // A cut is scaled as the whole is.
    let options = EurocOptions { frames: Some(0..3), ..EurocOptions::default() };
    let cut = EurocDataset::open(sample.dir.path(), &options).unwrap();
    assert_eq!(all_frames(&mut cut.stereo(), cut.sizes_px())[2].images[0].pixels()[0], 42);
    // All sixteen bits in use: as before.
    std::fs::write(sample.image(1, 5), wide(0x4321)).unwrap();
    let dataset = sample.open().unwrap();
    assert_eq!(dataset.defects(), []);
    assert_eq!(
        all_frames(&mut dataset.stereo(), dataset.sizes_px())[11].images[0].pixels()[0],
        3740_u16.to_be_bytes()[0]
    );
}
