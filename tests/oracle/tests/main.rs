//! What others' libraries say of ours, one module a behaviour: OpenCV of cameras, tracks, lines and calibrations, PX4's filter of our
//! odometry.

mod autopilot;
mod calibration;
mod flow;
mod lines;
mod projection;
