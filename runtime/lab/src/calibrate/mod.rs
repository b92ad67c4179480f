//! Calibration of the sensors: numbers of the configuration, measured from recordings.
//!
//! - [`camera`]: intrinsics, and the pose between two cameras, by images of a board.
//! - [`rig`]: where the cameras sit on the IMU and how far their clocks are apart, of a recording in motion.

pub mod camera;
pub mod rig;
