//! Matching of described segments: nearest neighbours by Hamming distance among those that geometry admits.

use super::descriptor::LineDescriptor;
use plumbline_config::options::LinesConfig;

/// No partner.
const NONE: u16 = u16::MAX;

/// The best and the second best partner so far.
#[derive(Clone, Copy, Debug)]
struct Nearest {
    index: u16,
    distance: u32,
    second: u32,
}

impl Nearest {
    const NOBODY: Self = Self { index: NONE, distance: u32::MAX, second: u32::MAX };

    fn offer(&mut self, index: u16, distance: u32) {
        if distance < self.distance {
            (self.second, self.distance, self.index) = (self.distance, distance, index);
        } else if distance < self.second {
            self.second = distance;
        }
    }
}

/// Mutual nearest neighbours with distance and ratio tests. Everything is allocated at construction.
#[derive(Clone, Debug)]
pub struct LineMatcher {
    max_hamming: u32,
    max_ratio: f64,
    forward: Vec<Nearest>,
    backward: Vec<Nearest>,
    pairs: Vec<(u16, u16)>,
}

impl LineMatcher {
    /// With room for `room` tracks or segments on either side.
    #[must_use]
    pub fn new(options: &LinesConfig, room: usize) -> Self {
        Self {
            max_hamming: options.max_hamming,
            max_ratio: options.max_hamming_ratio,
            forward: Vec::with_capacity(room),
            backward: Vec::with_capacity(room),
            pairs: Vec::with_capacity(room),
        }
    }

    /// Pairs of `from` and `to`, in the order of `from`, of which each is the other's nearest among those
    /// that `admits` (index, index) lets pass. A second nearest that is nearly as near makes a match
    /// ambiguous.
    pub fn pairs(
        &mut self,
        from: &[LineDescriptor],
        to: &[LineDescriptor],
        mut admits: impl FnMut(usize, usize) -> bool,
    ) -> &[(u16, u16)] {
        self.forward.clear();
        self.forward.resize(from.len(), Nearest::NOBODY);
        self.backward.clear();
        self.backward.resize(to.len(), Nearest::NOBODY);
        for (i, a) in from.iter().enumerate() {
            for (j, b) in to.iter().enumerate() {
                if admits(i, j) {
                    let distance = a.hamming(b);
                    self.forward[i].offer(j as u16, distance);
                    self.backward[j].offer(i as u16, distance);
                }
            }
        }
        self.pairs.clear();
        for (i, best) in self.forward.iter().enumerate() {
            if best.index == NONE || best.distance > self.max_hamming {
                continue;
            }
            let back = &self.backward[usize::from(best.index)];
            let is_clear = |n: &Nearest| {
                n.second == u32::MAX || f64::from(n.distance) <= self.max_ratio * f64::from(n.second)
            };
            if usize::from(back.index) == i && is_clear(best) && is_clear(back) {
                self.pairs.push((i as u16, best.index));
            }
        }
        &self.pairs
    }
}
