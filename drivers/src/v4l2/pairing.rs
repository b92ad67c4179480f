//! Pairing of left and right images as they arrive.
//!
//! By time: the stamps of two cameras that are triggered together differ by a constant (their drivers' delays), those of
//! cameras that run free by anything up to half a period, slowly changing. So the first pair is the nearest in time, and
//! from then on the nearest to a running offset: jitter about half a period cannot make pairs change sides. By sequence:
//! the difference of the numbers is taken from three pairs by time in agreement, and holds until the stamps contradict it.
//!
//! No clock and no device here: what is waiting, and what time it is, is handed in.

/// An image that waits for its partner.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Waiting {
    /// Time of measurement, ns.
    pub(crate) stamp_ns: i64,
    /// Number in the stream of its camera.
    pub(crate) sequence: u64,
    /// Arrival, ns of the same clock.
    pub(crate) arrival_ns: i64,
}

/// Decision about the images in front.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Next {
    /// Both belong together.
    Pair,
    /// The image of this camera has no partner.
    Alone(usize),
    /// A partner may still come, until this time, ns; `None` where there is nothing to wait with.
    Wait(Option<i64>),
}

/// State of a camera's queue.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Side {
    /// The oldest image that waits.
    pub(crate) front: Option<Waiting>,
    /// True if more images are expected from this camera.
    pub(crate) is_alive: bool,
    /// True if it holds as many as it may.
    pub(crate) is_full: bool,
}

/// An image waits for its partner so long at most, periods: a camera that lost one shows the next by then.
const PATIENCE_PERIODS: f64 = 1.5;
/// After so many images in a row that waited in vain nobody waits for that camera, until it brings one.
const SILENT_AFTER: u32 = 2;
/// Images of a pair are within this of the running offset, periods.
const HALF: f64 = 0.5;
/// A running offset beyond this has drifted into the next period.
const TURN_PERIODS: f64 = 0.6;
/// The running offset is the mean of so many pairs.
const OFFSET_PAIRS: i64 = 16;
/// The period is followed with this gain.
const PERIOD_GAIN: f64 = 1.0 / 16.0;
/// The period is within this factor of the configured one.
const MAX_PERIOD_RATIO: f64 = 10.0;
/// Pairs in agreement that say how numbers belong together, and in disagreement that they no longer do.
const AGREEING: u32 = 3;
/// Number of unpaired images in a row after which the numbering is checked anew: numbers may be so far apart that no
/// partner arrives in time.
const LONELY: u32 = 8;

/// Finds pairs.
#[derive(Clone, Debug)]
pub(crate) struct Pairing {
    by_sequence: bool,
    nominal_ns: f64,
    period_ns: f64,
    last: [Option<Waiting>; 2],
    /// Right less left, ns, and from how many pairs.
    offset_ns: i64,
    pairs: i64,
    /// Numbers of right less left, how many pairs in a row say so, and how many contradict it.
    base: i64,
    agreed: u32,
    contradicted: u32,
    /// Images alone since the last pair.
    lonely: u32,
    /// Waits in vain in a row, for each camera.
    in_vain: [u32; 2],
}

impl Pairing {
    /// For cameras with about this period, ns.
    pub(crate) fn new(by_sequence: bool, period_ns: f64) -> Self {
        Self {
            by_sequence,
            nominal_ns: period_ns,
            period_ns,
            last: [None; 2],
            offset_ns: 0,
            pairs: 0,
            base: 0,
            agreed: 0,
            contradicted: 0,
            lonely: 0,
            in_vain: [0; 2],
        }
    }

    /// Right less left in the mean of the last pairs, ns; `None` before the first.
    pub(crate) fn offset_ns(&self) -> Option<i64> {
        (self.pairs > 0).then_some(self.offset_ns)
    }

    /// Period as it is measured, ns.
    pub(crate) fn period_ns(&self) -> f64 {
        self.period_ns
    }

    /// An image has come. To be told of each, in order.
    pub(crate) fn arrived(&mut self, camera: usize, image: Waiting) {
        self.in_vain[camera] = 0;
        if let Some(last) = self.last[camera].replace(image)
            && image.sequence == last.sequence + 1
        {
            let period = (image.stamp_ns - last.stamp_ns) as f64;
            let [least, most] = [self.nominal_ns / MAX_PERIOD_RATIO, self.nominal_ns * MAX_PERIOD_RATIO];
            if (least..most).contains(&period) {
                self.period_ns += PERIOD_GAIN * (period - self.period_ns);
            }
        }
    }

    /// A camera begins a new stream: its numbers start anew.
    pub(crate) fn restarted(&mut self, camera: usize) {
        self.last[camera] = None;
        self.in_vain[camera] = 0;
        self.forget_base();
    }

    /// Decides about the images in front.
    pub(crate) fn next(&self, sides: [Side; 2], now_ns: i64) -> Next {
        match sides.map(|side| side.front) {
            [None, None] => Next::Wait(None),
            [Some(left), Some(right)] => self.both(left, right),
            [Some(image), None] => self.one(0, image, sides, now_ns),
            [None, Some(image)] => self.one(1, image, sides, now_ns),
        }
    }

    /// A pair was handed out, of these images.
    pub(crate) fn paired(&mut self, left: Waiting, right: Waiting) {
        let apart = right.stamp_ns - left.stamp_ns;
        self.lonely = 0;
        self.learn_base(right.sequence as i64 - left.sequence as i64, apart);
        self.pairs = (self.pairs + 1).min(OFFSET_PAIRS);
        self.offset_ns += (apart - self.offset_ns) / self.pairs;
        if self.offset_ns.abs() as f64 > TURN_PERIODS * self.period_ns && !self.is_by_number() {
            self.offset_ns -= self.offset_ns.signum() * self.period_ns as i64;
        }
    }

    /// An image of `camera` was handed out alone; `in_vain` says that there was nothing of the other camera, which is
    /// there.
    pub(crate) fn alone(&mut self, camera: usize, in_vain: bool) {
        if in_vain {
            self.in_vain[1 - camera] = self.in_vain[1 - camera].saturating_add(1);
        }
        self.lonely += 1;
        if self.lonely >= LONELY {
            self.forget_base();
        }
    }

    /// True if the image numbers decide.
    fn is_by_number(&self) -> bool {
        self.by_sequence && self.agreed >= AGREEING
    }

    fn learn_base(&mut self, base: i64, apart_ns: i64) {
        if !self.is_by_number() {
            self.agreed = if self.agreed > 0 && base == self.base { self.agreed + 1 } else { 1 };
            self.base = base;
            return;
        }
        let is_near = ((apart_ns - self.offset_ns).abs() as f64) < HALF * self.period_ns;
        self.contradicted = if is_near { 0 } else { self.contradicted + 1 };
        if self.contradicted >= AGREEING {
            self.forget_base();
            (self.pairs, self.offset_ns) = (0, 0);
        }
    }

    /// Numbers are to be brought together anew.
    fn forget_base(&mut self) {
        (self.agreed, self.contradicted, self.lonely) = (0, 0, 0);
    }

    /// Lag of the right image behind the counterpart of the left one, periods.
    fn apart(&self, left: Waiting, right: Waiting) -> f64 {
        if self.is_by_number() {
            return (right.sequence as i64 - left.sequence as i64 - self.base) as f64;
        }
        let apart = right.stamp_ns.saturating_sub(left.stamp_ns).saturating_sub(self.offset_ns);
        apart as f64 / self.period_ns
    }

    fn both(&self, left: Waiting, right: Waiting) -> Next {
        match self.apart(left, right) {
            apart if apart > HALF => Next::Alone(0),
            apart if apart < -HALF => Next::Alone(1),
            _ => Next::Pair,
        }
    }

    fn one(&self, camera: usize, image: Waiting, sides: [Side; 2], now_ns: i64) -> Next {
        let until = image.arrival_ns.saturating_add((PATIENCE_PERIODS * self.period_ns) as i64);
        let is_vain = !sides[1 - camera].is_alive || self.in_vain[1 - camera] >= SILENT_AFTER;
        match is_vain || sides[camera].is_full || now_ns >= until {
            true => Next::Alone(camera),
            false => Next::Wait(Some(until)),
        }
    }
}

#[cfg(test)]
mod tests;
