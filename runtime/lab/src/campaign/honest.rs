//! Faults with a dose: which health bits name them, and the table that judges the estimate under them.

use super::table::number;
use super::{CampaignFault, Entry};
use crate::report::Report;
use crate::report::honesty::Honesty;
use crate::report::silence::MAX_NAMELESS_S;
use plumbline_estimator::HealthBits;

/// Health bits of which one names a fault whose kind begins like this. The longest beginning that fits counts.
const NAMED_BY: [(&str, &[HealthBits]); 15] = [
    ("accel-", &[HealthBits::ACCEL_STUCK, HealthBits::ACCEL_CONTRADICTED, HealthBits::ACCEL_NOISY]),
    ("gyro-", &[HealthBits::GYRO_STUCK, HealthBits::GYRO_CONTRADICTED]),
    (
        "imu-frozen",
        &[
            HealthBits::GYRO_STUCK,
            HealthBits::ACCEL_STUCK,
            HealthBits::GYRO_CONTRADICTED,
            HealthBits::ACCEL_CONTRADICTED,
        ],
    ),
    ("imu-late", &[HealthBits::IMU_LATE]),
    ("imu-gap", &[HealthBits::IMU_GAP]),
    ("stamp-late", &[HealthBits::IMAGES_LATE]),
    ("clock-back", &[HealthBits::BAD_STAMP]),
    ("frame-gap", &[HealthBits::FRAME_GAP]),
    ("image-black", &[HealthBits::DARK]),
    // With noise it does not repeat its image, but sees other things than the other camera.
    ("image-frozen", &[HealthBits::LEFT_FROZEN, HealthBits::RIGHT_FROZEN, HealthBits::CAMERAS_DISAGREE]),
    ("image-repeat", &[HealthBits::LEFT_FROZEN, HealthBits::RIGHT_FROZEN]),
    // It begins with the repetition of an image.
    (
        "image-late",
        &[
            HealthBits::CAMERAS_OUT_OF_STEP,
            HealthBits::CAMERAS_DISAGREE,
            HealthBits::LEFT_FROZEN,
            HealthBits::RIGHT_FROZEN,
        ],
    ),
    ("image-shift", &[HealthBits::CAMERAS_DISAGREE]),
    ("images-exchanged", &[HealthBits::CAMERAS_DISAGREE]),
    ("rig-baseline", &[HealthBits::SCALE_CONTRADICTED]),
];

impl CampaignFault {
    /// Health bits of which one should name this fault with a dose; none where the estimate should only stay right.
    #[must_use]
    pub fn named_by(self) -> &'static [HealthBits] {
        let Self::Injected(fault) = self else { return &[] };
        let fits = NAMED_BY.iter().filter(|(kind, _)| fault.kind().name.starts_with(kind));
        fits.max_by_key(|(kind, _)| kind.len()).map_or(&[], |(_, bits)| bits)
    }
}

/// Report of a fault.
struct Naming<'a> {
    /// First of the bits that name it, and when, s after its beginning.
    first: Option<(&'a str, f64)>,
    /// Other bits since its beginning, and when.
    others: Vec<(&'a str, f64)>,
}

impl<'a> Naming<'a> {
    fn of(fault: CampaignFault, honesty: &'a Honesty) -> Self {
        let named_by = fault.named_by();
        let names: Vec<&str> = HealthBits::NAMES
            .iter()
            .filter(|(bit, _)| named_by.contains(bit))
            .map(|(_, name)| *name)
            .collect();
        let since = honesty.since_fault_s.iter().flatten().map(|(name, s)| (*name, *s));
        let (named, others): (Vec<_>, Vec<_>) = since.partition(|(name, _)| names.contains(name));
        Self { first: named.into_iter().min_by(|a, b| a.1.total_cmp(&b.1)), others }
    }
}

/// Head of the table of faults with a dose.
pub const HONESTY_HEAD: &str = "\
| fault | path | scene | seed | named after s | other bits, s | usable % | of these, sigma: position / velocity / tilt | m / m/s / mrad | worst m | jumps | resets | NEES position / steps | ATE m | allocations | honest |
|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|";

/// The row of a flight with a fault that has a dose; none of another.
#[must_use]
pub fn honesty_row(entry: &Entry, report: &Report) -> Option<String> {
    let CampaignFault::Injected(_) = entry.fault else { return None };
    let honesty = report.honesty.as_ref();
    let naming = honesty.map(|honesty| Naming::of(entry.fault, honesty));
    let bit = |(name, s): &(&str, f64)| format!("{name} {s:.2}");
    let first = naming.as_ref().and_then(|naming| naming.first.as_ref().map(bit));
    let others = naming.as_ref().map_or_else(Vec::new, |naming| naming.others.iter().map(bit).collect());
    let nameless = if entry.fault.named_by().is_empty() { "-" } else { "never" };
    let three = |[a, b, c]: [f64; 3], digits: usize| format!("{a:.digits$} / {b:.digits$} / {c:.digits$}");
    let nees = report.consistency.as_ref().map_or([None; 5], |consistency| consistency.estimates.ratios());
    let cells = [
        entry.failure(),
        entry.path.clone(),
        entry.scene.to_owned(),
        entry.scenario.seed.to_string(),
        first.unwrap_or_else(|| nameless.to_owned()),
        others.join(", "),
        number(honesty.map(|h| 100.0 * h.usable), 0),
        honesty.map_or_else(
            || "-".into(),
            |h| three([h.worst_sigmas.position, h.worst_sigmas.velocity, h.worst_sigmas.tilt], 1),
        ),
        honesty.map_or_else(
            || "-".into(),
            |h| three([h.worst_usable.position, h.worst_usable.velocity, 1e3 * h.worst_usable.tilt], 3),
        ),
        number(honesty.map(|h| h.worst.position), 3),
        number(honesty.map(|h| h.jumps as f64), 0),
        report.resets.to_string(),
        format!("{} / {}", number(nees[0], 2), number(nees[4], 2)),
        number(report.ate_rmse_m, 4),
        report.hot_path_allocations.to_string(),
        if honesty.is_some_and(Honesty::is_honest) { "yes" } else { "NO" }.to_owned(),
    ];
    Some(format!("| {} |", cells.join(" | ")))
}

/// Sentence that sums up the flights with faults that have a dose; `None` without any.
#[must_use]
pub fn honesty_summary<'a>(flights: impl IntoIterator<Item = (&'a Entry, &'a Report)>) -> Option<String> {
    let (mut count, mut honest, mut nameable, mut named) = (0, 0, 0, 0);
    for (entry, report) in flights {
        let CampaignFault::Injected(_) = entry.fault else { continue };
        count += 1;
        let Some(honesty) = &report.honesty else { continue };
        honest += u32::from(honesty.is_honest());
        nameable += u32::from(!entry.fault.named_by().is_empty());
        let first = Naming::of(entry.fault, honesty).first;
        named += u32::from(first.is_some_and(|(_, s)| s <= MAX_NAMELESS_S));
    }
    (count > 0).then(|| {
        format!("{honest} of {count} honest; {named} of {nameable} that a health bit can name named within {MAX_NAMELESS_S} s")
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_longest_beginning_names_a_fault() {
        let bits = |text: &str| CampaignFault::Injected(text.parse().unwrap()).named_by();
        assert_eq!(bits("imu-late:50"), [HealthBits::IMU_LATE]);
        assert!(bits("imu-frozen").contains(&HealthBits::GYRO_CONTRADICTED), "with noise nothing repeats");
        assert_eq!(bits("image-shift:left:5:0"), [HealthBits::CAMERAS_DISAGREE]);
        let late = bits("image-late:right:1");
        assert!(late.contains(&HealthBits::CAMERAS_OUT_OF_STEP) && !late.contains(&HealthBits::IMAGES_LATE));
        assert!(bits("stamp-jitter:2").is_empty() && CampaignFault::Blackout.named_by().is_empty());
    }

    #[test]
    fn the_first_of_the_bits_that_name_a_fault_counts() {
        let since_fault_s =
            Some([("accelerometer noisy", 0.4), ("accelerometer stuck", 0.2), ("IMU gap", 0.1)].into());
        let honesty = Honesty { since_fault_s, ..Honesty::default() };
        let naming = Naming::of(CampaignFault::Injected("accel-dead:x".parse().unwrap()), &honesty);
        assert_eq!(naming.first, Some(("accelerometer stuck", 0.2)));
        assert_eq!(naming.others, [("IMU gap", 0.1)]);
    }
}
