//! Tests of the whole front-end on rendered images with a known truth.

mod rendered;
mod repeated;
mod scene;
