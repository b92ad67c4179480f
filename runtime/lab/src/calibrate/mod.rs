//! Calibration of the sensors: numbers of the configuration, measured from recordings.
//!
//! - [`camera`]: intrinsics, and the pose between two cameras, by images of a board.
//! - [`imu`]: noise densities and bias walks of the inertial sensor, of a recording at rest.
//! - [`mask`]: parts of the vehicle in view, of a recording in motion.
//! - [`rig`]: where the cameras sit on the IMU and how far their clocks are apart, of a recording in motion.

pub mod camera;
pub mod imu;
pub mod mask;
pub mod rig;
