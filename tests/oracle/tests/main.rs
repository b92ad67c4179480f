//! Comparison with other libraries, one module a behaviour: OpenCV for cameras, tracks, lines and calibrations, PX4's filter
//! for our odometry.

mod autopilot;
mod calibration;
mod flow;
mod lines;
mod projection;
