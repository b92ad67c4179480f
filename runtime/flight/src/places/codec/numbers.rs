//! Numbers, poses, lines and features of a map, to and from bytes.

use super::MapDefect;
use nalgebra::{Isometry3, Quaternion, Translation3, UnitQuaternion, Vector2, Vector3};
use plumbline_estimator::places::{Descriptor, Feature, MapLine};

/// Places further from the origin than this are no places, m.
const MAX_POSITION_M: f64 = 1e7;
/// By how much the length of a quaternion may differ from 1.
const ROTATION_TOLERANCE: f64 = 1e-6;

/// Bytes of a map that is written.
pub(super) struct Writer(pub Vec<u8>);

impl Writer {
    pub fn u32(&mut self, value: u32) {
        self.0.extend(value.to_le_bytes());
    }

    pub fn pose(&mut self, pose: &Isometry3<f64>) {
        let (p, q) = (pose.translation.vector, pose.rotation.coords);
        [p.x, p.y, p.z, q.x, q.y, q.z, q.w].iter().for_each(|v| self.0.extend(v.to_le_bytes()));
    }
}

/// Takes numbers off bytes whose length was checked before; beyond the end it reads zeros.
pub(super) struct Reader<'a>(pub &'a [u8]);

impl Reader<'_> {
    fn bytes<const N: usize>(&mut self) -> [u8; N] {
        match self.0.split_first_chunk::<N>() {
            Some((head, rest)) => {
                self.0 = rest;
                *head
            }
            None => [0; N],
        }
    }

    pub fn u32(&mut self) -> u32 {
        u32::from_le_bytes(self.bytes())
    }

    pub fn u64(&mut self) -> u64 {
        u64::from_le_bytes(self.bytes())
    }

    fn f64(&mut self) -> f64 {
        f64::from_le_bytes(self.bytes())
    }

    fn f32(&mut self) -> f32 {
        f32::from_le_bytes(self.bytes())
    }

    pub fn pose(&mut self) -> Result<Isometry3<f64>, MapDefect> {
        let [x, y, z, qx, qy, qz, qw] = std::array::from_fn(|_| self.f64());
        let rotation = Quaternion::new(qw, qx, qy, qz);
        // Written so that a NaN fails.
        let sound = [x, y, z].iter().all(|v| v.abs() <= MAX_POSITION_M)
            && (rotation.norm() - 1.0).abs() <= ROTATION_TOLERANCE;
        if !sound {
            return Err(MapDefect::Impossible("a pose that is none"));
        }
        // Not normalized anew: what is read is what was written, to the bit.
        let rotation = UnitQuaternion::new_unchecked(rotation);
        Ok(Isometry3::from_parts(Translation3::new(x, y, z), rotation))
    }

    pub fn line(&mut self) -> Result<MapLine, MapDefect> {
        let ends_c = [(); 2].map(|()| Vector3::from_fn(|_, _| self.f32()));
        // Written so that a NaN fails.
        if !ends_c.iter().flatten().all(|v| f64::from(v.abs()) <= MAX_POSITION_M) {
            return Err(MapDefect::Impossible("a line that is none"));
        }
        Ok(MapLine { ends_c })
    }

    pub fn feature(&mut self) -> Result<Feature, MapDefect> {
        let descriptor = Descriptor(std::array::from_fn(|_| self.u64()));
        let [x, y, sigma_xy, inverse_depth, sigma_inverse_depth] = std::array::from_fn(|_| self.f32());
        // Written so that a NaN fails. An unknown depth has an infinite deviation.
        let sound = x.abs() <= 1e3
            && y.abs() <= 1e3
            && sigma_xy > 0.0
            && sigma_xy <= 1.0
            && (0.0..=1e3).contains(&inverse_depth)
            && sigma_inverse_depth > 0.0;
        if !sound {
            return Err(MapDefect::Impossible("a feature that is none"));
        }
        Ok(Feature { descriptor, xy: Vector2::new(x, y), sigma_xy, inverse_depth, sigma_inverse_depth })
    }
}
