//! From what the frames of a device say to readings: a function of bytes and of their times, without a device or a clock.

use super::framing::Deframer;
use super::protocol::{Content, DeviceSample, Outgoing, Protocol, TimeAnswer};
use crate::ImuReading;
use crate::clock::{DeviceClock, RoundTrip, StampPace, Stamped, Unwrap};
use crate::inertial::{ImuFigures, LinkFigures, Numbering, SampleWatch};
use plumbline_config::options::ImuConfig;
use plumbline_config::{ImuSample, Timestamp};

/// Bytes to readings.
pub struct Stream {
    protocol: Box<dyn Protocol>,
    deframer: Deframer,
    time: Unwrap,
    tick_ns: i64,
    counter: Unwrap,
    clock: DeviceClock,
    pace: StampPace,
    watch: SampleWatch,
    numbering: Numbering,
    delay_ns: i64,
    /// Figures that the parts do not count themselves.
    figures: ImuFigures,
}

impl Stream {
    /// For a device that speaks `protocol` and measures as `imu` says; `delay_ns` is taken off every stamp.
    pub fn new(protocol: Box<dyn Protocol>, imu: &ImuConfig, delay_ns: i64) -> Self {
        let unit = protocol.time_unit();
        Self {
            deframer: Deframer::default(),
            time: Unwrap::new(unit.bits),
            tick_ns: unit.tick_ns,
            counter: Unwrap::new(protocol.counter_bits()),
            clock: DeviceClock::new(protocol.asks_time()),
            pace: StampPace::default(),
            watch: SampleWatch::new(imu),
            numbering: Numbering::new(imu.rate_hz),
            delay_ns,
            protocol,
            figures: ImuFigures::default(),
        }
    }

    /// Space for the bytes that come; [`Self::came`] says how many have. Everything that came before has to be taken with
    /// [`Self::next`].
    pub fn space(&mut self) -> &mut [u8] {
        self.deframer.space()
    }

    /// Registers `count` bytes that were received into [`Self::space`].
    pub fn came(&mut self, count: usize) {
        self.deframer.advance(count);
    }

    /// The next reading of what came, the last bytes at `arrival_ns` of the host.
    pub fn next(&mut self, arrival_ns: i64) -> Option<ImuReading> {
        loop {
            let content = {
                let Self { deframer, protocol, .. } = self;
                let frame = deframer.next(|bytes| protocol.scan(bytes))?;
                protocol.decode(frame)
            };
            match content {
                Content::Sample(sample) => {
                    if let Some(reading) = self.sample(&sample, arrival_ns) {
                        return Some(reading);
                    }
                }
                Content::Answer(answer) => self.answer(&answer, arrival_ns),
                Content::Lacking(what) => self.figures.lacking = Some(what),
                Content::Malformed => self.figures.malformed += 1,
                Content::Other => {}
            }
        }
    }

    /// Writes the request to the device that is due, if any.
    pub fn request(&mut self, now_ns: i64, into: &mut Outgoing) {
        self.protocol.request(now_ns, into);
    }

    /// The line was opened anew. The device's clock is kept: one that runs on is still right, and another is noticed.
    pub fn reopened(&mut self) {
        self.deframer.clear();
        self.protocol.restart();
    }

    /// Figures of the samples, with `link` from the port.
    pub fn figures(&self, link: LinkFigures) -> ImuFigures {
        ImuFigures {
            missing: self.numbering.missing(),
            watch: self.watch.figures(),
            clock: self.clock.figures(),
            stamp_problem: self.pace.problem(),
            framing: self.deframer.figures(),
            link,
            ..self.figures
        }
    }

    fn sample(&mut self, sample: &DeviceSample, arrival_ns: i64) -> Option<ImuReading> {
        self.figures.lacking = None;
        let counter = sample.counter.map(|counter| self.counter.extend(counter));
        let device_ns = self.time.extend(sample.ticks).checked_mul(self.tick_ns);
        let Some(device_ns) = device_ns else {
            self.figures.malformed += 1;
            return None;
        };
        self.pace.take(device_ns, arrival_ns);
        let stamp_ns = match self.clock.sample(device_ns, arrival_ns) {
            Stamped::At(stamp_ns) => stamp_ns.saturating_sub(self.delay_ns),
            Stamped::Settling => {
                self.figures.settling += 1;
                return None;
            }
            Stamped::Refused => return None,
        };
        if sample.is_failed {
            self.watch.failed();
            return None;
        }
        if !self.watch.look(&sample.gyro, &sample.accel, sample.is_saturated) {
            return None;
        }
        self.figures.samples += 1;
        let sequence = self.numbering.next(counter, stamp_ns);
        let stamp = Timestamp::from_nanos(stamp_ns);
        Some(ImuReading { sequence, sample: ImuSample { stamp, gyro: sample.gyro, accel: sample.accel } })
    }

    fn answer(&mut self, answer: &TimeAnswer, arrival_ns: i64) {
        self.clock.round_trip(&RoundTrip {
            sent_ns: answer.asked_ns,
            device_received_ns: answer.device_received_ns,
            device_sent_ns: answer.device_sent_ns,
            received_ns: arrival_ns,
        });
    }
}
