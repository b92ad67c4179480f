//! The line extractor: how good its segments are against OpenCV's LSD, and that its work is bounded.

mod bounds;
mod york;
