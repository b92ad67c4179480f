//! One fit of a recording: motions, points and everything that a calibration consists of.
//!
//! A recording is cut into pieces of two seconds ([`piece`]). Each finds its own motion by points of both images and by the inertial
//! samples, and all share one calibration ([`rig`]): lenses, extrinsics, delay and rate of the clocks, readout, axes of the inertial
//! sensors. Gauss-Newton frees all of it at once, from loose inertial noise down to what is measured, so that not even a negated
//! axis pulls the images along. What is left of each piece is a quadratic of the calibration, in which [`causes`] asks which single
//! change explains most.

pub(crate) mod causes;
mod integral;
pub(crate) mod judge;
mod orientation;
pub(crate) mod parts;
mod piece;
pub(crate) mod rig;

use crate::tracks::Tracks;
use causes::SIGMAS;
use integral::{Reading, Sensors, reading_at};
use nalgebra::{DVector, Matrix3, SMatrix, SVector, UnitQuaternion, Vector2, Vector3};
use piece::{Noise, Normal, Piece, View};
use plumbline_config::{Config, ImuSample, Timestamp, median};
use rig::{ACCEL, ALTERNATING, BIASES, CALIBRATION, CLOCK_RATE, DELAY, GYRO, Key, LENSES, P_B_C, READOUT};
use rig::{ROT_B_C, ROT_PAIR, Rig, Vector};

/// Keyframes of a piece: two seconds.
const KEYS: usize = 14;
/// Keyframes further apart than this end a piece, s.
const MAX_KEY_GAP_S: f64 = 0.5;
/// Steps with the calibration held, and in all at most: they end when the noise falls by less than this share.
const HELD_STEPS: usize = 3;
const STEPS: usize = 60;
const SETTLED: f64 = 0.02;
/// Damping of the states at first; it falls by a third with each step.
const DAMPING: f64 = 1e-2;
/// A median absolute value times this is a standard deviation; of the length of two components, times the other.
const OF_MEDIAN: f64 = 1.4826;
const OF_MEDIAN_LENGTH: f64 = 0.849;
/// Noise to begin with: pixels, and densities of the inertial sensors that leave the motion to the images.
const LOOSE: Noise = Noise { px: 1.0, gyro: 0.03, accel: 3.0, biases: [0.5, 2.0] };
/// Noise that leaves it to them altogether, and steps of one camera by them.
const LOOSEST: Noise = Noise { px: 1.0, gyro: 0.3, accel: 30.0, biases: [0.5, 2.0] };
const SETTLING: i32 = 4;
/// Least noise of a followed pixel, px.
const LEAST_PX: f64 = 0.05;
/// Noise falls by no more than this from one step to the next.
const FALL: f64 = 0.2;
/// Unknowns with what they may be off by at most and what is little of it, standard deviations.
const PRIOR: [(usize, usize, f64, f64); 17] = [
    (LENSES[0], 2, 0.3, 1e-3),
    (LENSES[0] + 2, 2, 50.0, 0.5),
    (LENSES[0] + 4, 1, 0.3, 2e-3),
    (LENSES[0] + 5, 4, 0.3, 1e-3),
    (LENSES[1] + 2, 2, 50.0, 0.5),
    (LENSES[1] + 4, 1, 0.3, 2e-3),
    (LENSES[1] + 5, 2, 0.3, 1e-3),
    (ROT_B_C, 3, 0.5, 3e-3),
    (P_B_C, 3, 0.1, 3e-3),
    (ROT_PAIR, 7, 0.1, 1e-3),
    (READOUT, 1, 0.03, 1e-3),
    (DELAY, 1, 0.2, 1e-3),
    (CLOCK_RATE, 1, 0.03, 1e-4),
    (ALTERNATING, 1, 0.03, 1e-3),
    (GYRO, 18, 0.7, 3e-3),
    (BIASES, 3, 1.0, 0.1),
    (BIASES + 3, 3, 5.0, 0.3),
];
/// Delays that are tried at first: so many to either side, so far apart, s; one is better by this much of the correlation.
const DELAYS: (i32, f64, f64) = (15, 0.04, 0.1);
/// Rates by which clocks that are no better than counted samples differ.
const MAX_RATE: f64 = 0.035;
/// Turn from keyframe to keyframe, root mean square, below which nothing is fitted, rad: fifty times the noise of a followed point.
const LEAST_TURN_RAD: f64 = 0.01;
/// Other columns of the accelerometer explain gravity better where they leave this share of its scatter.
const BETTER: f64 = 0.6;
/// Information that holds what cannot be measured.
const HELD: f64 = 1e20;
/// From this step on, what the data do not need stays as it is configured.
const SPARSE_STEP: usize = 6;

/// Result of a fit.
pub(crate) struct Fitted {
    /// Quadratic of each piece at the solution: gradient, information, and time of its middle as a share of the recording.
    pub(crate) pieces: Vec<(Vector, SMatrix<f64, CALIBRATION, CALIBRATION>, f64)>,
    /// The solution as a step from the configuration.
    pub(crate) steps: Vector,
    pub(crate) rig: Rig,
    pub(crate) noise: Noise,
    pub(crate) span_s: f64,
}

/// Turning from one keyframe to the next, by the images and by the gyroscope.
type Turn = (Vector3<f64>, Vector3<f64>);

/// Attitude at a keyframe, specific force as it is read, and acceleration.
type Forces = (UnitQuaternion<f64>, Vector3<f64>, Vector3<f64>);

/// Pieces of a recording at their first guess.
#[derive(Clone)]
struct Pieces {
    rig: Rig,
    readings: Vec<Reading>,
    pieces: Vec<Piece>,
    /// Pieces that did not hold together.
    lost: usize,
    span_s: f64,
}

impl Pieces {
    /// Pieces of a recording from this step of the calibration on; at most `most` of them, evenly.
    fn of(
        config: &Config,
        tracks: &Tracks,
        samples: &[ImuSample],
        from: &Vector,
        most: usize,
    ) -> Option<Self> {
        let rig = Rig::new(config)?.plus(from);
        let span_s = tracks.span_s();
        let middle = tracks.keys.first()?.0.plus_seconds(0.5 * span_s);
        let reading =
            |s: &ImuSample| Reading { t_s: s.stamp.seconds_since(middle), gyro: s.gyro, accel: s.accel };
        let readings: Vec<Reading> = samples.iter().map(reading).collect();
        let key = |(stamp, is_odd): &(Timestamp, bool)| Key {
            t_s: stamp.seconds_since(middle),
            parity: if *is_odd { 0.5 } else { -0.5 },
            ..Key::default()
        };
        let keys: Vec<Key> = tracks.keys.iter().map(key).collect();
        let mut ranges = ranges(&keys);
        let every = ranges.len().div_ceil(most).max(1);
        ranges = ranges.into_iter().step_by(every).collect();
        let (all, views) = (ranges.len(), views(tracks, &ranges));
        let is_pair = config.camera.len() > 1;
        let of = |(range, views): (std::ops::Range<usize>, _)| {
            Piece::new(&rig, &readings, keys[range].to_vec(), views, is_pair)
        };
        let pieces: Vec<Piece> = ranges.into_iter().zip(views).filter_map(of).collect();
        Some(Self { lost: all - pieces.len(), rig, readings, pieces, span_s })
    }

    /// Lets the images of one camera alone say how it moves.
    fn settle(&mut self) {
        for round in 0..SETTLING {
            let damping = DAMPING * 0.3_f64.powi(round);
            let normals = normals(&mut self.pieces, &self.rig, &self.readings, &LOOSEST, damping);
            for (piece, normal) in self.pieces.iter_mut().zip(&normals) {
                piece.apply(normal, &Vector::zeros());
            }
        }
    }

    /// Turning from keyframe to keyframe, by the images and by the gyroscope.
    fn turns(&self) -> Vec<Turn> {
        let sensors = Sensors::of(&self.rig, &SVector::zeros());
        let pairs = self.pieces.iter().flat_map(|piece| piece.keys.windows(2));
        let turn = |pair: &[Key]| {
            let [from_s, to_s] = [0, 1].map(|k| self.rig.imu_time_s(&pair[k]));
            let middle = reading_at(&self.readings, 0.5 * (from_s + to_s))?;
            let seen = pair[0].pose_w_b.rotation.inverse() * pair[1].pose_w_b.rotation;
            Some((seen.scaled_axis(), sensors.rate(&middle) * (pair[1].t_s - pair[0].t_s)))
        };
        pairs.filter_map(turn).collect()
    }

    /// Delay and rate of the clocks at which images and gyroscope turn as fast as each other, s and 1, about one of these rates: how they turn
    /// may be told in other axes.
    fn clocks(&self, about: &[f64]) -> [f64; 2] {
        let sensors = Sensors::of(&self.rig, &SVector::zeros());
        let pairs = self.pieces.iter().flat_map(|piece| piece.keys.windows(2));
        let seen = |pair: &[Key]| {
            let angle = pair[0].pose_w_b.rotation.angle_to(&pair[1].pose_w_b.rotation);
            let middle_s = 0.5 * (self.rig.imu_time_s(&pair[0]) + self.rig.imu_time_s(&pair[1]));
            (middle_s, angle / (pair[1].t_s - pair[0].t_s))
        };
        let seen: Vec<(f64, f64)> = pairs.map(seen).collect();
        let alike = |[delay_s, rate]: &[f64; 2]| {
            let reading = |t_s: f64| reading_at(&self.readings, t_s + delay_s + rate * t_s);
            let both: Vec<_> = seen
                .iter()
                .filter_map(|(t_s, turn)| Some((*turn, sensors.rate(&reading(*t_s)?).norm())))
                .collect();
            correlation(&both) * (both.len() as f64 / seen.len() as f64)
        };
        // They may be in step at the beginning: so is one that only counts its samples.
        let (step, half_s) = (DELAYS.1 / self.span_s, 0.5 * self.span_s);
        let rates = (MAX_RATE / step) as i32;
        let rates = about.iter().flat_map(|about| (-rates..=rates).map(move |k| about + f64::from(k) * step));
        let tried = rates.flat_map(|rate| {
            (-DELAYS.0..=DELAYS.0).map(move |k| [f64::from(k) * DELAYS.1 + rate * half_s, rate])
        });
        let best = tried.map(|clocks| (alike(&clocks), clocks)).max_by(|a, b| a.0.total_cmp(&b.0));
        best.filter(|(found, _)| *found > alike(&[0.0; 2]) + DELAYS.2).map_or([0.0; 2], |(_, clocks)| clocks)
    }

    /// Attitude, mean specific force and acceleration at the inner keyframes of each piece; how large the last is, one camera does not say.
    fn forces(&self) -> Vec<Vec<Forces>> {
        let of = |keys: &[Key]| {
            let [from_s, at_s, to_s] = [0, 1, 2].map(|k| self.rig.imu_time_s(&keys[k]));
            let within = self.readings.partition_point(|r| r.t_s < from_s)
                ..self.readings.partition_point(|r| r.t_s < to_s);
            let share = |t_s: f64| ((t_s - from_s) / (at_s - from_s)).min((to_s - t_s) / (to_s - at_s));
            let mut mean = (Vector3::zeros(), 0.0);
            for reading in self.readings.get(within)? {
                mean = (mean.0 + reading.accel * share(reading.t_s), mean.1 + share(reading.t_s));
            }
            let speed = |k: usize| {
                let moved = keys[k + 1].pose_w_b.translation.vector - keys[k].pose_w_b.translation.vector;
                moved / (keys[k + 1].t_s - keys[k].t_s)
            };
            let acceleration = (speed(1) - speed(0)) / (0.5 * (keys[2].t_s - keys[0].t_s));
            (mean.1 > 0.0).then(|| (keys[1].pose_w_b.rotation, mean.0 / mean.1, acceleration))
        };
        self.pieces.iter().map(|piece| piece.keys.windows(3).filter_map(of).collect()).collect()
    }

    /// Largest share of the turning about an axis that images and gyroscope do not agree on, with the shares of pieces that are lost and of
    /// points behind the cameras, where exchanged images have them.
    fn disagreement(&self) -> f64 {
        let turns = self.turns();
        let of_axis = |k: usize| {
            let sum = |of: &dyn Fn(&Turn) -> f64| turns.iter().map(|turn| of(turn).powi(2)).sum::<f64>();
            let (off, all) = (sum(&|t| t.0[k] - t.1[k]), sum(&|t| t.0[k]).max(sum(&|t| t.1[k])));
            let is_turning = all > LEAST_TURN_RAD * LEAST_TURN_RAD * turns.len() as f64;
            if is_turning { off / all } else { 0.0 }
        };
        let share = |count: usize, all: usize| count as f64 / all.max(1) as f64;
        let points = || self.pieces.iter().flat_map(|piece| &piece.points);
        let behind = points().filter(|(point, _)| point.inverse_m <= 0.0).count();
        (0..3).map(of_axis).fold(0.0, f64::max)
            + share(self.lost, self.lost + self.pieces.len())
            + share(behind, points().count())
    }
}

/// A first look at a recording: whether it turns, and where the fit begins.
pub(crate) struct FirstLook {
    /// True if the images turn enough for a calibration to show: well above the noise of a followed point.
    pub(crate) turns_enough: bool,
    /// Axis of the gyroscope that turns with none of the images'.
    pub(crate) silent: Option<usize>,
    /// Step of the calibration to begin with: a delay, and columns of the accelerometer, too far off for small steps.
    step: Vector,
    /// What was found of a pair that begins as it is configured.
    found: Option<Pieces>,
}

impl FirstLook {
    pub(crate) fn at(config: &Config, tracks: &Tracks, samples: &[ImuSample]) -> Option<Self> {
        let mut step = Vector::zeros();
        let mut pieces = Pieces::of(config, tracks, samples, &step, usize::MAX)?;
        if config.camera.len() == 1 {
            pieces.settle();
        }
        let counted_s = pieces.readings.len() as f64 / config.imu.rate_hz;
        let stamped_s = pieces.readings.last()?.t_s - pieces.readings.first()?.t_s;
        [step[DELAY], step[CLOCK_RATE]] = pieces.clocks(&[0.0, stamped_s / counted_s - 1.0]);
        pieces.rig = pieces.rig.plus(&step);
        let forces = pieces.forces();
        let as_is = scatter(&forces, &Matrix3::identity());
        let scatters = assignments().map(|columns| (scatter(&forces, &columns), columns));
        let best = scatters.min_by(|a, b| a.0.total_cmp(&b.0))?;
        if best.0 < BETTER * as_is {
            let change = (best.1 - Matrix3::identity()).transpose();
            step.fixed_rows_mut::<9>(ACCEL).copy_from_slice(change.as_slice());
        }
        let turns = pieces.turns();
        let least = LEAST_TURN_RAD * LEAST_TURN_RAD * turns.len() as f64;
        let about = |axis: usize| turns.iter().map(|(seen, _)| seen[axis] * seen[axis]).sum::<f64>();
        let alike = |seen: usize, axis: usize| {
            correlation(&turns.iter().map(|turn| (turn.0[seen], turn.1[axis])).collect::<Vec<_>>()).abs()
        };
        let by_chance = SIGMAS / (turns.len() as f64).sqrt();
        let loudest = |of: &dyn Fn(usize) -> f64| (0..3).map(of).fold(0.0, f64::max);
        // Half of the turning about an axis is not in the samples.
        let is_missed = |seen: usize| about(seen) > least && loudest(&|axis| alike(seen, axis)).powi(2) < 0.5;
        let silent = (0..3).find(|axis| loudest(&|seen| alike(seen, *axis)) < by_chance);
        Some(Self {
            turns_enough: (0..3).map(about).sum::<f64>() > least,
            silent: silent.filter(|_| turns.len() > 2 * KEYS && (0..3).any(is_missed)),
            step,
            found: (config.camera.len() > 1 && step == Vector::zeros()).then_some(pieces),
        })
    }
}

/// Scatter of gravity within the pieces, that is of the specific force, with these columns, less the acceleration: gravity does not turn.
fn scatter(pieces: &[Vec<Forces>], columns: &Matrix3<f64>) -> f64 {
    let of = |piece: &Vec<Forces>| {
        let count = piece.len() as f64;
        let seen = || piece.iter().map(|(attitude, force, moved)| (attitude * (columns * force), moved));
        let mean = seen().fold([Vector3::zeros(); 2], |sum, (force, moved)| {
            [sum[0] + force / count, sum[1] + moved / count]
        });
        let square = |of: &dyn Fn(Vector3<f64>, Vector3<f64>) -> f64| {
            seen().map(|(force, moved)| of(force - mean[0], moved - mean[1])).sum::<f64>()
        };
        let (all, both, moved) =
            (square(&|f, _| f.norm_squared()), square(&|f, m| f.dot(&m)), square(&|_, m| m.norm_squared()));
        all - both.max(0.0).powi(2) / moved.max(f64::MIN_POSITIVE)
    };
    pieces.iter().map(of).filter(|square| square.is_finite()).sum()
}

/// All assignments of three columns with all signs.
fn assignments() -> impl Iterator<Item = Matrix3<f64>> {
    const ORDERS: [[usize; 3]; 6] = [[0, 1, 2], [0, 2, 1], [1, 0, 2], [1, 2, 0], [2, 0, 1], [2, 1, 0]];
    ORDERS.into_iter().flat_map(|order| {
        (0..8).map(move |signs| {
            Matrix3::from_fn(|row, column| match (order[row] == column, signs >> row & 1) {
                (false, _) => 0.0,
                (true, sign) => 1.0 - 2.0 * f64::from(sign),
            })
        })
    })
}

/// Correlation of pairs of numbers; 0 of fewer than three.
fn correlation(pairs: &[(f64, f64)]) -> f64 {
    let centred = |of: fn(&(f64, f64)) -> f64| {
        let values = DVector::from_iterator(pairs.len(), pairs.iter().map(of));
        values.add_scalar(-values.mean())
    };
    let (a, b) = (centred(|pair| pair.0), centred(|pair| pair.1));
    if pairs.len() < 3 { 0.0 } else { a.dot(&b) / (a.norm() * b.norm()).max(f64::MIN_POSITIVE) }
}

/// Fits a recording by these unknowns of the calibration; `None` where no piece holds together.
pub(crate) fn fit(
    config: &Config,
    tracks: &Tracks,
    samples: &[ImuSample],
    first: &FirstLook,
    is_free: &dyn Fn(usize) -> bool,
) -> Option<Fitted> {
    let is_of_right = |k: usize| (LENSES[1]..ROT_B_C).contains(&k) || (ROT_PAIR..READOUT).contains(&k);
    let is_free = |k: usize| is_free(k) && (config.camera.len() > 1 || !is_of_right(k));
    let found = match &first.found {
        Some(found) => found.clone(),
        None => Pieces::of(config, tracks, samples, &first.step, usize::MAX)?,
    };
    let Pieces { mut rig, readings, mut pieces, span_s, .. } = found;
    let mut noise = LOOSE;
    let mut damping = DAMPING;
    for round in 0..STEPS {
        let normals = normals(&mut pieces, &rig, &readings, &noise, damping);
        let step = if round < HELD_STEPS {
            Vector::zeros()
        } else {
            step(&normals, &rig, &prior(&rig.steps(), round >= SPARSE_STEP, &is_free))?
        };
        for (piece, normal) in pieces.iter_mut().zip(&normals) {
            piece.apply(normal, &step);
        }
        rig = rig.plus(&step);
        if round >= HELD_STEPS {
            let before = noise;
            noise = measured(&normals, &pieces, &noise, config);
            if round > SPARSE_STEP && noise.has_settled_from(&before, SETTLED) {
                break;
            }
        }
        damping *= 0.3;
    }
    let normals = normals(&mut pieces, &rig, &readings, &noise, 0.0);
    let share = |piece: &Piece| (piece.keys[KEYS / 2].t_s / span_s + 0.5).clamp(0.0, 1.0);
    let quadratics =
        normals.into_iter().zip(&pieces).map(|(n, piece)| (n.gradient, n.information, share(piece)));
    let quadratics: Vec<_> = quadratics.collect();
    (!quadratics.is_empty()).then(|| Fitted { pieces: quadratics, steps: rig.steps(), rig, noise, span_s })
}

/// Normal equations of the pieces; those without are dropped.
fn normals(
    pieces: &mut Vec<Piece>,
    rig: &Rig,
    readings: &[Reading],
    noise: &Noise,
    damping: f64,
) -> Vec<Normal> {
    let mut normals = Vec::with_capacity(pieces.len());
    pieces.retain_mut(|piece| {
        let sensors = Sensors::of(rig, &piece.biases);
        for key in &mut piece.keys {
            let reading = reading_at(readings, rig.imu_time_s(key));
            key.rate_b = reading.map_or_else(Vector3::zeros, |reading| sensors.rate(&reading));
        }
        let normal = piece.normal(rig, readings, noise, damping);
        let normal = normal.filter(|normal| normal.gradient.iter().all(|x| x.is_finite()));
        let is_there = normal.is_some();
        normals.extend(normal);
        is_there
    });
    normals
}

/// Step of the calibration that all pieces agree on.
fn step(normals: &[Normal], rig: &Rig, prior: &Vector) -> Option<Vector> {
    let mut information = SMatrix::<f64, CALIBRATION, CALIBRATION>::from_diagonal(prior);
    let mut gradient = prior.component_mul(&rig.steps());
    for normal in normals {
        information += normal.information;
        gradient += normal.gradient;
    }
    Some(-information.cholesky()?.solve(&gradient))
}

/// Information of the prior; what is not free is held. Where steps explain the data alike, the sparsest wins: a step that
/// is large already may be.
fn prior(steps: &Vector, is_sparse: bool, is_free: &dyn Fn(usize) -> bool) -> Vector {
    let mut prior = Vector::zeros();
    for (at, count, wide, little) in PRIOR {
        for k in at..at + count {
            let own = steps[k] * steps[k] + little * little;
            let free = 1.0 / if is_sparse { own.min(wide * wide) } else { wide * wide };
            prior[k] = if is_free(k) { free } else { HELD };
        }
    }
    prior
}

/// Noise that the residuals show.
fn measured(normals: &[Normal], pieces: &[Piece], noise: &Noise, config: &Config) -> Noise {
    let of = |k: usize| median(normals.iter().flat_map(|n| n.residuals[k].iter().copied())).unwrap_or(0.0);
    let imu = &config.imu;
    let fallen = |now: f64, least: f64, before: f64| now.max(least).max(FALL * before).min(before);
    let walk_s = 30.0_f64.sqrt();
    let of_biases = |at: usize| {
        let scatter = pieces.iter().flat_map(|piece| (at..at + 3).map(|k| piece.biases[k].abs()));
        OF_MEDIAN * median(scatter).unwrap_or(0.0)
    };
    let least = [
        imu.gyro_bias_walk * walk_s + imu.gyro_error_sigma_rad_s,
        imu.accel_bias_walk * walk_s + imu.accel_error_sigma_m_s2,
    ];
    Noise {
        px: fallen(OF_MEDIAN_LENGTH * of(0), LEAST_PX, noise.px),
        gyro: fallen(OF_MEDIAN * of(1), imu.gyro_noise_density, noise.gyro),
        accel: fallen(OF_MEDIAN * of(2), imu.accel_noise_density, noise.accel),
        biases: [0, 1].map(|k| fallen(of_biases(3 * k), least[k], noise.biases[k])),
    }
}

/// Keyframes of each piece.
fn ranges(keys: &[Key]) -> Vec<std::ops::Range<usize>> {
    let mut ranges = Vec::new();
    let mut from = 0;
    for k in 1..=keys.len() {
        if k == keys.len() || keys[k].t_s - keys[k - 1].t_s > MAX_KEY_GAP_S {
            from = k;
        } else if k + 1 - from == KEYS {
            ranges.push(from..k + 1);
            from = k + 1;
        }
    }
    ranges
}

/// Views of each piece's points.
fn views(tracks: &Tracks, ranges: &[std::ops::Range<usize>]) -> Vec<Vec<Vec<View>>> {
    let mut pieces = vec![Vec::new(); ranges.len()];
    for track in &tracks.tracks {
        for (range, piece) in ranges.iter().zip(&mut pieces) {
            let seen = track.iter().filter(|sighting| range.contains(&sighting.key));
            let views: Vec<View> = seen
                .flat_map(|sighting| {
                    let of = move |(camera, px): (usize, Option<Vector2<f32>>)| {
                        Some(View { key: sighting.key - range.start, camera, px: px?.cast() })
                    };
                    sighting.px.into_iter().enumerate().filter_map(of)
                })
                .collect();
            if views.last().zip(views.first()).is_some_and(|(last, first)| last.key > first.key) {
                piece.push(views);
            }
        }
    }
    pieces
}
