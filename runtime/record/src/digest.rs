//! SHA-256 over the bits of what was estimated: two runs agree in it or differ.
//!
//! It holds what a user of the estimate acts on, in the order that its fields give. Left out are the figures
//! of a frame, the variances of the biases and the sigma of the time offset, and of odometry its number, state and
//! quality: the digests of all flights so far would change with them, and `verify` of the flight log compares these too,
//! field by field.

use crate::fields::{Record, Shape, Value};
use plumbline_config::Config;
use sha2::{Digest as _, Sha256};

/// A running digest.
#[derive(Clone, Debug, Default)]
pub struct Digest(Sha256);

impl Digest {
    /// Adds a record.
    pub fn add<T: Record>(&mut self, record: &T) {
        let at = |place: u8| T::FIELDS.iter().find(|field| field.about.digest == place);
        for field in (1..).map_while(at) {
            let value = (field.get_for_digest)(record);
            if field.about.shape == Shape::FloatsIfKnown {
                self.integer(i64::from(!matches!(value, Value::Missing)));
            }
            match value {
                Value::Whole(number) => self.integer(number),
                Value::Floats(runs) => runs.into_iter().flatten().for_each(|number| self.number(*number)),
                Value::Missing
                | Value::Bytes(_)
                | Value::Part(_)
                | Value::Singles(_)
                | Value::Text(_)
                | Value::Items(_) => {}
            }
        }
    }

    /// The digest so far, in hexadecimal.
    pub fn hex(&self) -> String {
        self.0.clone().finalize().iter().map(|byte| format!("{byte:02x}")).collect()
    }

    fn integer(&mut self, value: i64) {
        self.0.update(value.to_le_bytes());
    }

    fn number(&mut self, value: f64) {
        self.0.update(value.to_bits().to_le_bytes());
    }
}

/// SHA-256 of the configuration as TOML.
pub fn config_hash(config: &Config) -> String {
    hash_of(&config.to_toml().unwrap_or_default())
}

/// SHA-256 of a text, in hexadecimal.
pub fn hash_of(text: &str) -> String {
    hash_of_bytes(text.as_bytes())
}

/// SHA-256 of bytes, in hexadecimal.
pub fn hash_of_bytes(bytes: &[u8]) -> String {
    Sha256::digest(bytes).iter().map(|b| format!("{b:02x}")).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_bit_makes_another_digest() {
        let (mut a, mut b) = (Digest::default(), Digest::default());
        a.number(1.0);
        b.number(f64::from_bits(1.0f64.to_bits() + 1));
        assert_ne!(a.hex(), b.hex());
        assert_eq!(a.hex().len(), 64);
    }
}
