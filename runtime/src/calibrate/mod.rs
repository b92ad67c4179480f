//! Calibration of the sensors: of cameras by images of a board ([`camera`]).

pub mod camera;
