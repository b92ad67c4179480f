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

/// A square grey pattern, repeated in both directions, with its pyramid.
///
/// A texel is stored with its right, lower and lower-right neighbours in one word: a bilinear look-up is
/// one read.
#[derive(Clone, Debug)]
pub(super) struct Texture {
    levels: Vec<Level>,
}

#[derive(Clone, Debug)]
struct Level {
    /// Side minus one; the side is a power of two.
    mask: i32,
    shift: u32,
    /// By blocks of 4x4, each of one line of the processor's cache: neighbours in any direction are mostly there already.
    quads: Vec<u32>,
}

impl Texture {
    /// Builds the pyramid of `side * side` values in `[0, 1]`; `side` is a power of two.
    pub(super) fn new(side: usize, values: &[f32]) -> Self {
        assert!(side.is_power_of_two() && values.len() == side * side, "a texture is a square of 2^n");
        let mut levels = Vec::new();
        let (mut side, mut values) = (side, values.to_vec());
        loop {
            levels.push(Level::new(side, &values));
            if side == 1 {
                return Self { levels };
            }
            values = halve(side, &values);
            side /= 2;
        }
    }

    /// Memory of the pyramid, bytes.
    #[cfg(test)]
    pub(super) fn bytes(&self) -> usize {
        self.levels.iter().map(|level| 4 * level.quads.len()).sum()
    }

    /// Means of the pattern over `N` footprints, 0 to 255.
    #[inline]
    pub(super) fn sample<const N: usize>(&self, footprints: &Footprints<N>) -> [f32; N] {
        let plan = footprints.plan(self.levels.len() - 1);
        let (mut fine, mut coarse) = ([0; N], [0; N]);
        if plan.part.iter().any(|&part| part < 1.0) {
            fine = self.sums::<N, false>(&plan);
        }
        if plan.part.iter().any(|&part| part > 0.0) {
            coarse = self.sums::<N, true>(&plan);
        }
        std::array::from_fn(|i| {
            let fine = if plan.part[i] < 1.0 { fine[i] as i32 as f32 } else { 0.0 };
            let blend = fine + (coarse[i] as i32 as f32 - fine) * plan.part[i];
            blend / (65536 * plan.taps[i]) as i32 as f32
        })
    }

    /// Sums, of the samples of each footprint on its level or on the `NEXT`, of the bilinear values times 65536.
    #[inline]
    fn sums<const N: usize, const NEXT: bool>(&self, plan: &Plan<N>) -> [u32; N] {
        let number = |i: usize| (plan.level[i] as usize + usize::from(NEXT)).min(self.levels.len() - 1);
        if plan.level.iter().all(|&level| level == plan.level[0]) {
            let level = &self.levels[number(0)];
            let (shift, mask) = (level.shift, level.mask);
            return plan.sums::<NEXT>(|_| (shift, mask), |_, at| level.quad(at));
        }
        let levels: [&Level; N] = std::array::from_fn(|i| &self.levels[number(i)]);
        let (shifts, masks) = (levels.map(|level| level.shift), levels.map(|level| level.mask));
        plan.sums::<NEXT>(|i| (shifts[i], masks[i]), |i, at| levels[i].quad(at))
    }
}

/// What `N` pixels cover of a pattern, in texels of the finest level: parallelograms around `(u, v)`
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

/// How footprints are sampled: level and share of the next, number of samples, the first one's place on
/// the level and the step to the next (with [`FRACTION_BITS`] fractional bits).
struct Plan<const N: usize> {
    level: [i32; N],
    part: [f32; N],
    taps: [u32; N],
    x: [i32; N],
    y: [i32; N],
    step_x: [i32; N],
    step_y: [i32; N],
}

impl<const N: usize> Plan<N> {
    /// Sums, of the samples of each footprint, of the bilinear values times 65536; `shape` tells shift and mask of the level
    /// of a lane, `quad` reads from it. Everything but the reading goes side by side.
    #[inline]
    fn sums<const NEXT: bool>(
        &self,
        shape: impl Fn(usize) -> (u32, i32),
        quad: impl Fn(usize, u32) -> u32,
    ) -> [u32; N] {
        // The same place on the next level: p / 2 - 1/4.
        let there = |p: i32| if NEXT { p.wrapping_sub(HALF) >> 1 } else { p };
        let most = self.taps.iter().fold(0, |most, &taps| taps.max(most)) as usize;
        // In memory, since the compiler would reckon one by one what is read one by one.
        let mut places = [[0; N]; MAX_TAPS as usize];
        let (mut x, mut y) = (self.x, self.y);
        for places in places.iter_mut().take(most) {
            for i in 0..N {
                let (shift, mask) = shape(i);
                let (column, row) =
                    ((there(x[i]) >> FRACTION_BITS) & mask, (there(y[i]) >> FRACTION_BITS) & mask);
                places[i] = quad_at(column as u32, row as u32, shift);
                // Lanes that nobody looks at may hold anything.
                (x[i], y[i]) = (x[i].wrapping_add(self.step_x[i]), y[i].wrapping_add(self.step_y[i]));
            }
        }
        let mut sums = [0; N];
        (x, y) = (self.x, self.y);
        for (tap, places) in (0..).zip(places.iter().take(most)) {
            let quads: [u32; N] = std::array::from_fn(|i| quad(i, places[i]));
            for i in 0..N {
                let (right, down) = ((there(x[i]) & 255) as u32, (there(y[i]) & 255) as u32);
                let (left, next) = (quads[i] & 0x00ff_00ff, (quads[i] >> 8) & 0x00ff_00ff);
                let mixed = left * (256 - right) + next * right;
                let value = (mixed & 0xffff) * (256 - down) + (mixed >> 16) * down;
                sums[i] += if tap < self.taps[i] { value } else { 0 };
                (x[i], y[i]) = (x[i].wrapping_add(self.step_x[i]), y[i].wrapping_add(self.step_y[i]));
            }
        }
        sums
    }
}

impl<const N: usize> Footprints<N> {
    /// Lane by lane without branches, so that it vectorises.
    #[inline]
    fn plan(&self, last_level: usize) -> Plan<N> {
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

impl Level {
    fn new(side: usize, values: &[f32]) -> Self {
        let byte = |x: usize, y: usize| {
            let value = values[(y % side) * side + x % side];
            (value * 255.0).round().clamp(0.0, 255.0) as u32
        };
        let shift = side.trailing_zeros();
        let mut quads = vec![0; (side * side).max(16)];
        for (y, x) in (0..side).flat_map(|y| (0..side).map(move |x| (y, x))) {
            // Even bytes: left column (upper, lower); odd bytes: right column.
            let left = byte(x, y) | byte(x, y + 1) << 16;
            let right = byte(x + 1, y) | byte(x + 1, y + 1) << 16;
            quads[quad_at(x as u32, y as u32, shift) as usize] = left | right << 8;
        }
        Self { mask: side as i32 - 1, shift, quads }
    }

    /// The texel that stands at `at`, with its neighbours.
    #[inline]
    fn quad(&self, at: u32) -> u32 {
        self.quads[at as usize]
    }
}

/// Where the quad of a texel stands in a level of side `2^shift`.
#[inline]
fn quad_at(x: u32, y: u32, shift: u32) -> u32 {
    (y >> 2) << (shift + 2) | (x >> 2) << 4 | (y & 3) << 2 | (x & 3)
}

fn halve(side: usize, values: &[f32]) -> Vec<f32> {
    let half = side / 2;
    let mut out = Vec::with_capacity(half * half);
    for y in 0..half {
        for x in 0..half {
            let at = 2 * y * side + 2 * x;
            out.push(0.25 * (values[at] + values[at + 1] + values[at + side] + values[at + side + 1]));
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(texture: &Texture, at: [f32; 2], right: [f32; 2], down: [f32; 2]) -> f32 {
        let footprint = Footprints {
            u: [at[0]],
            v: [at[1]],
            u_right: [right[0]],
            v_right: [right[1]],
            u_down: [down[0]],
            v_down: [down[1]],
        };
        texture.sample(&footprint)[0]
    }

    fn checker(side: usize, field: usize) -> Texture {
        let values: Vec<f32> = (0..side * side)
            .map(
                |i: usize| {
                    if ((i % side) / field + (i / side) / field).is_multiple_of(2) { 0.2 } else { 0.8 }
                },
            )
            .collect();
        Texture::new(side, &values)
    }

    #[test]
    fn close_up_it_shows_the_texels() {
        let texture = checker(64, 8);
        let small = ([0.1, 0.0], [0.0, 0.1]);
        assert!((one(&texture, [4.0, 4.0], small.0, small.1) - 51.0).abs() < 1.0);
        assert!((one(&texture, [12.0, 4.0], small.0, small.1) - 204.0).abs() < 1.0);
        assert!((one(&texture, [8.0, 4.0], small.0, small.1) - 127.5).abs() < 1.0);
        assert!((one(&texture, [4.0 - 64.0, 4.0 + 128.0], small.0, small.1) - 51.0).abs() < 1.0);
    }

    #[test]
    fn from_afar_it_is_grey_at_every_angle() {
        let texture = checker(64, 2);
        for i in 0..20 {
            let at = [i as f32 * 0.7, i as f32 * 1.3];
            let value = one(&texture, at, [16.0, 3.0], [-3.0, 16.0]);
            assert!((value - 127.5).abs() < 6.0, "{value}");
        }
    }

    #[test]
    fn no_level_shifts_the_pattern() {
        let side = 256;
        let values: Vec<f32> = (0..side * side)
            .map(|i| 0.5 + 0.4 * (((i % side) as f32 + 0.5) / 64.0 * std::f32::consts::TAU).sin())
            .collect();
        let texture = Texture::new(side, &values);
        for width in [1.0_f32, 2.0, 4.0, 8.0] {
            // The pattern's zero crossing at texel 64 stays there at every level.
            let value = one(&texture, [64.0, 10.0], [width, 0.0], [0.0, width]);
            assert!((value - 127.5).abs() < 1.0, "{width}: {value}");
        }
    }

    #[test]
    fn oblique_surfaces_keep_their_detail_across() {
        let side = 64;
        let values: Vec<f32> = (0..side * side)
            .map(|i: usize| if ((i % side) / 4).is_multiple_of(2) { 0.2 } else { 0.8 })
            .collect();
        let texture = Texture::new(side, &values);
        let contrast = one(&texture, [6.0, 0.0], [1.0, 0.0], [0.0, 7.0])
            - one(&texture, [2.0, 0.0], [1.0, 0.0], [0.0, 7.0]);
        assert!(contrast > 120.0, "{contrast}");
    }
}
