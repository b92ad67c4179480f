//! The simulated stereo camera: frames on demand, in order or in any order.

use super::{RenderScratch, Simulator};
use plumbline_config::Timestamp;
use plumbline_drivers::{DriverError, StereoFrame, StereoSource};

/// Frames of a simulated flight, in order. After it is made nothing is allocated.
#[derive(Clone, Debug)]
pub struct SimulatedStereo {
    simulator: Simulator,
    scratch: RenderScratch,
    next: u64,
}

impl SimulatedStereo {
    pub(super) fn new(simulator: Simulator) -> Self {
        let scratch = simulator.scratch();
        Self { simulator, scratch, next: 0 }
    }
}

impl StereoSource for SimulatedStereo {
    fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError> {
        if self.next >= self.simulator.frame_count() {
            return Ok(false);
        }
        self.simulator.render_frame(self.next, &mut self.scratch, frame);
        self.next += 1;
        Ok(true)
    }

    fn skip_to(&mut self, stamp: Timestamp) -> u64 {
        let first = self.next;
        while self.next < self.simulator.frame_count() && self.simulator.frame_stamp(self.next) < stamp {
            self.next += 1;
        }
        self.next - first
    }

    fn expected_frames(&self) -> Option<u64> {
        Some(self.simulator.frame_count())
    }
}
