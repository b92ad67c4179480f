//! Which keyframes hold features like these? Words without a vocabulary, and votes.
//!
//! A descriptor has [`TABLES`] words: [`WORD_BITS`] of its bits each (locality-sensitive hashing for the Hamming
//! distance, Indyk and Motwani 1998). Descriptors that differ in a tenth of their bits share one of four words with a
//! probability of six tenths. A stored feature that shares a word is compared whole, so that chance does not vote
//! (Hamming embedding, Jégou et al. 2008). A vote weighs as the feature is rare: `ln(1 + keyframes / keyframes voted
//! for)`, the inverse document frequency.
//!
//! Lists are chains through one array; the place of a feature in the map is its place in the array, so that nothing
//! is allocated and a keyframe is taken out as quickly as it was put in.

use super::descriptor::Descriptor;
use super::feature::Feature;

/// Words of a descriptor.
pub const TABLES: usize = 4;
/// Bits of a word.
pub const WORD_BITS: usize = 14;
/// Stored features looked at for one word, at most: a word that so many share says little.
const MAX_CHAIN: usize = 256;
/// Descriptors that differ in more bits are not alike.
const MAX_VOTE_DISTANCE: u32 = 64;
/// End of a chain.
const NONE: u32 = u32::MAX;

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
    heads: Vec<u32>,
    next: Vec<u32>,
}

/// What a query needs besides the index; allocated once.
#[derive(Clone, Debug)]
pub struct Votes {
    scores: Vec<f32>,
    /// Query feature that voted last for a slot, and its smallest distance.
    voted: Vec<(u32, u32)>,
    touched: Vec<u32>,
    candidates: Vec<Candidate>,
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
        }
    }
}

impl Index {
    /// For `keyframes` of up to `features` each.
    #[must_use]
    pub fn new(keyframes: usize, features: usize) -> Self {
        Self {
            stride: features,
            heads: vec![NONE; TABLES << WORD_BITS],
            next: vec![NONE; keyframes * features * TABLES],
        }
    }

    /// Puts the features of a keyframe in.
    pub fn insert(&mut self, slot: usize, features: &[Feature]) {
        for (i, feature) in features.iter().enumerate() {
            for table in 0..TABLES {
                let node = self.node(slot, i, table);
                let head = &mut self.heads[word(&feature.descriptor, table)];
                self.next[node] = std::mem::replace(head, node as u32);
            }
        }
    }

    /// Takes the features of a keyframe out; they must be those that were put in.
    pub fn remove(&mut self, slot: usize, features: &[Feature]) {
        for (i, feature) in features.iter().enumerate() {
            for table in 0..TABLES {
                let node = self.node(slot, i, table);
                let word = word(&feature.descriptor, table);
                self.unlink(word, node as u32);
            }
        }
    }

    fn node(&self, slot: usize, feature: usize, table: usize) -> usize {
        (slot * self.stride + feature) * TABLES + table
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
            votes.touched.clear();
            for table in 0..TABLES {
                self.collect(i as u32, &feature.descriptor, table, stored, votes);
            }
            let weight = (1.0 + keyframes / votes.touched.len().max(1) as f32).ln();
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

    fn collect(
        &self,
        query: u32,
        descriptor: &Descriptor,
        table: usize,
        stored: &[Feature],
        votes: &mut Votes,
    ) {
        let mut at = self.heads[word(descriptor, table)];
        for _ in 0..MAX_CHAIN {
            if at == NONE {
                return;
            }
            let feature = at as usize / TABLES;
            let distance = stored[feature].descriptor.distance(descriptor);
            if distance <= MAX_VOTE_DISTANCE {
                let slot = feature / self.stride;
                let voted = &mut votes.voted[slot];
                if voted.0 != query {
                    *voted = (query, distance);
                    votes.touched.push(slot as u32);
                } else {
                    voted.1 = voted.1.min(distance);
                }
            }
            at = self.next[at as usize];
        }
    }
}

/// A word of a descriptor: where its chain begins.
fn word(descriptor: &Descriptor, table: usize) -> usize {
    let bits = descriptor.0[table] as usize & ((1 << WORD_BITS) - 1);
    (table << WORD_BITS) | bits
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::places::random::Random;
    use nalgebra::Vector2;

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

    /// The same with a tenth of the bits changed.
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
