use super::super::reader::Ending;
use super::*;
use crate::log::RecorderHandle;
use crate::pipeline::listener::{FrameKeeper as _, Listener, Producer, Several};
use nalgebra::Vector3;
use plumbline_drivers::{DriverError, Faults, ImuReading, StereoFrame, StereoSource};
use plumbline_estimator::{Estimate, Estimator, FrameInput, Odometry, Propagator, ResetKind};
use plumbline_record::compare::Pairing;
use plumbline_record::protobuf::{decode, encode};
use plumbline_record::said::FullEstimate;
use plumbline_record::{CorrectionOrder, FrameOrder, ResetOrder, Said, Verdict};
use std::collections::VecDeque;
use std::sync::Arc;

#[test]
fn a_recorded_flight_comes_out_again_bit_for_bit() {
    for images in [ImageRecording::Png, ImageRecording::Raw] {
        let (_folder, path, outcome) = recorded(images);
        let v = verified(&path).unwrap();
        assert!(v.identical && v.complete && v.same_build, "{v:?}");
        assert_eq!(v.estimates_identical, outcome.figures.frames);
        assert!(v.odometry_identical > 100);
        assert_eq!(v.estimate_digest, outcome.estimate_digest);
        assert_eq!(v.odometry_digest, outcome.odometry_digest);
        let config = flight().config.with("test", |config| config.recorder.images = images).unwrap();
        assert_eq!(v.config_hash, config_hash(&config));
    }
}

#[test]
fn a_log_without_images_is_verified_against_its_data_set() {
    let (_folder, path, outcome) = recorded(ImageRecording::None);
    assert!(verified(&path).unwrap_err().to_string().contains("--images"));
    let v = verify(&path, Some(flight().streams.stereo), None, &mut |_| {}).unwrap();
    assert!(v.identical && v.complete, "{v:?}");
    assert_eq!(v.estimate_digest, outcome.estimate_digest);
    let other = flight_of_seed(2).streams.stereo;
    let refused = verify(&path, Some(other), None, &mut |_| {}).unwrap_err().to_string();
    assert!(refused.contains("frame 0 of the data set"), "{refused}");
}

#[test]
fn one_bit_of_an_inertial_sample_changes_the_flight() {
    let (_folder, path, _) = recorded(ImageRecording::Png);
    rewritten(&path, Channel::Imu, |number, data| {
        if number == 60 {
            let mut imu: ImuReading = decode(data).unwrap();
            let accel = &mut imu.sample.accel[1];
            *accel = f64::from_bits(accel.to_bits() ^ 1 << 30);
            *data = encode(&imu);
        }
    });
    let v = verified(&path).unwrap();
    assert!(!v.identical && v.inputs_changed, "{v:?}");
    let difference = v.difference.unwrap();
    assert!(difference.recorded.contains("bits") && difference.executed.contains("bits"), "{difference}");
}

#[test]
fn a_changed_input_that_no_estimate_depends_on_is_found_too() {
    let (_folder, path, _) = recorded(ImageRecording::Png);
    rewritten(&path, Channel::Imu, |number, data| {
        if number == 60 {
            let mut imu: ImuReading = decode(data).unwrap();
            imu.sequence += 1;
            *data = encode(&imu);
        }
    });
    let v = verified(&path).unwrap();
    assert!(v.difference.is_none() && v.inputs_changed && !v.identical, "{v:?}");
}

#[test]
fn a_changed_pixel_is_named() {
    let (_folder, path, _) = recorded(ImageRecording::Raw);
    rewritten(&path, Channel::Right, |number, data| {
        if number == 3 {
            let middle = data.len() / 2;
            data[middle] ^= 1;
        }
    });
    let refused = verified(&path).unwrap_err().to_string();
    assert!(refused.contains("frame 3") && refused.contains("hash"), "{refused}");
}

#[test]
fn a_changed_output_is_named_with_both_values() {
    let (_folder, path, _) = recorded(ImageRecording::Png);
    rewritten(&path, Channel::Estimate, |number, data| {
        if number == 9 {
            let mut estimate: Estimate = decode(data).unwrap();
            estimate.v_o_b[1] = f64::from_bits(estimate.v_o_b[1].to_bits() + 1);
            *data = encode(&estimate);
        }
    });
    let v = verified(&path).unwrap();
    let difference = v.difference.unwrap();
    assert!(!v.identical && !v.inputs_changed);
    assert_eq!((difference.output.as_str(), difference.field.as_str()), ("estimate of frame 9", "v_o_b[1]"));
    assert_ne!(difference.recorded, difference.executed);
}

/// A live run in small: frames are refused, corrections come late, and somebody asks for a reset.
fn fly_with_orders(flight: Flight, recorder: &mut RecorderHandle) {
    let mut keeper = recorder.clone();
    let Streams { mut imu, mut stereo, .. } = flight.streams;
    let (mut estimator, mut propagator) =
        (Estimator::new(flight.config.setup()), Propagator::new(flight.config.setup()));
    let mut readings: VecDeque<ImuReading> = VecDeque::new();
    let mut frame = StereoFrame::new([(0, 0); 2]);
    let (mut ticked, mut late): (u64, Option<Estimate>) = (0, None);
    while stereo.next_frame(&mut frame).unwrap() {
        let needed = estimator.imu_needed_until(frame.stamp);
        while readings.back().is_none_or(|r| r.sample.stamp < needed) {
            let Some(reading) = imu.next_reading().unwrap() else { break };
            if let Some(estimate) = late.take_if(|_| ticked % 7 == 3) {
                let order = CorrectionOrder { frame: estimate.frame_sequence, readings_before: ticked };
                recorder.said(&Said::Correction(order));
                propagator.correct(&estimate);
            }
            recorder.said(&Said::Imu(reading));
            if let Some(odometry) = propagator.tick(&reading.sample) {
                recorder.said(&Said::Odometry(odometry));
            }
            estimator.add_imu(&reading.sample);
            readings.push_back(reading);
            ticked += 1;
        }
        let sequence = frame.sequence;
        if sequence == 12 {
            let order = ResetOrder { kind: ResetKind::Soft, before_frame: sequence, is_renewal: false };
            recorder.said(&Said::Reset(order));
            estimator.reset(ResetKind::Soft);
        }
        let refused = sequence % 5 == 4;
        let verdict = if refused { Verdict::Refused } else { Verdict::Taken { level: 0 } };
        recorder.said(&Said::Order(FrameOrder { frame: sequence, readings_before: ticked, verdict }));
        if !refused {
            let images = [frame.image(0), frame.image(1)];
            let input = FrameInput::new(frame.stamp, images).numbered(sequence);
            let estimate = estimator.add_frame(&input);
            late = Some(estimate.clone());
            recorder.said(&Said::Estimate(FullEstimate { estimate, frame_ms: 0.0 }));
        }
        keeper.keep(&mut frame);
    }
}

#[test]
fn what_the_clock_decided_is_followed() {
    let (_folder, path) = place();
    let mut flight = flight();
    // The run in small has no map.
    flight.config = flight.config.with("test", |config| config.estimator.places.enabled = false).unwrap();
    let recorder = Recorder::start(&path, &flight.config, (None, 0), WhenFull::Wait).unwrap();
    fly_with_orders(flight, &mut recorder.handle());
    assert_eq!(recorder.finish().not_recorded, 0);
    let v = verified(&path).unwrap();
    assert!(v.identical && v.complete, "{v:?}");
    assert_eq!((v.frames_refused, v.estimates_identical), (4, 16));
    // Another order of the same inputs is another flight.
    rewritten(&path, Channel::FrameOrder, |number, data| {
        if number == 9 {
            let order: FrameOrder = decode(data).unwrap();
            *data = encode(&FrameOrder { verdict: Verdict::Taken { level: 0 }, ..order });
        }
    });
    assert!(!verified(&path).unwrap().identical);
}

/// A live run in small whose sensor's clock is found late: the estimator has one reading for all frames, and the odometry goes on by
/// one in twelve of them.
fn fly_frames_in_masses(flight: Flight, recorder: &mut RecorderHandle) -> u64 {
    let mut keeper = recorder.clone();
    let Streams { mut imu, mut stereo, .. } = flight.streams;
    let (mut estimator, mut propagator) =
        (Estimator::new(flight.config.setup()), Propagator::new(flight.config.setup()));
    let mut take = |recorder: &mut RecorderHandle, propagator: &mut Propagator| {
        let reading = imu.next_reading().unwrap()?;
        recorder.said(&Said::Imu(reading));
        if let Some(odometry) = propagator.tick(&reading.sample) {
            recorder.said(&Said::Odometry(odometry));
        }
        Some(reading)
    };
    estimator.add_imu(&take(recorder, &mut propagator).unwrap().sample);
    let (mut frame, mut frames, mut ticked) = (StereoFrame::new([(0, 0); 2]), 0, 1);
    while stereo.next_frame(&mut frame).unwrap() {
        if frame.sequence.is_multiple_of(12) {
            take(recorder, &mut propagator).unwrap();
            ticked += 1;
        }
        let verdict = Verdict::Taken { level: 0 };
        recorder.said(&Said::Order(FrameOrder { frame: frame.sequence, readings_before: 1, verdict }));
        let images = [frame.image(0), frame.image(1)];
        let estimate = estimator.add_frame(&FrameInput::new(frame.stamp, images).numbered(frame.sequence));
        recorder.said(&Said::Estimate(FullEstimate { estimate: estimate.clone(), frame_ms: 0.0 }));
        if !estimate.is_refused() {
            recorder
                .said(&Said::Correction(CorrectionOrder { frame: frame.sequence, readings_before: ticked }));
            propagator.correct(&estimate);
            frames += 1;
        }
        keeper.keep(&mut frame);
    }
    while take(recorder, &mut propagator).is_some() {}
    frames
}

#[test]
fn frames_in_masses_between_two_readings_come_out_again() {
    let (_folder, path) = place();
    let mut flight = flight_of(1, 1.5);
    flight.config = flight.config.with("test", |config| config.estimator.places.enabled = false).unwrap();
    let recorder = Recorder::start(&path, &flight.config, (None, 0), WhenFull::Wait).unwrap();
    let frames = fly_frames_in_masses(flight, &mut recorder.handle());
    assert_eq!(recorder.finish().not_recorded, 0);
    assert!(frames > 20, "{frames} frames were estimated");
    let v = verified(&path).unwrap();
    assert!(v.identical && v.complete, "{v:?}");
}

/// Listener that asks for a reset while frame 12 is being processed.
struct Asker(Arc<Control>);

impl Subscriber for Asker {
    fn listener(&mut self, producer: Producer) -> Box<dyn Listener> {
        match producer {
            Producer::FrontEnd => Box::new(Self(Arc::clone(&self.0))),
            _ => Box::new(()),
        }
    }
}

impl Listener for Asker {
    fn said(&mut self, said: &Said) {
        if matches!(said, Said::Order(FrameOrder { frame: 12, .. })) {
            self.0.ask_reset(ResetKind::Hard);
        }
    }
}

#[test]
fn a_reset_on_command_is_recorded_and_executed_again() {
    let (_folder, path) = place();
    let flight = flight();
    let mut recorder = Recorder::start(&path, &flight.config, (None, 0), WhenFull::Wait).unwrap();
    let control = Arc::new(Control::default());
    let mut asker = Asker(Arc::clone(&control));
    let outcome = fly(flight, &control, &mut Several(vec![&mut asker, &mut recorder]));
    assert_eq!(recorder.finish().not_recorded, 0);
    assert_eq!(outcome.figures.resets, 1);
    let v = verified(&path).unwrap();
    assert!(v.identical && v.complete, "{v:?}");
    assert_eq!(v.estimate_digest, outcome.estimate_digest);
    // The same flight without the command is another.
    let (_folder, _, undisturbed) = recorded(ImageRecording::Png);
    assert_ne!(outcome.estimate_digest, undisturbed.estimate_digest);
}

#[test]
fn a_level_that_this_build_does_not_have_is_refused() {
    let (_folder, path, _) = recorded(ImageRecording::Png);
    rewritten(&path, Channel::FrameOrder, |number, data| {
        if number == 5 {
            let order: FrameOrder = decode(data).unwrap();
            *data = encode(&FrameOrder { verdict: Verdict::Taken { level: 9 }, ..order });
        }
    });
    assert!(verified(&path).unwrap_err().to_string().contains("level 9"));
}

#[test]
fn zero_keeps_its_sign_and_what_is_no_number_its_bits() {
    let mut reading = flight().streams.imu.next_reading().unwrap().unwrap();
    reading.sample.gyro = Vector3::new(-0.0, 0.0, f64::from_bits(0x7ff8_0000_0000_1234));
    let back = decode::<ImuReading>(&encode(&reading)).unwrap();
    assert_eq!(back.sample.gyro.map(f64::to_bits), reading.sample.gyro.map(f64::to_bits));
}

#[test]
fn outputs_are_paired_by_their_numbers() {
    let (_folder, path, _) = recorded(ImageRecording::Png);
    let mut reader = LogReader::open(&path).unwrap();
    let mut odometry = Vec::new();
    while let Some(message) = reader.next_message().unwrap() {
        if message.channel == Channel::Odometry {
            odometry.push(decode::<Odometry>(message.payload).unwrap());
        }
    }
    assert_eq!(reader.ending(), Ending::Flight);
    let mut pairing = Pairing::default();
    for (index, output) in odometry.iter().take(20).enumerate() {
        pairing.executed(output.clone());
        if index != 7 {
            pairing.recorded(output.clone());
        }
    }
    pairing.finish(true);
    assert_eq!((pairing.identical, pairing.missing, &pairing.difference), (19, 1, &None));
    pairing.recorded(odometry[25].clone());
    pairing.finish(false);
    assert_eq!((pairing.left_over(), &pairing.difference), (1, &None));
    pairing.finish(true);
    assert!(pairing.difference.unwrap().to_string().contains("odometry 25"));
}

/// Source that loses all frames between two, for longer than readings wait for a frame.
struct Gap(Box<dyn StereoSource>);

impl StereoSource for Gap {
    fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError> {
        loop {
            let is_there = self.0.next_frame(frame)?;
            if !is_there || !(8..46).contains(&frame.sequence) {
                return Ok(is_there);
            }
        }
    }

    fn expected_frames(&self) -> Option<u64> {
        None
    }

    fn faults(&self) -> Faults {
        self.0.faults()
    }
}

/// The front-end hears what the window found with a frame when it has tracked the next, however long that takes to come.
#[test]
fn a_flight_whose_cameras_pause_comes_out_again() {
    let (_folder, path) = place();
    let mut flight = flight_of(1, 3.5);
    flight.streams.stereo = Box::new(Gap(flight.streams.stereo));
    let mut recorder = Recorder::start(&path, &flight.config, (None, 0), WhenFull::Wait).unwrap();
    let outcome = fly(flight, &Control::default(), &mut recorder);
    assert_eq!(recorder.finish().not_recorded, 0);
    assert!(outcome.figures.frames < 40, "{}", outcome.figures.frames);
    let v = verified(&path).unwrap();
    assert!(v.identical && v.complete, "{v:?}");
    assert_eq!(v.estimate_digest, outcome.estimate_digest);
}
