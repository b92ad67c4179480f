//! trace
use super::Odometer;
use crate::inertial::Preintegration;
use crate::window::growth::GrowingCovariance;
use crate::window::state::{FrameMatrix, NavState};

#[derive(Clone, Debug)]
pub(super) struct Innovations {
    joint: Option<FrameMatrix>,
    mean: [(f64, f64); 5],
    scale2: [f64; 2],
    base: Option<crate::inertial::ImuNoise>,
}
impl Default for Innovations {
    fn default() -> Self {
        Self { joint: None, mean: [(0.0, 0.0); 5], scale2: [1.0; 2], base: None }
    }
}

fn env(name: &str, default: f64) -> f64 {
    std::env::var(name).ok().and_then(|s| s.parse().ok()).unwrap_or(default)
}

impl Odometer {
    pub(super) fn predict_innovation(&self, nav: &NavState, motion: &Preintegration) -> Option<FrameMatrix> {
        let joint = self.innovations.joint.as_ref()?;
        let mut grown = GrowingCovariance::of_joint(joint);
        grown.grow(nav, motion, &self.noise);
        Some(grown.joint())
    }

    pub(super) fn note_innovation(&mut self, predicted: &NavState, before: Option<FrameMatrix>, dt: f64) {
        let joint = self.window.covariance_of_newest();
        if let (Some(before), Some(after), Some(frame)) = (before, &joint, self.window.frames.last()) {
            let d = frame.nav.minus(predicted);
            let mut line = format!("INNOV {:.3}", frame.stamp.as_nanos() as f64 * 1e-9);
            let alpha = dt / env("AD_MEAN", 1.0);
            let it = &mut self.innovations;
            for part in 0..5 {
                let (mut sq, mut gain, mut post) = (0.0, 0.0, 0.0);
                for k in 3 * part..3 * part + 3 {
                    sq += d[k] * d[k];
                    gain += before[(k, k)] - after[(k, k)];
                    post += after[(k, k)];
                }
                let gain_c = gain.max(0.0);
                let sq_c = sq.min(env("AD_CAP", 25.0) * gain_c.max(it.mean[part].1));
                it.mean[part].0 += alpha * (sq_c - it.mean[part].0);
                it.mean[part].1 += alpha * (gain_c - it.mean[part].1);
                line += &format!(" {sq:.4e} {gain:.4e} {post:.4e}");
            }
            let n = |k: usize| it.mean[k].0 / it.mean[k].1.max(1e-30);
            let ratios = [n(0), n(1), n(2), n(3), n(4)];
            let tau = env("AD_TAU", 1.0);
            let dead = env("AD_DEAD", 1.5);
            let w = env("AD_V", 0.5);
            let pair = [(ratios[1], ratios[3]), (ratios[2], ratios[4])];
            for s in 0..2 {
                let dead = if s == 0 { env("AD_GDEAD", 1.0) } else { dead };
                let dead = dead.max(env("AD_P", 0.0) * ratios[0]);
                let x = pair[s].0.max(1e-6).powf(w) * pair[s].1.max(1e-6).powf(1.0 - w) / dead;
                let max = if s == 0 { env("AD_GMAX", 1.0) } else { env("AD_MAX", 1.0) };
                it.scale2[s] = (it.scale2[s] * x.powf(dt / tau)).clamp(1.0, max * max);
            }
            let base = *it.base.get_or_insert(self.noise);
            let [g, a] = it.scale2.map(f64::sqrt);
            let white = env("AD_WHITE", 1.0);
            let noise = crate::inertial::ImuNoise {
                gyro_density: base.gyro_density * g.powf(white), accel_density: base.accel_density * a.powf(white),
                gyro_walk: base.gyro_walk * g, accel_walk: base.accel_walk * a };
            if max_on() { self.noise = noise; self.window.options.imu_noise = noise; }
            if std::env::var("PLUMBLINE_TRACE").is_ok() {
                for r in ratios { line += &format!(" {r:.3}"); }
                line += &format!(" {g:.3} {a:.3}");
                eprintln!("{line}");
            }
        }
        self.innovations.joint = joint;
    }
}
fn max_on() -> bool { env("AD_MAX", 1.0) > 1.0 }
