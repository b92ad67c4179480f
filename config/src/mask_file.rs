//! Pictures of masks, beside the configuration that names them.

use crate::error::{ConfigError, Violation};
use crate::options::{Config, MAX_MASK_RUNS, Mask, PixelMask};
use std::fs::File;
use std::io::BufReader;
use std::path::Path;

/// Memory for decoding, bytes: the largest image in colour has 50 MB.
const MAX_DECODED_BYTES: usize = 1 << 27;

/// Reads the pictures of all masks of `config` that have not been read; relative paths start at `folder`. `origin` names the
/// configuration in messages.
pub(crate) fn read_all(config: &mut Config, folder: &Path, origin: &str) -> Result<(), ConfigError> {
    let mut found = Vec::new();
    for (k, camera) in config.camera.iter_mut().enumerate() {
        let Some(Mask::Picture(picture)) = &camera.mask else { continue };
        match read(&folder.join(picture)) {
            Ok(mask) => camera.mask = Some(Mask::Pixels(mask)),
            Err((reason, cure)) => found.push(Violation::new(format!("camera[{k}].mask"), reason, cure)),
        }
    }
    ConfigError::if_any(origin, found)
}

/// Reads a mask; else what is wrong and what to do about it.
fn read(file: &Path) -> Result<PixelMask, (String, &'static str)> {
    let name = file.display();
    let opened = File::open(file).map_err(|error| {
        let cure = "give the path of a PNG picture, from the folder of the configuration on";
        (format!("{name} cannot be read ({error})"), cure)
    })?;
    let not_png =
        |error: png::DecodingError| (format!("{name} is no PNG picture ({error})"), "save the mask as PNG");
    let mut decoder =
        png::Decoder::new_with_limits(BufReader::new(opened), png::Limits { bytes: MAX_DECODED_BYTES });
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader = decoder.read_info().map_err(not_png)?;
    let size = (reader.info().width as usize, reader.info().height as usize);
    let mut pixels = vec![0; reader.output_buffer_size().unwrap_or(0)];
    let frame = reader.next_frame(&mut pixels).map_err(not_png)?;
    let channels = frame.color_type.samples();
    // Transparency is no colour.
    let colours = if channels > 2 { 3 } else { 1 };
    let is_seen = |u: usize, v: usize| {
        let at = (v * size.0 + u) * channels;
        pixels[at..at + colours].iter().any(|level| *level != 0)
    };
    let mask = PixelMask::of(size.0, size.1, is_seen);
    if mask.run_count() > MAX_MASK_RUNS {
        let reason = format!("{name} has {} edges, more than {MAX_MASK_RUNS}", mask.run_count());
        return Err((reason, "draw it with plain black areas on white, without noise"));
    }
    Ok(mask)
}
