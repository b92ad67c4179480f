//! Grey pixels of a picture in a file: PNG or JPEG, whichever it begins as.

use super::depth::Depth;
use super::image::{MAX_FILE_BYTES, decode_png, png_size_of};
use crate::open_regular;
use crate::v4l2::jpeg::{LumaDecoder, components_of as jpeg_components, size_of as jpeg_size_of};
use plumbline_config::GrayImage;
use std::io::{ErrorKind, Read as _};
use std::path::Path;

/// First bytes of a JPEG file.
const JPEG: [u8; 2] = [0xff, 0xd8];
/// Cure for an image format that is not supported.
pub(super) const CONVERT: &str =
    "convert the images to PNG or baseline JPEG (`mogrify -format png *.EXT`), keeping their names";

/// Width and height of a picture that is read, px.
pub(crate) fn picture_size(file: &[u8]) -> Option<(usize, usize)> {
    // Pictures of four inks are not read.
    png_size_of(file).or_else(|| jpeg_size_of(file).filter(|_| jpeg_components(file) < 4))
}

/// Buffers that are used again for each picture.
#[derive(Debug, Default)]
pub(crate) struct PictureDecoder {
    depth: Depth,
    channels: Vec<u8>,
    jpeg: Option<((usize, usize), LumaDecoder)>,
}

impl PictureDecoder {
    /// For pictures of which, where they have 16 bits, these are in use.
    pub(crate) fn new(depth: Depth) -> Self {
        Self { depth, ..Self::default() }
    }

    /// Bits in use of pictures of 16 bits.
    pub(crate) fn depth(&self) -> Depth {
        self.depth
    }

    /// Writes the picture in `file` into `image`, whose size it must have. Colour is weighed to grey (ITU-R BT.601).
    /// `None` where it is damaged, or of another kind or size.
    pub(crate) fn decode(&mut self, file: &[u8], image: &mut GrayImage) -> Option<()> {
        if !file.starts_with(&JPEG) {
            return decode_png(file, self.depth, &mut self.channels, image);
        }
        let size = (image.width(), image.height());
        if self.jpeg.as_ref().is_none_or(|(of, _)| *of != size) {
            self.jpeg = Some((size, LumaDecoder::new(size.0, size.1)));
        }
        let (_, decoder) = self.jpeg.as_mut()?;
        image.pixels_mut().copy_from_slice(decoder.decode(file)?);
        Some(())
    }
}

/// Reason for a missing image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum NoImage {
    /// There is no such file.
    Missing,
    /// The file cannot be read, is cut off, or is no picture.
    Corrupt,
    /// The image has this size, which is another than the camera's.
    OtherSize((usize, usize)),
}

/// Buffers that are used again for each image.
#[derive(Debug, Default)]
pub(super) struct ImageReader {
    file: Vec<u8>,
    decoder: PictureDecoder,
}

impl ImageReader {
    /// For pictures of which, where they have 16 bits, these are in use.
    pub(super) fn new(depth: Depth) -> Self {
        Self { file: Vec::new(), decoder: PictureDecoder::new(depth) }
    }

    /// Reads the file at `path` into `image`, whose size it must have. Colour is weighed to grey
    /// (ITU-R BT.601), of 16 bits the upper 8 of those in use are kept.
    pub(super) fn read(&mut self, path: &Path, image: &mut GrayImage) -> Result<(), NoImage> {
        self.file.clear();
        let file = open_regular(path).map_err(|e| match e.kind() {
            ErrorKind::NotFound => NoImage::Missing,
            _ => NoImage::Corrupt,
        })?;
        file.take(MAX_FILE_BYTES).read_to_end(&mut self.file).map_err(|_| NoImage::Corrupt)?;
        self.decoder.decode(&self.file, image).ok_or_else(|| {
            let expected = (image.width(), image.height());
            match picture_size(&self.file) {
                Some(size) if size != expected => NoImage::OtherSize(size),
                _ => NoImage::Corrupt,
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_of_four_inks_are_not_read() {
        // Start of a frame with so many components, and of its scan.
        let jpeg = |components: u8| {
            let list = |of: &[u8]| (1..=components).flat_map(|id| [&[id], of].concat()).collect::<Vec<_>>();
            let segment =
                |marker: u8, body: Vec<u8>| [vec![0xff, marker, 0, body.len() as u8 + 2], body].concat();
            let frame = [vec![8, 0, 16, 0, 16, components], list(&[0x11, 0])].concat();
            let scan = [vec![components], list(&[0]), vec![0, 63, 0]].concat();
            [vec![0xff, 0xd8], segment(0xc0, frame), segment(0xda, scan), vec![0xff, 0xd9]].concat()
        };
        assert_eq!((picture_size(&jpeg(1)), picture_size(&jpeg(3))), (Some((16, 16)), Some((16, 16))));
        assert_eq!(picture_size(&jpeg(4)), None);
    }
}
