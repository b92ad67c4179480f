//! Pictures have the bits that they had: figures of earlier flights hold, and a flight is the same on every processor.

use super::*;

/// FNV-1a over frames all over the flight of the preset `sim`, left before right; `counted_render` prints the same.
fn digest(scene: Scene) -> u64 {
    const FRAMES: u64 = 20;
    const STRIDE: u64 = 31;
    let config = Config::preset("sim").unwrap().into_inner();
    let duration_s = (FRAMES * STRIDE) as f64 / config.camera[0].rate_hz;
    let simulator = Simulator::new(&config, &Scenario { scene, duration_s, ..Scenario::default() }).unwrap();
    let (mut scratch, mut frame) = (simulator.scratch(), StereoFrame::new(simulator.image_sizes()));
    let mut digest = 0xcbf2_9ce4_8422_2325_u64;
    for number in 0..FRAMES {
        simulator.render_frame(STRIDE * number, &mut scratch, &mut frame);
        for pixel in frame.images.iter().flat_map(|image| image.pixels()) {
            digest = (digest ^ u64::from(*pixel)).wrapping_mul(0x0100_0000_01b3);
        }
    }
    digest
}

#[test]
fn a_room_looks_as_ever() {
    assert_eq!(digest(Scene::Room), 0xe644_ed42_2a7b_568a);
}

#[test]
fn a_hall_looks_as_ever() {
    assert_eq!(digest(Scene::Hall), 0x7948_5414_363d_8d84);
}

#[test]
fn plain_walls_look_as_ever() {
    assert_eq!(digest(Scene::LowTexture), 0xf3bf_1c94_2ffa_7c50);
}
