//! Calibration of the cameras by images of a board.

pub mod camera;
