//! Checks the figures against those of evo on the same files.
//!
//! evo is that of the Python of the tests, the ground truth a recorded one.

use super::test_noise::Noise;
use super::*;
use nalgebra::{Isometry3, UnitQuaternion, Vector3};
use plumbline_drivers::tum::write_tum;
use plumbline_test_support::{Need, shared, skip};
use std::io::{BufRead as _, BufReader, Lines, Write as _};
use std::process::{Child, ChildStdin, ChildStdout, Command, Stdio};

/// Largest difference from evo, in metres or degrees; evo prints six decimals.
const TOLERANCE: f64 = 1e-5;

/// Answers command lines of `evo_ape` and `evo_rpe`, one a line, by what these print: starting Python for each takes longer.
const ANSWERS: &str = "
import logging, sys
from evo.cli.entry_points import ape, rpe
for line in sys.stdin:
    sys.argv = line.split()
    logging.getLogger('evo').handlers.clear()
    {'evo_ape': ape, 'evo_rpe': rpe}[sys.argv[0]]()
    print('answered', flush=True)
";

/// evo, in a Python that goes on.
struct Evo {
    child: Child,
    questions: ChildStdin,
    answers: Lines<BufReader<ChildStdout>>,
}

impl Evo {
    fn start() -> Option<Self> {
        let python = plumbline_test_support::python();
        if !python.with_file_name("evo_ape").exists() {
            skip(
                Need::Python,
                format_args!("{} has no evo (scripts/setup test installs it)", python.display()),
            );
            return None;
        }
        let mut child = Command::new(python)
            .args(["-c", ANSWERS])
            .stdin(Stdio::piped())
            .stdout(Stdio::piped())
            .spawn()
            .unwrap();
        let answers = BufReader::new(child.stdout.take().unwrap()).lines();
        Some(Self { questions: child.stdin.take().unwrap(), answers, child })
    }

    /// Print of `tool` for two files.
    fn answer(&mut self, tool: &str, arguments: &str, [reference, estimate]: [&Path; 2]) -> String {
        let (reference, estimate) = (reference.display(), estimate.display());
        writeln!(self.questions, "{tool} tum {reference} {estimate} {arguments}").unwrap();
        let mut text = String::new();
        for line in &mut self.answers {
            match line.unwrap().as_str() {
                "answered" => return text,
                line => text = text + line + "\n",
            }
        }
        panic!("{tool} {arguments} ended with {:?}: {text}", self.child.wait());
    }
}

/// Takes one figure a line from what evo prints.
fn evo(theirs: &mut Evo, tool: &str, arguments: &str, files: [&Path; 2]) -> Statistics {
    let text = theirs.answer(tool, arguments, files);
    let figure = |name: &str| -> f64 {
        let line = text
            .lines()
            .find_map(|l| l.trim().strip_prefix(name))
            .unwrap_or_else(|| panic!("no {name} in {text}"));
        line.trim().parse().unwrap()
    };
    Statistics {
        rmse: figure("rmse"),
        mean: figure("mean"),
        median: figure("median"),
        std: figure("std"),
        min: figure("min"),
        max: figure("max"),
        sse: figure("sse"),
        count: 0,
    }
}

fn assert_same(ours: Statistics, evo: Statistics, what: &str) {
    let near = |a: f64, b: f64| (a - b).abs() <= TOLERANCE;
    let figures = near(ours.rmse, evo.rmse)
        && near(ours.mean, evo.mean)
        && near(ours.median, evo.median)
        && near(ours.std, evo.std)
        && near(ours.min, evo.min)
        && near(ours.max, evo.max);
    let sse = (ours.sse - evo.sse).abs() <= TOLERANCE * (1.0 + evo.sse);
    assert!(figures && sse, "{what}\n{ours:?}\n{evo:?}");
}

/// An odometry that might have been: drift, noise, scale, another frame, jittering stamps, missing rows.
fn imagined_estimate(truth: &[StampedPose], keep_one_in: usize, seed: u64) -> Vec<StampedPose> {
    let mut noise = Noise::new(seed);
    let frame = Isometry3::new(Vector3::new(4.0, -2.0, 0.7), Vector3::new(0.02, -0.01, 1.3));
    let mut walk = Vector3::zeros();
    let mut estimate = Vec::new();
    for p in truth.iter().step_by(keep_one_in) {
        walk += Vector3::from_fn(|_, _| 0.004 * noise.normal());
        let jitter_ns = (4e6 * (noise.uniform() - 0.5)) as i64;
        let dropped = noise.uniform() < 0.1;
        let turn = UnitQuaternion::from_scaled_axis(Vector3::from_fn(|_, _| 0.01 * noise.normal()));
        let mut pose = frame * p.pose;
        pose.rotation *= turn;
        pose.translation.vector = pose.translation.vector * 1.02 + walk;
        if !dropped {
            estimate.push(StampedPose { stamp: p.stamp.plus_nanos(jitter_ns), pose });
        }
    }
    estimate
}

fn compare(theirs: &mut Evo, estimate: &Path, reference: &Path) {
    let (est, gt) = (load_trajectory(estimate).unwrap(), load_trajectory(reference).unwrap());
    let pairs = associate(&est, &gt, 0.01).unwrap();
    let in_frame = |mode| aligned(&pairs, &align(&pairs, mode).unwrap());
    let modes = [
        ("", AlignmentMode::None),
        ("--align", AlignmentMode::Se3),
        ("--align --correct_scale", AlignmentMode::Sim3),
        ("--align_origin", AlignmentMode::Origin),
    ];
    for (argument, mode) in modes {
        let (ate_m, _) = absolute_errors(&in_frame(mode)).unwrap();
        assert_same(ate_m, evo(theirs, "evo_ape", argument, [reference, estimate]), argument);
    }
    let (_, rotation_deg) = absolute_errors(&in_frame(AlignmentMode::Se3)).unwrap();
    assert_same(rotation_deg, evo(theirs, "evo_ape", "-a -r angle_deg", [reference, estimate]), "rotation");
    let deltas = [
        ("", Delta::Frames(1), false),
        ("-d 10 -u f", Delta::Frames(10), false),
        ("-d 10 -u f --all_pairs", Delta::Frames(10), true),
        ("-d 1 -u m", Delta::Metres(1.0), false),
        ("-d 2 -u m --all_pairs", Delta::Metres(2.0), true),
    ];
    for (argument, delta, all_pairs) in deltas {
        let errors = relative_errors(&pairs, delta, all_pairs).unwrap();
        assert_same(errors.translation_m, evo(theirs, "evo_rpe", argument, [reference, estimate]), argument);
    }
    let errors = relative_errors(&pairs, Delta::Metres(1.0), false).unwrap();
    let turned = evo(theirs, "evo_rpe", "-d 1 -u m -r angle_deg", [reference, estimate]);
    assert_same(errors.rotation_deg, turned, "relative rotation");
}

#[test]
fn figures_are_those_of_evo() {
    let Some(truth) = shared("euroc/trajectories/MH_05_difficult.tum.gz") else { return };
    let Some(mut theirs) = Evo::start() else { return };
    let truth = load_trajectory(&truth).unwrap();
    let dir = tempfile::tempdir().unwrap();
    let (reference, estimate) = (dir.path().join("reference.tum"), dir.path().join("estimate.tum"));
    // A sparse estimate against dense truth, and the other way round.
    for (every, thin, seed) in [(1, 10, 11), (20, 7, 12)] {
        let sparse: Vec<StampedPose> = truth.iter().step_by(every).copied().collect();
        write_tum(&reference, &sparse).unwrap();
        write_tum(&estimate, &imagined_estimate(&truth, thin, seed)).unwrap();
        compare(&mut theirs, &estimate, &reference);
    }
}
