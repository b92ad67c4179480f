//! The front-end on rendered images, where the truth is known to a hundredth of a pixel.

use super::scene::{Flight, HEIGHT, Scene, Shot, WIDTH, extrinsics, model, sway};
use crate::image::Pyramid;
use crate::image::mask::ImageMask;
use crate::image::noise::NoiseWatch;
use crate::image::patch::SIDE;
use crate::image::synthetic::Texture;
use crate::points::corners::{CornerDetector, Demand};
use crate::points::flow::{FlowOptions, track_patch};
use crate::points::{PointObservation, TrackerInput};
use crate::work_budget::InTurn;
use nalgebra::{Isometry3, Matrix2, Point3, UnitQuaternion, Vector2, Vector3};
use plumbline_config::GrayImage;
use plumbline_config::Random;
use plumbline_config::options::PixelMask;
use std::collections::BTreeMap;

/// Compares observations with the truth: the point of a track is where its first ray met the scene.
#[derive(Default)]
struct Judge {
    points: BTreeMap<u32, Point3<f64>>,
}

impl Judge {
    /// Errors of all observations of a frame in one camera, px; tracks seen for the first time have none.
    fn errors(&mut self, flight: &Flight, shot: &Shot, seen: &[PointObservation], camera: usize) -> Vec<f64> {
        let poses = extrinsics().map(|m| shot.pose_w_b * m);
        let mut errors = Vec::new();
        for point in seen {
            let is_new = !self.points.contains_key(&point.track_id);
            if is_new && let Some(c) = (0..2).find(|&c| point.px[c].is_some()) {
                let px = point.px[c].expect("seen");
                self.points.insert(point.track_id, flight.scene.point(&poses[c], &px));
            }
            let p_w = self.points[&point.track_id];
            let truth = model().project(&(poses[camera].inverse() * p_w).coords).expect("ahead");
            if let Some(px) = point.px[camera]
                && (!is_new || camera == 1)
            {
                errors.push((px - truth).norm());
            }
        }
        errors
    }
}

fn rms(errors: &[f64]) -> f64 {
    (errors.iter().map(|e| e * e).sum::<f64>() / errors.len().max(1) as f64).sqrt()
}

fn quantile(errors: &mut [f64], share: f64) -> f64 {
    errors.sort_by(f64::total_cmp);
    errors[((errors.len() - 1) as f64 * share) as usize]
}

/// Root mean square error of plain flow over a shift, at the corners of a random texture.
fn flow_error(noise: f64, gain: f64, offset: f64) -> f64 {
    let shift = Vector2::new(6.37, -4.81);
    let mut errors = Vec::new();
    for seed in 0..4 {
        let (texture, mut random) = (Texture::new(seed), Random::new(seed + 100));
        let mut pyramids = [Vector2::zeros(), shift].map(|s| {
            let (gain, offset) = if s == shift { (gain, offset) } else { (1.0, 0.0) };
            let mut tone = |g: f64| offset + gain * g + noise * random.gaussian();
            let image = texture.render_through(WIDTH, HEIGHT, |p| p - s, &mut tone);
            let mut pyramid = Pyramid::new(WIDTH, HEIGHT, 4);
            assert!(pyramid.build(&image.view()));
            pyramid
        });
        let [before, after] = &mut pyramids;
        let mut detector = CornerDetector::new(WIDTH, HEIGHT, 32, 16, 12.0);
        let options = FlowOptions { top_level: 3, max_iterations: 8 };
        for corner in detector.detect(&before.plane(0), &[], &Demand { wanted: 100, max_new: 100 }) {
            let found =
                track_patch((before, &corner.px), (after, &corner.px), &Matrix2::identity(), &options);
            let moved =
                found.map_or(Vector2::from_element(f64::INFINITY), |f| (f.px - corner.px).cast::<f64>());
            errors.push((moved - shift).norm());
        }
    }
    let count = errors.len();
    errors.retain(|e| *e < 1.0);
    println!("flow: {} of {count} lost", count - errors.len());
    // A shift of 8 px without any guess, on a texture with waves of 7 px.
    assert!(count > 200 && errors.len() * 20 > count * 19);
    rms(&errors)
}

#[test]
fn flow_meets_a_known_shift() {
    let (clean, noisy) = (flow_error(0.0, 1.0, 0.0), flow_error(2.0, 1.0, 0.0));
    println!("flow: {clean:.4} px rms without noise, {noisy:.4} px rms at 2 grey levels");
    assert!(clean < 0.05 && noisy < 0.1, "{clean} {noisy}");
}

/// Errors of the tracks that live through `frames` frames of swaying: at the end, left and right.
fn drift(frames: u64) -> ([f64; 2], usize) {
    let mut flight = Flight::new(Scene::new(11, 2.0).with_noise(2.0), 2);
    let mut judge = Judge::default();
    let mut last = [0.0; 2];
    let mut survivors = 0;
    for frame in 0..frames {
        let shot = sway(frame);
        let seen = flight.shoot(&shot);
        let mut old = seen.clone();
        old.retain(|p| u64::from(p.age) > frame);
        survivors = old.len();
        let (left, right) = (judge.errors(&flight, &shot, &old, 0), judge.errors(&flight, &shot, &old, 1));
        last = [rms(&left), rms(&right)];
    }
    (last, survivors)
}

#[test]
fn the_reference_stops_drift() {
    let (off, survivors) = drift(60);
    println!("after 60 frames, px rms left/right: {off:.3?} ({survivors})");
    assert!(survivors >= 15 && off[0] < 0.15 && off[1] < 0.15, "{survivors} {off:?}");
}

#[test]
fn stereo_is_right_from_far_to_half_a_metre() {
    for depth in [0.5, 1.0, 3.0, 15.0] {
        let mut flight = Flight::new(Scene::new(12, depth).with_noise(1.0), 2);
        let shot = sway(0);
        let seen = flight.shoot(&shot);
        let mut errors = Judge::default().errors(&flight, &shot, &seen, 1);
        let (count, median, worst) = (errors.len(), quantile(&mut errors, 0.5), quantile(&mut errors, 1.0));
        println!(
            "stereo at {depth} m: {count} of {}, median error {median:.3} px, worst {worst:.3}",
            seen.len()
        );
        // At half a metre a quarter of the left image is beyond the right one.
        assert!(count * 2 > seen.len() && median < 0.1 && worst < 1.0, "{depth} {count} {median} {worst}");
    }
}

#[test]
fn a_rig_slightly_off_still_matches() {
    let mut flight = Flight::new(Scene::new(13, 2.0), 2);
    let mut off = extrinsics();
    off[1].rotation *= UnitQuaternion::from_euler_angles(0.003, 0.002, 0.003);
    flight.tracker.set_extrinsics(&off);
    let seen = flight.shoot(&sway(0));
    let stereo = seen.iter().filter(|p| p.px[1].is_some()).count();
    assert!(stereo * 10 > seen.len() * 7, "{stereo} of {}", seen.len());
}

#[test]
fn exposure_may_double_from_frame_to_frame() {
    let mut flight = Flight::new(Scene::new(14, 2.0).with_noise(1.0), 2);
    let (mut kept, mut before) = (Vec::new(), Vec::new());
    for frame in 0..20 {
        let gain = if frame % 2 == 0 { 1.0 } else { 0.5 };
        let seen: Vec<u32> = flight.shoot(&Shot { gain, ..sway(frame) }).iter().map(|p| p.track_id).collect();
        if frame > 0 {
            let again = before.iter().filter(|id| seen.contains(id)).count();
            kept.push(again as f64 / before.len() as f64);
        }
        assert!(seen.len() > 30);
        before = seen;
    }
    assert!(kept.iter().sum::<f64>() / kept.len() as f64 > 0.9, "{kept:?}");
}

#[test]
fn tracks_survive_the_loss_of_the_left_camera() {
    let mut flight = Flight::new(Scene::new(16, 2.0).with_noise(1.0), 2);
    let mut judge = Judge::default();
    let mut before = Vec::new();
    for frame in 0..30 {
        let arrives = [!(10..18).contains(&frame), true];
        let shot = Shot { arrives, ..sway(frame) };
        let seen = flight.shoot(&shot);
        let (left, right) = (judge.errors(&flight, &shot, &seen, 0), judge.errors(&flight, &shot, &seen, 1));
        assert!(rms(&right) < 0.4, "frame {frame}: {}", rms(&right));
        assert_eq!(left.is_empty(), !arrives[0] || frame == 0);
        assert!(rms(&left) < 0.4, "frame {frame}: {}", rms(&left));
        match frame {
            9 => before = seen.iter().filter(|p| p.px[1].is_some()).map(|p| p.track_id).collect(),
            12..30 => {
                let camera = usize::from(frame < 18);
                let alive = |id: &&u32| seen.iter().any(|p| p.track_id == **id && p.px[camera].is_some());
                let kept = before.iter().filter(alive).count();
                assert!(kept * 2 > before.len(), "frame {frame}: {kept} of {}", before.len());
            }
            _ => {}
        }
    }
}

#[test]
fn a_frame_without_images_is_bridged() {
    let mut flight = Flight::new(Scene::new(17, 2.0), 2);
    for frame in 0..5 {
        flight.shoot(&sway(frame));
    }
    assert!(flight.shoot(&Shot { arrives: [false; 2], ..sway(5) }).is_empty());
    let seen = flight.shoot(&sway(6));
    let old = seen.iter().filter(|p| p.age > 5).count();
    assert!(old >= 25, "{old} of {}", seen.len());
}

#[test]
fn images_without_content_or_of_another_size_lose_the_points_and_nothing_else() {
    let mut flight = Flight::new(Scene::new(19, 2.0), 2);
    flight.shoot(&sway(0));
    let names = flight.shoot(&sway(1)).iter().map(|p| p.track_id).max();
    let show = |flight: &mut Flight, image: GrayImage| {
        let input =
            TrackerInput { images: [Some(image.view()); 2], rot_prev_cur: UnitQuaternion::identity() };
        flight.tracker.track(&input, &InTurn, &mut ()).len()
    };
    // An image of another size counts as missing: the tracks wait.
    assert_eq!(show(&mut flight, GrayImage::new(WIDTH + 1, HEIGHT)), 0);
    assert_eq!(show(&mut flight, GrayImage::new(0, 0)), 0);
    assert!(flight.shoot(&sway(2)).iter().filter(|p| p.age > 1).count() > 20);
    for value in [0, 255, 77] {
        let uniform = GrayImage::from_pixels(WIDTH, HEIGHT, vec![value; WIDTH * HEIGHT]).expect("size");
        assert_eq!(show(&mut flight, uniform), 0);
    }
    let after = flight.shoot(&sway(3));
    assert!(after.len() > 30 && after.iter().all(|p| Some(p.track_id) > names && p.age == 1));
}

#[test]
fn dropped_and_reset_tracks_do_not_return() {
    let mut flight = Flight::new(Scene::new(20, 2.0), 2);
    let first = flight.shoot(&sway(0));
    flight.tracker.drop_track(first[3].track_id);
    flight.tracker.drop_track(u32::MAX);
    let second = flight.shoot(&sway(1));
    assert!(second.iter().all(|p| p.track_id != first[3].track_id));
    assert!(second.len() + 10 > first.len());
    flight.tracker.reset();
    let third = flight.shoot(&sway(2));
    let highest = second.iter().map(|p| p.track_id).max();
    assert!(third.len() > 30 && third.iter().all(|p| Some(p.track_id) > highest && p.age == 1));
}

#[test]
fn a_wild_rotation_or_a_singular_rig_does_no_harm() {
    let mut flight = Flight::new(Scene::new(21, 2.0), 2);
    flight.shoot(&sway(0));
    let shot = Shot {
        pose_w_b: sway(1).pose_w_b * Isometry3::rotation(nalgebra::Vector3::new(1.0, 2.0, -1.0)),
        ..sway(1)
    };
    flight.shoot(&shot);
    flight.tracker.set_extrinsics(&[Isometry3::identity(); 2]);
    for frame in 2..5 {
        flight.shoot(&sway(frame));
    }
}

#[test]
fn tracks_survive_a_gyroscope_that_turns_wildly_about_each_axis() {
    for axis in 0..3 {
        for turn_rad in [0.2, -0.2, 0.6] {
            let mut flight = Flight::new(Scene::new(23, 2.0), 2);
            (0..4).for_each(|frame| _ = flight.shoot(&sway(frame)));
            for frame in 4..8 {
                let wrong = Isometry3::rotation(Vector3::ith(axis, turn_rad));
                flight.last_pose_w_b *= wrong;
                let seen = flight.shoot(&sway(frame));
                let old = seen.iter().filter(|p| p.age > 3).count();
                assert!(old >= 25, "{turn_rad} rad about {axis}: {old} of {} in frame {frame}", seen.len());
            }
        }
    }
}

#[test]
fn noisy_images_are_tracked_alike_whether_or_not_their_pyramids_go_round() {
    let noisy = || Scene::new(22, 2.0).with_noise(7.0);
    let mut image = Pyramid::new(WIDTH, HEIGHT, 4);
    assert!(image.build(&noisy().render(&extrinsics()[0], 0.4, 40.0, 1).view()));
    assert!(NoiseWatch::default().is_noisy(&image));
    let (mut kept, mut exchanged) = (Flight::new(noisy(), 2), Flight::new(noisy(), 2));
    let mut others = vec![image; 2];
    for frame in 0..6 {
        let shot = Shot { gain: 0.4, offset: 40.0, ..sway(frame) };
        assert_eq!(kept.shoot(&shot), exchanged.shoot(&shot), "frame {frame}");
        let before = exchanged.tracker.frame() - 1;
        assert!(frame == 0 || exchanged.tracker.exchange_images(before, &mut others) == [true; 2]);
    }
}

#[test]
fn masked_pixels_have_no_points_and_no_mask_changes_nothing_elsewhere() {
    // Left a bar on the right, which tracks walk into; right the upper third.
    let masks = [
        PixelMask::of(WIDTH, HEIGHT, |u, _| u < WIDTH - 90),
        PixelMask::of(WIDTH, HEIGHT, |_, v| 3 * v > HEIGHT),
    ];
    let run = |masks: [Option<&PixelMask>; 2]| {
        let mut flight = Flight::new(Scene::new(5, 3.0), 2);
        flight.tracker.set_masks(masks);
        (0..12).map(|k| flight.shoot(&sway(k))).collect::<Vec<_>>()
    };
    let hidden = |seen: &PointObservation| {
        [0, 1].map(|c| seen.px[c].is_some_and(|px| ImageMask::new(&masks[c], SIDE / 2).hides_px(&px)))
    };
    let [free, masked] = [run([None, None]), run(masks.each_ref().map(Some))];
    let count = |frames: &[Vec<PointObservation>], camera: usize| {
        frames.iter().flatten().filter(|seen| hidden(seen)[camera]).count()
    };
    assert!(count(&free, 0) > 100 && count(&free, 1) > 100);
    assert_eq!([count(&masked, 0), count(&masked, 1)], [0, 0]);
    assert!(masked.iter().all(|frame| frame.len() > 40), "the rest of the image has its points");
    let everything = PixelMask::of(WIDTH, HEIGHT, |_, _| true);
    let same = run([Some(&everything), Some(&everything)]);
    let bits = |frames: &[Vec<PointObservation>]| format!("{frames:?}");
    assert_eq!(bits(&same), bits(&free));
}
