//! Luma of the JPEG images that cameras send (MJPEG): baseline, 8 bits, Huffman codes (ITU-T T.81).
//!
//! Our own, since the hot path may not allocate and needs luma alone: chroma is passed over bit by bit, with neither
//! transform nor interpolation. Images are handed out row by row from a strip of one row of blocks. The tables of codes
//! that a camera leaves out, as many do, are those of Annex K.
//!
//! Everything from outside is bounded: an image of another size than the camera's is refused before anything is decoded,
//! codes that there are not and data that end early end the image.

mod bits;
mod huffman;
mod segments;
mod transform;

use bits::Bits;
use huffman::Huffman;
use segments::{Component, Frame, Scan, Segments};
use thiserror::Error;
use transform::{Block, inverse_dct};

/// Pixels along the side of a block.
const BLOCK: usize = 8;
/// Blocks of a component along each side of a unit, at most.
const MAX_SAMPLING: usize = 4;

/// Why an image of JPEG cannot be read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
pub enum JpegDamage {
    /// It does not begin as one, or a segment makes no sense.
    #[error("no segments of JPEG")]
    Segments,
    /// It is one that cameras do not send: progressive, arithmetic, lossless or of 12 bits.
    #[error("a kind that is not read here (only baseline is)")]
    Kind,
    /// It has another size than the camera was set to.
    #[error("an image of {width} x {height} px")]
    Size {
        /// Width, px.
        width: usize,
        /// Height, px.
        height: usize,
    },
    /// A table that is needed is missing or impossible.
    #[error("a table is missing or impossible")]
    Table,
    /// A code that is in no table, or a coefficient beyond the last.
    #[error("an impossible code")]
    Code,
    /// The data end before the image does.
    #[error("the data end early")]
    Short,
}

/// Width and height of the JPEG image in `bytes`, px; `None` for one that is not read.
pub(crate) fn size_of(bytes: &[u8]) -> Option<(usize, usize)> {
    let mut segments = Segments::new(bytes).ok()?;
    while let Some((marker, payload)) = segments.next().ok()? {
        if matches!(marker, segments::BASELINE | segments::EXTENDED) {
            let frame = segments::frame(payload).ok()?;
            return Some((frame.width, frame.height));
        }
    }
    None
}

/// Tables of the image at hand, and where its luma is put together. Everything is allocated when it is made.
pub(crate) struct LumaDecoder {
    width: usize,
    height: usize,
    /// Steps of quantization, in the order of the data.
    steps: [Option<[u16; 64]>; 4],
    /// Codes of differences and of coefficients.
    dc: [Huffman; 4],
    ac: [Huffman; 4],
    /// Whether codes are those of Annex K.
    is_standard: bool,
    /// Rows of one row of units, `stride` bytes each.
    strip: Vec<u8>,
    stride: usize,
}

impl std::fmt::Debug for LumaDecoder {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("LumaDecoder").field("width", &self.width).field("height", &self.height).finish()
    }
}

impl LumaDecoder {
    /// For images of this size, px.
    pub(crate) fn new(width: usize, height: usize) -> Self {
        let stride = width + MAX_SAMPLING * BLOCK;
        Self {
            width,
            height,
            steps: [None; 4],
            dc: huffman::standard_dc(),
            ac: huffman::standard_ac(),
            is_standard: true,
            strip: vec![0; stride * MAX_SAMPLING * BLOCK],
            stride,
        }
    }

    /// Decodes an image and hands `row` each of its rows, from the top: number and luma.
    pub(crate) fn decode(
        &mut self,
        bytes: &[u8],
        mut row: impl FnMut(usize, &[u8]),
    ) -> Result<(), JpegDamage> {
        if !self.is_standard {
            (self.dc, self.ac, self.is_standard) = (huffman::standard_dc(), huffman::standard_ac(), true);
        }
        self.steps = [None; 4];
        let (frame, scan, data, restart) = self.header(bytes)?;
        if (frame.width, frame.height) != (self.width, self.height) {
            return Err(JpegDamage::Size { width: frame.width, height: frame.height });
        }
        let plan = Plan::new(&frame, &scan)?;
        self.scan(&plan, data, restart, &mut row)
    }

    /// Reads segments up to the data of the first scan: what they say, the data, and units from restart to restart.
    fn header<'a>(&mut self, bytes: &'a [u8]) -> Result<(Frame, Scan, &'a [u8], usize), JpegDamage> {
        let (mut frame, mut restart) = (None, 0);
        let mut segments = Segments::new(bytes)?;
        while let Some((marker, payload)) = segments.next()? {
            match marker {
                segments::QUANTIZATION => segments::quantization(payload, &mut self.steps)?,
                segments::HUFFMAN => {
                    self.is_standard = false;
                    segments::huffman(payload, &mut self.dc, &mut self.ac)?;
                }
                segments::BASELINE | segments::EXTENDED => frame = Some(segments::frame(payload)?),
                segments::RESTART => restart = segments::restart(payload)?,
                segments::SCAN => {
                    let frame: Frame = frame.ok_or(JpegDamage::Segments)?;
                    let scan = segments::scan(payload, &frame)?;
                    return Ok((frame, scan, segments.rest(), restart));
                }
                marker if segments::is_other_frame(marker) => return Err(JpegDamage::Kind),
                _ => {}
            }
        }
        Err(JpegDamage::Short)
    }

    fn scan(
        &mut self,
        plan: &Plan,
        data: &[u8],
        restart: usize,
        row: &mut impl FnMut(usize, &[u8]),
    ) -> Result<(), JpegDamage> {
        let steps = self.steps[plan.luma.table].ok_or(JpegDamage::Table)?;
        let Self { dc, ac, strip, stride, width, height, .. } = self;
        let (unit_width, unit_height) = (plan.across * BLOCK, plan.down * BLOCK);
        let mut bits = Bits::new(data);
        let (mut last_dc, mut left) = (0i32, restart);
        for top in (0..*height).step_by(unit_height) {
            for x in (0..*width).step_by(unit_width) {
                if restart > 0 && left == 0 {
                    bits.restart()?;
                    (last_dc, left) = (0, restart);
                }
                left = left.wrapping_sub(1);
                for block in 0..plan.across * plan.down {
                    let (dc, ac) = (&dc[plan.luma.dc], &ac[plan.luma.ac]);
                    let mut coefficients = Block::default();
                    let last = luma_block(&mut bits, dc, ac, &steps, &mut last_dc, &mut coefficients)?;
                    let at = x + block % plan.across * BLOCK + block / plan.across * BLOCK * *stride;
                    inverse_dct(&coefficients, last, &mut strip[at..], *stride);
                }
                for chroma in plan.others() {
                    for _ in 0..chroma.blocks {
                        pass_over_block(&mut bits, &dc[chroma.dc], &ac[chroma.ac])?;
                    }
                }
            }
            if bits.is_past_end() {
                return Err(JpegDamage::Short);
            }
            for (y, luma) in (top..*height).zip(strip.chunks_exact(*stride)).take(unit_height) {
                row(y, &luma[..*width]);
            }
        }
        Ok(())
    }
}

/// Reads a block of luma: the coefficients, times their steps; the place of the last that is not 0.
fn luma_block(
    bits: &mut Bits<'_>,
    dc: &Huffman,
    ac: &Huffman,
    steps: &[u16; 64],
    last_dc: &mut i32,
    block: &mut Block,
) -> Result<usize, JpegDamage> {
    let size = dc.decode(bits)?;
    if size > 15 {
        return Err(JpegDamage::Code);
    }
    *last_dc = last_dc.wrapping_add(bits.signed(size.into()));
    block.set(0, *last_dc, steps[0]);
    let (mut k, mut last) = (1, 0);
    while k < 64 {
        let code = ac.decode(bits)?;
        let (run, size) = (usize::from(code >> 4), u32::from(code & 15));
        match (run, size) {
            (15, 0) => k += 16,
            (_, 0) => break,
            _ => {
                k += run;
                let value = bits.signed(size);
                let step = steps.get(k).ok_or(JpegDamage::Code)?;
                block.set(k, value, *step);
                last = k;
                k += 1;
            }
        }
    }
    Ok(last)
}

/// Reads a block without looking at it.
fn pass_over_block(bits: &mut Bits<'_>, dc: &Huffman, ac: &Huffman) -> Result<(), JpegDamage> {
    let size = dc.decode(bits)?;
    if size > 15 {
        return Err(JpegDamage::Code);
    }
    bits.take(size.into());
    let mut k = 1;
    while k < 64 {
        let code = ac.decode(bits)?;
        let (run, size) = (usize::from(code >> 4), u32::from(code & 15));
        match (run, size) {
            (15, 0) => k += 16,
            (_, 0) => break,
            _ => {
                bits.take(size);
                k += run + 1;
            }
        }
    }
    Ok(())
}

/// Tables of a component, and its blocks in a unit.
#[derive(Clone, Copy, Debug, Default)]
struct Part {
    blocks: usize,
    table: usize,
    dc: usize,
    ac: usize,
}

/// How the blocks follow each other.
#[derive(Debug)]
struct Plan {
    /// Blocks of luma in a unit, across and down.
    across: usize,
    down: usize,
    luma: Part,
    chroma: [Part; 3],
    chroma_count: usize,
}

impl Plan {
    /// Luma is the first component, of the full resolution, and in the first scan.
    fn new(frame: &Frame, scan: &Scan) -> Result<Self, JpegDamage> {
        let components = frame.components();
        let first = components.first().ok_or(JpegDamage::Segments)?;
        let is_full = |c: &Component| c.across <= first.across && c.down <= first.down;
        let entries = scan.entries();
        if !components.iter().all(is_full) || entries.first().is_none_or(|entry| entry.component != 0) {
            return Err(JpegDamage::Kind);
        }
        // A scan of one component has no units: block follows block.
        let is_alone = entries.len() == 1;
        let (across, down) = if is_alone { (1, 1) } else { (first.across, first.down) };
        let part = |entry: &segments::Entry| {
            let component = &components[entry.component];
            let blocks = component.across * component.down;
            Part { blocks, table: component.table, dc: entry.dc, ac: entry.ac }
        };
        let mut chroma = [Part::default(); 3];
        for (to, entry) in chroma.iter_mut().zip(&entries[1..]) {
            *to = part(entry);
        }
        Ok(Self { across, down, luma: part(&entries[0]), chroma, chroma_count: entries.len() - 1 })
    }

    fn others(&self) -> &[Part] {
        &self.chroma[..self.chroma_count]
    }
}

/// Width and height that an image says it has, px.
#[cfg(any(test, feature = "fuzzing"))]
pub(crate) fn size_px(bytes: &[u8]) -> Option<(usize, usize)> {
    let mut segments = Segments::new(bytes).ok()?;
    while let Ok(Some((marker, payload))) = segments.next() {
        if matches!(marker, segments::BASELINE | segments::EXTENDED) {
            let frame = segments::frame(payload).ok()?;
            return Some((frame.width, frame.height));
        }
    }
    None
}

#[cfg(test)]
mod tests;
