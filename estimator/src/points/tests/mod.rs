//! Tests of the whole front-end: on rendered images with a known truth, and on recorded flights.

mod dataset;
mod recorded;
mod rendered;
mod repeated;
mod scene;
