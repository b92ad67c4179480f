//! Orders of virtual time: as fast as it goes, in the order that the rule gives.
//!
//! The estimator is given readings up to the time that a frame needs, then the frame. The odometry is given each reading as
//! soon as no estimate that would correct it is still to come.

use super::effect::Effect;
use super::machine::{Machine, Order, Orders};
use super::tick::CORRECTION_DELAY_NS;
use super::{Control, DriverFaults, RunError, RunOptions, RunOutcome, Streams};
use crate::pipeline::listener::Subscriber;
use crate::pipeline::team::Team;
use crate::schedule::ladder::Rung;
use plumbline_config::options::image_sizes;
use plumbline_config::{Timestamp, ValidConfig};
use plumbline_drivers::{DriverError, ImuReading, ImuSource, Prefetch, StereoFrame, StereoSource};
use plumbline_record::ResetOrder;
use std::collections::VecDeque;

/// Readings that wait for an estimate, at most: then the window does not wait for another frame.
const MAX_WAITING: usize = 256;

/// Runs both streams to their end, or until `control` says so.
///
/// # Errors
/// When a driver cannot go on.
pub fn run(
    config: &ValidConfig,
    Streams { imu, stereo, map, first_reset_counter, .. }: Streams,
    options: &RunOptions,
    control: &Control,
    team: &Team,
    subscriber: &mut dyn Subscriber,
) -> Result<RunOutcome, RunError> {
    let mut machine =
        Machine::new(config, (map, control.instants().cloned()), Effect::ByRule, team, subscriber);
    let mut orders = VirtualTime::new(config, imu, stereo, options, control)?;
    team.lead(|| machine.run(&mut orders, first_reset_counter))?;
    machine.finish_instants();
    let (estimate_digest, odometry_digest) = (machine.window().digest(), machine.tick().digest());
    let (figures, places) = machine.into_end();
    let faults = DriverFaults { imu: orders.imu.faults(), cameras: orders.stereo.faults() };
    Ok(RunOutcome { figures, estimate_digest, odometry_digest, faults, places, live: None })
}

/// Next step of the run.
#[derive(Clone, Copy)]
enum Step {
    /// Another frame.
    Frame,
    /// Readings until this time, for the frame that is there.
    Until(Timestamp),
    /// A fixed number of readings, for a frame whose stamp is not believed.
    Readings(usize),
    /// The frame that is there.
    Track,
    /// The readings after the last frame.
    Rest,
}

/// The rule over one pair of streams.
struct VirtualTime<'a> {
    imu: Box<dyn ImuSource>,
    stereo: Box<dyn StereoSource>,
    control: &'a Control,
    frame: StereoFrame,
    step: Step,
    /// The reading that the estimator was given last, and the odometry is still to wait for.
    fed: Option<ImuReading>,
    /// The newest time that was believed before it.
    newest_before: Timestamp,
    /// Readings for the odometry, each with the newest time that is believed of them.
    waiting: VecDeque<(ImuReading, Timestamp)>,
    /// Readings in a frame's time.
    readings_per_frame: usize,
}

impl<'a> VirtualTime<'a> {
    fn new(
        config: &ValidConfig,
        imu: Box<dyn ImuSource>,
        stereo: Box<dyn StereoSource>,
        options: &RunOptions,
        control: &'a Control,
    ) -> Result<Self, DriverError> {
        let sizes_px = image_sizes(&config.camera);
        let stereo: Box<dyn StereoSource> = match options.threads {
            0 | 1 => stereo,
            _ => Box::new(Prefetch::new(stereo, sizes_px, config.driver.image_queue)?),
        };
        Ok(Self {
            imu,
            stereo,
            control,
            frame: StereoFrame::new(sizes_px),
            step: Step::Frame,
            fed: None,
            newest_before: Timestamp::MIN,
            waiting: VecDeque::with_capacity(MAX_WAITING),
            readings_per_frame: (config.imu.rate_hz / config.camera[0].rate_hz).ceil() as usize,
        })
    }

    /// The reading that the odometry may be given now: one that no estimate still to come would correct.
    fn tick(&mut self, unsolved: Option<Timestamp>) -> Option<ImuReading> {
        let until = unsolved.map(|stamp| stamp.plus_nanos(CORRECTION_DELAY_NS));
        let (reading, _) = self.waiting.pop_front_if(|(_, time)| until.is_none_or(|until| *time < until))?;
        Some(reading)
    }

    /// Takes the next reading from its source.
    fn feed(&mut self, machine: &Machine<'_>) -> Result<Option<Order<'static>>, DriverError> {
        self.newest_before = machine.newest_imu();
        self.fed = self.imu.next_reading()?;
        Ok(self.fed.map(Order::Feed))
    }

    /// Takes the next frame; what it needs, or the rest of the readings after the last.
    fn next_frame(&mut self, machine: &Machine<'_>) -> Result<Step, DriverError> {
        if self.control.is_stopped() || !self.stereo.next_frame(&mut self.frame)? {
            return Ok(Step::Rest);
        }
        let (front, stamp) = (machine.front(), self.frame.stamp);
        self.newest_before = machine.newest_imu();
        Ok(match front.expects(stamp) {
            true => Step::Until(front.needed_until(stamp)),
            false => Step::Readings(self.readings_per_frame),
        })
    }
}

impl Orders for VirtualTime<'_> {
    type Error = DriverError;

    fn next<'f>(&'f mut self, machine: &Machine<'_>) -> Result<Option<Order<'f>>, DriverError> {
        loop {
            if let Some(reading) = self.tick(machine.unsolved()) {
                return Ok(Some(Order::Tick(reading)));
            }
            if self.fed.is_some() && self.waiting.len() == MAX_WAITING {
                return Ok(Some(Order::Solve));
            }
            if let Some(reading) = self.fed.take() {
                self.waiting.push_back((reading, machine.newest_imu()));
                continue;
            }
            match self.step {
                Step::Frame => self.step = self.next_frame(machine)?,
                // Where the clock is set back meanwhile, what is needed never comes.
                Step::Until(needed) if (self.newest_before..needed).contains(&machine.newest_imu()) => {
                    match self.feed(machine)? {
                        Some(order) => return Ok(Some(order)),
                        None => self.step = Step::Track,
                    }
                }
                Step::Readings(count) if count > 0 => match self.feed(machine)? {
                    Some(order) => {
                        self.step = Step::Readings(count - 1);
                        return Ok(Some(order));
                    }
                    None => self.step = Step::Track,
                },
                Step::Until(_) | Step::Readings(_) => self.step = Step::Track,
                Step::Track => {
                    let before_frame = self.frame.sequence;
                    if let Some(kind) = self.control.take_reset() {
                        return Ok(Some(Order::Reset(ResetOrder { kind, before_frame, is_renewal: false })));
                    }
                    self.step = Step::Frame;
                    return Ok(Some(Order::Track(&mut self.frame, Rung::Full)));
                }
                Step::Rest if machine.unsolved().is_some() => return Ok(Some(Order::Solve)),
                Step::Rest => return self.feed(machine),
            }
        }
    }
}
