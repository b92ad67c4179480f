//! Selection of the facets that may be seen within a part of the image, eight at a time.

use super::facet::Facet;
use super::lens::Span;
use plumbline_config::Portable;

/// Facets side by side.
pub(super) const GROUP: usize = 8;

/// A linear function of the bearing for each facet: factors of x and of y, and constants.
type Lanes = [[f32; GROUP]; 3];

/// Eight facets, their linear functions side by side (see [`Facet`]); lanes that are left over are never in view.
#[derive(Clone, Copy, Debug)]
pub(super) struct Group {
    s: Lanes,
    t: Lanes,
    w: Lanes,
    facets: [u16; GROUP],
    count: usize,
}

/// Working memory of a selection.
#[derive(Clone, Debug)]
pub(super) struct Selection {
    groups: Vec<Group>,
    nearest: Vec<[f32; GROUP]>,
}

/// Values of `f` over `span`: the least, and the greatest, as [`Span::range`].
#[inline]
fn range(span: &Span, f: &Lanes) -> [[f32; GROUP]; 2] {
    let mut out = [[0.0; GROUP]; 2];
    for i in 0..GROUP {
        [out[0][i], out[1][i]] = span.range(&[f[0][i], f[1][i], f[2][i]]);
    }
    out
}

#[inline]
fn difference(a: &Lanes, b: &Lanes) -> Lanes {
    std::array::from_fn(|k| std::array::from_fn(|i| a[k][i] - b[k][i]))
}

impl Group {
    const EMPTY: Self = Self {
        s: [[0.0; GROUP]; 3],
        t: [[0.0; GROUP]; 3],
        w: [[0.0; GROUP]; 3],
        facets: [0; GROUP],
        count: 0,
    };

    /// Greatest inverse depth within `span`, -1 for a facet that is not there, and the least for those that cover all of
    /// it, else 0: see [`Facet::nearest_within`] and [`Facet::covers`].
    #[inline]
    pub(super) fn depths(&self, span: &Span) -> [[f32; GROUP]; 2] {
        let [furthest, nearest] = range(span, &self.w);
        let sides = [&self.s, &self.t].map(|f| [range(span, f), range(span, &difference(&self.w, f))]);
        let [[[s0, s1], [r0, r1]], [[t0, t1], [q0, q1]]] = sides;
        let mut out = [[0.0; GROUP]; 2];
        for i in 0..GROUP {
            let is_in =
                (nearest[i] > 0.0) & (s1[i] >= 0.0) & (r1[i] >= 0.0) & (t1[i] >= 0.0) & (q1[i] >= 0.0);
            let covers =
                (furthest[i] > 0.0) & (s0[i] >= 0.0) & (r0[i] >= 0.0) & (t0[i] >= 0.0) & (q0[i] >= 0.0);
            out[0][i] = if is_in { nearest[i] } else { -1.0 };
            out[1][i] = if covers { furthest[i] } else { 0.0 };
        }
        out
    }
}

impl Group {
    /// Their numbers.
    #[inline]
    pub(super) fn facets(&self) -> &[u16] {
        &self.facets[..self.count]
    }

    /// Flags of the facets that may be seen within `span`, see [`Facet::nearest_within`].
    #[inline]
    pub(super) fn touch(&self, span: &Span) -> [bool; GROUP] {
        std::array::from_fn(|i| {
            let lane = |f: &Lanes| [f[0][i], f[1][i], f[2][i]];
            let (s, t, w) = (lane(&self.s), lane(&self.t), lane(&self.w));
            let rest = |f: &[f32; 3]| [w[0] - f[0], w[1] - f[1], w[2] - f[2]];
            let reaches = |f: &[f32; 3]| span.range(f)[1] >= 0.0;
            (span.range(&w)[1] > 0.0) & reaches(&s) & reaches(&rest(&s)) & reaches(&t) & reaches(&rest(&t))
        })
    }
}

impl Selection {
    /// Memory for a world with `surfaces`.
    pub(super) fn new(surfaces: usize) -> Self {
        let groups = surfaces.div_ceil(GROUP);
        Self { groups: Vec::with_capacity(groups), nearest: Vec::with_capacity(groups) }
    }

    /// Makes `chosen` those that are selected from.
    pub(super) fn load(&mut self, facets: &[Facet], chosen: impl Iterator<Item = u16>) {
        self.groups.clear();
        for (k, index) in chosen.enumerate() {
            let (lane, facet) = (k % GROUP, &facets[index as usize]);
            if lane == 0 {
                self.groups.push(Group::EMPTY);
            }
            let Some(group) = self.groups.last_mut() else { return };
            (group.facets[lane], group.count) = (index, lane + 1);
            for c in 0..3 {
                group.s[c][lane] = facet.s[c];
                group.t[c][lane] = facet.t[c];
                group.w[c][lane] = facet.w[c];
            }
        }
    }

    /// Groups that were loaded.
    #[inline]
    pub(super) fn groups(&self) -> &[Group] {
        &self.groups
    }

    /// Selects the facets that may be seen within `span`, in their order: not outside of it and not behind
    /// one that covers it.
    pub(super) fn select(&mut self, span: &Span, into: &mut Vec<u16>) {
        into.clear();
        self.nearest.clear();
        let mut behind = [0.0_f32; GROUP];
        for group in &self.groups {
            let [nearest, covered] = group.depths(span);
            self.nearest.push(nearest);
            behind.iter_mut().zip(&covered).for_each(|(behind, covered)| *behind = behind.at_least(*covered));
        }
        let behind = behind.iter().fold(0.0_f32, |most, behind| most.at_least(*behind));
        for (group, nearest) in self.groups.iter().zip(&self.nearest) {
            for (&index, &nearest) in group.facets.iter().zip(nearest) {
                if nearest >= behind {
                    into.push(index);
                }
            }
        }
    }
}
