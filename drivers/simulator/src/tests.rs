//! Tests of the whole simulator.

use super::*;
use nalgebra::Vector3;
use plumbline_drivers::{ImuReading, StereoSource};

/// A short flight of the wobbling body in `scene`, through a perfect camera.
fn short_flight(scene: Scene, seed: u64, effects: Effects) -> Simulator {
    short_flight_in(1.0, scene, seed, effects)
}

/// A flight of two seconds in images of this scale.
fn short_flight_in(resolution_scale: f64, scene: Scene, seed: u64, effects: Effects) -> Simulator {
    let dir = tempfile::tempdir().unwrap();
    let file = dir.path().join("wobble.tum");
    plumbline_drivers::tum::write_tum(&file, &fixture::wobble_poses(3.0)).unwrap();
    let scenario = Scenario {
        scene,
        path: FlightPath::Tum(file),
        duration_s: 2.0,
        seed,
        effects,
        resolution_scale,
        ..Scenario::default()
    };
    Simulator::new(&fixture::config(), &scenario).unwrap()
}

fn render(simulator: &Simulator, index: u64) -> StereoFrame {
    let mut frame = StereoFrame::new(simulator.image_sizes());
    simulator.render_frame(index, &mut simulator.scratch(), &mut frame);
    frame
}

/// Grey level at `px`, between pixels by interpolation.
pub(super) fn grey(image: &GrayImage, px: &Vector2<f64>) -> f64 {
    let (u, v) = (px.x.floor(), px.y.floor());
    let at = |du: usize, dv: usize| {
        let (x, y) = ((u as usize + du).min(image.width() - 1), (v as usize + dv).min(image.height() - 1));
        f64::from(image.pixels()[y * image.width() + x])
    };
    let (fu, fv) = (px.x - u, px.y - v);
    let upper = at(0, 0) + (at(1, 0) - at(0, 0)) * fu;
    let lower = at(0, 1) + (at(1, 1) - at(0, 1)) * fu;
    upper + (lower - upper) * fv
}

/// Pixel of `camera` at which a point of the world is at `time`, if it is in view and not hidden.
fn sees(simulator: &Simulator, time: Timestamp, camera: usize, p_w: &Vector3<f64>) -> Option<Vector2<f64>> {
    let lens = &simulator.inner.cameras[camera].0;
    let p_c = simulator.pose_w_c(time, lens).inverse_transform_point(&(*p_w).into());
    let px = lens.model.project(&p_c.coords).filter(|px| lens.model.contains(px, 0.0))?;
    let hit = simulator.first_hit(time, camera, &px)?;
    ((hit.p_w - p_w).norm() < 1e-4 * (1.0 + p_c.z)).then_some(px)
}

const SCENES: [Scene; 3] = [Scene::Room, Scene::Hall, Scene::LowTexture];

/// Pixels in a grid over an image.
fn grid() -> impl Iterator<Item = Vector2<f64>> {
    (0..40 * 25).map(|i| Vector2::new(20.0 + f64::from(i % 40) * 18.0, 20.0 + f64::from(i / 40) * 18.0))
}

/// Mean difference of grey levels between two images after warping by the true geometry, and the share
/// of pixels that were seen in both.
fn photometric_error(simulator: &Simulator, from: (u64, usize), to: (u64, usize)) -> (f64, f64) {
    let (a, b) = (render(simulator, from.0), render(simulator, to.0));
    let (mut sum, mut count, mut all) = (0.0, 0.0, 0.0);
    for px in grid() {
        all += 1.0;
        let Some(hit) = simulator.first_hit(simulator.frame_time(from.0), from.1, &px) else { continue };
        let Some(there) = sees(simulator, simulator.frame_time(to.0), to.1, &hit.p_w) else { continue };
        sum += (grey(&a.images[from.1], &px) - grey(&b.images[to.1], &there)).abs();
        count += 1.0;
    }
    (sum / count, count / all)
}

#[test]
fn both_cameras_and_frames_from_two_poses_show_the_same_world() {
    for scene in SCENES {
        let simulator = short_flight(scene, 1, Effects::none());
        // To the right camera, and 0.15 s later.
        for (to, most) in [((5, 1), 3.5), ((8, 0), 5.0)] {
            let (error, share) = photometric_error(&simulator, (5, 0), to);
            println!("{scene:?} to {to:?}: {error:.2} grey levels over {:.0} %", 100.0 * share);
            assert!(error < most && share > 0.5, "{scene:?} to {to:?}: {error} {share}");
        }
    }
}

/// The mean of 8x8 exact rays through a pixel, with the finest level of the patterns and no filter.
pub(super) fn by_rays(
    world: &World,
    lens: &Lens,
    pose_w_c: &Isometry3<f64>,
    px: &Vector2<f64>,
) -> Option<f64> {
    let mut sum = 0.0;
    for k in 0..64 {
        let part = |i: i32| (f64::from(i) + 0.5) / 8.0 - 0.5;
        let ray = pose_w_c.rotation * lens.ray(&(px + Vector2::new(part(k % 8), part(k / 8))))?;
        let hit = world.first_hit(&pose_w_c.translation.vector, &ray)?;
        let surface = &world.surfaces[hit.surface];
        let (_, s, t) = surface.hit(&pose_w_c.translation.vector, &ray)?;
        let (s, t) = (s as f32, t as f32);
        let none = [0.0];
        let spot = texture::Footprints {
            u: [surface.texel_origin[0] + s * surface.texels[0]],
            v: [surface.texel_origin[1] + t * surface.texels[1]],
            u_right: none,
            v_right: none,
            u_down: none,
            v_down: none,
        };
        let texture = surface.finish.material.texture();
        let value = texture.means(&texture.plan(&spot))[0] / 255.0;
        let albedo = surface.finish.dark + (surface.finish.bright - surface.finish.dark) * value;
        sum += f64::from(albedo * surface.light.at(&[s], &[t])[0]) / 64.0;
    }
    Some(sum)
}

/// Some of the pixels whose neighbours see another surface.
fn edge_pixels(renderer: &Renderer, lens: &Lens) -> Vec<Vector2<f64>> {
    let surface = |u: usize, v: usize| renderer.surface_at(lens, u, v);
    let places = (0..748 * 476).step_by(7).map(|i| (2 + i % 748, 2 + i / 748));
    let on_edge = |&(u, v): &(usize, usize)| {
        surface(u - 1, v) != surface(u + 1, v) || surface(u, v - 1) != surface(u, v + 1)
    };
    places.filter(on_edge).map(|(u, v)| Vector2::new(u as f64, v as f64)).collect()
}

/// The image agrees with exact rays, and a Gauss-Newton step for a common shift finds none.
#[test]
fn images_are_true_to_a_hundredth_of_a_pixel() {
    for (scene, largest_rms) in [(Scene::Room, 2.5), (Scene::LowTexture, 2.5)] {
        let simulator = short_flight(scene, 1, Effects::none());
        let (inner, lens) = (&simulator.inner, &simulator.inner.cameras[0].0);
        let mut renderer = Renderer::new(inner.world.surfaces.len(), (752, 480));
        let mut light = vec![0.0; 752 * 480];
        let (mut normal, mut right) = (nalgebra::Matrix2::zeros(), Vector2::zeros());
        let (mut square, mut count) = (0.0, 0.0);
        for frame in [2, 12, 22, 32] {
            let pose_w_c = simulator.pose_w_c(simulator.frame_time(frame), lens);
            renderer.render(&inner.world, lens, &[Shot::at(pose_w_c)], &mut light);
            let edges = edge_pixels(&renderer, lens);
            for px in if scene == Scene::LowTexture { edges } else { grid().collect() } {
                let at = |u: usize, v: usize| {
                    f64::from(light[(px.y as usize + v - 1) * 752 + px.x as usize + u - 1])
                };
                let slope = 0.5 * Vector2::new(at(2, 1) - at(0, 1), at(1, 2) - at(1, 0));
                let error = by_rays(&inner.world, lens, &pose_w_c, &px).unwrap() - at(1, 1);
                normal += slope * slope.transpose();
                right += slope * error;
                square += error * error;
                count += 1.0;
            }
        }
        let shift = normal.try_inverse().unwrap() * right;
        let rms = f64::sqrt(square / count);
        println!("{scene:?}: shift {:.4} {:.4} px, rms {rms:.2} grey levels", shift.x, shift.y);
        assert!(shift.norm() < 0.01 && rms < largest_rms, "{scene:?}: {shift} {rms}");
    }
}

#[test]
fn the_renderer_sees_what_rays_see() {
    let simulator = short_flight(Scene::Room, 2, Effects::none());
    let inner = &simulator.inner;
    let lens = &inner.cameras[0].0;
    let pose_w_c = simulator.pose_w_c(simulator.frame_time(3), lens);
    let mut renderer = Renderer::new(inner.world.surfaces.len(), (752, 480));
    renderer.render(&inner.world, lens, &[Shot::at(pose_w_c)], &mut vec![0.0; 752 * 480]);
    let mut different = 0;
    for px in grid() {
        let hit = simulator.first_hit(simulator.frame_time(3), 0, &px).unwrap();
        let seen = renderer.surface_at(lens, px.x as usize, px.y as usize);
        different += usize::from(seen != Some(hit.surface));
    }
    assert!(different <= 2, "{different} of 1000 pixels");
}

#[test]
fn the_same_seed_gives_the_same_bits_in_any_order() {
    let effects = Effects { exposure_s: 0.004, ..Effects::default() };
    let [one, two] = [7; 2].map(|seed| short_flight_in(0.5, Scene::Room, seed, effects));
    let mut stream = one.stereo();
    let mut frame = StereoFrame::new(one.image_sizes());
    let mut frames = Vec::new();
    while frames.len() < 4 && stream.next_frame(&mut frame).unwrap() {
        frames.push(frame.clone());
    }
    for index in [2, 0, 3, 1] {
        let again = render(&two, index);
        let first = &frames[index as usize];
        assert_eq!((again.stamp, again.sequence), (first.stamp, first.sequence));
        assert!(again.images == first.images, "frame {index}");
    }
    let other = short_flight_in(0.5, Scene::Room, 8, effects);
    assert!(render(&other, 0).images[0] != frames[0].images[0]);
}

#[test]
fn frames_that_would_come_too_late_are_passed_over() {
    let simulator = short_flight(Scene::Room, 7, Effects::none());
    let mut stream = simulator.stereo();
    let mut frame = StereoFrame::new(simulator.image_sizes());
    assert!(stream.next_frame(&mut frame).unwrap());
    assert_eq!(stream.skip_to(simulator.frame_stamp(1)), 0);
    assert_eq!(stream.skip_to(simulator.frame_stamp(3).plus_nanos(1)), 3);
    assert!(stream.next_frame(&mut frame).unwrap());
    assert_eq!((frame.sequence, frame.stamp), (4, simulator.frame_stamp(4)));
    let left = simulator.frame_count() - 5;
    assert_eq!(stream.skip_to(Timestamp::MAX), left);
    assert!(!stream.next_frame(&mut frame).unwrap());
}

#[test]
fn furniture_keeps_clear_of_the_flight() {
    let files: &[&str] = &["V1_02_medium", "V2_02_medium", "MH_04_difficult"];
    let mut flights =
        vec![fixture::wobble(3.0), path::flown(40.0, &Isometry3::identity(), path::demo).unwrap()];
    for name in files {
        let Some(file) = plumbline_test_support::shared(&format!("euroc/trajectories/{name}.tum.gz")) else {
            continue;
        };
        flights.push(Trajectory::from_poses(&plumbline_drivers::tum::read_tum(&file).unwrap()).unwrap());
    }
    for flight in &flights {
        for (scene, seed) in SCENES.into_iter().zip(1..) {
            let path: Vec<_> = flight.positions(PATH_STEP_S).collect();
            let world = scenes::build(scene, seed, &path, Surroundings::Usual);
            let low = path.iter().map(|p| p.z).fold(f64::MAX, f64::min);
            for p in flight.positions(0.2) {
                for surface in &world.surfaces {
                    let local = p - surface.origin;
                    let s = (local.dot(&surface.edge_u) / surface.edge_u.norm_squared()).clamp(0.0, 1.0);
                    let t = (local.dot(&surface.edge_v) / surface.edge_v.norm_squared()).clamp(0.0, 1.0);
                    let distance = (local - surface.edge_u * s - surface.edge_v * t).norm();
                    // The floor and what lies flat on it.
                    let top = [surface.edge_u, surface.edge_v].map(|e| e.z.max(0.0)).iter().sum::<f64>();
                    let floor = surface.origin.z + top < low - 0.09;
                    assert!(distance > if floor { 0.09 } else { 0.5 }, "{scene:?}: {distance}");
                }
            }
        }
    }
}

#[test]
fn inertial_samples_surround_the_images() {
    let simulator = short_flight(Scene::Room, 1, Effects::none());
    let mut imu = simulator.imu();
    let mut readings = Vec::new();
    while let Some(reading) = imu.next_reading().unwrap() {
        readings.push(reading);
    }
    let last = simulator.frame_time(simulator.frame_count() - 1);
    assert_eq!(simulator.frame_count(), 40);
    assert!(readings[0].sample.stamp <= simulator.frame_time(0).plus_seconds(-0.09));
    assert!(readings[readings.len() - 1].sample.stamp >= last.plus_seconds(0.09));
    assert!(readings.windows(2).all(|r| r[0].sample.stamp < r[1].sample.stamp));
    assert_eq!(simulator.truth().count(), readings.len());
}

#[test]
fn darkness_and_the_time_offset_are_seen() {
    let effects = Effects { blackout: Some((1.5, 1.8)), time_offset_s: 0.01, ..Effects::default() };
    let simulator = short_flight_in(0.3, Scene::Room, 5, effects);
    let mut stereo = simulator.stereo();
    let mut frame = StereoFrame::new(simulator.image_sizes());
    while stereo.next_frame(&mut frame).unwrap() {
        let time_s = 0.05 * frame.sequence as f64;
        assert_eq!(frame.stamp, simulator.frame_time(frame.sequence).plus_nanos(-10_000_000));
        let dark = frame.images[0].pixels().iter().all(|&p| p < 12);
        assert_eq!(dark, (1.5 - 1e-6..1.8 - 1e-6).contains(&time_s), "{time_s}");
    }
}

#[test]
fn motion_blur_softens_and_scale_shrinks() {
    let sharpness = |exposure_s: f64| {
        let effects = Effects { exposure_s, sub_exposures: 6, ..Effects::none() };
        let image = &render(&short_flight(Scene::Room, 1, effects), 10).images[0];
        image.pixels().windows(2).map(|p| f64::from(p[0].abs_diff(p[1]))).sum::<f64>()
    };
    assert!(sharpness(0.03) < 0.8 * sharpness(0.0));
    let scenario = Scenario { resolution_scale: 0.5, duration_s: 1.0, ..Scenario::default() };
    let simulator = Simulator::new(&fixture::config(), &scenario).unwrap();
    assert_eq!(simulator.image_sizes(), [(376, 240); 2]);
    let full = fixture::config().camera[0].model();
    let half = simulator.config().camera[0].model();
    let ray = nalgebra::Vector3::new(0.2, -0.1, 1.0);
    let (a, b) = (full.project(&ray).unwrap(), half.project(&ray).unwrap());
    assert!(((a.add_scalar(0.5)) * 0.5 - b.add_scalar(0.5)).norm() < 1e-9);
}

#[test]
fn impossible_flights_are_refused_with_a_reason() {
    let base = Scenario { duration_s: 1.0, ..Scenario::default() };
    let cases = [
        Scenario { duration_s: f64::INFINITY, ..base.clone() },
        Scenario { duration_s: f64::NAN, ..base.clone() },
        Scenario { start_s: -1.0, ..base.clone() },
        Scenario { resolution_scale: 0.0, ..base.clone() },
        Scenario { effects: Effects { gain: 0.0, ..Effects::none() }, ..base.clone() },
    ];
    for scenario in cases {
        assert!(matches!(Simulator::new(&fixture::config(), &scenario), Err(DriverError::Scenario(_))));
    }
    let missing = Scenario { path: FlightPath::Tum("no/such/file.tum".into()), ..base };
    assert!(
        Simulator::new(&fixture::config(), &missing).unwrap_err().to_string().contains("no/such/file.tum")
    );
}

/// Corners that a tracker would find: cells of 42 px whose best Shi-Tomasi score is high enough.
#[test]
fn corners_are_plentiful_in_texture_and_scarce_without() {
    let mean_corners = |scene| {
        let simulator = short_flight(scene, 1, Effects::default());
        let frames = [0, 10, 20, 30];
        frames.iter().map(|&k| corner_cells(&render(&simulator, k).images[0])).sum::<usize>() as f64 / 4.0
    };
    let [room, hall, plain] = SCENES.map(mean_corners);
    println!("of 187 cells with a corner: room {room}, hall {hall}, low texture {plain}");
    assert!(room > 150.0 && hall > 140.0 && (25.0..110.0).contains(&plain));
}

pub(super) fn corner_cells(image: &GrayImage) -> usize {
    const CELL: usize = 42;
    let width = image.width();
    let p = |x: usize, y: usize| f64::from(image.pixels()[y * width + x]);
    let score = |x: usize, y: usize| {
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for v in y - 2..=y + 2 {
            for u in x - 2..=x + 2 {
                let (gx, gy) = (0.5 * (p(u + 1, v) - p(u - 1, v)), 0.5 * (p(u, v + 1) - p(u, v - 1)));
                xx += gx * gx / 25.0;
                xy += gx * gy / 25.0;
                yy += gy * gy / 25.0;
            }
        }
        0.5 * (xx + yy) - (0.25 * (xx - yy) * (xx - yy) + xy * xy).sqrt()
    };
    let cells = (0..image.height() / CELL).flat_map(|j| (0..width / CELL).map(move |i| (i * CELL, j * CELL)));
    cells
        .filter(|&(x, y)| {
            let inner = |k: usize| (3..CELL - 3).map(move |d| k + d);
            inner(y).any(|v| inner(x).any(|u| score(u, v) > 12.0))
        })
        .count()
}

#[test]
fn recorded_samples_are_handed_out_as_they_are() {
    let Some(path) = plumbline_test_support::shared("euroc/trajectories/V1_02_medium.tum.gz") else { return };
    let file = recorded_along(&path);
    let scenario = Scenario {
        path: FlightPath::Tum(path),
        start_s: 15.0,
        duration_s: 3.0,
        inertial: Inertial::Recorded(file.clone()),
        ..Scenario::default()
    };
    let mut imu = Simulator::new(&fixture::config(), &scenario).unwrap().imu();
    let flown: Vec<ImuReading> = std::iter::from_fn(|| imu.next_reading().unwrap()).collect();
    let rows = plumbline_drivers::euroc::read_imu_samples(&file).unwrap();
    let from = rows.iter().position(|row| *row == flown[0].sample).unwrap();
    assert!((638..=642).contains(&flown.len()), "{}", flown.len());
    assert!(flown.iter().zip(&rows[from..]).all(|(reading, row)| reading.sample == *row));
}

#[test]
fn recorded_samples_take_no_simulated_errors() {
    let scenario = Scenario {
        path: FlightPath::Tum("path.tum".into()),
        inertial: Inertial::Recorded("imu.csv".into()),
        imu: ImuEffects { scale_error: 0.01, ..ImuEffects::default() },
        ..Scenario::default()
    };
    let error = Simulator::new(&fixture::config(), &scenario).unwrap_err();
    assert!(error.to_string().contains("errors of their sensor"), "{error}");
}

#[test]
fn leaning_scene_tilts_about_the_path_and_leaves_truth_and_samples() {
    let base = Scenario { duration_s: 2.0, resolution_scale: 0.2, ..Scenario::default() };
    let leaning = Scenario { lean_deg: 0.2, ..base.clone() };
    let [plain, leaning] = [base, leaning].map(|s| Simulator::new(&fixture::config(), &s).unwrap());
    let at = plain.frame_time(10);
    assert_eq!(plain.ground_truth(at).pose_w_b, leaning.ground_truth(at).pose_w_b);
    assert_eq!(plain.imu().next_reading().unwrap(), leaning.imu().next_reading().unwrap());
    let uprights = |s: &Simulator| {
        let edges = s.inner.world.surfaces.iter().map(|surface| surface.edge_v.normalize());
        edges.filter(|edge| edge.z.abs() > 0.999).collect::<Vec<_>>()
    };
    let (upright, leaning) = (uprights(&plain), uprights(&leaning));
    assert!(upright.len() > 10 && upright.len() == leaning.len());
    for (a, b) in upright.iter().zip(&leaning) {
        assert!((a.angle(b).to_degrees() - 0.2).abs() < 1e-6);
    }
}
