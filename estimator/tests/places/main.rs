//! Places as a whole: maps of thousands of keyframes, buildings that look alike, real images.

mod building;
mod flight;
mod images;
mod look_alike;
mod scale;
