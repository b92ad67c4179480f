//! Numbers of frames: a jump says how many were lost.

use crate::grid::steps;

/// Counts frames by the numbers of the cameras' drivers, and by time where these say nothing: over a camera that went
/// away and came back, or a change from one camera to the other.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Numbering {
    last: Option<(u64, i64)>,
    /// Stream and number of each camera's last image, and the frame that it was in.
    marks: [Option<(u64, u64, u64)>; 2],
    missing: u64,
}

impl Numbering {
    /// The number of the frame of this time, ns, with these images: stream and number in it.
    pub(crate) fn next(&mut self, stamp_ns: i64, marks: [Option<(u64, u64)>; 2], period_ns: f64) -> u64 {
        let number = match self.last {
            None => 0,
            Some((last, last_ns)) => {
                let by_time = || last + steps(stamp_ns.saturating_sub(last_ns), Some(period_ns as i64));
                self.by_marks(marks).unwrap_or_else(by_time).max(last + 1)
            }
        };
        self.missing += self.last.map_or(0, |(last, _)| number - last - 1);
        self.last = Some((number, stamp_ns));
        for (kept, mark) in self.marks.iter_mut().zip(marks) {
            if let Some((stream, image)) = mark {
                *kept = Some((stream, image, number));
            }
        }
        number
    }

    /// By the first camera whose image follows one of the same stream.
    fn by_marks(&self, marks: [Option<(u64, u64)>; 2]) -> Option<u64> {
        self.marks.iter().zip(marks).find_map(|(kept, mark)| {
            let ((stream, image, frame), (now_stream, now_image)) = ((*kept)?, mark?);
            // Numbers wrap; one that goes back is none of the next.
            let step = now_image.wrapping_sub(image);
            (stream == now_stream).then(|| frame.saturating_add(if step > u64::MAX / 2 { 0 } else { step }))
        })
    }

    /// Frames missing between the first and the last.
    pub(crate) fn missing(&self) -> u64 {
        self.missing
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const PERIOD: f64 = 100.0;

    #[test]
    fn frames_are_numbered_by_their_images() {
        let mut numbering = Numbering::default();
        let mut next = |at: i64, left: Option<u64>, right: Option<u64>| {
            numbering.next(at, [left.map(|n| (1, n)), right.map(|n| (1, n))], PERIOD)
        };
        assert_eq!(next(0, Some(5), Some(2)), 0);
        assert_eq!(next(100, Some(6), Some(3)), 1);
        // The left one alone, then two frames lost, however late the stamps are.
        assert_eq!(next(200, Some(7), None), 2);
        assert_eq!(next(560, Some(10), Some(7)), 5);
        assert_eq!(next(600, None, Some(8)), 6);
        assert_eq!(numbering.missing(), 2);
    }

    #[test]
    fn over_a_gap_without_a_stream_time_counts() {
        let mut numbering = Numbering::default();
        assert_eq!(numbering.next(0, [Some((1, 900)), None], PERIOD), 0);
        assert_eq!(numbering.next(1010, [Some((2, 0)), None], PERIOD), 10);
        assert_eq!(numbering.next(1105, [Some((2, 1)), None], PERIOD), 11);
        // Left and right of one time, unpaired, are two frames.
        assert_eq!(numbering.next(1110, [None, Some((1, 4))], PERIOD), 12);
        assert_eq!(numbering.missing(), 9);
    }
}
