//! Pairing of images: left and right by time, not by row.

use super::table::{Row, RowFault, Stamped, stamp};
use crate::DriverError;
use crate::grid::{median_period_ns, steps};
use plumbline_config::Timestamp;
use std::path::{Component, Path};

/// One image of a camera: a row of its `data.csv`, or a message of its topic.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ImageRow<F = String> {
    pub(crate) stamp: Timestamp,
    /// Name of the file within the camera's `data` folder, or number of the message.
    pub(crate) file: F,
}

impl<F> Stamped for ImageRow<F> {
    fn stamp(&self) -> Timestamp {
        self.stamp
    }
}

/// Columns of the table; where the name is left out it is `<timestamp>.png`.
pub(crate) const IMAGE_COLUMNS: &str = "timestamp [ns], filename";

/// A row of [`IMAGE_COLUMNS`].
pub(crate) fn parse_image_row(row: &Row) -> Result<ImageRow, RowFault> {
    let stamp = stamp(row)?;
    let file = match row.get(1) {
        None | Some("") => format!("{}.png", stamp.as_nanos()),
        Some(name) if is_plain_name(in_data(name)) => in_data(name).to_owned(),
        Some(_) => {
            return Err(RowFault::Impossible(
                "the file name leads out of the folder data; name a file in it",
            ));
        }
    };
    Ok(ImageRow { stamp, file })
}

/// True if a name stays within its folder.
/// The name within the folder `data`, which some tables name too.
fn in_data(name: &str) -> &str {
    let name = name.strip_prefix("./").unwrap_or(name);
    name.strip_prefix("data/").unwrap_or(name)
}

pub(crate) fn is_plain_name(name: &str) -> bool {
    let mut parts = Path::new(name).components();
    matches!((parts.next(), parts.next()), (Some(Component::Normal(_)), None)) && !name.contains('\0')
}

/// One frame to hand out: what is to be read for it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct FrameEntry<F = String> {
    /// Counts from the first frame of the data set, gaps included.
    pub(crate) sequence: u64,
    /// Time of the left image where there is one.
    pub(crate) stamp: Timestamp,
    /// Files of left and right image.
    pub(crate) files: [Option<F>; 2],
}

/// Frames of the whole data set.
#[derive(Debug)]
pub(crate) struct Pairing<F = String> {
    pub(crate) frames: Vec<FrameEntry<F>>,
    /// Right images before the first or after the last left one: not handed out.
    pub(crate) outside: u64,
}

/// Frames of one camera or two. At least one pair must be found; `cure` says what to do where there is none.
pub(crate) fn paired<F>(
    path: &Path,
    rows: Vec<Vec<ImageRow<F>>>,
    tolerance_s: f64,
    cure: &str,
) -> Result<Pairing<F>, DriverError> {
    let mut rows = rows.into_iter();
    let left = rows.next().unwrap_or_default();
    let Some(right) = rows.next() else { return Ok(monocular(left)) };
    let pairing = stereo(left, right, ((tolerance_s * 1e9).round() as i64).max(0));
    if pairing.frames.iter().any(|frame| frame.files.iter().all(Option::is_some)) {
        return Ok(pairing);
    }
    let message =
        format!("no left image has a partner within {tolerance_s} s; {cure} (driver.pair_tolerance_s)");
    Err(DriverError::refused(path, message))
}

/// Frames of a single camera.
pub(crate) fn monocular<F>(left: Vec<ImageRow<F>>) -> Pairing<F> {
    let frames = left.into_iter().map(|row| entry(row.stamp, [Some(row.file), None])).collect();
    numbered(frames, 0)
}

/// Frames of two cameras: nearest stamps within `tolerance_ns`, each image used once. An image without a
/// partner is a frame of its own; both lists are in order.
pub(crate) fn stereo<F>(left: Vec<ImageRow<F>>, right: Vec<ImageRow<F>>, tolerance_ns: i64) -> Pairing<F> {
    let ends = left.first().zip(left.last()).map(|(first, last)| (first.stamp, last.stamp));
    let mut frames = Vec::with_capacity(left.len());
    let (mut left, mut right) = (left.into_iter().peekable(), right.into_iter().peekable());
    loop {
        let apart = match (left.peek(), right.peek()) {
            (None, None) => break,
            (Some(_), None) => i64::MAX,
            (None, Some(_)) => i64::MIN,
            (Some(l), Some(r)) => r.stamp.nanos_since(l.stamp),
        };
        let l = if apart >= -tolerance_ns { left.next() } else { None };
        let r = if apart <= tolerance_ns { right.next() } else { None };
        match (l, r) {
            (Some(l), Some(r)) => pair_closest(l, r, &mut left, &mut right, &mut frames),
            (l, r) => frames.extend(l.map(left_only).or(r.map(right_only))),
        }
    }
    frames.sort_by_key(|frame| frame.stamp);
    let all = frames.len();
    frames.retain(|frame| {
        frame.files[0].is_some()
            || ends.is_some_and(|(first, last)| first <= frame.stamp && frame.stamp <= last)
    });
    let outside = (all - frames.len()) as u64;
    numbered(frames, outside)
}

type Rows<F> = std::iter::Peekable<std::vec::IntoIter<ImageRow<F>>>;

/// Pairs `l` with `r`, unless the next row of either side is closer to the other: then the passed-over
/// image stands alone and the closer two are looked at.
fn pair_closest<F>(
    mut l: ImageRow<F>,
    mut r: ImageRow<F>,
    left: &mut Rows<F>,
    right: &mut Rows<F>,
    frames: &mut Vec<FrameEntry<F>>,
) {
    let apart = |l: &ImageRow<F>, r: &ImageRow<F>| l.stamp.nanos_since(r.stamp).saturating_abs();
    loop {
        let now = apart(&l, &r);
        if let Some(closer) = right.next_if(|next| apart(&l, next) < now) {
            frames.push(right_only(std::mem::replace(&mut r, closer)));
        } else if let Some(closer) = left.next_if(|next| apart(next, &r) < now) {
            frames.push(left_only(std::mem::replace(&mut l, closer)));
        } else {
            frames.push(entry(l.stamp, [Some(l.file), Some(r.file)]));
            return;
        }
    }
}

fn left_only<F>(row: ImageRow<F>) -> FrameEntry<F> {
    entry(row.stamp, [Some(row.file), None])
}

fn right_only<F>(row: ImageRow<F>) -> FrameEntry<F> {
    entry(row.stamp, [None, Some(row.file)])
}

fn entry<F>(stamp: Timestamp, files: [Option<F>; 2]) -> FrameEntry<F> {
    FrameEntry { sequence: 0, stamp, files }
}

fn numbered<F>(mut frames: Vec<FrameEntry<F>>, outside: u64) -> Pairing<F> {
    let period = median_period_ns(frames.iter().filter(|f| f.files[0].is_some()).map(|f| f.stamp));
    for i in 1..frames.len() {
        let gap = frames[i].stamp.nanos_since(frames[i - 1].stamp);
        frames[i].sequence = frames[i - 1].sequence + steps(gap, period);
    }
    Pairing { frames, outside }
}

#[cfg(test)]
mod tests {
    use super::super::table::row;
    use super::*;

    #[test]
    fn names_may_have_their_folder_and_lead_nowhere_else() {
        for name in ["5.png", "data/5.png", "./5.png", "./data/5.png"] {
            assert_eq!(parse_image_row(&row(&format!("5,{name}"))).unwrap().file, "5.png", "{name}");
        }
        for name in ["../5.png", "data/../5.png", "/5.png", "data/data/5.png", "data/", "other/5.png"] {
            assert!(parse_image_row(&row(&format!("5,{name}"))).is_err(), "{name}");
        }
    }

    fn rows(stamps: &[i64]) -> Vec<ImageRow> {
        stamps.iter().map(|&t| parse_image_row(&row(&t.to_string())).unwrap()).collect()
    }

    fn summary(pairing: &Pairing) -> Vec<(u64, i64, bool, bool)> {
        let one =
            |f: &FrameEntry| (f.sequence, f.stamp.as_nanos(), f.files[0].is_some(), f.files[1].is_some());
        pairing.frames.iter().map(one).collect()
    }

    #[test]
    fn rows_are_paired_by_time_and_gaps_are_numbered() {
        let pairing = stereo(rows(&[100, 150, 200, 400]), rows(&[52, 101, 199, 248, 402, 450]), 3);
        let expected = [
            (0, 100, true, true),
            (1, 150, true, false),
            (2, 200, true, true),
            (3, 248, false, true),
            (6, 400, true, true),
        ];
        assert_eq!(summary(&pairing), expected);
        assert_eq!(pairing.outside, 2);
    }

    #[test]
    fn the_closer_partner_wins() {
        let pairing = stereo(rows(&[100, 103]), rows(&[97, 101]), 5);
        assert_eq!(summary(&pairing), [(0, 100, true, true), (1, 103, true, false)]);
        let pairing = stereo(rows(&[100, 104, 200]), rows(&[105, 200]), 6);
        assert_eq!(summary(&pairing)[..2], [(0, 100, true, false), (1, 104, true, true)]);
    }

    #[test]
    fn names_must_stay_in_their_folder() {
        assert_eq!(parse_image_row(&row("5, a.png ")).unwrap().file, "a.png");
        assert_eq!(parse_image_row(&row("5,")).unwrap().file, "5.png");
        for text in ["5,../a.png", "5,/etc/passwd", "5,a/b.png", "5,..", "x,a.png", "", "5.5,a.png"] {
            assert!(parse_image_row(&row(text)).is_err(), "{text}");
        }
    }
}
