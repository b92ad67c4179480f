//! Faults of frames: a decorator around any source.

use super::InjectedFault;
use super::kinds::{Effect, ImageChange, Stamping, Target};
use super::pixels::{Jpeg, add_noise, shift};
use crate::noise::NoiseTable;
use crate::random::Draws;
use plumbline_config::{Portable, Timestamp};
use plumbline_drivers::{DriverError, Faults, StereoFrame, StereoSource};
use std::f64::consts::TAU;

/// Source of frames with faults.
pub struct InjectedFrames<S> {
    source: S,
    /// First frame of the source, read ahead for its stamp.
    first: Option<StereoFrame>,
    begin: Timestamp,
    slots: Vec<Slot>,
    missing: u64,
    unpaired: u64,
}

impl<S: StereoSource> InjectedFrames<S> {
    /// Wraps `source`, whose images have `sizes_px`, and reads its first frame.
    ///
    /// # Errors
    /// When the first frame cannot be read.
    pub fn start(
        mut source: S,
        sizes_px: [(usize, usize); 2],
        faults: &[InjectedFault],
        seed: u64,
    ) -> Result<Self, DriverError> {
        let mut frame = StereoFrame::new(sizes_px);
        let first = source.next_frame(&mut frame)?.then_some(frame);
        let begin = first.as_ref().map_or_else(Timestamp::default, |frame| frame.stamp);
        let slot =
            |(place, fault): (usize, &InjectedFault)| Slot::new(*fault, fault.seed(seed, place), sizes_px);
        let slots = faults.iter().enumerate().map(slot).collect();
        Ok(Self { source, first, begin, slots, missing: 0, unpaired: 0 })
    }

    /// Stamp of the first frame, from which the times of faults count.
    pub fn begin(&self) -> Timestamp {
        self.begin
    }
}

impl<S: StereoSource> StereoSource for InjectedFrames<S> {
    fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError> {
        loop {
            match self.first.take() {
                Some(first) => *frame = first,
                None if !self.source.next_frame(frame)? => return Ok(false),
                None => {}
            }
            let time_s = frame.stamp.seconds_since(self.begin);
            let (mut is_lost, was_pair) = (false, frame.valid == [true; 2]);
            for slot in &mut self.slots {
                is_lost |= slot.strike(frame, time_s);
            }
            if !is_lost && frame.valid != [false; 2] {
                self.unpaired += u64::from(was_pair && frame.valid != [true; 2]);
                return Ok(true);
            }
            self.missing += 1;
        }
    }

    fn skip_to(&mut self, stamp: Timestamp) -> u64 {
        let passed = self.first.take_if(|first| first.stamp < stamp);
        u64::from(passed.is_some()) + self.source.skip_to(stamp)
    }

    fn expected_frames(&self) -> Option<u64> {
        self.source.expected_frames()
    }

    fn faults(&self) -> Faults {
        let Faults { missing, unpaired, .. } = self.source.faults();
        Faults { missing: missing + self.missing, unpaired: unpaired + self.unpaired, ..self.source.faults() }
    }
}

/// One fault, with what it remembers.
struct Slot {
    fault: InjectedFault,
    seed: u64,
    noise: Option<NoiseTable>,
    /// Noise of the frame before.
    fields: [Vec<f32>; 2],
    /// Images of earlier frames, as many as the fault needs.
    kept: Vec<StereoFrame>,
    /// Frames so far.
    count: usize,
    /// True while a frozen image is kept.
    is_frozen: bool,
    jpeg: Option<[Jpeg; 2]>,
}

impl Slot {
    fn new(fault: InjectedFault, seed: u64, sizes_px: [(usize, usize); 2]) -> Self {
        let blank = StereoFrame::new(sizes_px);
        let change = match fault.kind.effect {
            Effect::Image(change) => Some(change),
            _ => None,
        };
        let count = match change {
            Some(ImageChange::Late) => fault.doses[0].round() as usize + 1,
            Some(ImageChange::Repeat) => 2,
            Some(ImageChange::Freeze) => 1,
            _ => 0,
        };
        let is_noisy = matches!(change, Some(ImageChange::Freeze | ImageChange::Black | ImageChange::Noise));
        let fields = sizes_px.map(|(w, h)| Vec::with_capacity(if is_noisy { w * h } else { 0 }));
        let jpeg = matches!(change, Some(ImageChange::Jpeg)).then(|| blank.images.each_ref().map(Jpeg::new));
        let noise = is_noisy.then(|| NoiseTable::new(seed));
        Self { fault, seed, noise, fields, kept: vec![blank; count], count: 0, is_frozen: false, jpeg }
    }

    /// Changes the frame at `time_s`; returns whether it is lost.
    fn strike(&mut self, frame: &mut StereoFrame, time_s: f64) -> bool {
        let acts = self.fault.acts_at(time_s);
        let dose = self.fault.doses[0];
        match self.fault.kind.effect {
            Effect::FrameGap => return acts,
            Effect::FramesMissing if acts => return self.draws(frame).unit() < dose,
            Effect::Clocks if acts => frame.stamp = frame.stamp.plus_seconds(-dose),
            Effect::FrameStamps(stamping) if acts => {
                let late_ms = self.late_ms(stamping, frame, time_s);
                frame.stamp = frame.stamp.plus_seconds(1e-3 * late_ms);
            }
            Effect::Image(change) => self.change(change, frame, acts),
            _ => {}
        }
        false
    }

    fn draws(&self, frame: &StereoFrame) -> Draws {
        Draws::new(self.seed, self.fault.purpose(), frame.sequence)
    }

    fn late_ms(&self, stamping: Stamping, frame: &StereoFrame, time_s: f64) -> f64 {
        let [dose, period_s] = self.fault.doses;
        match stamping {
            Stamping::Jitter => dose * self.draws(frame).normal(),
            Stamping::Swing => dose * libm::sin(TAU * time_s / period_s.at_least(1e-3)),
            Stamping::End => 0.5 * dose,
            Stamping::Late => dose,
        }
    }

    fn change(&mut self, change: ImageChange, frame: &mut StereoFrame, acts: bool) {
        self.keep(change, frame, acts);
        if !acts {
            return;
        }
        if let ImageChange::Exchange = change {
            frame.images.swap(0, 1);
            frame.valid.swap(0, 1);
            return;
        }
        let Target::Cameras(cameras) = self.fault.target else { return };
        for camera in (0..2).filter(|camera| cameras[*camera]) {
            if !frame.images[camera].pixels().is_empty() {
                self.spoil(change, frame, camera);
            }
        }
    }

    /// Remembers the images of this frame for later ones.
    fn keep(&mut self, change: ImageChange, frame: &StereoFrame, acts: bool) {
        self.count += 1;
        let slot = match change {
            ImageChange::Late | ImageChange::Repeat => (self.count - 1) % self.kept.len(),
            ImageChange::Freeze if acts && !self.is_frozen => 0,
            ImageChange::Freeze if !acts => {
                self.is_frozen = false;
                return;
            }
            _ => return,
        };
        self.is_frozen = true;
        let kept = &mut self.kept[slot];
        for (to, from) in kept.images.iter_mut().zip(&frame.images) {
            to.clone_from(from);
        }
        kept.valid = frame.valid;
    }

    /// Images of `frames` frames before this one; `None` if there were none.
    fn earlier(&self, frames: usize) -> Option<&StereoFrame> {
        let index = self.count.checked_sub(1 + frames)?;
        self.kept.get(index % self.kept.len().max(1))
    }

    fn spoil(&mut self, change: ImageChange, frame: &mut StereoFrame, camera: usize) {
        let [dose, second] = self.fault.doses;
        let sequence = frame.sequence;
        let image = &mut frame.images[camera];
        match change {
            ImageChange::Lost => frame.valid[camera] = false,
            ImageChange::Black => image.pixels_mut().fill(0),
            ImageChange::Freeze if self.is_frozen => image.clone_from(&self.kept[0].images[camera]),
            ImageChange::Shift => shift(image, dose, second),
            ImageChange::Late => match self.earlier(dose.round() as usize) {
                Some(kept) => {
                    image.clone_from(&kept.images[camera]);
                    frame.valid[camera] = kept.valid[camera];
                }
                None => frame.valid[camera] = false,
            },
            ImageChange::Repeat if self.count.is_multiple_of((dose.round() as usize).max(2)) => {
                if let Some(kept) = self.earlier(1) {
                    image.clone_from(&kept.images[camera]);
                }
            }
            ImageChange::Jpeg => {
                if let Some(jpeg) = &mut self.jpeg {
                    jpeg[camera].pass(image, dose);
                }
            }
            ImageChange::Noise | ImageChange::Freeze | ImageChange::Repeat | ImageChange::Exchange => {}
        }
        if let Some(noise) = &self.noise {
            let field = &mut self.fields[camera];
            add_noise(noise, &mut frame.images[camera], field, (dose, second), (sequence, camera));
        }
    }
}
