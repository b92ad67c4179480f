//! Poses as files: TUM and CSV.

use super::track::PoseSample;
use std::fmt::Write as _;

/// A format of files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ExportFormat {
    /// `t[s] x y z qx qy qz qw`.
    Tum,
    /// With velocity, quality and resets.
    Csv,
}

impl ExportFormat {
    /// By the ending of a file.
    #[must_use]
    pub fn of(ending: &str) -> Option<Self> {
        [Self::Tum, Self::Csv].into_iter().find(|format| format.ending() == ending)
    }

    /// The ending of its files.
    #[must_use]
    pub fn ending(self) -> &'static str {
        match self {
            Self::Tum => "tum",
            Self::Csv => "csv",
        }
    }

    /// Media type.
    #[must_use]
    pub fn mime(self) -> &'static str {
        match self {
            Self::Tum => "text/plain; charset=utf-8",
            Self::Csv => "text/csv; charset=utf-8",
        }
    }
}

/// The samples as a file.
#[must_use]
pub fn export(samples: &[PoseSample], format: ExportFormat) -> String {
    match format {
        ExportFormat::Tum => tum(samples),
        ExportFormat::Csv => csv(samples),
    }
}

fn tum(samples: &[PoseSample]) -> String {
    let mut text = String::new();
    for sample in samples {
        let (p, q) = (sample.pose_o_b.translation.vector, sample.pose_o_b.rotation.coords);
        let (s, ns) = (sample.stamp_ns.div_euclid(1_000_000_000), sample.stamp_ns.rem_euclid(1_000_000_000));
        let _ = writeln!(
            text,
            "{s}.{ns:09} {:.9} {:.9} {:.9} {:.9} {:.9} {:.9} {:.9}",
            p.x, p.y, p.z, q.x, q.y, q.z, q.w
        );
    }
    text
}

fn csv(samples: &[PoseSample]) -> String {
    let mut text = String::from(
        "stamp [ns],x [m],y [m],z [m],qx,qy,qz,qw,vx [m/s],vy [m/s],vz [m/s],quality,reset_counter\n",
    );
    for sample in samples {
        let (p, q, v) = (sample.pose_o_b.translation.vector, sample.pose_o_b.rotation.coords, sample.v_o_b);
        let _ = writeln!(
            text,
            "{},{},{},{},{},{},{},{},{},{},{},{},{}",
            sample.stamp_ns,
            p.x,
            p.y,
            p.z,
            q.x,
            q.y,
            q.z,
            q.w,
            v.x,
            v.y,
            v.z,
            sample.quality,
            sample.reset_counter
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, Vector3};

    fn samples() -> Vec<PoseSample> {
        let sample = |k: i64| PoseSample {
            stamp_ns: 1_403_715_273_262_142_976 + k * 5_000_000,
            pose_o_b: Isometry3::translation(k as f64, 0.5, -1.0),
            v_o_b: Vector3::new(1.0, 2.0, 3.0),
            quality: 90,
            reset_counter: 1,
        };
        (0..3).map(sample).collect()
    }

    #[test]
    fn text_keeps_every_nanosecond() {
        let text = export(&samples(), ExportFormat::Tum);
        assert!(text.starts_with("1403715273.262142976 0.000000000 0.500000000 -1.000000000 0.0"));
        let text = export(&samples(), ExportFormat::Csv);
        assert_eq!(text.lines().count(), 4);
        assert!(text.lines().nth(2).unwrap().starts_with("1403715273267142976,1,0.5,-1,"));
    }
}
