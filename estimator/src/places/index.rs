//! Search for the keyframes that hold features like these, by words without a vocabulary, and votes.
//!
//! The word of a descriptor is [`WORD_BITS`] of its bits (locality-sensitive hashing for the Hamming distance, Indyk and
//! Motwani 1998). A feature is stored under its word; a query looks under its own word and under those that differ in
//! one bit (multi-probe, Lv et al. 2007), so that one list of a feature does the work of several tables. A stored
//! feature that is met is compared whole, so that chance does not vote (Hamming embedding, Jégou et al. 2008). A vote
//! weighs as the feature is rare: `ln(1 + keyframes / keyframes voted for)`, the inverse document frequency.
//!
//! Lists are chains through one array; the place of a feature in the map is its place in the array, so that nothing
//! is allocated and a keyframe is taken out as quickly as it was put in. A step along a chain waits for memory; the
//! chains of a feature are walked side by side, so that these waits overlap, and so that none is favoured when the work
//! that is allowed for a feature ends.
//!
//! Other designs that were tried, vocabularies among them, stand in `notes/places.md`.

use super::descriptor::{BITS, Descriptor};
use super::feature::Feature;
use plumbline_config::Random;

/// Bits of a word.
pub const WORD_BITS: usize = 20;
/// Words that are looked under: that of the feature, and its neighbours.
const PROBES: usize = WORD_BITS + 1;
/// Stored features that one of a query is compared with, at most: words that so many share say little.
const MAX_COMPARED: usize = 512;
/// Descriptors that differ in more bits are not alike.
const MAX_VOTE_DISTANCE: u32 = 64;
/// Draws the bits of a descriptor that make its word. They are comparisons at places drawn at random, so that no choice is
/// better than another one beforehand.
const WORD_SEED: u64 = 1;
/// No feature: the end of a chain.
pub(super) const NONE: u32 = u32::MAX;

/// A keyframe and how well it fits a query.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Candidate {
    /// Place of the keyframe in the map.
    pub slot: usize,
    /// Sum of the votes, over the root of the number of features.
    pub score: f32,
}

/// An inverted index over the features of a map of fixed size.
#[derive(Clone, Debug)]
pub struct Index {
    stride: usize,
    word_bits: [u8; WORD_BITS],
    heads: Vec<u32>,
    next: Vec<u32>,
}

/// Working memory of a query; allocated once.
#[derive(Clone, Debug)]
pub struct Votes {
    scores: Vec<f32>,
    /// Query feature that voted last for a slot, and its smallest distance.
    voted: Vec<(u32, u32)>,
    touched: Vec<u32>,
    candidates: Vec<Candidate>,
    /// Stored features that a feature is compared with.
    compared: Vec<u32>,
}

impl Votes {
    /// For maps of up to `keyframes`.
    #[must_use]
    pub fn new(keyframes: usize) -> Self {
        Self {
            scores: vec![0.0; keyframes],
            voted: vec![(NONE, 0); keyframes],
            touched: Vec::with_capacity(keyframes),
            candidates: Vec::with_capacity(keyframes),
            compared: Vec::with_capacity(MAX_COMPARED),
        }
    }
}

impl Index {
    /// For `keyframes` of up to `features` each.
    #[must_use]
    pub fn new(keyframes: usize, features: usize) -> Self {
        Self {
            stride: features,
            word_bits: draw_bits(),
            heads: vec![NONE; 1 << WORD_BITS],
            next: vec![NONE; keyframes * features],
        }
    }

    /// Puts the features of a keyframe in.
    pub fn insert(&mut self, slot: usize, features: &[Feature]) {
        for (i, feature) in features.iter().enumerate() {
            let node = slot * self.stride + i;
            let word = self.word(&feature.descriptor);
            self.next[node] = std::mem::replace(&mut self.heads[word], node as u32);
        }
    }

    /// Takes the features of a keyframe out; they must be those that were put in.
    pub fn remove(&mut self, slot: usize, features: &[Feature]) {
        for (i, feature) in features.iter().enumerate() {
            let node = slot * self.stride + i;
            self.unlink(self.word(&feature.descriptor), node as u32);
        }
    }

    fn unlink(&mut self, word: usize, node: u32) {
        let after = self.next[node as usize];
        let mut at = self.heads[word];
        if at == node {
            self.heads[word] = after;
            return;
        }
        while at != NONE {
            let next = self.next[at as usize];
            if next == node {
                self.next[at as usize] = after;
                return;
            }
            at = next;
        }
    }

    /// The word of a descriptor: where its chain begins.
    fn word(&self, descriptor: &Descriptor) -> usize {
        let bit = |at: u8| (descriptor.0[usize::from(at >> 6)] >> (at & 63)) as usize & 1;
        self.word_bits.iter().enumerate().fold(0, |word, (i, &at)| word | bit(at) << i)
    }

    /// Keyframes that hold features like those of a query, best first (ties: by slot). `stored` are the features of
    /// all slots, `counts` how many each slot has; `allowed` passes over keyframes.
    pub fn query<'a>(
        &self,
        features: &[Feature],
        stored: &[Feature],
        counts: &[u16],
        allowed: impl Fn(usize) -> bool,
        votes: &'a mut Votes,
    ) -> &'a [Candidate] {
        votes.scores.fill(0.0);
        votes.voted.fill((NONE, 0));
        let keyframes = counts.iter().filter(|c| **c > 0).count() as f32;
        for (i, feature) in features.iter().enumerate() {
            self.walk(&feature.descriptor, &mut votes.compared);
            self.vote(i as u32, &feature.descriptor, stored, votes);
            let weight = libm::log1pf(keyframes / votes.touched.len().max(1) as f32);
            for &slot in &votes.touched {
                let distance = votes.voted[slot as usize].1 as f32;
                votes.scores[slot as usize] += weight * (1.0 - distance / (MAX_VOTE_DISTANCE + 1) as f32);
            }
        }
        votes.candidates.clear();
        for (slot, &count) in counts.iter().enumerate() {
            let score = votes.scores[slot] / f32::from(count.max(1)).sqrt();
            if score > 0.0 && allowed(slot) {
                votes.candidates.push(Candidate { slot, score });
            }
        }
        votes.candidates.sort_unstable_by(|a, b| b.score.total_cmp(&a.score).then(a.slot.cmp(&b.slot)));
        &votes.candidates
    }

    /// Follows the chains of a descriptor, one step of each at a time.
    fn walk(&self, descriptor: &Descriptor, compared: &mut Vec<u32>) {
        let word = self.word(descriptor);
        let mut chains: heapless::Vec<u32, PROBES> = heapless::Vec::new();
        let neighbours = (0..WORD_BITS).map(|bit| word ^ (1 << bit));
        chains.extend(std::iter::once(word).chain(neighbours).map(|w| self.heads[w]).filter(|h| *h != NONE));
        compared.clear();
        while !chains.is_empty() && compared.len() + chains.len() <= MAX_COMPARED {
            compared.extend_from_slice(&chains);
            chains.retain_mut(|at| {
                *at = self.next[*at as usize];
                *at != NONE
            });
        }
    }

    /// The keyframes that feature `query` votes for, and its distance to each.
    fn vote(&self, query: u32, descriptor: &Descriptor, stored: &[Feature], votes: &mut Votes) {
        votes.touched.clear();
        for &feature in &votes.compared {
            let distance = stored[feature as usize].descriptor.distance(descriptor);
            if distance > MAX_VOTE_DISTANCE {
                continue;
            }
            let slot = feature as usize / self.stride;
            let voted = &mut votes.voted[slot];
            if voted.0 != query {
                *voted = (query, distance);
                votes.touched.push(slot as u32);
            } else {
                voted.1 = voted.1.min(distance);
            }
        }
    }
}

/// Different bits.
fn draw_bits() -> [u8; WORD_BITS] {
    let mut random = Random::new(WORD_SEED);
    let mut order: [u8; BITS] = std::array::from_fn(|i| i as u8);
    for i in 0..WORD_BITS {
        order.swap(i, i + random.below(BITS - i));
    }
    std::array::from_fn(|i| order[i])
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::Vector2;
    use plumbline_config::Random;

    const FEATURES: usize = 50;

    fn feature(descriptor: Descriptor) -> Feature {
        Feature {
            descriptor,
            xy: Vector2::zeros(),
            sigma_xy: 0.002,
            inverse_depth: 0.5,
            sigma_inverse_depth: 0.01,
        }
    }

    fn keyframe(seed: u64) -> Vec<Feature> {
        let mut random = Random::new(seed);
        (0..FEATURES).map(|_| feature(Descriptor(std::array::from_fn(|_| random.next_bits())))).collect()
    }

    /// Returns the features with a tenth of their bits changed.
    fn seen_again(features: &[Feature], seed: u64) -> Vec<Feature> {
        let mut random = Random::new(seed);
        let mut noisy = |bits: u64| (0..64).fold(bits, |b, i| b ^ (u64::from(random.unit() < 0.1) << i));
        features.iter().map(|f| feature(Descriptor(f.descriptor.0.map(&mut noisy)))).collect()
    }

    #[test]
    fn the_keyframe_seen_again_comes_first_until_it_is_taken_out() {
        let keyframes: Vec<_> = (0..40).map(keyframe).collect();
        let mut index = Index::new(40, FEATURES);
        keyframes.iter().enumerate().for_each(|(slot, f)| index.insert(slot, f));
        let stored = keyframes.concat();
        let mut votes = Votes::new(40);
        let query = seen_again(&keyframes[7], 1);
        let mut counts = [FEATURES as u16; 40];
        assert_eq!(index.query(&query, &stored, &counts, |_| true, &mut votes)[0].slot, 7);
        assert!(index.query(&query, &stored, &counts, |s| s != 7, &mut votes).iter().all(|c| c.slot != 7));
        index.remove(7, &keyframes[7]);
        counts[7] = 0;
        assert!(index.query(&query, &stored, &counts, |_| true, &mut votes).iter().all(|c| c.slot != 7));
        // The others are still found.
        let query = seen_again(&keyframes[8], 2);
        assert_eq!(index.query(&query, &stored, &counts, |_| true, &mut votes)[0].slot, 8);
    }
}
