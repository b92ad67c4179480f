//! System tests that need the libraries, one module a behaviour.

mod accuracy;
mod clips;
mod clocks;
mod determinism;
mod faults;
mod instants;
mod lenses;
mod loops;
mod places;
mod soak;
mod truth;
