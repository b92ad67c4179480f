//! Parts of a calibration: what may be wrong with it, one at a time.

use super::rig::{
    self, ACCEL, ALTERNATING, CALIBRATION, DELAY, GYRO, LENSES, P_B_C, P_PAIR, READOUT, RIGHT_LATE, ROT_B_C,
    ROT_PAIR,
};
use nalgebra::{DMatrix, Vector3};
use plumbline_config::Config;

/// Over what a part changes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd)]
pub(crate) enum Course {
    Constant,
    Thirds,
    Pieces,
}

/// A part of a calibration: directions in which it may change.
pub(crate) struct Part {
    pub(crate) name: &'static str,
    pub(crate) basis: DMatrix<f64>,
    /// Columns of it that count; the others are free beside them.
    pub(crate) counted: usize,
    /// Over what it may change.
    pub(crate) courses: &'static [Course],
    /// Parts of one subject are not free at once.
    pub(crate) subject: usize,
    /// One standard deviation of what a careful calibration is worth, and which an estimator bears.
    pub(crate) worth: f64,
    /// Unit of the values, and its size.
    pub(crate) unit: (&'static str, f64),
    /// Cure, or the key with what it says.
    pub(crate) cure: &'static str,
    pub(crate) configured: Option<f64>,
    /// Motion that shows it, where no flight should begin without.
    pub(crate) motion: Option<&'static str>,
    /// Whether it is a line of its own where nothing is wrong with it.
    pub(crate) is_listed: bool,
}

/// Names of parts that a calibration of the cameras on the IMU frees.
pub(crate) const CAMERA_IMU_ROTATION: &str = "camera-IMU rotation";
pub(crate) const CAMERA_IMU_POSITION: &str = "camera-IMU position";
pub(crate) const TIME_OFFSET: &str = "time offset";
pub(crate) const READOUT_TIME: &str = "readout";
/// Name of the part that explains another rate of the samples.
pub(crate) const CLOCK_RATE: &str = "clock rate";

const COURSES: [Course; 3] = [Course::Constant, Course::Thirds, Course::Pieces];
pub(crate) const TURN: &str = "turn it by hand about all three axes for ten seconds, with texture in view";
const SHAKE: &str = "move it to and fro along all three axes by half a metre, once a second, for ten seconds";
const CAMERAS: &str = "calibrate the camera again (`plumbline calibrate camera`), with the lens, focus and image size of this recording";
const LENS: &str = "use the lens model and the coefficients of this camera";
const PAIR: &str =
    "calibrate the pair again: a camera has been knocked, or its extrinsics are of another rig";
const BASELINE: &str = "correct the distance between the cameras";
const MOUNT: &str = "correct `camera.0.pose_b_c`, or run `plumbline calibrate rig`";
const COLUMNS: &str = "put columns, signs and unit of the sensor in order, or the extrinsics right";
const CLOCKS: &str = "stamp samples and images by one clock: that of the IMU runs at another rate than the images' clock, so the delay grows \
                      all the time; samples that are counted need the rate that is delivered";
const IN_TURN: &str = "every other frame is stamped late: stamp each in the middle of its own exposure";
const TRIGGER: &str = "trigger both cameras together; look at which frames the driver pairs: left and right are not of the same moment";

/// The parts that the rig of a configuration has.
pub(crate) fn parts(config: &Config) -> Vec<Part> {
    let [left, right] = LENSES;
    let sigmas = &config.rig;
    let span = |from: usize, count: usize| (from..from + count).map(|k| vec![(k, 1.0)]).collect::<Vec<_>>();
    let one = |k: usize| span(k, 1);
    let both = |k: usize| vec![(left + k, 1.0), (right + k, 1.0)];
    let diagonal = |at: usize| vec![vec![(at, 1.0), (at + 4, 1.0), (at + 8, 1.0)]];
    let part = |name, subject, columns: Vec<Vec<(usize, f64)>>, worth: f64, unit, cure, motion| {
        let mut basis = DMatrix::zeros(CALIBRATION, columns.len());
        for (column, entries) in columns.iter().enumerate() {
            entries.iter().for_each(|(row, value)| basis[(*row, column)] = *value);
        }
        let (counted, courses) = match columns.len() {
            1 => (1, &COURSES[..]),
            counted => (counted, &COURSES[..2]),
        };
        let (configured, is_listed) = (None, true);
        Part { name, counted, courses, basis, subject, worth, unit, cure, configured, motion, is_listed }
    };
    // A delay comes with it.
    let with_delay = |part: Part| {
        let mut basis = part.basis.insert_column(1, 0.0);
        basis[(DELAY, 1)] = 1.0;
        Part { basis, courses: &COURSES[..1], ..part }
    };
    let hidden = |part: Part| Part { is_listed: false, ..part };
    // What moves within the pieces too.
    let moving = |name, columns, worth| {
        let part = part(name, 0, columns, worth, ("%", 1e2), CAMERAS, None);
        Part { courses: &COURSES[2..], ..hidden(part) }
    };
    let key = |configured: f64, part: Part| Part { configured: Some(configured), ..part };
    let readout_s = config.camera.first().map_or(0.0, |camera| camera.readout_s);
    let (share, px, mrad, mm, ms) = (("%", 1e2), ("px", 1.0), ("mrad", 1e3), ("mm", 1e3), ("ms", 1e3));
    let (ppm, cubic) = (("ppm", 1e6), ("of r^3", 1.0));
    // A careful calibration repeats to a thousandth of the focal length and to a pixel of its centre.
    let (focal, centre) = (sigmas.camera_focal_sigma.max(1e-3), sigmas.camera_centre_sigma_px.max(1.0));
    let rotation = sigmas.camera_imu_rotation_sigma_rad.max(3e-3);
    let place = sigmas.camera_imu_translation_sigma_m.max(5e-3);
    let offset_s = sigmas.time_offset_sigma_s.max(1e-3);
    let scales = [config.imu.gyro_scale_sigma.max(5e-3), config.imu.accel_scale_sigma.max(1e-2)];
    // One camera holds it against gravity alone.
    let against = (config.camera.len() > 1).then_some(SHAKE);
    let mut all = vec![
        part("focal length", 0, vec![both(0)], focal, share, CAMERAS, Some(TURN)),
        part("focal length by fx / fy", 1, vec![both(1)], 2.0 * focal, share, CAMERAS, None),
        part("lens model", 2, vec![both(4)], 5e-3, cubic, LENS, None),
        part("principal point", 3, vec![both(2), both(3)], 2.0 * centre, px, CAMERAS, None),
        part(CAMERA_IMU_ROTATION, 4, span(ROT_B_C, 3), rotation, mrad, MOUNT, Some(TURN)),
        part(CAMERA_IMU_POSITION, 5, span(P_B_C, 3), 2.0 * place, mm, MOUNT, None),
        key(
            sigmas.time_offset_s,
            part(TIME_OFFSET, 6, one(DELAY), offset_s, ms, "rig.time_offset_s", Some(TURN)),
        ),
        // Two crystals differ by 100 ppm at most (data sheets: 50 ppm each over temperature).
        with_delay(part(CLOCK_RATE, 7, one(rig::CLOCK_RATE), 5e-5, ppm, CLOCKS, None)),
        with_delay(part("even and odd frames", 8, one(ALTERNATING), 1e-3, ms, IN_TURN, None)),
        key(readout_s, part(READOUT_TIME, 9, one(READOUT), 2e-3, ms, "camera.0.readout_s", None)),
        part("gyroscope scale", 10, diagonal(GYRO), scales[0], share, COLUMNS, None),
        part("gyroscope axes", 10, span(GYRO, 9), 3.0 * scales[0], share, COLUMNS, Some(TURN)),
        part("accelerometer scale", 11, diagonal(ACCEL), scales[1], share, COLUMNS, against),
        part("accelerometer axes", 11, span(ACCEL, 9), 3.0 * scales[1], share, COLUMNS, Some(SHAKE)),
        moving("focal length", vec![both(0), both(5), both(6)], focal),
    ];
    if let [a, b] = config.camera.as_slice() {
        let along: Vector3<f64> = (a.pose_b_c().inverse() * b.pose_b_c()).translation.vector;
        let baseline = vec![(0..3).map(|k| (P_PAIR + k, along[k])).collect()];
        let pair_rad = sigmas.camera_camera_rotation_sigma_rad.max(1e-3);
        all.extend([
            part("camera-camera rotation", 12, span(ROT_PAIR, 3), pair_rad, mrad, PAIR, None),
            part("baseline", 13, baseline, 1e-2, share, BASELINE, Some(SHAKE)),
            part("right camera's delay", 14, one(RIGHT_LATE), 5e-4, ms, TRIGGER, None),
            hidden(part("camera-camera position", 13, span(P_PAIR, 3), 1e-2 * along.norm(), mm, PAIR, None)),
        ]);
        let sides = [
            (left, ["left focal length", "left principal point", "left lens model"]),
            (right, ["right focal length", "right principal point", "right lens model"]),
        ];
        for (at, [of_focal, of_centre, of_lens]) in sides {
            all.extend([
                moving(of_focal, [at, at + 5, at + 6].map(|k| vec![(k, 1.0)]).to_vec(), focal),
                hidden(part(of_focal, 0, one(at), focal, share, CAMERAS, None)),
                hidden(part(of_centre, 3, span(at + 2, 2), centre, px, CAMERAS, None)),
                hidden(part(of_lens, 2, one(at + 4), 5e-3, cubic, CAMERAS, None)),
            ]);
        }
    }
    all
}
