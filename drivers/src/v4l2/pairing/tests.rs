//! Streams of two cameras, made up image by image, and what becomes of them.

use super::*;
use std::collections::VecDeque;

const PERIOD: i64 = 50_000_000;

/// An image that a camera sends: when it is measured, when it arrives, its number.
#[derive(Clone, Copy)]
struct Sent {
    camera: usize,
    image: Waiting,
}

/// Images of a camera at these times (periods), numbered in order, each `delay` (periods) on its way.
fn stream(camera: usize, times: impl IntoIterator<Item = f64>, delay: f64) -> Vec<Sent> {
    let sent = |(number, time): (usize, f64)| Sent {
        camera,
        image: Waiting {
            stamp_ns: (time * PERIOD as f64) as i64,
            sequence: number as u64,
            arrival_ns: ((time + delay) * PERIOD as f64) as i64,
        },
    };
    times.into_iter().enumerate().map(sent).collect()
}

/// Leaves out the images of these numbers.
fn without(sent: Vec<Sent>, numbers: &[u64]) -> Vec<Sent> {
    sent.into_iter().filter(|s| !numbers.contains(&s.image.sequence)).collect()
}

/// Numbers of left and right image of each frame, and when it was handed out, periods.
type Frames = Vec<(Option<u64>, Option<u64>, f64)>;

/// Hands all of it to `pairing`, as the driver does.
fn run(pairing: &mut Pairing, left: Vec<Sent>, right: Vec<Sent>) -> Frames {
    let mut sent = [left, right].concat();
    sent.sort_by_key(|s| s.image.arrival_ns);
    let end = sent.last().map_or(0, |s| s.image.arrival_ns) + 10 * PERIOD;
    let mut sent = VecDeque::from(sent);
    let mut waiting = [VecDeque::new(), VecDeque::new()];
    let (mut now, mut frames) = (0, Frames::new());
    loop {
        while sent.front().is_some_and(|s| s.image.arrival_ns <= now) {
            let Sent { camera, image } = sent.pop_front().unwrap();
            pairing.arrived(camera, image);
            waiting[camera].push_back(image);
        }
        let side = |camera: usize| Side {
            front: waiting[camera].front().copied(),
            is_alive: true,
            is_full: waiting[camera].len() >= 4,
        };
        let sides = [side(0), side(1)];
        let at = now as f64 / PERIOD as f64;
        match pairing.next(sides, now) {
            Next::Pair => {
                let [left, right] = [0, 1].map(|c| waiting[c].pop_front().unwrap());
                pairing.paired(left, right);
                frames.push((Some(left.sequence), Some(right.sequence), at));
            }
            Next::Alone(camera) => {
                let image = waiting[camera].pop_front().unwrap();
                pairing.alone(camera, sides[1 - camera].front.is_none());
                let number = |c| (c == camera).then_some(image.sequence);
                frames.push((number(0), number(1), at));
            }
            Next::Wait(until) => {
                let next = sent.front().map_or(end, |s| s.image.arrival_ns);
                let then = until.unwrap_or(i64::MAX).min(next);
                if then >= end || (then == now && sent.is_empty()) {
                    return frames;
                }
                now = then.max(now + 1);
            }
        }
    }
}

fn by_time() -> Pairing {
    Pairing::new(false, PERIOD as f64)
}

fn by_sequence() -> Pairing {
    Pairing::new(true, PERIOD as f64)
}

fn even(count: usize, start: f64) -> impl Iterator<Item = f64> {
    (0..count).map(move |n| n as f64 + start)
}

/// Pairs, and images alone of left and right.
fn counts(frames: &Frames) -> (usize, usize, usize) {
    let count = |left: bool, right: bool| {
        frames.iter().filter(|(l, r, _)| (l.is_some(), r.is_some()) == (left, right)).count()
    };
    (count(true, true), count(true, false), count(false, true))
}

/// All pairs have this difference of numbers.
fn assert_apart(frames: &Frames, numbers: i64) {
    for (left, right, at) in frames {
        if let (Some(left), Some(right)) = (left, right) {
            assert_eq!(*right as i64 - *left as i64, numbers, "at {at}");
        }
    }
}

#[test]
fn images_of_one_time_are_pairs_whichever_comes_first() {
    for (delay_left, delay_right) in [(0.1, 0.2), (0.3, 0.1), (0.2, 0.9)] {
        let mut pairing = by_time();
        let frames =
            run(&mut pairing, stream(0, even(40, 1.0), delay_left), stream(1, even(40, 1.002), delay_right));
        assert_eq!(counts(&frames), (40, 0, 0), "{delay_left} {delay_right}");
        assert_apart(&frames, 0);
        assert_eq!(pairing.offset_ns(), Some(PERIOD / 500));
    }
}

#[test]
fn jitter_about_half_a_period_does_not_make_pairs_change_sides() {
    // The right camera is 0.47 periods late, give or take 0.1.
    let jitter = |n: usize| [0.0, 0.1, -0.1, 0.07, -0.05][n % 5];
    let right = (0..200).map(|n| n as f64 + 1.47 + if n > 20 { jitter(n) } else { 0.0 });
    let frames = run(&mut by_time(), stream(0, even(200, 1.0), 0.1), stream(1, right, 0.1));
    assert_eq!(counts(&frames), (200, 0, 0));
    assert_apart(&frames, 0);
}

#[test]
fn a_lost_image_leaves_its_partner_alone_and_nothing_else() {
    for (left, right, expected) in [(vec![], vec![7], (29, 1, 0)), (vec![5, 20], vec![11, 12], (26, 2, 2))] {
        let frames = run(
            &mut by_time(),
            without(stream(0, even(30, 1.0), 0.1), &left),
            without(stream(1, even(30, 1.0), 0.3), &right),
        );
        assert_eq!(counts(&frames), expected);
        assert_apart(&frames, 0);
    }
}

#[test]
fn a_partner_is_waited_for_until_the_next_one_shows_that_it_is_lost() {
    let frames =
        run(&mut by_time(), stream(0, even(30, 1.0), 0.1), without(stream(1, even(30, 1.0), 0.3), &[7]));
    let (_, _, at) = frames.iter().find(|(_, right, _)| right.is_none()).unwrap();
    // Measured at 8: the right one of 9 arrives at 9.3.
    assert!((9.25..9.35).contains(at), "{at}");
}

#[test]
fn a_camera_that_falls_silent_is_waited_for_twice() {
    let right = stream(1, even(10, 1.0), 0.1);
    let frames = run(&mut by_time(), stream(0, even(40, 1.0), 0.1), right);
    assert_eq!(counts(&frames), (10, 30, 0));
    for (left, _, at) in &frames[13..] {
        let late = at - (left.unwrap() as f64 + 1.0);
        assert!(late < 0.15, "{late} at {at}");
    }
}

#[test]
fn a_camera_that_comes_later_finds_its_pairs() {
    let late = stream(1, even(30, 31.0), 0.1);
    let frames = run(&mut by_time(), stream(0, even(60, 1.0), 0.1), late);
    assert_eq!(counts(&frames), (30, 30, 0));
    assert_apart(&frames, -30);
}

#[test]
fn cameras_that_run_free_slide_past_each_other() {
    // The right one is 1 % slower: it falls back by three periods in 300.
    let right = (0..300).map(|n| n as f64 * 1.01 + 1.0);
    let mut pairing = by_time();
    let frames = run(&mut pairing, stream(0, even(303, 1.0), 0.1), stream(1, right, 0.1));
    let (pairs, left, right) = counts(&frames);
    assert!(pairs >= 295 && left <= 8 && right <= 5, "{pairs} {left} {right}");
    assert!(pairing.offset_ns().unwrap().abs() < PERIOD * 7 / 10);
}

#[test]
fn numbers_pair_what_stamps_could_not() {
    // Triggered together; the right one's stamps say when it arrived, up to a period late.
    let jitter = |n: usize| [0.0, 0.4, 0.1, 0.8, 0.3, 0.95][n % 6];
    let right =
        |first: usize| (0..100).map(move |n| n as f64 + 1.0 + if n < first { 0.05 } else { jitter(n) });
    let mut pairing = by_sequence();
    let frames =
        run(&mut pairing, stream(0, even(100, 1.0), 0.1), without(stream(1, right(10), 0.1), &[40, 41]));
    assert_eq!(counts(&frames), (98, 2, 0));
    assert_apart(&frames, 0);
}

#[test]
fn numbers_that_do_not_begin_together_are_brought_together_by_time() {
    let mut pairing = by_sequence();
    let frames = run(&mut pairing, stream(0, even(50, 1.0), 0.1), stream(1, even(43, 8.0), 0.05));
    assert_eq!(counts(&frames), (43, 7, 0));
    assert_apart(&frames, -7);
}

#[test]
fn numbers_that_start_anew_are_brought_together_again() {
    let mut pairing = by_sequence();
    let frames = run(&mut pairing, stream(0, even(20, 1.0), 0.1), stream(1, even(20, 1.0), 0.2));
    assert_eq!(counts(&frames), (20, 0, 0));
    // The right camera is back after a second, from 0; images that nobody waited for come before the left ones.
    pairing.restarted(1);
    let left = stream(0, even(60, 1.0), 0.1).split_off(20);
    let frames = run(&mut pairing, left, stream(1, even(20, 41.0), 0.05));
    assert_eq!(counts(&frames), (20, 20, 0));
    assert_apart(&frames, -40);
    // Numbers that jump without a word are contradicted by the stamps.
    let mut right = stream(1, even(40, 61.0), 0.2);
    right.iter_mut().for_each(|s| s.image.sequence += 22);
    let frames = run(&mut pairing, stream(0, even(100, 1.0), 0.1).split_off(60), right);
    let settled: Frames = frames.into_iter().filter(|(.., at)| *at > 80.0).collect();
    assert_apart(&settled, -38);
    assert!(counts(&settled).0 >= 15, "{settled:?}");
}

#[test]
fn a_rate_other_than_the_configured_one_is_found() {
    // Twice as fast as configured, and the right one loses an image now and then.
    let times = |start: f64| (0..200).map(move |n| n as f64 / 2.0 + start);
    let mut pairing = by_time();
    let frames = run(
        &mut pairing,
        stream(0, times(1.0), 0.1),
        without(stream(1, times(1.01), 0.1), &[60, 61, 90, 130]),
    );
    assert_eq!(counts(&frames), (196, 4, 0));
    assert_apart(&frames, 0);
    assert!((pairing.period_ns() / PERIOD as f64 - 0.5).abs() < 0.01);
}

#[test]
fn a_camera_that_is_gone_is_not_waited_for() {
    let pairing = by_time();
    let image = Waiting { stamp_ns: 0, sequence: 0, arrival_ns: 10 };
    let waiting = Side { front: Some(image), is_alive: true, is_full: false };
    let empty = |is_alive| Side { front: None, is_alive, is_full: false };
    assert_eq!(pairing.next([waiting, empty(false)], 11), Next::Alone(0));
    assert!(matches!(pairing.next([empty(true), waiting], 11), Next::Wait(Some(_))));
    assert_eq!(pairing.next([empty(true), Side { is_full: true, ..waiting }], 11), Next::Alone(1));
    assert_eq!(pairing.next([empty(true), empty(false)], 11), Next::Wait(None));
}
