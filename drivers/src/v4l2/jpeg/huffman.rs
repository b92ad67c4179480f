//! Codes of Huffman: looked up by their first bits, or found by the canonical order (T.81, Annex C and F.2.2.3).

use super::JpegDamage;
use super::bits::Bits;

/// Codes up to this length are looked up at once, bits.
const FAST: u32 = 9;

#[derive(Clone)]
pub(super) struct Huffman {
    /// Length and symbol by the next [`FAST`] bits; length 0 where the code is longer.
    fast: [(u8, u8); 1 << FAST],
    /// For each length the first code beyond its own, in the upper bits of 16; codes grow with their length.
    end: [u32; 17],
    /// For each length what is added to a code for the place of its symbol.
    offset: [i32; 17],
    symbols: [u8; 256],
}

impl Huffman {
    /// The codes of so many symbols of each length from 1 to 16.
    pub(super) fn new(counts: &[u8; 16], symbols: &[u8]) -> Result<Self, JpegDamage> {
        let mut table = Self { fast: [(0, 0); 1 << FAST], end: [0; 17], offset: [0; 17], symbols: [0; 256] };
        let total: usize = counts.iter().map(|count| usize::from(*count)).sum();
        if total > 256 || symbols.len() < total {
            return Err(JpegDamage::Table);
        }
        table.symbols[..total].copy_from_slice(&symbols[..total]);
        let (mut code, mut place) = (0u32, 0usize);
        for (length, count) in (1..=16u32).zip(counts) {
            table.offset[length as usize] = place as i32 - code as i32;
            for symbol in &symbols[place..place + usize::from(*count)] {
                if code >= 1 << length {
                    return Err(JpegDamage::Table);
                }
                if length <= FAST {
                    let from = (code << (FAST - length)) as usize;
                    table.fast[from..from + (1 << (FAST - length))].fill((length as u8, *symbol));
                }
                code += 1;
            }
            place += usize::from(*count);
            table.end[length as usize] = code << (16 - length);
            code <<= 1;
        }
        Ok(table)
    }

    /// Takes the next code; the bits of a number of up to 15 are there then.
    #[inline]
    pub(super) fn decode(&self, bits: &mut Bits<'_>) -> Result<u8, JpegDamage> {
        bits.fill();
        let next = bits.peek16();
        let (length, symbol) = self.fast[(next >> (16 - FAST)) as usize];
        if length > 0 {
            bits.take(length.into());
            return Ok(symbol);
        }
        self.decode_long(next, bits)
    }

    fn decode_long(&self, next: u32, bits: &mut Bits<'_>) -> Result<u8, JpegDamage> {
        for length in FAST + 1..=16 {
            if next < self.end[length as usize] {
                let place = (next >> (16 - length)) as i32 + self.offset[length as usize];
                bits.take(length);
                let symbol = usize::try_from(place).ok().and_then(|place| self.symbols.get(place));
                return symbol.copied().ok_or(JpegDamage::Code);
            }
        }
        Err(JpegDamage::Code)
    }
}

/// Codes of Annex K.3: for luma in the even places, for chroma in the odd ones.
pub(super) fn standard_dc() -> [Huffman; 4] {
    let tables = [table(&LUMA_DC_COUNTS, &DC_SYMBOLS), table(&CHROMA_DC_COUNTS, &DC_SYMBOLS)];
    [tables[0].clone(), tables[1].clone(), tables[0].clone(), tables[1].clone()]
}

/// Codes of Annex K.3 for the AC coefficients: for luma in the even places, for chroma in the odd ones.
pub(super) fn standard_ac() -> [Huffman; 4] {
    let tables = [table(&LUMA_AC_COUNTS, &LUMA_AC_SYMBOLS), table(&CHROMA_AC_COUNTS, &CHROMA_AC_SYMBOLS)];
    [tables[0].clone(), tables[1].clone(), tables[0].clone(), tables[1].clone()]
}

fn table(counts: &[u8; 16], symbols: &[u8]) -> Huffman {
    Huffman::new(counts, symbols).expect("the tables of the standard are good")
}

const DC_SYMBOLS: [u8; 12] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11];
const LUMA_DC_COUNTS: [u8; 16] = [0, 1, 5, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0];
const CHROMA_DC_COUNTS: [u8; 16] = [0, 3, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0];
const LUMA_AC_COUNTS: [u8; 16] = [0, 2, 1, 3, 3, 2, 4, 3, 5, 5, 4, 4, 0, 0, 1, 0x7d];
const CHROMA_AC_COUNTS: [u8; 16] = [0, 2, 1, 2, 4, 4, 3, 4, 7, 5, 4, 4, 0, 1, 2, 0x77];
#[rustfmt::skip]
const LUMA_AC_SYMBOLS: [u8; 162] = [
    0x01, 0x02, 0x03, 0x00, 0x04, 0x11, 0x05, 0x12, 0x21, 0x31, 0x41, 0x06, 0x13, 0x51, 0x61, 0x07, 0x22, 0x71,
    0x14, 0x32, 0x81, 0x91, 0xa1, 0x08, 0x23, 0x42, 0xb1, 0xc1, 0x15, 0x52, 0xd1, 0xf0, 0x24, 0x33, 0x62, 0x72,
    0x82, 0x09, 0x0a, 0x16, 0x17, 0x18, 0x19, 0x1a, 0x25, 0x26, 0x27, 0x28, 0x29, 0x2a, 0x34, 0x35, 0x36, 0x37,
    0x38, 0x39, 0x3a, 0x43, 0x44, 0x45, 0x46, 0x47, 0x48, 0x49, 0x4a, 0x53, 0x54, 0x55, 0x56, 0x57, 0x58, 0x59,
    0x5a, 0x63, 0x64, 0x65, 0x66, 0x67, 0x68, 0x69, 0x6a, 0x73, 0x74, 0x75, 0x76, 0x77, 0x78, 0x79, 0x7a, 0x83,
    0x84, 0x85, 0x86, 0x87, 0x88, 0x89, 0x8a, 0x92, 0x93, 0x94, 0x95, 0x96, 0x97, 0x98, 0x99, 0x9a, 0xa2, 0xa3,
    0xa4, 0xa5, 0xa6, 0xa7, 0xa8, 0xa9, 0xaa, 0xb2, 0xb3, 0xb4, 0xb5, 0xb6, 0xb7, 0xb8, 0xb9, 0xba, 0xc2, 0xc3,
    0xc4, 0xc5, 0xc6, 0xc7, 0xc8, 0xc9, 0xca, 0xd2, 0xd3, 0xd4, 0xd5, 0xd6, 0xd7, 0xd8, 0xd9, 0xda, 0xe1, 0xe2,
    0xe3, 0xe4, 0xe5, 0xe6, 0xe7, 0xe8, 0xe9, 0xea, 0xf1, 0xf2, 0xf3, 0xf4, 0xf5, 0xf6, 0xf7, 0xf8, 0xf9, 0xfa,
];
#[rustfmt::skip]
const CHROMA_AC_SYMBOLS: [u8; 162] = [
    0x00, 0x01, 0x02, 0x03, 0x11, 0x04, 0x05, 0x21, 0x31, 0x06, 0x12, 0x41, 0x51, 0x07, 0x61, 0x71, 0x13, 0x22,
    0x32, 0x81, 0x08, 0x14, 0x42, 0x91, 0xa1, 0xb1, 0xc1, 0x09, 0x23, 0x33, 0x52, 0xf0, 0x15, 0x62, 0x72, 0xd1,
    0x0a, 0x16, 0x24, 0x34, 0xe1, 0x25, 0xf1, 0x17, 0x18, 0x19, 0x1a, 0x26, 0x27, 0x28, 0x29, 0x2a, 0x35, 0x36,
    0x37, 0x38, 0x39, 0x3a, 0x43, 0x44, 0x45, 0x46, 0x47, 0x48, 0x49, 0x4a, 0x53, 0x54, 0x55, 0x56, 0x57, 0x58,
    0x59, 0x5a, 0x63, 0x64, 0x65, 0x66, 0x67, 0x68, 0x69, 0x6a, 0x73, 0x74, 0x75, 0x76, 0x77, 0x78, 0x79, 0x7a,
    0x82, 0x83, 0x84, 0x85, 0x86, 0x87, 0x88, 0x89, 0x8a, 0x92, 0x93, 0x94, 0x95, 0x96, 0x97, 0x98, 0x99, 0x9a,
    0xa2, 0xa3, 0xa4, 0xa5, 0xa6, 0xa7, 0xa8, 0xa9, 0xaa, 0xb2, 0xb3, 0xb4, 0xb5, 0xb6, 0xb7, 0xb8, 0xb9, 0xba,
    0xc2, 0xc3, 0xc4, 0xc5, 0xc6, 0xc7, 0xc8, 0xc9, 0xca, 0xd2, 0xd3, 0xd4, 0xd5, 0xd6, 0xd7, 0xd8, 0xd9, 0xda,
    0xe2, 0xe3, 0xe4, 0xe5, 0xe6, 0xe7, 0xe8, 0xe9, 0xea, 0xf2, 0xf3, 0xf4, 0xf5, 0xf6, 0xf7, 0xf8, 0xf9, 0xfa,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn codes_are_those_of_the_standard() {
        // T.81, tables K.3 and K.5: size 4 is 101; run 0 and size 10 is 1111111110000011; the end of a block is 1010.
        let [dc, ..] = standard_dc();
        let [ac, ..] = standard_ac();
        assert_eq!(dc.decode(&mut Bits::new(&[0b1010_0000, 0])), Ok(4));
        assert_eq!(ac.decode(&mut Bits::new(&[0b1010_0000, 0])), Ok(0));
        // 0xff is followed by a zero in the data.
        assert_eq!(ac.decode(&mut Bits::new(&[0xff, 0, 0b1000_0011])), Ok(0x0a));
    }

    #[test]
    fn impossible_tables_and_codes_are_refused() {
        let mut counts = [0; 16];
        counts[0] = 3;
        assert_eq!(Huffman::new(&counts, &[1, 2, 3]).err(), Some(JpegDamage::Table));
        counts[0] = 1;
        assert_eq!(Huffman::new(&counts, &[]).err(), Some(JpegDamage::Table));
        assert_eq!(Huffman::new(&[255; 16], &[0; 4096]).err(), Some(JpegDamage::Table));
        let one = Huffman::new(&counts, &[7]).unwrap();
        assert_eq!(one.decode(&mut Bits::new(&[0x00])), Ok(7));
        assert_eq!(one.decode(&mut Bits::new(&[0x80])), Err(JpegDamage::Code));
    }
}
