//! Defects of the files of a data set, by name.

use super::imu::ImuRecord;
use super::order::Order;
use super::pairing::FrameEntry;
use super::picture::NoImage;
use parking_lot::Mutex;
use plumbline_config::Timestamp;
use std::path::Path;
use std::sync::Arc;

/// The inertial samples may end this long before the last image, or begin after the first, s.
const MAX_UNCOVERED_S: f64 = 0.5;
/// Cameras may differ by this share of their images.
const MAX_SURPLUS: f64 = 0.02;

/// Something that is wrong with a recording as a whole, in words for people.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Defect {
    /// Finding.
    pub what: String,
    /// The figures that show it, with the file.
    pub evidence: String,
    /// Probable cause.
    pub cause: String,
    /// Cure.
    pub cure: String,
    /// True if the recording should not be flown with this defect.
    pub is_grave: bool,
}

/// Images of one kind of defect.
#[derive(Debug)]
struct BadImages {
    why: NoImage,
    expected_px: (usize, usize),
    count: u64,
    first: String,
}

impl BadImages {
    /// A sentence on these images.
    fn words(&self) -> String {
        let (width, height) = self.expected_px;
        let (one, many) = match self.why {
            NoImage::Missing => ("is missing".to_owned(), "are missing".to_owned()),
            NoImage::Corrupt => {
                ("is cut off or not a PNG or JPEG".into(), "are cut off or not PNG or JPEG".into())
            }
            NoImage::OtherSize((w, h)) => {
                (format!("is {w}x{h}, not {width}x{height}"), format!("are {w}x{h}, not {width}x{height}"))
            }
        };
        match self.count {
            1 => format!("{} {one}", self.first),
            n => format!("{n} images {many}; the first is {}", self.first),
        }
    }
}

#[derive(Debug, Default)]
struct Found {
    /// The first row that cannot be read, and how many there are.
    rows: Option<(u64, String)>,
    images: Vec<BadImages>,
}

/// Rows and images that could not be read, while a data set is read. Clones share what is found.
#[derive(Clone, Debug, Default)]
pub struct FileDefects(Arc<Mutex<Found>>);

impl FileDefects {
    pub(super) fn with_rows(corrupt: u64, file: &Path, first: Option<&impl std::fmt::Display>) -> Self {
        let words = match first {
            Some(first) => format!("{}, {first}", file.display()),
            None => format!("{}: stamps more than a day apart from the others", file.display()),
        };
        let rows = (corrupt > 0).then_some((corrupt, words));
        Self(Arc::new(Mutex::new(Found { rows, ..Found::default() })))
    }

    pub(super) fn add(&self, path: &Path, why: NoImage, expected_px: (usize, usize)) {
        let mut found = self.0.lock();
        let is_same = |bad: &&mut BadImages| std::mem::discriminant(&bad.why) == std::mem::discriminant(&why);
        match found.images.iter_mut().find(is_same) {
            Some(bad) => bad.count += 1,
            None => {
                let first = path.display().to_string();
                found.images.push(BadImages { why, expected_px, count: 1, first });
            }
        }
    }

    /// Images that could not be read so far.
    pub fn images(&self) -> u64 {
        self.0.lock().images.iter().map(|bad| bad.count).sum()
    }

    /// True if all images that could not be read have another size, and all else could be read.
    pub fn are_other_sizes(&self) -> bool {
        let found = self.0.lock();
        found.rows.is_none() && matches!(&found.images[..], [BadImages { why: NoImage::OtherSize(_), .. }])
    }

    /// Findings so far: a sentence for each kind, with the first file.
    pub fn words(&self) -> Vec<String> {
        let found = self.0.lock();
        let rows = found.rows.as_ref().map(|(count, first)| match count {
            1 => first.clone(),
            n => format!("{n} rows of inertial samples cannot be read; the first is {first}"),
        });
        rows.into_iter().chain(found.images.iter().map(BadImages::words)).collect()
    }
}

/// Defects of coverage: frames before the first or after the last sample. `file` names the samples in
/// messages.
pub(crate) fn uncovered<F>(file: &Path, imu: &ImuRecord, frames: &[FrameEntry<F>]) -> Vec<Defect> {
    let (Some((imu_first, imu_last)), (first, last)) = (imu.span(), super::frames::frames_span(frames))
    else {
        return Vec::new();
    };
    let defect = |what: &str, evidence: String, cure: String| Defect {
        what: what.into(),
        evidence: format!("{}: {evidence}", file.display()),
        cause: "a file that was cut off, or that is of another recording".into(),
        cure,
        is_grave: true,
    };
    let after = |late: Timestamp, early: Timestamp| {
        Some(late.seconds_since(early)).filter(|seconds| *seconds > MAX_UNCOVERED_S)
    };
    let early = after(last, imu_last).map(|seconds| {
        defect(
            "the inertial samples end before the images",
            format!("its last sample is at {imu_last} s, the images go on for {seconds:.1} s"),
            format!("copy it again, or fly up to there (`--stop {:.1}`)", imu_last.seconds_since(first)),
        )
    });
    let late = after(imu_first, first).map(|seconds| {
        defect(
            "the inertial samples begin after the images",
            format!("its first sample is at {imu_first} s, {seconds:.1} s after the first image"),
            format!("copy it again, or fly from there (`--start {:.1}`)", imu_first.seconds_since(first)),
        )
    });
    early.into_iter().chain(late).collect()
}

/// Defect: a folder of a further camera, and none is that of the right one.
pub(super) fn misnamed_camera(root: &Path) -> Option<Defect> {
    let has = |camera: &usize| super::camera_folder(root, *camera).is_dir();
    let other = (2..10).find(has).filter(|_| !has(&1))?;
    Some(Defect {
        what: "cam1 is missing: one camera is used".into(),
        evidence: format!("{} holds cam{other}, but no cam1", root.display()),
        cause: "a folder that was renamed, or a copy that is not complete".into(),
        cure: "name the folder of the right camera cam1; to fly with one camera, give --mono".into(),
        is_grave: false,
    })
}

/// One row in this many may have the stamp of another.
const REPEATED_ONE_IN: u64 = 100;

/// Defects of the clock of a recording, by its stamps. `orders` are those of its tables or topics, by name;
/// `what` names their rows; the recording begins at `first`.
pub(crate) fn of_stamps(
    root: &Path,
    orders: &[(String, Order)],
    what: &str,
    first: Timestamp,
) -> Option<Defect> {
    stepped(root, orders, first).or_else(|| repeated(root, orders, what))
}

/// Defect: the clock of the stamps stepped back.
fn stepped(root: &Path, orders: &[(String, Order)], first: Timestamp) -> Option<Defect> {
    let step = |(name, order): &(String, Order)| {
        let at_s = order.step_at.seconds_since(first);
        let more = match order.steps_back {
            1 => String::new(),
            n => format!(", and {} times more", n - 1),
        };
        format!("{name} by {:.3} s after {at_s:.3} s{more}", order.longest_step_back_ns as f64 * 1e-9)
    };
    let told: Vec<String> = orders.iter().filter(|(_, order)| order.steps_back > 0).map(step).collect();
    (!told.is_empty()).then(|| Defect {
        what: "the clock of the stamps steps back".into(),
        evidence: format!("{}: {}", root.display(), told.join("; ")),
        cause: "a clock that was set while recording (NTP, GNSS, a change of the time), a counter that overflowed, or two recordings in \
                one"
            .into(),
        cure: "fly up to the step (`--stop`), or what comes after it alone; stamp by a monotonic clock, or let the clock settle before \
               recording"
            .into(),
        is_grave: true,
    })
}

/// Defect: stamps repeat.
fn repeated(root: &Path, orders: &[(String, Order)], what: &str) -> Option<Defect> {
    let repeats =
        |(_, order): &&(String, Order)| order.repeated > 1 && order.repeated * REPEATED_ONE_IN > order.rows;
    let told: Vec<String> = orders
        .iter()
        .filter(repeats)
        .map(|(name, order)| format!("{} of {} {what} of {name}", order.repeated, order.rows))
        .collect();
    (!told.is_empty()).then(|| Defect {
        what: "stamps repeat".into(),
        evidence: format!(
            "{}: {} have the stamp of an earlier one, and are dropped",
            root.display(),
            told.join(", ")
        ),
        cause: "data that were recorded twice, or stamps that are coarse or set on arrival".into(),
        cure: "record each sensor once; stamp each sample when it is measured".into(),
        is_grave: false,
    })
}

/// Defect: one camera has many images more than the other.
pub(super) fn surplus(root: &Path, images: [usize; 2]) -> Option<Defect> {
    let more = usize::from(images[1] > images[0]);
    let surplus = images[more] - images[1 - more];
    (surplus > 1 && surplus as f64 > MAX_SURPLUS * images[more] as f64).then(|| Defect {
        what: format!("cam{more} has {surplus} images more than cam{}", 1 - more),
        evidence: format!("{}: {} and {}", root.display(), images[0], images[1]),
        cause: format!("that cam{}/data.csv was cut off, or that a camera lost images", 1 - more),
        cure: format!("copy cam{} again", 1 - more),
        is_grave: false,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn images_of_other_sizes_are_told_apart() {
        let defects = FileDefects::default();
        assert!(!defects.are_other_sizes());
        defects.add(Path::new("a.png"), NoImage::OtherSize((752, 480)), (376, 240));
        assert!(defects.are_other_sizes() && defects.words()[0].contains("752x480, not 376x240"));
        defects.add(Path::new("b.png"), NoImage::Corrupt, (376, 240));
        assert!(!defects.are_other_sizes());
    }
}
