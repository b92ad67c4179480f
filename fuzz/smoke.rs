//! A smoke run of a fuzz target without coverage guidance: every seed as it is, and seeded mutations of the seeds, the
//! same on every run. Included by path into the tests of the crates, so that they always run.

use std::path::{Path, PathBuf};

/// Calls `target` with every file in `fuzz/seeds/NAME`, and then with `mutations` changed ones.
pub fn over_seeds_and_mutations(name: &str, mutations: usize, target: impl Fn(&[u8])) {
    let seeds = seeds(name);
    seeds.iter().for_each(|seed| target(seed));
    let mut random = Random(0x5eed);
    for _ in 0..mutations {
        let mut bytes = random.one_of(&seeds).clone();
        for _ in 0..1 + random.below(6) {
            mutate(&mut bytes, &seeds, &mut random);
        }
        target(&bytes);
    }
}

/// The seeds of a target, in order of their names.
fn seeds(name: &str) -> Vec<Vec<u8>> {
    let above = Path::new(env!("CARGO_MANIFEST_DIR")).ancestors().map(|folder| folder.join("fuzz/seeds"));
    let folder = above.into_iter().find(|folder| folder.is_dir()).expect("there are seeds").join(name);
    let listed = std::fs::read_dir(&folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    let mut paths: Vec<PathBuf> = listed.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    assert!(!paths.is_empty(), "{} is empty", folder.display());
    paths.iter().map(|path| std::fs::read(path).unwrap()).collect()
}

/// Bytes that parsers stumble over: ends of ranges, quotes, brackets, line ends, no UTF-8.
const AWKWARD: &[u8] = b"\0\x01\x7f\x80\xfe\xff\"'[]{}<>:,.=#-+/\\%&*!|e09 \t\r\n";

fn mutate(bytes: &mut Vec<u8>, seeds: &[Vec<u8>], random: &mut Random) {
    let at = random.below(bytes.len() + 1);
    let end = (at + 1 + random.below(16)).min(bytes.len());
    match random.below(8) {
        0 => bytes.truncate(at),
        1 => drop(bytes.drain(at..end)),
        2 => bytes.insert(at, *random.one_of(AWKWARD)),
        3 => {
            let piece = bytes[at..end].to_vec();
            bytes.splice(at..at, piece);
        }
        4 => {
            let other = random.one_of(seeds);
            let from = random.below(other.len() + 1);
            let to = (from + random.below(64)).min(other.len());
            bytes.splice(at..end, other[from..to].iter().copied());
        }
        5 if at < bytes.len() => bytes[at] ^= 1 << random.below(8),
        6 if at < bytes.len() => bytes[at] = *random.one_of(AWKWARD),
        _ => bytes[at..end].fill(random.next() as u8),
    }
}

/// SplitMix64.
struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// From 0 up to, but not including, `end`, which is above 0.
    fn below(&mut self, end: usize) -> usize {
        (self.next() % end as u64) as usize
    }

    fn one_of<'a, T>(&mut self, choices: &'a [T]) -> &'a T {
        &choices[self.below(choices.len())]
    }
}
