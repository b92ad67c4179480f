//! From tracked points and lines to measurements: weights in pixels, rates of change, and how still the
//! image is.

use crate::lines::{ImageLine, LineObservation, Segment};
use crate::points::PointObservation;
use crate::shutter::{Readout, readouts};
use crate::window::epipolar::EpipolarMoments;
use crate::window::landmark::LandmarkStore;
use crate::window::line::LineMeasurement;
use crate::window::reprojection::{InversePoint, PATCH_VARIANCE, PointMeasurement};
use crate::window::seen_by_row::SeenByRow;
use crate::window::state::Rig;
use crate::window::tracks::MIN_WITNESSES;
use crate::window::{LineTrack, PointTrack, TrackMeasurement};
use nalgebra::{Matrix2, Vector2, Vector3};
use plumbline_config::{CameraModel, Portable, ValidSetup};

/// Turns the points of one frame into measurements, remembering those of the frame before.
#[derive(Clone, Debug)]
pub struct Measurer {
    cameras: Vec<CameraModel>,
    /// Readouts of the cameras, as configured or found.
    pub readouts: [Readout; 2],
    sigma_px: f64,
    /// Points of the frame before, and of the one before that, by track.
    previous: Vec<PointObservation>,
    earlier: Vec<PointObservation>,
    measurements: Vec<PointTrack>,
    line_sigma_px: f64,
    lines: Vec<LineTrack>,
    flow: [Vec<f64>; 2],
    ways_px: [Vec<f64>; 2],
}

/// Motion of the points in the images since the frame before; `None` where too few are followed.
#[derive(Clone, Copy, Debug)]
pub struct ImageMotion {
    /// The common motion in both images, px: medians of the two components.
    pub common: Option<Vector2<f64>>,
    /// Median way in each image, px.
    pub ways_px: [Option<f64>; 2],
}

impl Measurer {
    /// For the cameras and features of a setup; allocates all it needs.
    pub fn new(setup: &ValidSetup) -> Self {
        let (points, lines) = (&setup.estimator.points, &setup.estimator.lines);
        let capacity = points.max_points;
        Self {
            cameras: setup.camera.iter().map(|c| c.model()).collect(),
            readouts: readouts(setup),
            sigma_px: points.sigma_px,
            line_sigma_px: lines.sigma_px,
            lines: Vec::with_capacity(2 * lines.max_segments),
            previous: Vec::with_capacity(capacity),
            earlier: Vec::with_capacity(capacity),
            measurements: Vec::with_capacity(capacity),
            flow: [Vec::with_capacity(2 * capacity), Vec::with_capacity(2 * capacity)],
            ways_px: [Vec::with_capacity(capacity), Vec::with_capacity(capacity)],
        }
    }

    /// Place of the row of normalized coordinates in the image of `camera`: -1/2 for the first, 1/2 for the last.
    pub fn row(&self, camera: usize, xy: &Vector2<f64>) -> f64 {
        let Some(model) = self.cameras.get(camera) else { return 0.0 };
        model.project_normalized(xy).0.y / (model.height_px as f64 - 1.0) - 0.5
    }

    /// Forgets the frame before.
    pub fn clear(&mut self) {
        self.previous.clear();
        self.earlier.clear();
        self.measurements.clear();
        self.lines.clear();
    }

    /// The points of the newest frame.
    pub fn points(&self) -> &[PointTrack] {
        &self.measurements
    }

    /// The lines of the newest frame.
    pub fn lines(&self) -> &[LineTrack] {
        &self.lines
    }

    /// Measures the lines of a frame, as [`Self::measure_points`] does the points.
    pub fn measure_lines(
        &mut self,
        observations: &[LineObservation],
        outliers: &[u32],
        rate_c: &[Vector3<f64>; 2],
    ) {
        self.lines.clear();
        let sound = observations.iter().filter(|o| !outliers.contains(&o.track_id));
        for observation in sound.take(self.lines.capacity()) {
            let measured = [0, 1].map(|camera| {
                let (line, segment) = observation.lines[camera].zip(observation.segments[camera])?;
                Some(self.line_measurement(camera, &line, &segment).turning(&rate_c[camera]))
            });
            self.lines.push(TrackMeasurement { track_id: observation.track_id, measured });
        }
    }

    fn line_measurement(&self, camera: usize, line: &ImageLine, segment: &Segment) -> LineMeasurement {
        let late_s = [segment.start.y, segment.end.y].map(|v| self.readouts[camera].late_s(f64::from(v)));
        LineMeasurement {
            rows: [0, 1].map(|k| SeenByRow { xy: line.ends_xy[k], late_s: late_s[k] }),
            ends_xy: line.ends_xy,
            rates: [0.0; 2],
            weights: line.px_per_unit.map(|scale| scale / self.line_sigma_px),
        }
    }

    /// Measures the points of a frame but for those whose track ids are in `outliers`; `rate_c` are the angular rates of the
    /// cameras in their own frames, rad/s. The image rates are those of far points, until the window knows
    /// better.
    pub fn measure_points(
        &mut self,
        observations: &[PointObservation],
        outliers: &[u32],
        rate_c: &[Vector3<f64>; 2],
    ) {
        self.measurements.clear();
        for observation in observations.iter().filter(|o| !outliers.contains(&o.track_id)) {
            let mut measured = [None, None];
            for camera in 0..self.cameras.len() {
                let Some(xy) = observation.xy[camera] else { continue };
                let xy_rate = rotational_rate(&xy, &rate_c[camera]);
                let weight = self.weight(camera, &xy, &observation.covariance_px2[camera]);
                let late_s = observation.px[camera].map_or(0.0, |px| self.readouts[camera].late_s(px.y));
                let row = SeenByRow { xy, late_s };
                measured[camera] = Some(PointMeasurement { xy, xy_rate, weight, row });
            }
            if measured.iter().any(Option::is_some) && self.measurements.len() < self.measurements.capacity()
            {
                self.measurements.push(TrackMeasurement { track_id: observation.track_id, measured });
            }
        }
    }

    /// Points and lines of the newest frame, to be corrected.
    pub fn tracks_mut(&mut self) -> (&mut [PointTrack], &mut [LineTrack]) {
        (&mut self.measurements, &mut self.lines)
    }

    /// Leaves out what `camera` measured of the newest frame.
    pub fn leave_out(&mut self, camera: usize) {
        self.measurements.retain_mut(|track| track.leave_out(camera));
        self.lines.retain_mut(|track| track.leave_out(camera));
    }

    /// Motion of the points in the images since the frame before; call before [`Self::remember`].
    pub fn motion(&mut self, observations: &[PointObservation]) -> ImageMotion {
        let Self { previous, flow, ways_px, .. } = self;
        flow.iter_mut().chain(ways_px.iter_mut()).for_each(Vec::clear);
        for observation in observations {
            let Some(before) = find(previous, observation.track_id) else { continue };
            for (camera, ways_px) in ways_px.iter_mut().enumerate() {
                if let (Some(now), Some(then)) = (observation.px[camera], before.px[camera]) {
                    let way_px = now - then;
                    flow[0].push(way_px.x);
                    flow[1].push(way_px.y);
                    ways_px.push(way_px.norm());
                }
            }
        }
        let [x, y] = flow.each_mut().map(|values| median(values));
        let common = x.zip(y).map(|(x, y)| Vector2::new(x, y));
        ImageMotion { common, ways_px: ways_px.each_mut().map(|values| median(values)) }
    }

    /// Epipolar moments of the points of the frame before, by their motion in the right image from the one before that to this one, which took
    /// `span_s`: rates that share no noise with the distances. `None` where too few points were seen throughout. Call before
    /// [`Self::remember`].
    pub fn epipolar_moments(
        &self,
        observations: &[PointObservation],
        rig: &Rig,
        span_s: f64,
    ) -> Option<EpipolarMoments> {
        let pairs = observations.iter().filter_map(|observation| {
            let track_id = observation.track_id;
            let [left, right] = find(&self.previous, track_id)?.xy;
            let moved = observation.xy[1]? - find(&self.earlier, track_id)?.xy[1]?;
            Some(([left?, right?], moved / span_s))
        });
        EpipolarMoments::of_pairs(rig, self.cameras.first()?.focal_px[0], pairs)
    }

    /// Median depth of the measured points, m, each in the camera that hosts it; infinite where too few have one.
    pub fn median_depth_m(&mut self, landmarks: &LandmarkStore<InversePoint>) -> f64 {
        let Self { measurements, flow: [inverse_depths, _], .. } = self;
        inverse_depths.clear();
        for track in measurements.iter() {
            let landmark = landmarks.of_track(track.track_id).map(|index| &landmarks.all()[index]);
            inverse_depths.extend(landmark.filter(|l| l.is_triangulated).map(|l| l.feature.rho));
        }
        median(inverse_depths).filter(|median| *median > 0.0).map_or(f64::INFINITY, |median| 1.0 / median)
    }

    /// Number of measured points whose depth is known.
    pub fn landmarks_in_view(&self, landmarks: &LandmarkStore<InversePoint>) -> usize {
        let is_known = |track: &&PointTrack| {
            landmarks.of_track(track.track_id).is_some_and(|index| landmarks.all()[index].is_triangulated)
        };
        self.measurements.iter().filter(is_known).count()
    }

    /// Keeps the points for the next frame.
    pub fn remember(&mut self, observations: &[PointObservation]) {
        std::mem::swap(&mut self.previous, &mut self.earlier);
        self.previous.clear();
        let room = self.previous.capacity().min(observations.len());
        self.previous.extend_from_slice(&observations[..room]);
        self.previous.sort_unstable_by_key(|o| o.track_id);
    }

    /// Square root of the information of a point's normalized coordinates. The pixel's covariance is that of a point in good
    /// texture, and that of its alignment with the reference patch, whose residuals hang together.
    fn weight(&self, camera: usize, xy: &Vector2<f64>, of_patch_px2: &Matrix2<f32>) -> Matrix2<f64> {
        let px_by_xy = self.cameras[camera].project_normalized(xy).1;
        let of_patch_px2 = of_patch_px2.cast::<f64>() * PATCH_VARIANCE;
        let covariance = Matrix2::identity() * self.sigma_px.squared() + of_patch_px2;
        let root = covariance.cholesky().and_then(|root| root.l().try_inverse());
        root.map_or_else(|| px_by_xy / self.sigma_px, |root| root * px_by_xy)
    }
}

/// The middle one of enough values: of so many points that a few false ones do not move it.
fn median(values: &mut [f64]) -> Option<f64> {
    let middle = values.len() / 2;
    (values.len() >= MIN_WITNESSES).then(|| *values.select_nth_unstable_by(middle, f64::total_cmp).1)
}

fn find(sorted: &[PointObservation], track_id: u32) -> Option<&PointObservation> {
    sorted.binary_search_by_key(&track_id, |o| o.track_id).ok().map(|k| &sorted[k])
}

/// Rate of the normalized coordinates of a far point seen from a turning camera: `q' = -w x q`.
fn rotational_rate(xy: &Vector2<f64>, rate_c: &Vector3<f64>) -> Vector2<f64> {
    let q = Vector3::new(xy.x, xy.y, 1.0);
    let d = -rate_c.cross(&q);
    Vector2::new(d.x - xy.x * d.z, d.y - xy.y * d.z)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::exp_so3;

    #[test]
    fn the_rotational_rate_is_that_of_a_turning_camera() {
        let (xy, rate) = (Vector2::new(0.3, -0.2), Vector3::new(0.5, -0.7, 1.1));
        let at = |dt: f64| {
            let q = exp_so3(&(rate * dt)).inverse() * Vector3::new(xy.x, xy.y, 1.0);
            Vector2::new(q.x / q.z, q.y / q.z)
        };
        let numeric = (at(1e-6) - at(-1e-6)) / 2e-6;
        assert!((numeric - rotational_rate(&xy, &rate)).norm() < 1e-8);
    }
}
