//! Surface patterns as pyramids of repeated textures, and their anti-aliased look-up.
//!
//! Every level is the 2x2 box mean of the one below, so the centres of texels lie at `(i + 1/2) 2^l`
//! of the finest level at every level, and no level shifts the pattern. A look-up blends two levels
//! (trilinear) and takes several samples along the longer axis of the pixel's footprint (anisotropic),
//! so oblique surfaces are as sharp across the view as they should be, and none shimmers.

use plumbline_config::Portable;

/// Most samples along the footprint.
const MAX_TAPS: f32 = 8.0;
/// The level is chosen for a footprint of this share of the true one: bilinear look-up blurs by itself,
/// and half a level finer the result is nearest to the mean of exact rays.
const SHARPNESS: f32 = 0.7;
/// Sub-texel resolution of the bilinear weights, bits.
const FRACTION_BITS: i32 = 8;
/// Half a texel.
const HALF: i32 = 1 << (FRACTION_BITS - 1);

/// Texels that a row of a level is longer by than its side: the first one again, and as many as keep rows one below another
/// from taking the same places of the processor's cache.
const PADDING: u32 = 32;
/// Bytes of a texel and the one below it, which stand together: with those to their right, a bilinear look-up is one read.
const PAIR: u32 = 2;

/// A square grey pattern, repeated in both directions, with its pyramid.
#[derive(Clone, Debug)]
pub(super) struct Texture {
    /// Levels, less one.
    last_level: u32,
    /// Pairs by rows, the coarsest level first.
    pairs: Vec<u8>,
}

impl Texture {
    /// Builds the pyramid of `side * side` values in `[0, 1]`; `side` is a power of two.
    pub(super) fn new(side: usize, values: &[f32]) -> Self {
        assert!(side.is_power_of_two() && values.len() == side * side, "a texture is a square of 2^n");
        let last_level = side.trailing_zeros();
        let mut pairs = vec![0; (PAIR * first_texel(2 * side as u32)) as usize];
        let (mut side, mut values) = (side, values.to_vec());
        loop {
            fill(&mut pairs[(PAIR * first_texel(side as u32)) as usize..], side, &values);
            if side == 1 {
                return Self { last_level, pairs };
            }
            values = halve(side, &values);
            side /= 2;
        }
    }

    /// Plans the sampling of footprints.
    #[inline]
    pub(super) fn plan<const N: usize>(&self, footprints: &Footprints<N>) -> Plan<N> {
        footprints.plan(self.last_level)
    }

    /// Means of the pattern, 0 to 255, over the footprints of a plan.
    #[inline]
    pub(super) fn means<const N: usize>(&self, plan: &Plan<N>) -> [f32; N] {
        let (mut level, mut next) = ([0; N], [0; N]);
        if plan.part.iter().any(|part| *part < 1.0) {
            level = self.sums::<N, false>(plan);
        }
        if plan.part.iter().any(|part| *part > 0.0) {
            next = self.sums::<N, true>(plan);
        }
        std::array::from_fn(|i| {
            let level = if plan.part[i] < 1.0 { level[i] as i32 as f32 } else { 0.0 };
            let blend = level + (next[i] as i32 as f32 - level) * plan.part[i];
            blend / (65536 * plan.taps[i]) as i32 as f32
        })
    }

    /// Sums, of the samples of each footprint, of the bilinear values times 65536.
    #[inline]
    fn sums<const N: usize, const NEXT: bool>(&self, plan: &Plan<N>) -> [u32; N] {
        let (mut masks, mut first, mut strides) = ([0; N], [0; N], [0; N]);
        for i in 0..N {
            let level = (plan.level[i] as u32 + u32::from(NEXT)).min(self.last_level);
            let side = 1 << (self.last_level - level);
            (masks[i], first[i], strides[i]) = (side - 1, PAIR * first_texel(side), PAIR * (side + PADDING));
        }
        let (mut sums, mut x, mut y) = ([0; N], plan.x, plan.y);
        for tap in 0..plan.taps.iter().fold(0, |most, taps| most.max(*taps)) {
            let mut places = [0; N];
            for i in 0..N {
                let [column, row] =
                    [x[i], y[i]].map(|p| (there::<NEXT>(p) >> FRACTION_BITS) as u32 & masks[i]);
                places[i] = first[i] + row * strides[i] + PAIR * column;
            }
            let quads = places.map(|place| self.quad(place));
            for i in 0..N {
                let [right, down] = [x[i], y[i]].map(|p| (there::<NEXT>(p) & 255) as u32);
                let (upper, lower) = (quads[i] & 0x00ff_00ff, (quads[i] >> 8) & 0x00ff_00ff);
                let mixed = upper * (256 - down) + lower * down;
                let value = (mixed & 0xffff) * (256 - right) + (mixed >> 16) * right;
                sums[i] += if tap < plan.taps[i] { value } else { 0 };
                // Lanes that nobody looks at may hold anything.
                (x[i], y[i]) = (x[i].wrapping_add(plan.step_x[i]), y[i].wrapping_add(plan.step_y[i]));
            }
        }
        sums
    }

    /// The texel that stands at byte `at`, the one below it, and those to their right, from the lowest byte on.
    #[inline]
    fn quad(&self, at: u32) -> u32 {
        let quad = &self.pairs[at as usize..][..4];
        u32::from_le_bytes([quad[0], quad[1], quad[2], quad[3]])
    }
}

/// Footprints of `N` pixels on a pattern, in texels of the finest level: parallelograms around `(u, v)`
/// spanned by one pixel's step right (`u_right`, `v_right`) and down.
#[derive(Clone, Copy, Debug)]
pub(super) struct Footprints<const N: usize> {
    pub(super) u: [f32; N],
    pub(super) v: [f32; N],
    pub(super) u_right: [f32; N],
    pub(super) v_right: [f32; N],
    pub(super) u_down: [f32; N],
    pub(super) v_down: [f32; N],
}

/// Sampling of footprints: level and share of the next, number of samples, the first one's place on the level
/// and the step to the next (with [`FRACTION_BITS`] fractional bits).
#[derive(Clone, Copy, Debug)]
pub(super) struct Plan<const N: usize> {
    level: [i32; N],
    part: [f32; N],
    taps: [u32; N],
    x: [i32; N],
    y: [i32; N],
    step_x: [i32; N],
    step_y: [i32; N],
}

/// Maps a coordinate to the `NEXT` level, p / 2 - 1/4, or returns it as it is.
#[inline]
fn there<const NEXT: bool>(p: i32) -> i32 {
    if NEXT { p.wrapping_sub(HALF) >> 1 } else { p }
}

impl<const N: usize> Footprints<N> {
    /// Lane by lane without branches, so that it vectorises.
    #[inline]
    fn plan(&self, last_level: u32) -> Plan<N> {
        let mut plan = Plan {
            level: [0; N],
            part: [0.0; N],
            taps: [0; N],
            x: [0; N],
            y: [0; N],
            step_x: [0; N],
            step_y: [0; N],
        };
        let last = last_level as f32;
        let side = (1_u32 << last_level) as f32;
        for i in 0..N {
            let right = self.u_right[i] * self.u_right[i] + self.v_right[i] * self.v_right[i];
            let down = self.u_down[i] * self.u_down[i] + self.v_down[i] * self.v_down[i];
            let wide = right > down;
            let (major_u, major_v) = (
                if wide { self.u_right[i] } else { self.u_down[i] },
                if wide { self.v_right[i] } else { self.v_down[i] },
            );
            let longest = right.at_least(down).sqrt().at_least(1e-6);
            let area = (self.u_right[i] * self.v_down[i] - self.v_right[i] * self.u_down[i]).abs();
            let narrow = area / longest;
            // Rounded, not rounded up: what the samples do not resolve is left to the level.
            let taps = (longest / narrow.at_least(1.0) + 0.5).clamp(1.0, MAX_TAPS).floor();
            let level = log2((SHARPNESS * narrow.at_least(longest / taps)).at_least(1.0)).at_most(last);
            let low = level.floor();
            let share = 1.0 / taps;
            let scale = f32::from_bits(((127 + FRACTION_BITS - whole(low)) as u32) << 23);
            let back = 0.5 * (taps - 1.0) * share;
            plan.level[i] = whole(low);
            // Blended over the middle half of the way between levels; elsewhere one of them will do.
            plan.part[i] = (2.0 * (level - low) - 0.5).clamp(0.0, 1.0);
            plan.taps[i] = whole(taps) as u32;
            // The side of the level, in the same units as the places on it.
            let (period, frequency) = (side * scale, f32::from_bits(TWICE_ONE - (side * scale).to_bits()));
            let place = |p: f32| whole(p.floor() - period * (p.floor() * frequency).floor());
            plan.x[i] = place((self.u[i] - major_u * back) * scale).wrapping_sub(HALF);
            plan.y[i] = place((self.v[i] - major_v * back) * scale).wrapping_sub(HALF);
            plan.step_x[i] = place(major_u * share * scale + 0.5);
            plan.step_y[i] = place(major_v * share * scale + 0.5);
        }
        plan
    }
}

/// Bits of 1 and of 1 again: less those of a power of two, the bits of its reciprocal.
const TWICE_ONE: u32 = 2 * 1.0_f32.to_bits();

/// The integer that `x` holds, of less than 2^22: its last bits once it is added to a number whose last bit is worth one.
/// `x as i32` would be made number by number, since it saturates.
#[inline]
fn whole(x: f32) -> i32 {
    const ONES: f32 = 12_582_912.0;
    (x + ONES).to_bits().wrapping_sub(ONES.to_bits()) as i32
}

/// Binary logarithm, exact at powers of two, continuous and rising between (error below 0.09).
#[inline]
fn log2(x: f32) -> f32 {
    let bits = x.to_bits();
    let exponent = (bits >> 23) as i32 - 127;
    exponent as f32 + ((bits & 0x007f_ffff) as f32) / 8_388_608.0
}

/// Texels of all levels that are smaller than one of `side`: a third of the square of it, rounded down, and the paddings.
#[inline]
fn first_texel(side: u32) -> u32 {
    ((side * side - 1) & 0x5555_5555) + (side - 1) * PADDING
}

/// Writes the pairs of a level.
fn fill(pairs: &mut [u8], side: usize, values: &[f32]) {
    let bytes: Vec<u8> = values.iter().map(|value| (value * 255.0).round().clamp(0.0, 255.0) as u8).collect();
    let stride = PAIR as usize * (side + PADDING as usize);
    for (y, row) in pairs.chunks_exact_mut(stride).take(side).enumerate() {
        let [upper, lower] = [y, (y + 1) % side].map(|y| &bytes[y * side..][..side]);
        let pairs = row.as_chunks_mut().0.iter_mut();
        // The first one again at the end.
        for (pair, (upper, lower)) in pairs.zip(upper.iter().zip(lower).chain([(&upper[0], &lower[0])])) {
            *pair = [*upper, *lower];
        }
    }
}

fn halve(side: usize, values: &[f32]) -> Vec<f32> {
    let mut out = Vec::with_capacity(values.len() / 4);
    for rows in values.chunks_exact(2 * side) {
        let (upper, lower) = rows.split_at(side);
        let squares = upper.as_chunks().0.iter().zip(lower.as_chunks().0);
        out.extend(squares.map(|([a, b], [c, d])| 0.25 * (a + b + c + d)));
    }
    out
}
