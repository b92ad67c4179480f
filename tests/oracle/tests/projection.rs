//! Our kernels against OpenCV's on the same input.

use nalgebra::{Vector2, Vector3};
use opencv::calib3d;
use opencv::core::{Mat, Point2d, Point3d, Scalar, Vector};
use plumbline_config::Config;

fn project_by_opencv(config: &Config, camera: usize, point: &Vector3<f64>) -> Vector2<f64> {
    let c = &config.camera[camera];
    let plumbline_config::camera::Distortion::RadialTangential { k1, k2, p1, p2 } = c.distortion else {
        panic!("the preset has radial-tangential lenses");
    };
    let points: Vector<Point3d> = Vector::from(vec![Point3d::new(point.x, point.y, point.z)]);
    let zero = Mat::new_rows_cols_with_default(3, 1, opencv::core::CV_64F, Scalar::all(0.0)).unwrap();
    let k = Mat::from_slice_2d(&[
        [c.focal_px[0], 0.0, c.centre_px[0]],
        [0.0, c.focal_px[1], c.centre_px[1]],
        [0.0, 0.0, 1.0],
    ])
    .unwrap();
    let distortion: Vector<f64> = Vector::from(vec![k1, k2, p1, p2]);
    let mut pixels: Vector<Point2d> = Vector::new();
    calib3d::project_points(
        &points,
        &zero,
        &zero,
        &k,
        &distortion,
        &mut pixels,
        &mut opencv::core::no_array(),
        0.0,
    )
    .unwrap();
    let px = pixels.get(0).unwrap();
    Vector2::new(px.x, px.y)
}

#[test]
fn projection_is_that_of_opencv() {
    let config = Config::preset("euroc").unwrap();
    for camera in 0..2 {
        let model = config.camera[camera].model();
        for i in -4..=4 {
            for j in -3..=3 {
                let p_c = Vector3::new(f64::from(i) * 0.4, f64::from(j) * 0.4, 2.0);
                let ours = model.project(&p_c).unwrap();
                assert!((ours - project_by_opencv(&config, camera, &p_c)).norm() < 1e-9);
            }
        }
    }
}
