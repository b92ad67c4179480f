//! Maps of thousands of keyframes: memory, allocations and time.

use super::building::{Building, FEATURES, tour};
use super::flight::{KEYFRAMES, Mapper, shots};
use super::images::open;
use plumbline_drivers::StereoSource as _;
use plumbline_estimator::places::Located;
use plumbline_test_support::shared;

/// Asked of a map of 2,000 keyframes with 400 features each, of what finds in it, and of its pose graph.
const MAX_BYTES: u64 = 60_000_000;

#[test]
fn two_thousand_keyframes_and_all_that_works_on_them_fit_into_60_mb() {
    let mut mapper = None;
    let memory = allocation_counter::measure(|| mapper = Some(Mapper::new(KEYFRAMES)));
    let limits = mapper.unwrap().map.limits();
    println!("{limits:?}: {:.1} MB", memory.bytes_max as f64 * 1e-6);
    assert_eq!((limits.keyframes, limits.features), (KEYFRAMES, FEATURES));
    assert!(memory.bytes_max <= MAX_BYTES, "{} bytes", memory.bytes_max);
}

#[test]
fn nothing_is_allocated_after_construction() {
    const KEYFRAMES: usize = 100;
    let shots = shots(&Building::new(1), &tour(KEYFRAMES + 50, 1), 5);
    let mut mapper = Mapper::new(KEYFRAMES);
    let mut located: Vec<Option<Located>> = Vec::with_capacity(shots.len());
    let flight = allocation_counter::measure(|| {
        for (number, shot) in shots.iter().enumerate() {
            let found = mapper.locate(number, shot);
            let is_full = mapper.graph.nodes().len() == KEYFRAMES;
            if !is_full {
                mapper.add_node(shot);
            }
            mapper.map.add(shot.keyframe(number), &shot.features);
            if let Some(found) = found.as_ref().filter(|_| !is_full) {
                mapper.close(found);
            }
            mapper.map.query(&shot.features, |_| true, &mut mapper.votes);
            located.push(found);
        }
        mapper.map.remove(7);
    });
    let found = located.iter().flatten().count();
    println!("{found} found, {} bytes", flight.bytes_total);
    // Something was found, closed and forgotten, so the paths to it were gone.
    assert!(found > 10 && mapper.graph.edges().len() > KEYFRAMES && mapper.map.len() == KEYFRAMES - 1);
    assert_eq!((flight.count_total, flight.bytes_total), (0, 0));
}

#[test]
fn features_are_made_without_an_allocation() {
    let Some(folder) = shared("euroc/V1_01_easy_clip") else { return };
    let (dataset, mut eyes) = open(&folder);
    let (mut stereo, mut frame) = (dataset.stereo(), dataset.new_frame());
    for _ in 0..3 {
        assert!(stereo.next_frame(&mut frame).unwrap());
        eyes.look(&frame);
        let (mut count, up_c) = (0, eyes.usual_up_c());
        let work = allocation_counter::measure(|| count = eyes.features(up_c).len());
        assert!(count > 100, "{count} features");
        assert_eq!((work.count_total, work.bytes_total), (0, 0));
    }
}

/// Time that a keyframe takes of its thread.
mod realtime {
    use super::super::flight::{KEYFRAMES, Mapper, fly, shots};
    use super::{Building, tour};

    /// In the median and at worst; in the product, which checks no sums, it is less.
    const MAX_MS: (f64, f64) = (10.0, 30.0);

    /// Fills a map, and measures a part of that, then known places and new ones.
    fn measure(keyframes: usize, measured: usize) {
        let all = shots(&Building::new(1), &tour(keyframes + measured, 1), 5);
        let elsewhere = shots(&Building::new(2), &tour(measured, 9), 6);
        let mut mapper = Mapper::new(keyframes);
        let (filling, full) = all.split_at(keyframes);
        let (first, last) = filling.split_at(keyframes - measured);
        fly(&mut mapper, 0, first);
        for (name, at, shots) in [
            ("the last ones of the map", first.len(), last),
            ("known places, full map", keyframes, full),
            ("new places, full map", keyframes + measured, &elsewhere[..]),
        ] {
            let figures = fly(&mut mapper, at, shots);
            figures.print(name);
            assert_eq!(figures.wrong, 0);
            let (median, worst) = (figures.whole.quantile(0.5), figures.whole.quantile(1.0));
            assert!(median <= MAX_MS.0 && worst <= MAX_MS.1, "{name}: median {median} ms, worst {worst} ms");
        }
    }

    #[test]
    fn a_keyframe_among_three_hundred_is_done_within_the_time_of_two_thousand() {
        measure(300, 50);
    }

    #[test]
    #[ignore = "half a minute; run by make soak"]
    fn soak_a_keyframe_among_two_thousand_is_done_within_its_time() {
        measure(KEYFRAMES, 200);
    }
}
