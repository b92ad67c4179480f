//! The images of a calibration from a flight log.

use super::Pair;
use plumbline_config::options::image_sizes;
use plumbline_drivers::StereoFrame;
use plumbline_flight::flight::{Flight, FlightError, open_log};
use std::path::Path;

/// Images from a log.
#[derive(Debug)]
pub struct Recorded {
    /// At most as many as were asked for, spread evenly, named by their stamps, ns.
    pub pairs: Vec<Pair>,
    /// Frames in the log.
    pub total: usize,
}

/// Reads `most` moments of a flight log at most, with `mono` their left images alone. The log is read twice: how many there
/// are is known at its end.
///
/// # Errors
/// When the log cannot be read, or holds no images.
pub fn read_log(path: &Path, most: usize, mono: bool) -> Result<Recorded, FlightError> {
    let mut total = 0;
    each_frame(open_log(path, None, None, mono)?, |_| total += 1)?;
    let (mut number, mut pairs) = (0, Vec::new());
    each_frame(open_log(path, None, None, mono)?, |frame| {
        if is_chosen(number, total, most) {
            let image = |camera: usize| frame.valid[camera].then(|| frame.images[camera].clone());
            pairs.push(Pair { name: frame.stamp.as_nanos().to_string(), images: [image(0), image(1)] });
        }
        number += 1;
    })?;
    Ok(Recorded { pairs, total })
}

/// Whether number `k` of `total` is one of `most` that are spread evenly.
#[must_use]
pub fn is_chosen(k: usize, total: usize, most: usize) -> bool {
    let most = most.max(1);
    total <= most || (k * most) / total != ((k + 1) * most) / total
}

fn each_frame(mut flight: Flight, mut take: impl FnMut(&StereoFrame)) -> Result<(), FlightError> {
    let mut frame = StereoFrame::new(image_sizes(&flight.config.camera));
    while flight.stereo.next_frame(&mut frame)? {
        take(&frame);
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn moments_are_chosen_evenly() {
        let chosen: Vec<usize> = (0..100).filter(|k| is_chosen(*k, 100, 7)).collect();
        assert_eq!(chosen.len(), 7);
        assert!(chosen.windows(2).all(|pair| (14..=15).contains(&(pair[1] - pair[0]))), "{chosen:?}");
        assert_eq!((0..5).filter(|k| is_chosen(*k, 5, 7)).count(), 5);
    }
}
