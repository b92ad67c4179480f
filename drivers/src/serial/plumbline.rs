//! Our own protocol, of a microcontroller: `docs/serial-protocol.md` and the crate `plumbline-protocol`.

use super::framing::Scan;
use super::protocol::{Content, DeviceSample, Outgoing, Protocol, Questions, TimeAnswer, TimeUnit, vector};
use plumbline_protocol::{FrameError, Imu, MAX_FRAME, Message, Settings, decode, encode};

/// A device that has not said who it is, or what it does, is asked again after this, ns.
const AGAIN_NS: i64 = 1_000_000_000;

/// A microcontroller with our own protocol.
#[derive(Debug)]
pub struct Plumbline {
    /// Settings asked of the device.
    settings: Settings,
    questions: Questions,
    is_known: bool,
    is_set: bool,
    asked_ns: Option<i64>,
}

impl Plumbline {
    /// One that is given these settings.
    pub fn new(settings: Settings) -> Self {
        Self { settings, questions: Questions::default(), is_known: false, is_set: false, asked_ns: None }
    }

    fn sample(imu: &Imu) -> Content {
        let (Some(gyro), Some(accel)) =
            (vector(imu.gyro_rad_s.map(f64::from)), vector(imu.accel_m_s2.map(f64::from)))
        else {
            return Content::Malformed;
        };
        Content::Sample(DeviceSample {
            ticks: imu.time_ns,
            counter: Some(u64::from(imu.sequence)),
            gyro,
            accel,
            is_saturated: imu.flags.gyro_saturated || imu.flags.accel_saturated,
            is_failed: imu.flags.sensor_failed,
        })
    }

    fn say(message: &Message, into: &mut Outgoing) {
        into.push(encode(message, &mut [0; MAX_FRAME]));
    }
}

impl Protocol for Plumbline {
    fn scan(&self, bytes: &[u8]) -> Scan {
        // The zero before a frame belongs to it, where it is its own.
        let begin = usize::from(bytes[0] == 0);
        match bytes.get(begin) {
            None => return Scan::More,
            Some(0) => return Scan::Noise(1),
            Some(_) => {}
        }
        // No frame is longer; whatever such bytes were ends with the next zero.
        let longest = &bytes[begin..bytes.len().min(MAX_FRAME)];
        let Some(length) = longest.iter().position(|byte| *byte == 0) else {
            return if bytes.len() < MAX_FRAME { Scan::More } else { Scan::BadLength(MAX_FRAME) };
        };
        let end = begin + length;
        match decode(&bytes[begin..end]) {
            Ok(_) | Err(FrameError::Unknown) => Scan::Frame(end + 1),
            Err(FrameError::Length) => Scan::BadLength(end + 1),
            Err(_) => Scan::BadChecksum(end + 1),
        }
    }

    fn decode(&mut self, frame: &[u8]) -> Content {
        let begin = usize::from(frame.first() == Some(&0));
        let Some(encoded) = frame.get(begin..frame.len().saturating_sub(1)) else {
            return Content::Malformed;
        };
        match decode(encoded) {
            Ok(Message::Imu(imu)) => Self::sample(&imu),
            Ok(Message::Time(time)) => match i64::try_from(time.asked_ns) {
                Ok(asked_ns) if self.questions.take(asked_ns) => Content::Answer(TimeAnswer {
                    asked_ns,
                    device_received_ns: time.received_ns as i64,
                    device_sent_ns: time.sent_ns as i64,
                }),
                _ => Content::Other,
            },
            Ok(Message::Hello(_)) => {
                // One that says hello of its own accord was started anew, and knows nothing.
                (self.is_known, self.is_set) = (true, self.is_set && !self.is_known);
                Content::Other
            }
            Ok(Message::Settings(_)) => {
                self.is_set = true;
                Content::Other
            }
            // Triggers of the cameras, what the host says, heard back, and types of later versions.
            Ok(_) | Err(FrameError::Unknown) => Content::Other,
            Err(_) => Content::Malformed,
        }
    }

    fn time_unit(&self) -> TimeUnit {
        TimeUnit::NANOS
    }

    fn counter_bits(&self) -> u32 {
        32
    }

    fn asks_time(&self) -> bool {
        true
    }

    fn request(&mut self, now_ns: i64, into: &mut Outgoing) {
        if let (true, Ok(asked_ns)) = (self.questions.is_due(now_ns), u64::try_from(now_ns)) {
            Self::say(&Message::AskTime { asked_ns }, into);
        }
        let is_due = self.asked_ns.is_none_or(|asked_ns| now_ns.saturating_sub(asked_ns) >= AGAIN_NS);
        if is_due && !(self.is_known && self.is_set) {
            self.asked_ns = Some(now_ns);
            if !self.is_known {
                Self::say(&Message::AskHello, into);
            }
            if !self.is_set {
                Self::say(&Message::Set(self.settings), into);
            }
        }
    }

    fn restart(&mut self) {
        *self = Self::new(self.settings);
    }
}

#[cfg(test)]
mod tests {
    use super::super::fixture::contents;
    use super::*;
    use plumbline_protocol::{Flags, Hello, Receiver, Time, Trigger};

    fn framed(message: &Message) -> Vec<u8> {
        encode(message, &mut [0; MAX_FRAME]).to_vec()
    }

    fn imu(sequence: u32) -> Message {
        let flags = Flags { accel_saturated: true, ..Flags::default() };
        Message::Imu(Imu {
            sequence,
            time_ns: 5,
            gyro_rad_s: [0.5; 3],
            accel_m_s2: [1.0; 3],
            temperature_c: None,
            flags,
        })
    }

    /// Messages of the host at `now_ns`.
    fn said(device: &mut Plumbline, now_ns: i64) -> Vec<Message> {
        let mut outgoing = Outgoing::default();
        device.request(now_ns, &mut outgoing);
        let mut receiver = Receiver::new();
        outgoing.bytes().iter().filter_map(|byte| receiver.push(*byte)).map(Result::unwrap).collect()
    }

    #[test]
    fn samples_and_triggers_are_found_amid_noise() {
        let trigger = Trigger { counter: 4, time_ns: 6, pulse_ns: 7, cameras: 3 };
        let stream =
            [&[1; 300][..], &framed(&imu(1)), &[9; 5], &framed(&Message::Trigger(trigger)), &framed(&imu(2))];
        let found = contents(&mut Plumbline::new(Settings::default()), &stream.concat());
        let [Content::Sample(first), Content::Other, Content::Sample(third)] = found[..] else {
            panic!("{found:?}")
        };
        assert_eq!((first.counter, first.ticks, third.counter), (Some(1), 5, Some(2)));
        assert!(first.is_saturated && !first.is_failed);
    }

    #[test]
    fn a_sample_whose_numbers_are_none_is_malformed_and_a_later_message_passed_over() {
        let mut bad = Imu { accel_m_s2: [0.0, f32::INFINITY, 0.0], ..Imu::default() };
        let mut device = Plumbline::new(Settings::default());
        assert_eq!(contents(&mut device, &framed(&Message::Imu(bad))), [Content::Malformed]);
        bad.accel_m_s2 = [0.0; 3];
        assert!(matches!(contents(&mut device, &framed(&Message::Imu(bad)))[..], [Content::Sample(_)]));
        assert_eq!(contents(&mut device, &framed(&Message::AskHello)), [Content::Other]);
    }

    #[test]
    fn a_device_is_asked_who_it_is_and_set_until_it_answers_and_again_when_it_starts_anew() {
        let settings = Settings { imu_rate_mhz: 200_000, ..Settings::default() };
        let mut device = Plumbline::new(settings);
        let has = |said: &[Message], what: &Message| said.contains(what);
        let set = Message::Set(settings);
        let first = said(&mut device, 0);
        assert!(
            has(&first, &Message::AskHello)
                && has(&first, &set)
                && has(&first, &Message::AskTime { asked_ns: 0 })
        );
        assert!(!has(&said(&mut device, 500_000_000), &set));
        assert!(has(&said(&mut device, 1_000_000_000), &set));
        let hello = framed(&Message::Hello(Hello::default()));
        contents(&mut device, &[hello.clone(), framed(&Message::Settings(settings))].concat());
        assert!(!has(&said(&mut device, 3_000_000_000), &set));
        contents(&mut device, &hello);
        assert!(has(&said(&mut device, 5_000_000_000), &set));
    }

    #[test]
    fn only_answers_to_what_was_asked_count() {
        let mut device = Plumbline::new(Settings::default());
        said(&mut device, 77);
        let time = |asked_ns| framed(&Message::Time(Time { asked_ns, received_ns: 5, sent_ns: 6 }));
        let answer = TimeAnswer { asked_ns: 77, device_received_ns: 5, device_sent_ns: 6 };
        let found = contents(&mut device, &[time(76), time(77), time(77), time(u64::MAX)].concat());
        assert_eq!(found, [Content::Other, Content::Answer(answer), Content::Other, Content::Other]);
    }
}
