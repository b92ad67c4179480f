//! Common parts of the tests and benchmarks beside other libraries: calibration boards, trackers of points, detectors of line
//! segments, and the images to judge them by.

pub mod boards;
pub mod flow;
pub mod lines;
