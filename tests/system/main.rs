//! System tests that need the libraries, one module a behaviour.

mod accuracy;
mod autopilot;
mod calibration;
mod clips;
mod clocks;
mod determinism;
mod faults;
mod flow;
mod health;
mod lines;
mod loops;
mod oracle;
mod places;
mod soak;
