//! Tests by behaviour: what is accepted, what is refused and how it is said, and that nothing panics.

mod camera;
mod import_euroc;
mod import_kalibr;
mod import_rig;
mod loading;
mod presets;
mod rigs;
mod robustness;
mod validation;
mod validation_network;

use crate::{Config, ValidConfig};

/// The preset `euroc`.
fn euroc() -> ValidConfig {
    Config::preset("euroc").expect("the preset is good")
}

/// `text` with one occurrence of `from` replaced, which must be there.
fn with(text: &str, from: &str, to: &str) -> String {
    assert!(text.contains(from), "{from} is in the text");
    text.replacen(from, to, 1)
}
