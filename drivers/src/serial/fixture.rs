//! Fixtures of the tests of all protocols: lines with their usual troubles, and what came over them.

use super::framing::Deframer;
use super::fuzzing::STEP_RAD_S;
pub use super::fuzzing::{Device, imu_config};
use super::protocol::{Content, Protocol};
use plumbline_config::Random;

/// Bytes written in hexadecimal.
pub fn hex(text: &str) -> Vec<u8> {
    text.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect()
}

/// Contents of the frames of a stream.
pub fn contents(protocol: &mut dyn Protocol, stream: &[u8]) -> Vec<Content> {
    let mut deframer = Deframer::default();
    let mut found = Vec::new();
    for piece in stream.chunks(100) {
        deframer.space()[..piece.len()].copy_from_slice(piece);
        deframer.advance(piece.len());
        while let Some(frame) = deframer.next(|bytes| protocol.scan(bytes)) {
            found.push(protocol.decode(frame));
        }
    }
    found
}

/// The sample that a reading was, by its values.
pub fn number_of(gyro_x: f64) -> i64 {
    (gyro_x / STEP_RAD_S).round() as i64
}

/// Troubles of a line, drawn from a seed for each sample on its own.
#[derive(Clone, Copy, Debug)]
pub struct Trouble {
    pub seed: u64,
    /// Share of samples with noise before them.
    pub noise: f64,
    /// Share of samples of which a byte is changed, or the end is missing.
    pub hit: f64,
}

impl Trouble {
    /// Bytes sent for sample `k`, whose frame this is, and true if the frame itself was hit.
    pub fn pass(&self, k: i64, mut frame: Vec<u8>) -> (Vec<u8>, bool) {
        let mut draws = Random::new(Random::new(self.seed ^ ((k as u64) << 32)).next_bits());
        let mut sent = Vec::new();
        if draws.unit() < self.noise {
            sent.extend((0..draws.below(60)).map(|_| draws.next_bits() as u8));
        }
        let is_hit = draws.unit() < self.hit;
        if is_hit {
            // Within the frame: the zeros around one of ours are shared with its neighbours.
            let place = 1 + draws.below(frame.len() - 2);
            match draws.next_bits() % 2 {
                0 => frame[place] ^= 1 << draws.below(8),
                _ => frame.truncate(place),
            }
        }
        sent.extend(frame);
        (sent, is_hit)
    }
}
