//! The segments of an image before its data (T.81, Annex B).

use super::huffman::Huffman;
use super::{JpegDamage, MAX_SAMPLING};

/// Start of a frame, baseline.
pub(super) const BASELINE: u8 = 0xc0;
/// Start of a frame, extended sequential: as baseline, where it has 8 bits.
pub(super) const EXTENDED: u8 = 0xc1;
/// Tables of Huffman's codes.
pub(super) const HUFFMAN: u8 = 0xc4;
/// Tables of quantization.
pub(super) const QUANTIZATION: u8 = 0xdb;
/// Restart interval.
pub(super) const RESTART: u8 = 0xdd;
/// Start of a scan.
pub(super) const SCAN: u8 = 0xda;

/// Components of an image, at most.
const MAX_COMPONENTS: usize = 4;

/// Whether a marker begins a frame of a kind that is not read here.
pub(super) fn is_other_frame(marker: u8) -> bool {
    matches!(marker, 0xc2..=0xcf) && !matches!(marker, HUFFMAN | 0xc8 | 0xcc)
}

/// Goes from segment to segment.
pub(super) struct Segments<'a> {
    rest: &'a [u8],
}

impl<'a> Segments<'a> {
    pub(super) fn new(bytes: &'a [u8]) -> Result<Self, JpegDamage> {
        match bytes {
            [0xff, 0xd8, rest @ ..] => Ok(Self { rest }),
            _ => Err(JpegDamage::Segments),
        }
    }

    /// The next segment's marker and payload; `None` at the end of the image.
    pub(super) fn next(&mut self) -> Result<Option<(u8, &'a [u8])>, JpegDamage> {
        loop {
            match *self.rest {
                // The second of these fills, and may begin a marker.
                [0xff, 0xff, ..] => self.rest = &self.rest[1..],
                [0xff, 0xd9, ..] => return Ok(None),
                [0xff, marker @ 0xc0..=0xfe, high, low, ref after @ ..] => {
                    let length = usize::from(u16::from_be_bytes([high, low]));
                    let length = length.checked_sub(2).ok_or(JpegDamage::Segments)?;
                    let (payload, rest) = after.split_at_checked(length).ok_or(JpegDamage::Short)?;
                    self.rest = rest;
                    return Ok(Some((marker, payload)));
                }
                [_, _, _, _, ..] => return Err(JpegDamage::Segments),
                _ => return Err(JpegDamage::Short),
            }
        }
    }

    /// What follows the last segment.
    pub(super) fn rest(&self) -> &'a [u8] {
        self.rest
    }
}

/// A colour component of a frame.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Component {
    id: u8,
    /// Blocks in a unit.
    pub(super) across: usize,
    pub(super) down: usize,
    /// Its table of quantization.
    pub(super) table: usize,
}

#[derive(Debug)]
pub(super) struct Frame {
    pub(super) width: usize,
    pub(super) height: usize,
    components: [Component; MAX_COMPONENTS],
    count: usize,
}

impl Frame {
    pub(super) fn components(&self) -> &[Component] {
        &self.components[..self.count]
    }
}

/// Reads the start of a frame.
pub(super) fn frame(payload: &[u8]) -> Result<Frame, JpegDamage> {
    let [bits, y1, y0, x1, x0, count, list @ ..] = payload else { return Err(JpegDamage::Segments) };
    if *bits != 8 {
        return Err(JpegDamage::Kind);
    }
    let count = usize::from(*count);
    if !(1..=MAX_COMPONENTS).contains(&count) || list.len() < 3 * count {
        return Err(JpegDamage::Segments);
    }
    let mut components = [Component::default(); MAX_COMPONENTS];
    for (component, bytes) in components.iter_mut().zip(list.chunks_exact(3)).take(count) {
        let (across, down) = (usize::from(bytes[1] >> 4), usize::from(bytes[1] & 15));
        let sampling = 1..=MAX_SAMPLING;
        if !sampling.contains(&across) || !sampling.contains(&down) || bytes[2] > 3 {
            return Err(JpegDamage::Segments);
        }
        *component = Component { id: bytes[0], across, down, table: bytes[2].into() };
    }
    let [height, width] = [[*y1, *y0], [*x1, *x0]].map(|bytes| usize::from(u16::from_be_bytes(bytes)));
    Ok(Frame { width, height, components, count })
}

/// A component in a scan: which of the frame's, and its codes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Entry {
    pub(super) component: usize,
    pub(super) dc: usize,
    pub(super) ac: usize,
}

#[derive(Debug)]
pub(super) struct Scan {
    entries: [Entry; MAX_COMPONENTS],
    count: usize,
}

impl Scan {
    pub(super) fn entries(&self) -> &[Entry] {
        &self.entries[..self.count]
    }
}

/// Reads the start of a scan.
pub(super) fn scan(payload: &[u8], frame: &Frame) -> Result<Scan, JpegDamage> {
    let [count, list @ ..] = payload else { return Err(JpegDamage::Segments) };
    let count = usize::from(*count);
    if !(1..=frame.count).contains(&count) || list.len() < 2 * count {
        return Err(JpegDamage::Segments);
    }
    let mut entries = [Entry::default(); MAX_COMPONENTS];
    for (entry, bytes) in entries.iter_mut().zip(list.chunks_exact(2)).take(count) {
        let component = frame.components().iter().position(|component| component.id == bytes[0]);
        let (dc, ac) = (usize::from(bytes[1] >> 4), usize::from(bytes[1] & 15));
        if dc > 3 || ac > 3 {
            return Err(JpegDamage::Table);
        }
        *entry = Entry { component: component.ok_or(JpegDamage::Segments)?, dc, ac };
    }
    Ok(Scan { entries, count })
}

/// Reads tables of quantization.
pub(super) fn quantization(mut payload: &[u8], steps: &mut [Option<[u16; 64]>; 4]) -> Result<(), JpegDamage> {
    while let [head, rest @ ..] = payload {
        let (wide, place) = (head >> 4 != 0, usize::from(head & 15));
        let bytes = if wide { 128 } else { 64 };
        let (Some((table, rest)), Some(to)) = (rest.split_at_checked(bytes), steps.get_mut(place)) else {
            return Err(JpegDamage::Table);
        };
        *to = Some(std::array::from_fn(|k| match wide {
            true => u16::from_be_bytes([table[2 * k], table[2 * k + 1]]),
            false => table[k].into(),
        }));
        payload = rest;
    }
    Ok(())
}

/// Reads tables of codes.
pub(super) fn huffman(
    mut payload: &[u8],
    dc: &mut [Huffman; 4],
    ac: &mut [Huffman; 4],
) -> Result<(), JpegDamage> {
    while let [head, rest @ ..] = payload {
        let tables = match head >> 4 {
            0 => &mut *dc,
            1 => &mut *ac,
            _ => return Err(JpegDamage::Table),
        };
        let (Some((counts, rest)), Some(to)) =
            (rest.split_first_chunk::<16>(), tables.get_mut(usize::from(head & 15)))
        else {
            return Err(JpegDamage::Table);
        };
        let total = counts.iter().map(|count| usize::from(*count)).sum();
        let (symbols, rest) = rest.split_at_checked(total).ok_or(JpegDamage::Table)?;
        *to = Huffman::new(counts, symbols)?;
        payload = rest;
    }
    Ok(())
}

/// Reads the restart interval, units; 0 for none.
pub(super) fn restart(payload: &[u8]) -> Result<usize, JpegDamage> {
    match payload {
        [high, low, ..] => Ok(u16::from_be_bytes([*high, *low]).into()),
        _ => Err(JpegDamage::Segments),
    }
}
