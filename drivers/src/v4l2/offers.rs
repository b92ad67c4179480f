//! Formats, sizes and rates that a device offers.

use super::sys::abi::KIND_DISCRETE;
use super::sys::calls;
use rustix::fd::BorrowedFd;
use serde::Serialize;
use std::fmt::{self, Display};

/// Formats of a device, sizes of a format and rates of a size that are listed, at most.
const MAX_ENTRIES: u32 = 64;

/// A size of a format.
#[derive(Clone, Debug, Serialize)]
pub struct SizeInfo {
    /// Width and height, px; the smallest where there is a range.
    pub size_px: (u32, u32),
    /// Width and height of the largest, px, where any size between can be had.
    pub largest_px: Option<(u32, u32)>,
    /// Rates of it (of the largest, where there is a range).
    pub rates: FrameRates,
}

/// Rates of a size: numerators and denominators of the interval in seconds.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub enum FrameRates {
    /// These.
    Listed(Vec<(u32, u32)>),
    /// Any from the shortest interval to the longest.
    Between((u32, u32), (u32, u32)),
}

fn hertz((numerator, denominator): (u32, u32)) -> f64 {
    f64::from(denominator) / f64::from(numerator.max(1))
}

impl FrameRates {
    /// The interval to ask for: the listed one that is nearest, or exactly that of the rate.
    pub(crate) fn nearest(&self, rate_hz: f64) -> (u32, u32) {
        let off = |interval: &(u32, u32)| (hertz(*interval) / rate_hz - 1.0).abs();
        let listed = match self {
            Self::Listed(intervals) => intervals.iter().min_by(|a, b| off(a).total_cmp(&off(b))),
            Self::Between(..) => None,
        };
        listed.copied().unwrap_or((1000, (rate_hz * 1000.0).round() as u32))
    }
}

impl Display for FrameRates {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        // 30 rather than 30.000, and 29.97.
        let rounded = |interval| (hertz(interval) * 1000.0).round() / 1000.0;
        match self {
            Self::Listed(intervals) if intervals.is_empty() => f.write_str("rates that it does not tell"),
            Self::Listed(intervals) => {
                for (i, interval) in intervals.iter().enumerate() {
                    write!(f, "{}{}", if i == 0 { "" } else { ", " }, rounded(*interval))?;
                }
                f.write_str(" Hz")
            }
            Self::Between(shortest, longest) => {
                write!(f, "{} to {} Hz", rounded(*longest), rounded(*shortest))
            }
        }
    }
}

impl SizeInfo {
    /// Width and height as text.
    pub fn size_text(&self) -> String {
        let (width, height) = self.size_px;
        match self.largest_px {
            None => format!("{width} x {height}"),
            Some((most_width, most_height)) => format!("{width} x {height} to {most_width} x {most_height}"),
        }
    }
}

/// Codes of the formats of a device.
pub(crate) fn fourccs(fd: BorrowedFd<'_>, kind: u32) -> Vec<u32> {
    let description = |index| calls::format_description(fd, kind, index).ok();
    (0..MAX_ENTRIES).map_while(description).map(|description| description.fourcc).collect()
}

/// Sizes of a format, with their rates.
pub(crate) fn size_list(fd: BorrowedFd<'_>, fourcc: u32) -> Vec<SizeInfo> {
    let size = |index| calls::frame_size(fd, fourcc, index).ok();
    let with_rates = |size_px: (u32, u32), largest_px: Option<(u32, u32)>| SizeInfo {
        size_px,
        largest_px,
        rates: intervals(fd, fourcc, largest_px.unwrap_or(size_px)),
    };
    let mut found = Vec::new();
    for size in (0..MAX_ENTRIES).map_while(size) {
        let [a, b, _, c, d, _] = size.sizes;
        if size.kind != KIND_DISCRETE {
            found.push(with_rates((a, c), Some((b, d))));
            break;
        }
        found.push(with_rates((a, b), None));
    }
    found
}

/// Sizes of a format as text.
pub(crate) fn sizes(fd: BorrowedFd<'_>, fourcc: u32) -> String {
    let sizes: Vec<String> = size_list(fd, fourcc).iter().map(SizeInfo::size_text).collect();
    if sizes.is_empty() { "in sizes that it does not tell".to_owned() } else { sizes.join(", ") }
}

/// Rates of a size.
pub(crate) fn intervals(fd: BorrowedFd<'_>, fourcc: u32, size: (u32, u32)) -> FrameRates {
    let interval = |index| calls::frame_interval(fd, fourcc, size, index).ok();
    let mut listed = Vec::new();
    for interval in (0..MAX_ENTRIES).map_while(interval) {
        let [n, d, longest_n, longest_d, ..] = interval.fractions;
        if interval.kind != KIND_DISCRETE {
            return FrameRates::Between((n, d), (longest_n, longest_d));
        }
        listed.push((n, d));
    }
    FrameRates::Listed(listed)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_nearest_rate_is_asked_for_and_rates_read_well() {
        let listed = FrameRates::Listed(vec![(1, 60), (1, 30), (1001, 30_000), (1, 15)]);
        assert_eq!(listed.nearest(29.97), (1001, 30_000));
        assert_eq!(listed.nearest(20.0), (1, 15));
        assert_eq!(listed.to_string(), "60, 30, 29.97, 15 Hz");
        let between = FrameRates::Between((1, 120), (1, 1));
        assert_eq!(between.nearest(22.5), (1000, 22_500));
        assert_eq!(between.to_string(), "1 to 120 Hz");
        assert_eq!(FrameRates::Listed(Vec::new()).nearest(20.0), (1000, 20_000));
    }
}
