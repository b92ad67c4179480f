//! Images that are mirrored, upside down, turned, or exchanged: each is tried where images and gyroscope disagree.

use super::{FirstLook, Pieces};
use crate::tracks::{Sighting, Tracks};
use crate::verdict::Measure;
use nalgebra::Vector2;
use plumbline_config::{Config, ImuSample};

const NAME: &str = "way the images lie";
/// Disagreement from which on the images are tried otherwise; another way that explains it leaves less, and less than half.
const DISAGREES: f64 = 0.4;

/// Pieces that are tried otherwise.
const TRIED: usize = 4;
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
    let sightings = || tracks.tracks.iter().flatten();
    let (both, all) = (sightings().filter(|sighting| sighting.px[1].is_some()).count(), sightings().count());
    // By chance 1 in 2000.
    if 100 * both < all {
        let value = format!("{both} of {all} sightings of the left image are found in the right one");
        let cure = "one of both is turned on its side or upside down, covered, out of focus, or of another camera: put it right";
        return Some(Measure::not_fit(NAME, value, cure));
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
    (left < DISAGREES && left < 0.5 * as_is).then(|| {
        let value = format!("{words}: {left:.2} of the motion disagrees then, {as_is:.2} as it is");
        let cure = "put it right in the driver (mirror, flip, rotation, order of the cameras), or calibrate with the images as they are";
        Measure::not_fit(NAME, value, cure)
    })
}

fn with(tracks: &Tracks, change: impl Fn(&mut Sighting)) -> Tracks {
    let mut changed = tracks.clone();
    changed.tracks.iter_mut().flatten().for_each(change);
    changed
}
