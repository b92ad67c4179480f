//! The lower convex hull of points that come in order of x: the nearest that a line can come to them from below.
//!
//! A measured delay is the smallest possible one plus what chance added, never less. So the line that describes two
//! clocks lies below all points (device time, host arrival), and touches those that were not held up: an edge of the
//! hull. Of all lines below the points the one with the least sum of distances is the edge above their mean abscissa
//! (L. Zhang, Z. Liu, C. H. Xia, *Clock synchronization algorithms for network measurements*, INFOCOM 2002, which
//! follows S. B. Moon et al. 1999); late arrivals, however late, do not move it.

/// Vertices that are kept: a smooth drift would make a vertex of every point.
const MAX_VERTICES: usize = 256;

/// A point of the hull, ns.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Vertex {
    x: i64,
    y: i64,
}

/// A straight line: `y(x) = y + slope (x - x0)`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    x: i64,
    y: i64,
    /// Dimensionless: ns per ns.
    pub slope: f64,
}

impl Line {
    /// Height at `x`, ns.
    pub fn at(&self, x: i64) -> i64 {
        self.y.saturating_add((self.slope * x.saturating_sub(self.x) as f64).round() as i64)
    }
}

/// The lower hull of the points since [`Hull::clear`]. Allocates at its construction alone.
#[derive(Clone, Debug)]
pub struct Hull {
    vertices: Vec<Vertex>,
    points: u64,
}

impl Default for Hull {
    fn default() -> Self {
        Self { vertices: Vec::with_capacity(MAX_VERTICES), points: 0 }
    }
}

impl Hull {
    /// Forgets all points.
    pub fn clear(&mut self) {
        self.vertices.clear();
        self.points = 0;
    }

    /// Points since it was cleared.
    pub fn points(&self) -> u64 {
        self.points
    }

    /// Abscissae of the first point and of the last, ns.
    pub fn span(&self) -> Option<(i64, i64)> {
        Some((self.vertices.first()?.x, self.vertices.last()?.x))
    }

    /// Takes a point to the right of all others; of two with the same abscissa the lower one counts. What lies further
    /// to the left is refused.
    pub fn push(&mut self, x: i64, y: i64) {
        if let Some(last) = self.vertices.last() {
            if x < last.x || (x == last.x && y >= last.y) {
                return;
            }
            if x == last.x {
                self.vertices.pop();
            }
        }
        let point = Vertex { x, y };
        while let [.., a, b] = self.vertices[..] {
            if turns_left(a, b, point) {
                break;
            }
            self.vertices.pop();
        }
        if self.vertices.len() == MAX_VERTICES {
            self.thin_out();
        }
        self.vertices.push(point);
        self.points += 1;
    }

    /// Gives every second vertex up: neighbours on a smooth curve stand for each other.
    fn thin_out(&mut self) {
        let mut index = 0;
        self.vertices.retain(|_| {
            index += 1;
            index % 2 == 1 || index == MAX_VERTICES
        });
    }

    /// The edge above the middle of the span, its slope held within `max_slope`: the line then touches the hull with
    /// that slope. None before there are two points.
    pub fn line(&self, max_slope: f64) -> Option<Line> {
        let (first, last) = self.span()?;
        if self.vertices.len() < 2 {
            return None;
        }
        let middle = first + (last - first) / 2;
        let right = self.vertices.partition_point(|v| v.x <= middle).clamp(1, self.vertices.len() - 1);
        let (a, b) = (self.vertices[right - 1], self.vertices[right]);
        let slope = (b.y - a.y) as f64 / (b.x - a.x) as f64;
        if slope.abs() <= max_slope {
            return Some(Line { x: a.x, y: a.y, slope });
        }
        let slope = max_slope.copysign(slope);
        let height = |v: &Vertex| v.y - (slope * (v.x - a.x) as f64).round() as i64;
        let lowest = self.vertices.iter().min_by_key(|v| height(v))?;
        Some(Line { x: lowest.x, y: lowest.y, slope })
    }
}

/// True if the way from `a` over `b` to `c` turns left: `b` is below the straight way.
fn turns_left(a: Vertex, b: Vertex, c: Vertex) -> bool {
    let across = |p: i64, q: i64| i128::from(p) * i128::from(q);
    across(b.x - a.x, c.y - a.y) > across(b.y - a.y, c.x - a.x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const FREE: f64 = 1.0;

    fn hull(points: &[(i64, i64)]) -> Hull {
        let mut hull = Hull::default();
        points.iter().for_each(|(x, y)| hull.push(*x, *y));
        hull
    }

    #[test]
    fn a_slope_beyond_the_limit_is_held_and_still_touches_from_below() {
        let steep = hull(&[(0, 0), (100, 90), (200, 170)]);
        let line = steep.line(0.1).unwrap();
        assert_eq!((line.slope, line.at(0)), (0.1, 0));
        let falling = hull(&[(0, 0), (100, -90), (200, -180)]);
        assert_eq!(falling.line(0.1).unwrap().at(200), -180);
    }

    proptest! {
        #[test]
        fn the_line_lies_below_all_points(
            steps in prop::collection::vec((1_i64..5_000_000, 0_i64..30_000_000), 2..400),
            skew in -1000_i64..1000,
        ) {
            let mut x = 0;
            let points: Vec<(i64, i64)> = steps
                .iter()
                .map(|(dx, delay)| { x += dx; (x, x / 1_000_000 * skew + delay) })
                .collect();
            let all = hull(&points);
            prop_assume!(all.vertices.len() < MAX_VERTICES);
            for max_slope in [FREE, 1e-3] {
                let line = all.line(max_slope).unwrap();
                prop_assert!(line.slope.abs() <= max_slope);
                // One for the rounding to whole nanoseconds.
                prop_assert!(points.iter().all(|(x, y)| line.at(*x) <= y + 1));
            }
        }
    }
}
