//! Images that are mirrored, upside down, turned, or exchanged: each is tried where images and gyroscope disagree.

use super::{FirstLook, LEAST_TURN_RAD, Pieces, Turn};
use crate::finding::UNITS_AND_COLUMNS;
use crate::tracks::{Sighting, Tracks};
use crate::verdict::{Fitness, Measure};
use nalgebra::Vector2;
use plumbline_config::{Config, ImuSample};

/// Disagreement from which on the images are tried otherwise, and below which that explains it.
const DISAGREES: f64 = 0.5;
const EXPLAINS: f64 = 0.25;

/// Pieces that are tried otherwise.
const TRIED: usize = 4;
/// Factor of a gyroscope in degrees a second, 57.3, as far as images tell it.
const DEGREES: std::ops::Range<f64> = 40.0..80.0;

/// Correlation of an axis that is dead, and of one that is not.
const DEAD: f64 = 0.3;
const LIVE: f64 = 0.7;

/// How the images may lie: along x and along y.
const WAYS: [(&str, [bool; 2]); 3] = [
    ("mirrored", [true, false]),
    ("flipped upside down", [false, true]),
    ("turned by 180 degrees", [true, true]),
];
const SIDES: [(&str, [bool; 2]); 3] = [
    ("both images are", [true, true]),
    ("the left image is", [true, false]),
    ("the right image is", [false, true]),
];

/// The images of a pair that lie otherwise than calibrated.
pub(super) fn judge(
    config: &Config,
    tracks: &Tracks,
    samples: &[ImuSample],
    first: &FirstLook,
) -> Option<Measure> {
    let sizes = [config.camera.first()?, config.camera.get(1)?]
        .map(|camera| Vector2::new(camera.width_px as f32 - 1.0, camera.height_px as f32 - 1.0));
    if let Some(measure) = in_degrees(&first.turns) {
        return Some(measure);
    }
    let pieces = |tracks: &Tracks| Pieces::of(config, tracks, samples, &first.step, TRIED);
    let disagreement = |tracks: &Tracks| pieces(tracks).map_or(1.0, |pieces| pieces.disagreement());
    let as_is = disagreement(tracks);
    if as_is < DISAGREES {
        return None;
    }
    let turned = |sides: [bool; 2], axes: [bool; 2]| {
        with(tracks, |sighting| {
            for camera in (0..2).filter(|camera| sides[*camera]) {
                let Some(px) = &mut sighting.px[camera] else { continue };
                (0..2).filter(|k| axes[*k]).for_each(|k| px[k] = sizes[camera][k] - px[k]);
            }
        })
    };
    let ways = SIDES.into_iter().flat_map(|(side, sides)| {
        WAYS.map(|(way, axes)| (format!("{side} {way}"), disagreement(&turned(sides, axes))))
    });
    let exchanged = disagreement(&with(tracks, |sighting| sighting.px.swap(0, 1)));
    let all = ways.chain([("left and right image are exchanged".to_owned(), exchanged)]);
    let (words, left) = all.min_by(|a, b| a.1.total_cmp(&b.1))?;
    if left >= EXPLAINS {
        return dead_axis(&first.turns);
    }
    Some(Measure::new(
        "way the images lie",
        Fitness::NotFit,
        format!("{words}: {left:.2} of the motion disagrees then, {as_is:.2} as it is"),
        "put it right in the driver (mirror, flip, rotation, order of the cameras), or calibrate with the images as they are",
        &[("disagreement", as_is)],
    ))
}

/// A gyroscope in degrees a second.
fn in_degrees(turns: &[Turn]) -> Option<Measure> {
    let [seen, by_gyro] =
        [0, 1].map(|k| turns.iter().map(|turn| [turn.0, turn.1][k].norm_squared()).sum::<f64>());
    let faster = (by_gyro / seen.max(f64::MIN_POSITIVE)).sqrt();
    DEGREES.contains(&faster).then(|| {
        Measure::new(
            UNITS_AND_COLUMNS,
            Fitness::NotFit,
            format!("the gyroscope turns {faster:.0} times as fast as the images"),
            "probably that it is in degrees a second; multiply it by pi/180: rad/s is expected",
            &[("factor", faster)],
        )
    })
}

/// One axis of the gyroscope that does not show what the images do, while the others do.
fn dead_axis(turns: &[Turn]) -> Option<Measure> {
    let alike = [0, 1, 2].map(|axis| {
        let sum = |of: &dyn Fn(&Turn) -> f64| turns.iter().map(of).sum::<f64>();
        let (seen, by_gyro) = (sum(&|t| t.0[axis].powi(2)), sum(&|t| t.1[axis].powi(2)));
        let rms = (seen / turns.len().max(1) as f64).sqrt();
        let both = sum(&|t| t.0[axis] * t.1[axis]).abs() / (seen * by_gyro).sqrt().max(f64::MIN_POSITIVE);
        (both, rms > LEAST_TURN_RAD)
    });
    let is_dead = |k: &usize| alike[*k].1 && alike[*k].0 < DEAD;
    let dead = (0..3).find(is_dead)?;
    (0..3).all(|k| k == dead || alike[k].0 > LIVE || !alike[k].1).then(|| {
        let axis = ["x", "y", "z"][dead];
        Measure::new(
            "IMU axes",
            Fitness::NotFit,
            format!(
                "gyroscope {axis} does not show the turns of the images ({:.2} of them, other axes do)",
                alike[dead].0
            ),
            "look at wiring, bus and driver of the sensor, or replace it",
            &[("alike", alike[dead].0)],
        )
    })
}

fn with(tracks: &Tracks, change: impl Fn(&mut Sighting)) -> Tracks {
    let mut changed = tracks.clone();
    changed.tracks.iter_mut().flatten().for_each(change);
    changed
}
