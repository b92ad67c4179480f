use super::*;
use crate::fixture;
use nalgebra::Vector3;
use plumbline_config::{ImuSample, Timestamp};
use plumbline_drivers::{DriverError, Faults, ImuReading, ImuSource, StereoFrame, StereoSource};

/// First frame; inertial samples begin a tenth of a second before.
const BEGIN: Timestamp = Timestamp::from_nanos(7_000_000_000);
const GYRO: Vector3<f64> = Vector3::new(0.1, -0.2, 0.3);
const ACCEL: Vector3<f64> = Vector3::new(1.0, 2.0, 9.0);

/// Two seconds of samples at 200 Hz; the accelerometer's x axis grows by 1 m/s² a second.
struct Rest(u64);

impl Rest {
    fn at(k: u64) -> ImuSample {
        let stamp = Timestamp::from_nanos(6_900_000_000 + k as i64 * 5_000_000);
        let accel = ACCEL + Vector3::x() * stamp.seconds_since(BEGIN);
        ImuSample { stamp, gyro: GYRO, accel }
    }
}

impl ImuSource for Rest {
    fn next_reading(&mut self) -> Result<Option<ImuReading>, DriverError> {
        self.0 += 1;
        Ok((self.0 <= 400).then(|| ImuReading { sequence: self.0 - 1, sample: Self::at(self.0 - 1) }))
    }

    fn faults(&self) -> Faults {
        Faults::default()
    }
}

fn parsed(texts: &[&str]) -> Vec<InjectedFault> {
    texts.iter().map(|text| text.parse().unwrap()).collect()
}

/// Samples with `texts`, with the time of each as it was taken, s after the first frame.
fn samples(texts: &[&str], seed: u64) -> Vec<(f64, ImuSample)> {
    let config = fixture::config();
    let mut source = InjectedImu::new(Rest(0), &config.imu, BEGIN, &parsed(texts), seed);
    let mut all = Vec::new();
    while let Some(reading) = source.next_reading().unwrap() {
        all.push((Rest::at(reading.sequence).stamp.seconds_since(BEGIN), reading.sample));
    }
    assert_eq!(source.faults().missing, 400 - all.len() as u64);
    all
}

/// Checks samples with `text`, which acts from 0.5 s for 0.25 s, against what `expected` makes of sound ones; the rest is sound.
fn changes(text: &str, expected: impl Fn(&mut ImuSample)) {
    for (time_s, sample) in samples(&[&format!("{text}@0.5+0.25")], 1) {
        let mut due = Rest::at(((time_s + 0.1) / 0.005).round() as u64);
        if (0.4999..0.7499).contains(&time_s) {
            expected(&mut due);
        }
        let apart = (due.gyro - sample.gyro).amax().max((due.accel - sample.accel).amax());
        assert!(
            apart < 1e-9 && due.stamp.nanos_since(sample.stamp).abs() < 10,
            "{text} at {time_s}: {sample:?}"
        );
    }
}

#[test]
fn readings_change_by_the_dose_on_the_axes_in_the_time() {
    changes("accel-pulse:y:30", |sample| sample.accel.y += 30.0);
    changes("accel-step:xz:-3", |sample| sample.accel += Vector3::new(-3.0, 0.0, -3.0));
    changes("accel-clip:xyz:1.5", |sample| sample.accel = sample.accel.map(|a| a.clamp(-1.5, 1.5)));
    changes("accel-dead:z:0", |sample| sample.accel.z = 0.0);
    changes("accel-sign:y", |sample| sample.accel.y = -2.0);
    changes("accel-exchanged:xz", |sample| sample.accel.swap_rows(0, 2));
    changes("accel-scale:xyz:1.1", |sample| sample.accel *= 1.1);
    changes("accel-late:xyz:20", |sample| sample.accel.x -= 0.02);
    changes("gyro-pulse:x:3", |sample| sample.gyro.x += 3.0);
    changes("gyro-dead:xyz:0", |sample| sample.gyro = Vector3::zeros());
    changes("gyro-sign:z", |sample| sample.gyro.z = -0.3);
    changes("gyro-exchanged:yz", |sample| sample.gyro.swap_rows(1, 2));
    changes("gyro-scale:xyz:0.5", |sample| sample.gyro *= 0.5);
    changes("imu-late:-20", |sample| sample.stamp = sample.stamp.plus_seconds(-0.02));
    changes("clock-back:0.5", |sample| sample.stamp = sample.stamp.plus_seconds(-0.5));
    let last = Rest::at(119);
    changes("imu-frozen:xyz:0", |sample| (sample.gyro, sample.accel) = (last.gyro, last.accel));
}

#[test]
fn a_dead_axis_has_the_noise_of_the_sensor_and_no_other_axis_has() {
    let sigma = fixture::config().imu.accel_noise_density * fixture::config().imu.rate_hz.sqrt();
    for (text, multiple) in [("accel-dead:x@0", 1.0), ("accel-dead:x:3@0", 3.0), ("accel-frozen:x:2@0", 2.0)]
    {
        let all = samples(&[text], 1);
        let late: Vec<f64> =
            all.iter().filter(|(time_s, _)| *time_s >= 0.0).map(|(_, sample)| sample.accel.x).collect();
        let mean = late.iter().sum::<f64>() / late.len() as f64;
        let deviation = (late.iter().map(|x| (x - mean).powi(2)).sum::<f64>() / late.len() as f64).sqrt();
        let held = if text.starts_with("accel-frozen") { Rest::at(19).accel.x } else { 0.0 };
        assert!((deviation / (multiple * sigma) - 1.0).abs() < 0.15, "{text}: {deviation}");
        assert!((mean - held).abs() < 4.0 * multiple * sigma / 19.0, "{text}: {mean}");
        assert!(all.iter().all(|(_, sample)| sample.accel.y == 2.0 && sample.gyro == GYRO));
        assert!(late.windows(2).all(|pair| pair[0] != pair[1]), "never bit for bit");
    }
}

#[test]
fn spikes_are_as_many_and_as_large_as_asked() {
    let all = samples(&["accel-spikes:y:0.1:50@0"], 1);
    let hit = all.iter().filter(|(_, sample)| sample.accel.y != 2.0);
    assert!(hit.clone().all(|(time_s, sample)| *time_s >= -1e-9 && (sample.accel.y - 2.0).abs() == 50.0));
    assert!((20..60).contains(&hit.count()));
}

#[test]
fn samples_are_missing_in_a_gap_and_counted() {
    let all = samples(&["imu-gap@0.5+0.2"], 1);
    assert_eq!(all.len(), 360);
    assert!(all.iter().all(|(time_s, _)| !(0.501..0.699).contains(time_s)));
}

#[test]
fn draws_depend_on_the_seed_and_on_the_place_of_the_fault() {
    let of =
        |texts: &[&str], seed| samples(texts, seed).into_iter().map(|(_, sample)| sample).collect::<Vec<_>>();
    let dead = "accel-dead:x@0";
    assert_eq!(of(&[dead], 1), of(&[dead], 1));
    assert_ne!(of(&[dead], 1), of(&[dead], 2));
    assert_eq!(of(&[dead, "stamp-jitter:2"], 1), of(&[dead], 1), "later faults leave earlier draws alone");
    assert_ne!(of(&["stamp-jitter:2", dead], 1), of(&[dead], 1));
}

#[test]
fn faults_combine_in_the_order_given() {
    let y = |texts: &[&str]| samples(texts, 1)[200].1.accel.y;
    assert_eq!(y(&["accel-step:y:3@0", "accel-sign:y@0"]), -5.0);
    assert_eq!(y(&["accel-sign:y@0", "accel-step:y:3@0"]), 1.0);
}

/// Two seconds of frames at 20 Hz; pixel `k` of camera `c` in frame `n` is `n + 2 k + 50 c`.
struct Ramp(u64);

const SIZE_PX: (usize, usize) = (12, 8);

fn pixel(frame: usize, camera: usize, k: usize) -> u8 {
    (frame + 2 * (k % SIZE_PX.0) + (k / SIZE_PX.0) + 50 * camera) as u8
}

impl StereoSource for Ramp {
    fn next_frame(&mut self, frame: &mut StereoFrame) -> Result<bool, DriverError> {
        frame.sequence = self.0;
        frame.stamp = BEGIN.plus_seconds(self.0 as f64 * 0.05);
        frame.valid = [true; 2];
        for (camera, image) in frame.images.iter_mut().enumerate() {
            image
                .pixels_mut()
                .iter_mut()
                .enumerate()
                .for_each(|(k, to)| *to = pixel(self.0 as usize, camera, k));
        }
        self.0 += 1;
        Ok(self.0 <= 40)
    }

    fn expected_frames(&self) -> Option<u64> {
        Some(40)
    }

    fn faults(&self) -> Faults {
        Faults { missing: 1, ..Faults::default() }
    }
}

fn frames(texts: &[&str], seed: u64) -> Vec<StereoFrame> {
    let mut source = InjectedFrames::start(Ramp(0), [SIZE_PX; 2], &parsed(texts), seed).unwrap();
    assert_eq!((source.begin(), source.expected_frames()), (BEGIN, Some(40)));
    let mut frame = StereoFrame::new([SIZE_PX; 2]);
    let mut all = Vec::new();
    while source.next_frame(&mut frame).unwrap() {
        all.push(frame.clone());
    }
    assert_eq!(source.faults().missing, 1 + 40 - all.len() as u64);
    all
}

/// Lateness of the stamps of the frames that come, ms.
fn late_ms(texts: &[&str], seed: u64) -> Vec<f64> {
    let late = |frame: &StereoFrame| frame.stamp.seconds_since(BEGIN) - frame.sequence as f64 * 0.05;
    frames(texts, seed).iter().map(|frame| 1e3 * late(frame)).collect()
}

/// Number of the frame of which the image of `camera` is, by its first pixel.
fn shown(frame: &StereoFrame, camera: usize) -> Option<u64> {
    frame.image(camera).map(|_| u64::from(frame.images[camera].pixels()[0]) - 50 * camera as u64)
}

#[test]
fn without_a_fault_frames_and_samples_pass_unchanged() {
    let all = frames(&[], 1);
    assert!(all.len() == 40 && all.iter().all(|frame| shown(frame, 0) == Some(frame.sequence)));
    assert!(samples(&[], 1).iter().enumerate().all(|(k, (_, sample))| *sample == Rest::at(k as u64)));
}

#[test]
fn stamps_are_late_by_jitter_swing_and_exposure() {
    let jitter = late_ms(&["stamp-jitter:2"], 1);
    let deviation = (jitter.iter().map(|ms| ms * ms).sum::<f64>() / 40.0).sqrt();
    assert!((1.4..2.6).contains(&deviation), "{deviation}");
    assert_ne!(jitter, late_ms(&["stamp-jitter:2"], 2));
    let swing = late_ms(&["stamp-swing:3:1"], 1);
    assert!(
        swing[0].abs() < 1e-6 && (swing[5] - 3.0).abs() < 1e-6 && (swing[15] + 3.0).abs() < 1e-6,
        "{swing:?}"
    );
    for (text, due) in [("stamp-end:6@1", 3.0), ("stamp-late:-20@1", -20.0), ("clock-back:0.5@1", -500.0)] {
        let late = late_ms(&[text], 1);
        assert!(late[19].abs() < 1e-6 && (late[20] - due).abs() < 1e-6, "{text}: {late:?}");
    }
    assert!((late_ms(&["stamp-end:6", "stamp-late:5"], 1)[7] - 8.0).abs() < 1e-6, "both");
}

#[test]
fn frames_are_missing_at_random_or_in_a_gap() {
    let kept =
        |texts: &[&str], seed| frames(texts, seed).iter().map(|frame| frame.sequence).collect::<Vec<_>>();
    let random = kept(&["frames-missing:0.33"], 1);
    assert!((18..36).contains(&random.len()), "{random:?}");
    assert_ne!(random, kept(&["frames-missing:0.33"], 2));
    assert_eq!(kept(&["frame-gap@0.5+0.5"], 1), (0..10).chain(20..40).collect::<Vec<_>>());
}

#[test]
fn images_are_late_repeated_exchanged_and_lost() {
    let show = |texts: &[&str], camera| frames(texts, 1).iter().map(|f| shown(f, camera)).collect::<Vec<_>>();
    let late = show(&["image-late:right:3"], 1);
    assert_eq!(late[..5], [None, None, None, Some(0), Some(1)]);
    assert_eq!(show(&["image-late:right:3"], 0), show(&[], 0));
    let from_the_middle = show(&["image-late:left:1@1"], 0);
    assert_eq!(from_the_middle[18..22], [Some(18), Some(19), Some(19), Some(20)]);
    let both = frames(&["image-late:both:2"], 1);
    assert_eq!((both.len(), both[0].sequence, shown(&both[0], 0)), (38, 2, Some(0)), "no image, no frame");
    let repeated = show(&["image-repeat:right:5"], 1);
    assert_eq!(repeated[3..10], [3, 3, 5, 6, 7, 8, 8].map(Some));
    let exchanged = frames(&["images-exchanged@1"], 1);
    assert!(exchanged[19].images[0].pixels()[0] == 19 && exchanged[20].images[0].pixels()[0] == 70);
    assert_eq!(
        show(&["camera-lost:left@0.5+0.5"], 0)[9..21].iter().filter(|shown| shown.is_none()).count(),
        10
    );
}

#[test]
fn frozen_and_black_images_have_new_noise_in_each_frame() {
    let sound = frames(&[], 1);
    let frozen = frames(&["image-frozen:left@1"], 1);
    for k in 20..39 {
        let [a, b] = [&frozen[k].images[0], &frozen[k + 1].images[0]];
        assert!(
            a != b && a.pixels().iter().zip(sound[20].images[0].pixels()).all(|(a, b)| a.abs_diff(*b) < 9),
            "{k}"
        );
        assert_eq!(frozen[k].images[1], sound[k].images[1]);
    }
    assert_eq!(frozen[19].images, sound[19].images);
    let exact = frames(&["image-frozen:both:0@1"], 1);
    assert!((20..40).all(|k| exact[k].images == sound[20].images));
    let black = frames(&["image-black:both:1@1+0.5"], 1);
    assert!(black[25].images.iter().all(|image| image.pixels().iter().all(|p| *p < 8)));
    assert!(black[25].images != black[26].images && black[30].images == sound[30].images);
}

#[test]
fn images_are_shifted_by_whole_pixels() {
    let (width, height) = SIZE_PX;
    for (right, down) in [(4_isize, 0_isize), (-3, 2), (0, -2)] {
        let seen = &frames(&[&format!("image-shift:right:{right}:{down}")], 1)[7];
        for v in 0..height as isize {
            for u in 0..width as isize {
                let from = (v - down).clamp(0, height as isize - 1) * width as isize
                    + (u - right).clamp(0, width as isize - 1);
                assert_eq!(
                    seen.images[1].pixels()[(v * width as isize + u) as usize],
                    pixel(7, 1, from as usize)
                );
            }
        }
        assert_eq!(seen.images[0], frames(&[], 1)[7].images[0]);
    }
}

#[test]
fn noise_is_as_strong_and_as_correlated_as_asked() {
    let sound = frames(&[], 1);
    for correlation in [0.0, 0.9] {
        let noisy = frames(&[&format!("image-noise:right:5:{correlation}")], 1);
        let noise = |k: usize| {
            let pairs = noisy[k].images[1].pixels().iter().zip(sound[k].images[1].pixels());
            pairs.map(|(a, b)| f64::from(*a) - f64::from(*b)).collect::<Vec<_>>()
        };
        let (mut squares, mut products, mut count) = (0.0, 0.0, 0.0);
        for k in 1..40 {
            for (a, b) in noise(k - 1).iter().zip(noise(k)) {
                (squares, products, count) = (squares + b * b, products + a * b, count + 1.0);
            }
        }
        let (sigma, found) = ((squares / count).sqrt(), products / squares);
        assert!((sigma - 5.0).abs() < 0.7 && (found - correlation).abs() < 0.12, "{sigma} {found}");
        assert_eq!(noisy[3].images[0], sound[3].images[0]);
    }
}

#[test]
fn jpeg_loses_more_the_lower_its_quality() {
    let noisy = frames(&["image-noise:both:20:0"], 1);
    let loss = |quality: u32| {
        let packed = frames(&["image-noise:both:20:0", &format!("image-jpeg:both:{quality}")], 1);
        let pairs = packed[5].images[0].pixels().iter().zip(noisy[5].images[0].pixels());
        pairs.map(|(a, b)| f64::from(a.abs_diff(*b))).sum::<f64>()
    };
    let [best, good, poor] = [100, 80, 30].map(loss);
    assert!(best < good && good < poor, "{best} {good} {poor}");
}

#[test]
fn mistakes_are_made_in_the_calibration() {
    let sound = fixture::config();
    let mistaken = |text: &str| {
        let mut config = sound.clone();
        text.parse::<InjectedFault>().unwrap().mistake(&mut config);
        config
    };
    let baseline = |config: &Config| {
        let [left, right] = [0, 1].map(|k| config.camera[k].pose_b_c().translation.vector);
        right - left
    };
    let apart = baseline(&mistaken("rig-baseline:0.5")) - 0.5 * baseline(&sound);
    assert!(apart.norm() < 1e-12 && mistaken("rig-baseline").camera[0] == sound.camera[0]);
    let other = mistaken("rig-lens");
    let models = |config: &Config| {
        config.camera.iter().map(|camera| std::mem::discriminant(&camera.distortion)).collect::<Vec<_>>()
    };
    assert_ne!(models(&other)[0], models(&sound)[0]);
    assert_eq!(mistaken("accel-dead"), sound, "a fault of the streams");
}

#[test]
fn a_rig_of_one_camera_has_no_fault_of_the_other() {
    let check = |text: &str| text.parse::<InjectedFault>().unwrap().check_cameras(1);
    for text in ["image-late:right", "images-exchanged", "rig-baseline"] {
        assert!(check(text).unwrap_err().contains("one camera; leave it out"));
    }
    assert!(["image-late:left", "image-frozen:both", "stamp-jitter"].iter().all(|text| check(text).is_ok()));
}

#[test]
fn every_kind_is_read_and_written() {
    for kind in InjectedFault::kinds() {
        let fault: InjectedFault = kind.name.parse().unwrap();
        assert_eq!(fault.to_string().parse::<InjectedFault>().unwrap(), fault);
    }
}

#[test]
fn what_cannot_be_read_is_refused_with_the_cure() {
    for (text, cure) in [
        ("akkel-dead", "choose stamp-jitter"),
        ("accel-dead:w", "write x, y, z"),
        ("image-frozen:top", "write left, right or both"),
        ("stamp-jitter:x", "no axes or cameras"),
        ("stamp-jitter:-1", "not a number from 0 to 1000"),
        ("stamp-jitter:1:2", "1 doses; stamp-jitter:standard deviation, ms [1]"),
        ("accel-exchanged:x", "give xy, xz or yz"),
        ("accel-exchanged:xyz", "give xy, xz or yz"),
        ("accel-pulse@6..7", "@FROM+DURATION"),
        ("accel-pulse@-1", "a number of seconds from 0"),
        ("accel-pulse@6+nan", "a number of seconds from 0"),
        ("rig-baseline:2@5", "leave out the time"),
        ("image-jpeg:both:0", "from 1 to 100"),
    ] {
        let message = text.parse::<InjectedFault>().unwrap_err();
        assert!(message.contains(cure), "{text}: {message}");
    }
}

#[test]
fn a_fault_with_a_period_acts_again_and_again() {
    let sound = frames(&[], 1);
    let dark = frames(&["image-black:both:0@0.25+0.2/0.5"], 1);
    for (k, frame) in dark.iter().enumerate() {
        // 20 Hz: frames 5 to 8, 15 to 18 and so on.
        let is_dark = k % 10 >= 5 && k % 10 < 9;
        assert_eq!(frame.images != sound[k].images, is_dark, "{k}");
    }
    // Each time the image of its own beginning freezes.
    let frozen = frames(&["image-frozen:both:0@0.25+0.2/0.5"], 1);
    assert!(frozen[8].images == sound[5].images && frozen[18].images == sound[15].images);
    assert!(frozen[9].images == sound[9].images);
    let again = "accel-step:x:1@0.5+0.1/0.4".parse::<InjectedFault>().unwrap();
    assert_eq!(again.to_string().parse(), Ok(again));
    for bad in ["image-black@5/10", "image-black@5+2/1", "image-black@5+2/x", "rig-lens@1+1/2"] {
        assert!(bad.parse::<InjectedFault>().is_err(), "{bad}");
    }
}

#[test]
fn words_of_a_fault_say_what_it_is_and_when() {
    for (text, words) in [
        ("image-frozen:left@5+3", "image-frozen:left:1.5@5+3 (One image again"),
        ("image-frozen:left@5+3", "from 5 to 8 s after the first frame"),
        ("accel-pulse:x:30@6+0.1", "from 6 to 6.1 s after the first frame"),
        ("gyro-dead:x@8", "from 8 s after the first frame to the end"),
        ("imu-gap@5+0.5/10", "from 5 to 5.5 s after the first frame, and every 10 s after that"),
        ("rig-baseline:1.1", "in the calibration that is written"),
    ] {
        let told = text.parse::<InjectedFault>().unwrap().words();
        assert!(told.contains(words), "{told}");
    }
}
