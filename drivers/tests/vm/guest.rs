//! Tests in the virtual machine: two of the kernel's cameras, the second of which has its images in planes.

use plumbline_config::GrayImage;
use plumbline_config::options::{PairBy, V4l2Config, V4l2Format};
use plumbline_drivers::v4l2::{self, PixelFormat, V4l2Figures, V4l2Options, V4l2Stereo};
use plumbline_drivers::{Faults, StereoFrame, StereoSource as _, StopFlag};
use rustix::ioctl::{Updater, ioctl, opcode};
use std::time::{Duration, Instant};

const LEFT: &str = "/dev/v4l/by-path/platform-vivid.0-port0-video-index0";
const RIGHT: &str = "/dev/v4l/by-path/platform-vivid.0-port1-video-index0";
const SIZE: (usize, usize) = (640, 480);
/// Slow enough for an emulated processor on a busy host.
const RATE_HZ: f64 = 10.0;

/// Both cameras; by default vivid's stamps are of the end of frames that have not ended yet.
fn both() -> V4l2Options {
    let v4l2 = V4l2Config {
        left: LEFT.into(),
        right: RIGHT.into(),
        controls: vec!["timestamp_source=1".into()],
        ..V4l2Config::default()
    };
    V4l2Options { v4l2, sizes_px: vec![SIZE; 2], rate_hz: RATE_HZ, pair_tolerance_s: 0.002 }
}

/// The left camera alone.
fn left(change: impl FnOnce(&mut V4l2Config)) -> V4l2Options {
    let mut options = both();
    options.v4l2.right.clear();
    options.sizes_px.truncate(1);
    change(&mut options.v4l2);
    options
}

/// Result of a run of the reader.
#[derive(Debug, Default)]
struct Run {
    seconds: f64,
    frames: u64,
    pairs: u64,
    /// Images alone, left and right.
    alone: [u64; 2],
    /// Longest time without a frame, s.
    longest_gap_s: f64,
    /// Largest gap: the last frame before it and the first one after it, s.
    gap: (f64, f64),
    /// Time from the stamp to when the frame was handed out, by the monotonic clock, ms.
    age_ms: (f64, f64, f64),
    /// Allocations on the thread that reads, beyond the first frames.
    allocations: u64,
    faults: Faults,
    figures: V4l2Figures,
}

/// Reads for so long; `watch` is called with the time after each frame and may end it.
fn read(source: &mut V4l2Stereo, stop: &StopFlag, seconds: f64) -> Run {
    let sizes = [SIZE; 2];
    let (mut frame, mut run) = (StereoFrame::new(sizes), Run::default());
    let begin = Instant::now();
    let (mut last_s, mut last_stamp, mut sum_ms) = (0.0, None, 0.0);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            std::thread::sleep(Duration::from_secs_f64(seconds));
            stop.stop();
        });
        loop {
            let mut is_frame = false;
            let counted = allocation_counter::measure(|| is_frame = source.next_frame(&mut frame).unwrap());
            let now_s = begin.elapsed().as_secs_f64();
            run.allocations += if run.frames < 2 { 0 } else { counted.count_total };
            if now_s - last_s > run.longest_gap_s {
                (run.longest_gap_s, run.gap) = (now_s - last_s, (last_s, now_s));
            }
            if !is_frame {
                break;
            }
            last_s = now_s;
            assert!(
                last_stamp.is_none_or(|last| last < (frame.stamp, frame.sequence)),
                "frames are in order"
            );
            last_stamp = Some((frame.stamp, frame.sequence));
            let now = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
            let age_ms = (now.tv_sec * 1_000_000_000 + now.tv_nsec - frame.stamp.as_nanos()) as f64 * 1e-6;
            let (least, _, most) = if run.frames == 0 { (age_ms, 0.0, age_ms) } else { run.age_ms };
            sum_ms += age_ms;
            run.frames += 1;
            run.age_ms = (least.min(age_ms), sum_ms / run.frames as f64, most.max(age_ms));
            match frame.valid {
                [true, true] => run.pairs += 1,
                [true, false] => run.alone[0] += 1,
                _ => run.alone[1] += 1,
            }
        }
    });
    run.seconds = begin.elapsed().as_secs_f64();
    (run.faults, run.figures) = (source.faults(), source.figures());
    run
}

/// Opens, reads for so long, and shows the figures.
fn run(name: &str, options: &V4l2Options, seconds: f64) -> Run {
    let stop = StopFlag::new();
    let mut source = V4l2Stereo::open(options, stop.clone()).unwrap_or_else(|e| panic!("{e}"));
    let run = read(&mut source, &stop, seconds);
    println!("{}", json(name, &run));
    run
}

fn json(name: &str, run: &Run) -> String {
    let Run { seconds, frames, pairs, alone, allocations, longest_gap_s, age_ms, faults, figures, .. } = run;
    let cameras: Vec<String> = figures
        .cameras
        .iter()
        .map(|c| {
            format!(
                "{{\"images\":{},\"missing\":{},\"corrupt\":{},\"disordered\":{},\"restamped\":{},\"alone\":{},\
                 \"started\":{},\"lost\":{},\"delay_ms\":{:.3},\"max_delay_ms\":{:.3}}}",
                c.images,
                c.missing,
                c.corrupt,
                c.disordered,
                c.restamped,
                c.alone,
                c.started,
                c.lost,
                c.delay_ms,
                c.max_delay_ms
            )
        })
        .collect();
    format!(
        "{{\"run\":\"{name}\",\"seconds\":{seconds:.2},\"frames\":{frames},\"rate_hz\":{:.3},\"pairs\":{pairs},\
         \"alone\":[{},{}],\"missing\":{},\"unpaired\":{},\"offset_ms\":{:.3},\"max_jitter_ms\":{:.3},\
         \"period_ms\":{:.3},\"longest_gap_s\":{longest_gap_s:.3},\"age_ms\":[{:.3},{:.3},{:.3}],\
         \"allocations\":{allocations},\"cameras\":[{}]}}",
        *frames as f64 / seconds,
        alone[0],
        alone[1],
        faults.missing,
        faults.unpaired,
        figures.offset_ms,
        figures.max_jitter_ms,
        figures.period_ms,
        age_ms.0,
        age_ms.1,
        age_ms.2,
        cameras.join(",")
    )
}

impl Run {
    /// Frames that came and frames that are missing are those of the time, whatever an emulated processor loses.
    fn assert_complete(&self) {
        let expected = self.seconds * RATE_HZ;
        let all = (self.frames + self.faults.missing) as f64;
        assert!((all - expected).abs() < 0.05 * expected + 4.0, "{all} of {expected:.0}: {self:?}");
    }

    /// An image is alone only where its partner is missing, but for the first and the last.
    fn assert_paired(&self) {
        let missing: u64 = self.figures.cameras.iter().map(|camera| camera.missing).sum();
        assert!(self.alone[0] + self.alone[1] <= missing + 4, "{self:?}");
        assert_eq!(self.faults.unpaired, self.alone[0] + self.alone[1], "{self:?}");
        assert_eq!(self.frames, self.pairs + self.alone[0] + self.alone[1]);
        assert_eq!((self.figures.frames, self.figures.pairs), (self.frames, self.pairs));
    }
}

/// Duration of the run that shows the figures of a flight, s.
fn long_run_s() -> f64 {
    std::env::var("PLUMBLINE_VM_SECONDS").ok().and_then(|seconds| seconds.parse().ok()).unwrap_or(5.0)
}

/// Presses a button or sets a control of a device, as another program would.
#[allow(unsafe_code)]
fn set(path: &str, name: &str, value: i32) {
    let node = std::fs::canonicalize(path).unwrap();
    let cameras = v4l2::cameras();
    let camera = cameras.iter().find(|camera| camera.path == node).unwrap();
    let control = camera.controls.iter().find(|control| control.name == name).unwrap();
    let file = std::fs::OpenOptions::new().read(true).write(true).open(&node).unwrap();
    const SET_CONTROL: rustix::ioctl::Opcode = opcode::read_write::<[i32; 2]>(b'V', 28);
    let mut value = [control.id as i32, value];
    // SAFETY: VIDIOC_S_CTRL takes two integers of 32 bits.
    unsafe { ioctl(&file, Updater::<SET_CONTROL, _>::new(&mut value)) }.unwrap();
}

/// Pulls the plug of both cameras, or puts it in.
fn plug(what: &str) {
    std::fs::write(format!("/sys/bus/platform/drivers/vivid/{what}"), "vivid.0").unwrap();
}

#[test]
#[ignore = "runs in the virtual machine"]
fn cameras_are_listed_with_what_they_offer() {
    let cameras = v4l2::cameras();
    assert_eq!(cameras.len(), 2, "{cameras:?}");
    for (camera, stable) in cameras.iter().zip([LEFT, RIGHT]) {
        assert_eq!((camera.driver.as_str(), camera.stable_paths[0].to_str()), ("vivid", Some(stable)));
        let grey = camera.formats.iter().find(|format| format.code == "GREY").unwrap();
        assert_eq!(grey.format, Some(PixelFormat::Grey));
        let size = grey.sizes.iter().find(|size| size.size_px == (640, 480)).unwrap();
        assert!(size.rates.to_string().contains("25"), "{}", size.rates);
        let source = camera.controls.iter().find(|control| control.name == "timestamp_source").unwrap();
        assert_eq!((source.range.0, source.range.1), (0, 1), "{source:?}");
    }
    assert!(cameras[0].to_string().contains("timestamp_source="));
}

#[test]
#[ignore = "runs in the virtual machine"]
fn two_cameras_give_pairs_in_time_without_allocating() {
    let seconds = long_run_s();
    let run = run("pairs", &both(), seconds);
    run.assert_complete();
    run.assert_paired();
    assert!(run.pairs as f64 > 0.8 * seconds * RATE_HZ, "{run:?}");
    assert!((run.figures.period_ms * RATE_HZ / 1e3 - 1.0).abs() < 0.2, "{run:?}");
    // Stamped before they arrived, and handed out soon after.
    assert!(run.age_ms.0 > 0.0 && run.age_ms.1 < 1e3 / RATE_HZ, "{run:?}");
    assert_eq!(run.figures.cameras.map(|c| (c.restamped, c.disordered, c.lost)), [(0, 0, 0); 2], "{run:?}");
    assert_eq!(run.allocations, 0, "{run:?}");
    // It ended soon after it was told to.
    assert!(run.seconds < seconds + 0.5, "{run:?}");
}

#[test]
#[ignore = "runs in the virtual machine"]
fn cameras_are_paired_by_their_numbers() {
    let mut options = both();
    options.v4l2.pair_by = PairBy::Sequence;
    let run = run("sequence", &options, 4.0);
    run.assert_complete();
    run.assert_paired();
}

/// The image of a camera in a format, without moving parts and writing.
fn still(path: &str, format: V4l2Format) -> GrayImage {
    let options = left(|v4l2| {
        (v4l2.left, v4l2.format) = (path.into(), format);
        v4l2.controls.push("osd_text_mode=2".into());
    });
    let mut source =
        V4l2Stereo::open(&options, StopFlag::new()).unwrap_or_else(|e| panic!("{format:?}: {e}"));
    let mut frame = StereoFrame::new([SIZE, (0, 0)]);
    for _ in 0..3 {
        assert!(source.next_frame(&mut frame).unwrap());
        assert_eq!(frame.valid, [true, false]);
    }
    frame.images[0].clone()
}

#[test]
#[ignore = "runs in the virtual machine"]
fn every_format_shows_the_same_picture() {
    use V4l2Format as F;
    // Eight bars of 75 % colour, as television has them: grey by the weights of BT.709, from black at 0, and the luma of
    // BT.601, from black at 16.
    let grey = [190, 176, 149, 136, 54, 40, 13, 0];
    let luma = [180, 162, 131, 112, 84, 65, 35, 16];
    for path in [LEFT, RIGHT] {
        for (formats, expected) in
            [(&[F::Grey, F::Y10, F::Y12, F::Y16][..], grey), (&[F::Yuyv, F::Uyvy, F::Nv12], luma)]
        {
            for format in formats {
                let image = still(path, *format);
                for (x, y) in (0..SIZE.1).flat_map(|y| (0..8).map(move |bar| (40 + 80 * bar, y))) {
                    let (is, should) = (image.pixels()[y * SIZE.0 + x], expected[x / 80]);
                    assert!(
                        u8::abs_diff(is, should) <= 2,
                        "{path} {format:?}: {is} at ({x}, {y}), not {should}"
                    );
                }
            }
        }
    }
}

#[test]
#[ignore = "runs in the virtual machine"]
fn lost_images_are_counted_and_their_partners_come_alone() {
    let mut options = both();
    options.v4l2.controls.push("percentage_of_dropped_buffers=20".into());
    let run = run("dropped", &options, 6.0);
    set(LEFT, "percentage_of_dropped_buffers", 0);
    set(RIGHT, "percentage_of_dropped_buffers", 0);
    for camera in run.figures.cameras {
        let share = camera.missing as f64 / (camera.images + camera.missing) as f64;
        assert!((0.05..0.6).contains(&share), "{share} {run:?}");
    }
    run.assert_complete();
    run.assert_paired();
    assert!(run.alone[0] > 2 && run.alone[1] > 2, "{run:?}");
    assert_eq!(run.allocations, 0, "{run:?}");
}

#[test]
#[ignore = "runs in the virtual machine"]
fn numbers_and_stamps_that_wrap_or_lie_are_survived() {
    // Numbers begin 128 before the end of their range.
    let mut options = left(|v4l2| v4l2.controls.push("wrap_sequence_number=1".into()));
    options.rate_hz = 25.0;
    let wrapped = run("wrap", &options, 7.0);
    set(LEFT, "wrap_sequence_number", 0);
    let all = wrapped.frames + wrapped.faults.missing;
    assert!(wrapped.frames > 128 && (150..200).contains(&all), "{wrapped:?}");
    // Stamps in the future: the end of a frame that has not ended.
    let ahead = run("ahead", &left(|v4l2| v4l2.controls = vec!["timestamp_source=0".into()]), 2.0);
    assert!(ahead.figures.cameras[0].restamped as f64 > 0.9 * ahead.frames as f64, "{ahead:?}");
    assert!(ahead.age_ms.0 >= 0.0, "{ahead:?}");
}

#[test]
#[ignore = "runs in the virtual machine"]
fn both_cameras_are_unplugged_in_flight_and_found_again() {
    let other = std::thread::spawn(|| {
        std::thread::sleep(Duration::from_secs(2));
        plug("unbind");
        std::thread::sleep(Duration::from_secs(2));
        plug("bind");
    });
    let run = run("unplugged", &both(), 7.0);
    other.join().unwrap();
    assert!((1.9..4.0).contains(&run.longest_gap_s), "{run:?}");
    assert_eq!(run.figures.cameras.map(|c| (c.started, c.lost)), [(2, 1); 2], "{run:?}");
    // What went missing meanwhile is told by the number.
    run.assert_complete();
    assert!(run.faults.missing as f64 > 1.5 * RATE_HZ, "{run:?}");
    assert!(run.pairs as f64 > 2.5 * RATE_HZ, "{run:?}");
    assert_eq!(run.allocations, 0, "{run:?}");
}

#[test]
#[ignore = "runs in the virtual machine"]
fn one_camera_goes_and_the_other_flies_on() {
    for (what, button) in [("disconnected", "disconnect"), ("failed", "inject_fatal_streaming_error")] {
        let other = std::thread::spawn(move || {
            std::thread::sleep(Duration::from_secs(1));
            set(RIGHT, button, 1);
        });
        let run = run(what, &both(), 4.0);
        other.join().unwrap();
        assert_eq!(run.figures.cameras.map(|c| (c.started, c.lost)), [(1, 0), (2, 1)], "{run:?}");
        run.assert_complete();
        assert!(run.longest_gap_s < 0.5, "{run:?}");
        // Pairs before and after.
        assert!(run.pairs as f64 > 2.2 * RATE_HZ, "{run:?}");
        assert_eq!(run.allocations, 0, "{run:?}");
    }
}

#[test]
#[ignore = "runs in the virtual machine"]
fn cameras_that_are_plugged_in_later_are_taken() {
    plug("unbind");
    let stop = StopFlag::new();
    let mut source = V4l2Stereo::open(&both(), stop.clone()).unwrap();
    let trouble = source.monitor().trouble();
    assert!(trouble[0].as_ref().is_some_and(|why| why.contains("driver.v4l2.left")), "{trouble:?}");
    let other = std::thread::spawn(|| {
        std::thread::sleep(Duration::from_secs(1));
        plug("bind");
    });
    let monitor = source.monitor();
    let run = read(&mut source, &stop, 4.0);
    println!("{}", json("later", &run));
    other.join().unwrap();
    assert!(run.pairs as f64 > 1.5 * RATE_HZ, "{run:?}");
    assert_eq!(monitor.trouble(), [None, None]);
    assert_eq!(monitor.figures().frames, run.frames);
}

#[test]
#[ignore = "runs in the virtual machine"]
fn what_a_camera_cannot_do_is_refused_by_key_with_what_it_can() {
    let refused = |options: &V4l2Options, parts: &[&str]| {
        let error = V4l2Stereo::open(options, StopFlag::new()).unwrap_err().to_string();
        for part in parts {
            assert!(error.contains(part), "'{part}' is missing in: {error}");
        }
    };
    let mut options = left(|_| {});
    options.sizes_px = vec![(648, 480)];
    refused(&options, &["648 x 480", "driver.v4l2.format", "GREY", "640 x 480", "width_px"]);
    options.sizes_px = vec![SIZE];
    options.rate_hz = 21.0;
    refused(&options, &["rate_hz", "12.5, 15, 25 Hz"]);
    refused(&left(|v4l2| v4l2.format = V4l2Format::Mjpeg), &["driver.v4l2.format"]);
    refused(&left(|v4l2| v4l2.controls = vec!["brightnes=1".into()]), &["controls[0]", "brightness"]);
    refused(&left(|v4l2| v4l2.controls = vec!["brightness=999".into()]), &["controls[0]", "0 to 255"]);
    refused(&left(|v4l2| v4l2.exposure_us = 5000.0), &["exposure_us", "no exposure"]);
    refused(&left(|v4l2| v4l2.gain = 1e6), &["driver.v4l2.gain", "0 to 255"]);
    let held = V4l2Stereo::open(&left(|_| {}), StopFlag::new()).unwrap();
    refused(&left(|_| {}), &["another program"]);
    drop(held);
    // And can be opened again at once.
    V4l2Stereo::open(&left(|_| {}), StopFlag::new()).unwrap();
}
