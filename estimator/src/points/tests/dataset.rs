//! Reads the recorded clips (EuRoC layout) as far as the front-end needs them.

use nalgebra::{Isometry3, Matrix3, Quaternion, Rotation3, Translation3, UnitQuaternion, Vector2, Vector3};
use plumbline_config::camera::Distortion;
use plumbline_config::{CameraModel, GrayImage};
use std::fs;
use std::path::PathBuf;

/// The two cameras of the recordings, with their extrinsics.
pub(super) fn euroc_rig() -> ([CameraModel; 2], [Isometry3<f64>; 2]) {
    let camera = |f: [f64; 2], c: [f64; 2], k: [f64; 4]| CameraModel {
        width_px: 752,
        height_px: 480,
        focal_px: Vector2::from(f),
        centre_px: Vector2::from(c),
        distortion: Distortion::RadialTangential { k1: k[0], k2: k[1], p1: k[2], p2: k[3] },
    };
    let models = [
        camera([458.654, 457.296], [367.215, 248.375], [-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05]),
        camera(
            [457.587, 456.134],
            [379.999, 255.238],
            [-0.28368365, 0.07451284, -0.00010473, -3.55590700e-05],
        ),
    ];
    #[rustfmt::skip]
    let left = Matrix3::new(
        0.0148655429818, -0.999880929698, 0.00414029679422,
        0.999557249008, 0.0149672133247, 0.025715529948,
        -0.0257744366974, 0.00375618835797, 0.999660727178,
    );
    #[rustfmt::skip]
    let right = Matrix3::new(
        0.0125552670891, -0.999755099723, 0.0182237714554,
        0.999598781151, 0.0130119051815, 0.0251588363115,
        -0.0253898008918, 0.0179005838253, 0.999517347078,
    );
    let pose = |r: Matrix3<f64>, t: [f64; 3]| {
        let rotation = Rotation3::from_matrix_eps(&r, 1e-12, 100, Rotation3::identity());
        Isometry3::from_parts(
            Translation3::from(Vector3::from(t)),
            UnitQuaternion::from_rotation_matrix(&rotation),
        )
    };
    let poses = [
        pose(left, [-0.0216401454975, -0.064676986768, 0.00981073058949]),
        pose(right, [-0.0198435579556, 0.0453689425024, 0.00786212447038]),
    ];
    (models, poses)
}

/// A recorded clip.
pub(super) struct Clip {
    folder: PathBuf,
    /// Stamps of the left images, ns.
    pub stamps: Vec<i64>,
    gyro: Vec<(i64, Vector3<f64>)>,
    /// Ground truth: pose of the body in the world.
    truth: Vec<(i64, Isometry3<f64>)>,
}

impl Clip {
    /// Opens a clip; `None` when it is not at hand.
    pub(super) fn open(name: &str) -> Option<Self> {
        let folder = plumbline_test_support::shared(&format!("euroc/{name}/mav0"))?;
        let table = |sensor: &str| -> Option<Vec<Vec<String>>> {
            let text = fs::read_to_string(folder.join(sensor).join("data.csv")).ok()?;
            let lines = text.lines().filter(|l| !l.starts_with('#') && !l.trim().is_empty());
            Some(lines.map(|l| l.trim().split(',').map(str::to_owned).collect()).collect())
        };
        let stamps = table("cam0")?.iter().filter_map(|r| r[0].parse().ok()).collect();
        let gyro = table("imu0")?
            .iter()
            .filter_map(|r| {
                let value = |i: usize| r[i].parse::<f64>().ok();
                Some((r[0].parse().ok()?, Vector3::new(value(1)?, value(2)?, value(3)?)))
            })
            .collect();
        let truth = table("state_groundtruth_estimate0").unwrap_or_default().into_iter().filter_map(|r| {
            let v: Vec<f64> = r[1..8].iter().filter_map(|x| x.parse().ok()).collect();
            let rotation = UnitQuaternion::from_quaternion(Quaternion::new(v[3], v[4], v[5], v[6]));
            Some((r[0].parse().ok()?, Isometry3::from_parts(Translation3::new(v[0], v[1], v[2]), rotation)))
        });
        let truth = truth.collect();
        Some(Self { folder, stamps, gyro, truth })
    }

    /// An image; `None` when the clip has none.
    pub(super) fn image(&self, camera: usize, stamp: i64) -> Option<GrayImage> {
        let file = fs::File::open(self.folder.join(format!("cam{camera}/data/{stamp}.png"))).ok()?;
        let mut reader = png::Decoder::new(std::io::BufReader::new(file)).read_info().ok()?;
        let mut pixels = vec![0; reader.output_buffer_size()?];
        let info = reader.next_frame(&mut pixels).ok()?;
        GrayImage::from_pixels(info.width as usize, info.height as usize, pixels)
    }

    /// True pose of the body, interpolated.
    pub(super) fn pose(&self, stamp: i64) -> Option<Isometry3<f64>> {
        let after = self.truth.partition_point(|(t, _)| *t < stamp);
        let ((t0, a), (t1, b)) = (self.truth.get(after.checked_sub(1)?)?, self.truth.get(after)?);
        let share = (stamp - t0) as f64 / (t1 - t0) as f64;
        a.try_lerp_slerp(b, share, 1e-9)
    }

    /// Rotation from the body at `to` to the body at `from`, by the gyroscope less `bias`.
    pub(super) fn rotation(&self, from: i64, to: i64, bias: &Vector3<f64>) -> UnitQuaternion<f64> {
        let mut rotation = UnitQuaternion::identity();
        for pair in self.gyro.windows(2) {
            let (start, end) = (pair[0].0.max(from), pair[1].0.min(to));
            if start < end {
                let rate = (pair[0].1 + pair[1].1) * 0.5 - bias;
                rotation *= UnitQuaternion::from_scaled_axis(rate * ((end - start) as f64 * 1e-9));
            }
        }
        rotation
    }
}
