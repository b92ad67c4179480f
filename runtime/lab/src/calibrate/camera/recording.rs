//! The images of a calibration from a flight log or a ROS bag.

use super::Pair;
use plumbline_config::options::image_sizes;
use plumbline_drivers::{BagDataset, BagTopics, EurocOptions, StereoFrame, StereoSource};
use plumbline_flight::flight::{FlightError, open_log};
use std::path::Path;

/// Images from a recording.
#[derive(Debug)]
pub struct Recorded {
    /// At most as many as were asked for, spread evenly, named by their stamps, ns.
    pub pairs: Vec<Pair>,
    /// Frames in the recording.
    pub total: usize,
}

/// Reads `most` moments of a flight log at most, with `mono` their left images alone. The log is read twice: how many there
/// are is known at its end.
///
/// # Errors
/// When the log cannot be read, or holds no images.
pub fn read_log(path: &Path, most: usize, mono: bool) -> Result<Recorded, FlightError> {
    let stereo = || {
        let flight = open_log(path, None, None, mono)?;
        Ok::<_, FlightError>((flight.stereo, image_sizes(&flight.config.camera)))
    };
    let mut total = 0;
    let (mut counted, sizes_px) = stereo()?;
    each_frame(&mut *counted, sizes_px, |_| total += 1)?;
    Ok(Recorded { pairs: chosen(&mut *stereo()?.0, sizes_px, total, most)?, total })
}

/// As [`read_log`], of a ROS bag, of which `topics` are read.
///
/// # Errors
/// When the bag cannot be read, or it is not plain which images are meant.
pub fn read_bag(path: &Path, topics: &BagTopics, most: usize, mono: bool) -> Result<Recorded, FlightError> {
    let options = EurocOptions { with_imu: false, ..EurocOptions::default() };
    let bag = BagDataset::open(path, topics, &options)?;
    let mut sizes_px = bag.sizes_px();
    if mono {
        sizes_px[1] = (0, 0);
    }
    let mut stereo = bag.stereo();
    let total = stereo.expected_frames().unwrap_or(0) as usize;
    let mut pairs = chosen(&mut stereo, sizes_px, total, most)?;
    // An image of the right camera alone is one of none.
    pairs.retain(|pair| pair.images.iter().any(Option::is_some));
    Ok(Recorded { pairs, total })
}

/// `most` of the `total` frames of a source.
fn chosen(
    stereo: &mut dyn StereoSource,
    sizes_px: [(usize, usize); 2],
    total: usize,
    most: usize,
) -> Result<Vec<Pair>, FlightError> {
    let (mut number, mut pairs) = (0, Vec::new());
    each_frame(stereo, sizes_px, |frame| {
        if is_chosen(number, total, most) {
            let image = |camera: usize| frame.valid[camera].then(|| frame.images[camera].clone());
            pairs.push(Pair { name: frame.stamp.as_nanos().to_string(), images: [image(0), image(1)] });
        }
        number += 1;
    })?;
    Ok(pairs)
}

/// True if number `k` of `total` is one of `most` that are spread evenly.
pub fn is_chosen(k: usize, total: usize, most: usize) -> bool {
    let most = most.max(1);
    total <= most || (k * most) / total != ((k + 1) * most) / total
}

fn each_frame(
    stereo: &mut dyn StereoSource,
    sizes_px: [(usize, usize); 2],
    mut take: impl FnMut(&StereoFrame),
) -> Result<(), FlightError> {
    let mut frame = StereoFrame::new(sizes_px);
    while stereo.next_frame(&mut frame)? {
        take(&frame);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bags_of_both_kinds_give_pairs_of_images() {
        for seed in ["sqlite_bag/raw.db3", "ros1_bag/raw-lz4.bag", "ros1_bag/png-bz2.bag"] {
            let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../fuzz/seeds").join(seed);
            let recorded = read_bag(&path, &BagTopics::default(), 2, false).unwrap();
            assert_eq!((recorded.total, recorded.pairs.len()), (3, 2), "{seed}");
            let sizes = |pair: &Pair| pair.images.each_ref().map(|image| image.as_ref().unwrap().width());
            assert!(recorded.pairs.iter().all(|pair| sizes(pair) == [6, 6]), "{seed}");
            let mono = read_bag(&path, &BagTopics::default(), 9, true).unwrap();
            assert!(
                mono.pairs.len() == 3 && mono.pairs.iter().all(|pair| pair.images[1].is_none()),
                "{seed}"
            );
        }
    }

    #[test]
    fn moments_are_chosen_evenly() {
        let chosen: Vec<usize> = (0..100).filter(|k| is_chosen(*k, 100, 7)).collect();
        assert_eq!(chosen.len(), 7);
        assert!(chosen.windows(2).all(|pair| (14..=15).contains(&(pair[1] - pair[0]))), "{chosen:?}");
        assert_eq!((0..5).filter(|k| is_chosen(*k, 5, 7)).count(), 5);
    }
}
