//! Parts of a calibration: what may be wrong with it, one at a time.

use super::rig::{
    ACCEL, ALTERNATING, CALIBRATION, CLOCK_RATE, DELAY, GYRO, LENSES, P_B_C, P_PAIR, READOUT, RIGHT_LATE,
    ROT_B_C, ROT_PAIR,
};
use nalgebra::{DMatrix, Vector3};
use plumbline_config::Config;

/// A part of a calibration: directions in which it may change.
pub(crate) struct Part {
    pub(crate) name: &'static str,
    pub(crate) basis: DMatrix<f64>,
    /// Columns of it that count; the others are free beside them.
    pub(crate) counted: usize,
    /// Parts of one subject are not free at once.
    pub(crate) subject: usize,
    /// One standard deviation of what a careful calibration is worth, and which an estimator bears.
    pub(crate) worth: f64,
    /// Unit of the values, and its size.
    pub(crate) unit: (&'static str, f64),
    pub(crate) cure: &'static str,
    /// Motion that shows it, where no flight should begin without.
    pub(crate) motion: Option<&'static str>,
    /// Whether it is a line of its own where nothing is wrong with it.
    pub(crate) is_listed: bool,
}

const TURN: &str = "turn it by hand about all three axes for ten seconds, with texture in view";
const SHAKE: &str = "move it to and fro along all three axes by half a metre, once a second, for ten seconds";
const CAMERAS: &str = "calibrate the camera again (`plumbline calibrate camera`), with the lens, focus and image size of this recording";
const PAIR: &str =
    "calibrate the pair again: a camera has been knocked, or its extrinsics are of another rig";
const MOUNT: &str = "correct `camera.pose_b_c`, or run `plumbline calibrate rig`";
const COLUMNS: &str = "put columns, signs and unit of the sensor in order, or the extrinsics right";

/// The parts that the rig of a configuration has.
pub(crate) fn parts(config: &Config) -> Vec<Part> {
    let [left, right] = LENSES;
    let sigmas = &config.rig;
    let one = |k: usize| vec![vec![(k, 1.0)]];
    let span = |from: usize, count: usize| (from..from + count).map(|k| vec![(k, 1.0)]).collect::<Vec<_>>();
    let both = |k: usize| vec![(left + k, 1.0), (right + k, 1.0)];
    let diagonal = |at: usize| vec![vec![(at, 1.0), (at + 4, 1.0), (at + 8, 1.0)]];
    let part = |name, subject, columns: Vec<Vec<(usize, f64)>>, worth: f64, unit, cure, motion| {
        let mut basis = DMatrix::zeros(CALIBRATION, columns.len());
        for (column, entries) in columns.iter().enumerate() {
            entries.iter().for_each(|(row, value)| basis[(*row, column)] = *value);
        }
        Part { name, counted: columns.len(), basis, subject, worth, unit, cure, motion, is_listed: true }
    };
    // A delay comes with it.
    let with_delay = |mut part: Part| {
        part.basis = part.basis.insert_column(1, 0.0);
        part.basis[(DELAY, 1)] = 1.0;
        part
    };
    let hidden = |mut part: Part| {
        part.is_listed = false;
        part
    };
    let (share, px, mrad, mm, ms) = (("%", 1e2), ("px", 1.0), ("mrad", 1e3), ("mm", 1e3), ("ms", 1e3));
    // A careful calibration repeats to a thousandth of the focal length and to a pixel of its centre.
    let (focal, centre) = (sigmas.camera_focal_sigma.max(1e-3), sigmas.camera_centre_sigma_px.max(1.0));
    let rotation = sigmas.camera_imu_rotation_sigma_rad.max(3e-3);
    let place = sigmas.camera_imu_translation_sigma_m.max(5e-3);
    let offset_s = sigmas.time_offset_sigma_s.max(1e-3);
    let scales = [config.imu.gyro_scale_sigma.max(5e-3), config.imu.accel_scale_sigma.max(1e-2)];
    let mut all = vec![
        part("focal length", 0, vec![both(0)], focal, share, CAMERAS, Some(TURN)),
        part("focal length by fx / fy", 1, vec![both(1)], 2.0 * focal, share, CAMERAS, None),
        part(
            "lens model",
            2,
            vec![both(4)],
            5e-3,
            ("of r^3", 1.0),
            "use the lens model and the coefficients of this camera",
            None,
        ),
        part("principal point", 3, vec![both(2), both(3)], 2.0 * centre, px, CAMERAS, None),
        part("camera-IMU rotation", 4, span(ROT_B_C, 3), rotation, mrad, MOUNT, Some(TURN)),
        part("camera-IMU position", 5, span(P_B_C, 3), 2.0 * place, mm, MOUNT, None),
        part("time offset", 6, one(DELAY), offset_s, ms, "set `rig.time_offset_s` to the sum", Some(TURN)),
        // Two crystals differ by 100 ppm at most (data sheets: 50 ppm each over temperature).
        with_delay(part(
            "clock rate",
            7,
            one(CLOCK_RATE),
            5e-5,
            ("ppm", 1e6),
            "stamp samples and images by one clock: that of the IMU runs at another rate than the images' clock, so the delay grows \
             all the time; samples that are counted need the rate that is delivered",
            None,
        )),
        with_delay(part(
            "even and odd frames",
            8,
            one(ALTERNATING),
            1e-3,
            ms,
            "every other frame is stamped late: stamp each in the middle of its own exposure",
            None,
        )),
        part("readout", 9, one(READOUT), 2e-3, ms, "set `camera.readout_s`", None),
        part("gyroscope scale", 10, diagonal(GYRO), scales[0], share, COLUMNS, None),
        part("gyroscope axes", 10, span(GYRO, 9), 3.0 * scales[0], share, COLUMNS, None),
        part("accelerometer scale", 11, diagonal(ACCEL), scales[1], share, COLUMNS, Some(SHAKE)),
        part("accelerometer axes", 11, span(ACCEL, 9), 3.0 * scales[1], share, COLUMNS, None),
    ];
    if let [a, b] = config.camera.as_slice() {
        let along: Vector3<f64> = (a.pose_b_c().inverse() * b.pose_b_c()).translation.vector;
        let baseline = vec![(0..3).map(|k| (P_PAIR + k, along[k])).collect()];
        let pair_rad = sigmas.camera_camera_rotation_sigma_rad.max(1e-3);
        all.push(part("camera-camera rotation", 12, span(ROT_PAIR, 3), pair_rad, mrad, PAIR, None));
        all.push(part(
            "baseline",
            13,
            baseline,
            1e-2,
            share,
            "correct the distance between the cameras",
            Some(SHAKE),
        ));
        all.push(part(
            "right camera's delay",
            14,
            one(RIGHT_LATE),
            5e-4,
            ms,
            "trigger both cameras together; look at which frames the driver pairs: left and right are not of the same moment",
            None,
        ));
        all.extend(
            [
                part("left focal length", 0, one(left), focal, share, CAMERAS, None),
                part("right focal length", 0, one(right), focal, share, CAMERAS, None),
                part("left principal point", 3, span(left + 2, 2), centre, px, CAMERAS, None),
                part("right principal point", 3, span(right + 2, 2), centre, px, CAMERAS, None),
                part("left lens model", 2, one(left + 4), 5e-3, ("of r^3", 1.0), CAMERAS, None),
                part("right lens model", 2, one(right + 4), 5e-3, ("of r^3", 1.0), CAMERAS, None),
                part("camera-camera position", 13, span(P_PAIR, 3), 1e-2 * along.norm(), mm, PAIR, None),
            ]
            .map(hidden),
        );
    }
    all
}
