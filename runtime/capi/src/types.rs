//! Structures of the header. Frames: `O` odometry (z up), `B` body, which is the IMU's.

/// The estimator of one vehicle.
pub struct Estimator;
/// Connection to the local socket of a flight.
pub struct Local;
/// Connection that frames are sent over.
pub struct Frames;
/// Inertial sensor that a program plays to a flight.
pub struct Imu;

/// State of the estimator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum State {
    /// Gathering data; there is no pose yet.
    Initialising = 0,
    /// Estimating from images and IMU.
    Tracking = 1,
    /// Estimating from the IMU alone.
    Blind = 2,
    /// The estimate was given up; a new start is under way.
    Failed = 3,
}

/// Extent of a reset.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum Reset {
    /// The map and the window go; the pose stays.
    Soft = 1,
    /// Everything goes: the new start begins at the origin.
    Hard = 2,
}

/// State at an inertial sample (200 Hz): record 16 of the local socket.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Odometry {
    /// Time of the inertial sample, ns: CLOCK_MONOTONIC, or the clock of a recording.
    pub stamp_ns: i64,
    /// Time of the hand-over by the flight, ns since 1970; 0 from an estimator of one's own.
    pub handed_over_ns: i64,
    /// Counts odometry.
    pub sequence: u64,
    /// Position of B in O, m.
    pub position_m: [f64; 3],
    /// Rotation that takes coordinates from B to O: quaternion x y z w.
    pub rotation_xyzw: [f64; 4],
    /// Velocity of B in O, m/s.
    pub velocity_m_s: [f64; 3],
    /// Angular rate of B, bias removed, rad/s.
    pub rate_rad_s: [f64; 3],
    /// Covariance of position, attitude and velocity: upper triangle of the 9 x 9 matrix by rows.
    pub covariance: [f64; 45],
    /// Health bits of the newest estimate.
    pub health: u32,
    /// Number of resets: where it changes, the pose may jump.
    pub reset_counter: u32,
    /// Number of steps within the same odometry frame so far.
    pub jumps: u32,
    /// State (plumbline_state): 0 initialising, 1 tracking, 2 blind, 3 failed; in 0 and 3 the pose is meaningless.
    pub state: u8,
    /// Quality: -1 failed, else 0 to 100.
    pub quality: i8,
    /// Zero.
    pub reserved: [u8; 2],
}

/// Main part of the estimate after a frame: record 17 of the local socket.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Estimate {
    /// Time of the state on the IMU's time axis, ns.
    pub stamp_ns: i64,
    /// Time of the hand-over by the flight, ns since 1970; 0 from an estimator of one's own.
    pub handed_over_ns: i64,
    /// Number of the frame.
    pub sequence: u64,
    /// Position of B in O, m.
    pub position_m: [f64; 3],
    /// Rotation that takes coordinates from B to O: quaternion x y z w.
    pub rotation_xyzw: [f64; 4],
    /// Velocity of B in O, m/s.
    pub velocity_m_s: [f64; 3],
    /// Bias of the gyroscope, rad/s.
    pub bias_gyro_rad_s: [f64; 3],
    /// Bias of the accelerometer, m/s^2.
    pub bias_accel_m_s2: [f64; 3],
    /// Covariance of position, attitude and velocity: upper triangle of the 9 x 9 matrix by rows.
    pub covariance: [f64; 45],
    /// Time offset of the camera, s: t_imu - t_camera.
    pub time_offset_s: f64,
    /// Health bits.
    pub health: u32,
    /// Number of resets: where it changes, the pose may jump.
    pub reset_counter: u32,
    /// State (plumbline_state): 0 initialising, 1 tracking, 2 blind, 3 failed; in 0 and 3 the pose is meaningless.
    pub state: u8,
    /// Quality: -1 failed, else 0 to 100.
    pub quality: i8,
    /// 1 if the frame is a keyframe.
    pub is_keyframe: u8,
    /// Zero.
    pub reserved: [u8; 5],
}

/// State at an instant: record 27 of the local socket.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Instant {
    /// The instant, ns.
    pub stamp_ns: i64,
    /// Time of the hand-over by the flight, ns since 1970.
    pub handed_over_ns: i64,
    /// Number of the request, or of the trigger.
    pub number: u64,
    /// Position of B in O, m.
    pub position_m: [f64; 3],
    /// Rotation that takes coordinates from B to O: quaternion x y z w.
    pub rotation_xyzw: [f64; 4],
    /// Velocity of B in O, m/s.
    pub velocity_m_s: [f64; 3],
    /// Angular rate of B, bias removed, rad/s.
    pub rate_rad_s: [f64; 3],
    /// Covariance of position, attitude and velocity: upper triangle of the 9 x 9 matrix by rows.
    pub covariance: [f64; 45],
    /// Time of the estimate before the instant, ns.
    pub estimated_ns: i64,
    /// Number of resets until then.
    pub reset_counter: u32,
    /// State (plumbline_state).
    pub state: u8,
    /// Quality: 0 to 100.
    pub quality: i8,
    /// Outcome: 0 answered, 1 there was no pose then, 2 longer ago than 3 s, 3 later than the newest inertial sample; the state
    /// counts only for 0.
    pub outcome: u8,
    /// 1 if there is an estimate after the instant too: the answer would not change any more.
    pub is_settled: u8,
    /// Source: 0 a request, 1 a trigger of the autopilot, 2 a list (replay --at).
    pub source: u8,
    /// Zero.
    pub reserved: [u8; 7],
}

/// Structure of numbers alone, without padding: any bytes are a value of it.
///
/// # Safety
/// Every field is an integer or a floating-point number, and the fields fill the structure.
#[allow(unsafe_code)]
pub(crate) unsafe trait Numbers: Copy {}

#[allow(unsafe_code)]
// SAFETY: numbers alone; a test of the crate compares the places of the fields with the tables of the records.
unsafe impl Numbers for Odometry {}
#[allow(unsafe_code)]
// SAFETY: numbers alone; a test of the crate compares the places of the fields with the tables of the records.
unsafe impl Numbers for Estimate {}
#[allow(unsafe_code)]
// SAFETY: numbers alone; a test of the crate compares the places of the fields with the tables of the records.
unsafe impl Numbers for Instant {}

/// Inertial sample.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct ImuSample {
    /// Time of measurement, ns.
    pub stamp_ns: i64,
    /// Angular rate x y z of B, rad/s.
    pub gyro_rad_s: [f64; 3],
    /// Specific force x y z in B, m/s^2 (at rest it points up, +9.81).
    pub accel_m_s2: [f64; 3],
}

/// 8-bit grey image that is lent for the time of a call.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Image {
    /// First pixel of the first row; null for an image that did not arrive.
    pub pixels: *const u8,
    /// Width, px.
    pub width: u32,
    /// Height, px.
    pub height: u32,
    /// Bytes from the beginning of a row to that of the next, at least the width.
    pub stride: usize,
}

/// Stereo frame, or a frame of one camera.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct Frame {
    /// Middle of the exposure, ns: by the camera's clock for an estimator, by CLOCK_MONOTONIC for a flight.
    pub stamp_ns: i64,
    /// Number of the frame as the camera counts.
    pub sequence: u64,
    /// Left image, or that of the one camera.
    pub left: Image,
    /// Right image.
    pub right: Image,
}

/// Inertial sensor: rate and ranges by section `imu` of the configuration of the flight.
#[derive(Clone, Copy, Debug)]
#[repr(C)]
pub struct ImuAbout {
    /// Samples a second.
    pub rate_hz: f64,
    /// Largest angular rate, rad/s.
    pub gyro_range_rad_s: f64,
    /// Largest specific force, m/s^2.
    pub accel_range_m_s2: f64,
}

/// Kind of a record that plumbline_local_read hands out.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u32)]
pub enum RecordKind {
    /// Number of records that this reader has lost so far, since it was slower than the flight.
    Lost = 2,
    /// Odometry.
    Odometry = 16,
    /// Estimate.
    Estimate = 17,
}

/// Content of a record.
#[derive(Clone, Copy)]
#[repr(C)]
pub union RecordContent {
    /// Number of lost records, where the kind is PLUMBLINE_RECORD_KIND_LOST.
    pub lost: u64,
    /// Odometry, where the kind is PLUMBLINE_RECORD_KIND_ODOMETRY.
    pub odometry: Odometry,
    /// Estimate, where the kind is PLUMBLINE_RECORD_KIND_ESTIMATE.
    pub estimate: Estimate,
}

/// Record of a flight.
#[derive(Clone, Copy)]
#[repr(C)]
pub struct Record {
    /// Kind of the content.
    pub kind: RecordKind,
    /// Content.
    pub content: RecordContent,
}
