//! A building whose truth is known: halls with points on their walls, and what a stereo camera sees of them. Large
//! enough to fill a map of thousands of keyframes.
//!
//! A point looks like a corner: two smooth edges and some texture, of which the descriptor compares places. So the
//! bits of a descriptor hang together as those of images do, and some words are far more common than others. Seen
//! again, the comparisons have noise that grows with the distance and with the slant of the view.

use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector2, Vector3};
use plumbline_config::Random;
use plumbline_estimator::places::{Descriptor, Feature};

/// Features of a frame at most.
pub const FEATURES: usize = 400;
/// A pixel, at a focal length of 458 px.
pub const PIXEL: f64 = 1.0 / 458.0;
/// Standard deviation of an inverse depth, 1/m: a third of a pixel over 0.11 m.
const SIGMA_DEPTH: f64 = 0.35 * PIXEL / 0.11;
/// Half the field of the camera, normalized coordinates.
const FIELD: [f64; 2] = [0.8, 0.5];
/// The image gives one corner in each of so many columns and rows.
const CELLS: [usize; 2] = [40, 26];
/// Nearest and furthest point that is seen, m.
const DEPTHS_M: [f64; 2] = [0.4, 25.0];
/// Points on a square metre of wall.
const DENSITY: f64 = 70.0;
/// Root of the mean square of the comparisons of a point.
const CONTRAST: f64 = 40.0;
/// Noise of a comparison seen from straight ahead at [`USUAL_M`], what a doubling of the distance adds, and a slant.
const NOISE: [f64; 3] = [7.0, 6.0, 9.0];
/// Distance from which points are seen best, m.
const USUAL_M: f64 = 2.5;
/// Share of the features of a frame that belong to no point: reflections, edges against the background, what moves.
const CLUTTER: f64 = 0.15;

/// The comparisons of intensities that make a descriptor.
type Comparisons = [i8; 256];

/// A point on a wall.
#[derive(Clone)]
pub struct Landmark {
    pub place_m: Vector3<f64>,
    pub normal: Vector3<f64>,
    strength: f64,
    comparisons: Comparisons,
}

/// A convex hall: what is in it is seen from everywhere in it, and from nowhere else.
#[derive(Clone)]
pub struct Hall {
    pub landmarks: Vec<Landmark>,
}

/// Halls.
#[derive(Clone)]
pub struct Building {
    pub halls: Vec<Hall>,
    clutter: Vec<Comparisons>,
}

/// A place on the way through a building.
#[derive(Clone, Copy)]
pub struct Stop {
    pub hall: usize,
    pub pose_m_b: Isometry3<f64>,
}

/// Draws patches that are compared at the same places.
struct Patches {
    pairs: Vec<[Vector2<f64>; 2]>,
}

impl Patches {
    fn new() -> Self {
        let mut random = Random::new(77);
        let mut place = || Vector2::new(0.4 * random.gaussian(), 0.4 * random.gaussian());
        Self { pairs: (0..256).map(|_| [place(), place()]).collect() }
    }

    fn draw(&self, random: &mut Random) -> Comparisons {
        let direction = |random: &mut Random| {
            let angle = std::f64::consts::TAU * random.unit();
            Vector2::new(angle.cos(), angle.sin())
        };
        let edges: [_; 2] = std::array::from_fn(|_| {
            (direction(random), 0.2 * random.gaussian(), (0.5 + random.unit()) * 2.0)
        });
        let waves: [_; 5] = std::array::from_fn(|k| {
            let frequency = direction(random) * (1.5 + 1.2 * k as f64);
            (frequency, std::f64::consts::TAU * random.unit(), random.unit() / (1.0 + 0.3 * k as f64))
        });
        let intensity = |u: &Vector2<f64>| {
            let of_edges: f64 = edges.iter().map(|(n, c, a)| a * (6.0 * (n.dot(u) - c)).tanh()).sum();
            let of_waves: f64 = waves.iter().map(|(f, phase, a)| a * (f.dot(u) + phase).cos()).sum();
            of_edges + of_waves
        };
        let differences: Vec<f64> = self.pairs.iter().map(|[a, b]| intensity(b) - intensity(a)).collect();
        let rms = (differences.iter().map(|d| d * d).sum::<f64>() / 256.0).sqrt().max(1e-9);
        std::array::from_fn(|i| {
            let fine = 0.8 * random.gaussian();
            (0.6 * (differences[i] / rms + fine) * CONTRAST / 0.77).clamp(-127.0, 127.0) as i8
        })
    }
}

/// The bits of a patch seen with noise.
fn describe(comparisons: &Comparisons, noise: f64, random: &mut Random) -> Descriptor {
    // Sums of four bytes are nearly Gaussian: mean 510, standard deviation 147.
    let scale = noise / 147.0;
    let mut bits = [0u64; 4];
    for (pair, chunk) in comparisons.chunks_exact(2).enumerate() {
        let draw = random.next_bits().to_le_bytes();
        for (half, &comparison) in chunk.iter().enumerate() {
            let sum: u32 = draw[4 * half..4 * half + 4].iter().map(|b| u32::from(*b)).sum();
            let value = f64::from(comparison) + (f64::from(sum) - 510.0) * scale;
            let at = 2 * pair + half;
            bits[at / 64] |= u64::from(value > 0.0) << (at % 64);
        }
    }
    Descriptor(bits)
}

impl Hall {
    fn new(low: Vector3<f64>, high: Vector3<f64>, patches: &Patches, random: &mut Random) -> Self {
        let size = high - low;
        let mut landmarks = Vec::new();
        for axis in 0..3 {
            let (u, v) = ((axis + 1) % 3, (axis + 2) % 3);
            let count = (DENSITY * size[u] * size[v]) as usize;
            for (side, at) in [(1.0, low[axis]), (-1.0, high[axis])] {
                for _ in 0..count {
                    let mut place_m = Vector3::zeros();
                    place_m[axis] = at;
                    place_m[u] = low[u] + size[u] * random.unit();
                    place_m[v] = low[v] + size[v] * random.unit();
                    let mut normal = Vector3::zeros();
                    normal[axis] = side;
                    let comparisons = patches.draw(random);
                    landmarks.push(Landmark { place_m, normal, strength: random.unit(), comparisons });
                }
            }
        }
        Self { landmarks }
    }
}

impl Building {
    /// A corridor of 48 m with three rooms on either side.
    pub fn new(seed: u64) -> Self {
        let (mut random, patches) = (Random::new(seed), Patches::new());
        let mut hall =
            |low: [f64; 3], high: [f64; 3]| Hall::new(low.into(), high.into(), &patches, &mut random);
        let mut halls = vec![hall([0.0, -1.2, 0.0], [48.0, 1.2, 2.6])];
        for k in 0..3 {
            let x = 16.0 * f64::from(k);
            halls.push(hall([x, 1.2, 0.0], [x + 7.0, 7.2, 2.8]));
            halls.push(hall([x + 8.0, -7.2, 0.0], [x + 15.0, -1.2, 2.8]));
        }
        Self { halls, clutter: Self::clutter(&patches) }
    }

    /// One room of 6 by 6 m, its middle at the origin.
    pub fn room(seed: u64) -> Self {
        let (mut random, patches) = (Random::new(seed), Patches::new());
        let (low, high) = (Vector3::new(-3.0, -3.0, -1.3), Vector3::new(3.0, 3.0, 1.3));
        Self { halls: vec![Hall::new(low, high, &patches, &mut random)], clutter: Self::clutter(&patches) }
    }

    fn clutter(patches: &Patches) -> Vec<Comparisons> {
        let mut random = Random::new(99);
        (0..2000).map(|_| patches.draw(&mut random)).collect()
    }

    /// This building with a share of its points replaced by others.
    pub fn changed(&self, share: f64, seed: u64) -> Self {
        let (mut random, patches) = (Random::new(seed), Patches::new());
        let mut changed = self.clone();
        for landmark in changed.halls.iter_mut().flat_map(|h| &mut h.landmarks) {
            if random.unit() < share {
                landmark.comparisons = patches.draw(&mut random);
                landmark.strength = random.unit();
            }
        }
        changed
    }

    /// This building with every point at the place that `moved` gives it.
    pub fn moved(&self, moved: impl Fn(&Vector3<f64>) -> Vector3<f64>) -> Self {
        let mut building = self.clone();
        for landmark in building.halls.iter_mut().flat_map(|h| &mut h.landmarks) {
            let tip = moved(&(landmark.place_m + landmark.normal));
            landmark.place_m = moved(&landmark.place_m);
            landmark.normal = tip - landmark.place_m;
        }
        building
    }

    /// Features that a camera in a hall sees from `pose_m_c`.
    pub fn seen(&self, hall: usize, pose_m_c: &Isometry3<f64>, random: &mut Random) -> Vec<Feature> {
        let mut best: Vec<Option<(f64, usize)>> = vec![None; CELLS[0] * CELLS[1]];
        let pose_c_m = pose_m_c.inverse();
        let landmarks = &self.halls[hall].landmarks;
        for (i, landmark) in landmarks.iter().enumerate() {
            let q = pose_c_m * Point3::from(landmark.place_m);
            let (x, y) = (q.x / q.z / FIELD[0], q.y / q.z / FIELD[1]);
            if q.z < DEPTHS_M[0] || q.z > DEPTHS_M[1] || x.abs() >= 1.0 || y.abs() >= 1.0 {
                continue;
            }
            let cell = |v: f64, count: usize| ((0.5 + 0.5 * v) * count as f64) as usize;
            let at = cell(y, CELLS[1]) * CELLS[0] + cell(x, CELLS[0]);
            // A corner that is strong in one view is most often strong in the next.
            let strength = landmark.strength + random.unit();
            if best[at].is_none_or(|(s, _)| strength > s) {
                best[at] = Some((strength, i));
            }
        }
        let mut found: Vec<_> = best.into_iter().flatten().collect();
        found.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
        found.truncate(FEATURES);
        found.iter().map(|(_, i)| self.feature(&landmarks[*i], &pose_c_m, random)).collect()
    }

    fn feature(&self, landmark: &Landmark, pose_c_m: &Isometry3<f64>, random: &mut Random) -> Feature {
        let q = (pose_c_m * Point3::from(landmark.place_m)).coords;
        let slant = 1.0 + (q.normalize()).dot(&(pose_c_m.rotation * landmark.normal));
        let noise = NOISE[0] + NOISE[1] * (q.norm() / USUAL_M).log2().abs() + NOISE[2] * slant;
        let is_clutter = random.unit() < CLUTTER;
        let comparisons =
            if is_clutter { &self.clutter[random.below(self.clutter.len())] } else { &landmark.comparisons };
        let descriptor = describe(comparisons, noise, random);
        let offset = Vector2::new(random.gaussian(), random.gaussian()) * PIXEL;
        let depth = 1.0 / q.z + SIGMA_DEPTH * random.gaussian();
        Feature {
            descriptor,
            xy: (Vector2::new(q.x / q.z, q.y / q.z) + offset).cast(),
            sigma_xy: PIXEL as f32,
            inverse_depth: depth.max(0.0) as f32,
            sigma_inverse_depth: SIGMA_DEPTH as f32,
        }
    }
}

/// A camera that looks forward, x right and y down, held by a body with z up.
pub fn pose_b_c() -> Isometry3<f64> {
    let rot = nalgebra::Rotation3::from_matrix_unchecked(nalgebra::Matrix3::new(
        0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0,
    ));
    Isometry3::from_parts(Vector3::new(0.1, 0.02, 0.0).into(), UnitQuaternion::from_rotation_matrix(&rot))
}

/// A body at a place with a heading, held nearly level.
pub fn held(place_m: Vector3<f64>, yaw: f64, random: &mut Random) -> Isometry3<f64> {
    let tilt = Vector3::new(0.06 * random.gaussian(), 0.06 * random.gaussian(), 0.0);
    let heading = UnitQuaternion::from_scaled_axis(Vector3::z() * yaw);
    Isometry3::from_parts(place_m.into(), heading * UnitQuaternion::from_scaled_axis(tilt))
}

/// A tour through all rooms and along the corridor there and back, as many stops as asked: lap after lap, each on a
/// way of its own.
pub fn tour(stops: usize, seed: u64) -> Vec<Stop> {
    let mut random = Random::new(seed);
    let mut tour = Vec::with_capacity(stops);
    while tour.len() < stops {
        let mut x = 3.5;
        for room in [1, 2, 3, 4, 5, 6] {
            let door = 3.5 + 8.0 * (room as f64 - 1.0);
            corridor(&mut tour, x, door, &mut random);
            circle(&mut tour, room, door, &mut random);
            x = door;
        }
        corridor(&mut tour, x, 3.5, &mut random);
    }
    tour.truncate(stops);
    tour
}

fn corridor(tour: &mut Vec<Stop>, from: f64, to: f64, random: &mut Random) {
    let steps = ((to - from).abs() / 0.3) as usize;
    let (side, height) = (0.4 * random.gaussian().clamp(-2.0, 2.0), 1.3 + 0.2 * random.gaussian());
    let heading = if to > from { 0.0 } else { std::f64::consts::PI };
    for k in 0..steps {
        let x = from + (to - from) * k as f64 / steps as f64;
        let place = Vector3::new(x, side, height.clamp(0.6, 2.0));
        let pose_m_b = held(place, heading + 0.15 * random.gaussian(), random);
        tour.push(Stop { hall: 0, pose_m_b });
    }
}

fn circle(tour: &mut Vec<Stop>, room: usize, door: f64, random: &mut Random) {
    const STEPS: usize = 60;
    let y = if room % 2 == 1 { 4.2 } else { -4.2 };
    let (radius, height) = (1.2 + 0.6 * random.unit(), 1.0 + 0.8 * random.unit());
    let (begin, outwards) = (std::f64::consts::TAU * random.unit(), random.unit() * 1.2);
    for k in 0..STEPS {
        let angle = begin + std::f64::consts::TAU * k as f64 / STEPS as f64;
        let place = Vector3::new(door + radius * angle.cos(), y + radius * angle.sin(), height);
        let yaw = angle + outwards + 0.1 * random.gaussian();
        tour.push(Stop { hall: room, pose_m_b: held(place, yaw, random) });
    }
}
