//! Geometry of the camera rig: where a pixel goes when the body turns, and where in the other camera.
//!
//! `xy` are ideal normalized coordinates, `px` pixels as measured. A point with inverse depth `rho` (1/m,
//! along the optical axis of the first camera) has in the second the direction `R [x y 1]^T + rho t`; with
//! `rho = 0` that is the infinite homography.

use crate::shutter::RowTurns;
use nalgebra::{Isometry3, Matrix2, Matrix2x3, Rotation3, UnitQuaternion, Vector2, Vector3};
use plumbline_config::camera::MAX_THETA_RAD;
use plumbline_config::{CameraModel, Portable};

/// Normalized coordinates this much further out than the image's corners are not projected: there the
/// distortion polynomial may fold back into the image.
const FIELD_MARGIN: f64 = 1.15;

/// A position predicted by geometry, and the local map of the pixels around it.
#[derive(Clone, Copy, Debug)]
pub struct Prediction {
    /// Predicted pixel.
    pub px: Vector2<f64>,
    /// Takes pixel offsets around the point in the source image to offsets around [`Self::px`].
    pub warp: Matrix2<f32>,
}

/// Depth and epipolar error of a point by two views.
#[derive(Clone, Copy, Debug)]
pub struct StereoGeometry {
    /// Inverse depth in the first camera, 1/m; negative when the rays diverge.
    pub inverse_depth: f64,
    /// Distance of the second view from the epipolar line, px (approximate, by the focal length).
    pub epipolar_px: f64,
}

/// One camera of the rig.
#[derive(Clone, Copy, Debug)]
pub struct RigCamera {
    /// Calibration.
    pub model: CameraModel,
    /// Takes camera to body coordinates.
    pub pose_b_c: Isometry3<f64>,
    /// Turns between the rows of the present frame.
    pub rows: RowTurns,
    /// Largest norm of normalized coordinates that is projected.
    field: f64,
}

impl RigCamera {
    /// A camera at the origin of the body.
    #[must_use]
    pub fn new(model: CameraModel) -> Self {
        let (right, bottom) = (model.width_px as f64 - 1.0, model.height_px as f64 - 1.0);
        let corners = [[0.0, 0.0], [right, 0.0], [0.0, bottom], [right, bottom]];
        // A corner without direction lies beyond the fold of the lens, or further aside than directions are used.
        let reach = libm::tan(model.distortion.fold_rad().unwrap_or(MAX_THETA_RAD));
        let field = corners
            .iter()
            .map(|&c| model.unproject(&Vector2::from(c)).map_or(reach, |xy| xy.norm() * FIELD_MARGIN))
            .fold(0.0, |most, x: f64| x.at_least(most));
        Self {
            model,
            pose_b_c: Isometry3::identity(),
            rows: RowTurns::default(),
            field: field.at_most(reach),
        }
    }

    /// Mean focal length, px.
    pub fn focal_px(&self) -> f64 {
        0.5 * (self.model.focal_px.x + self.model.focal_px.y)
    }

    /// Normalized coordinates, at the time of the frame, of what is seen at `px`.
    pub(crate) fn unproject(&self, px: &Vector2<f64>) -> Option<Vector2<f64>> {
        let xy = self.model.unproject(px)?;
        self.rows.at_frame(&xy, px.y)
    }

    /// Pixel of a direction at the time of the frame in this camera, its derivative by the normalized coordinates at the time of
    /// its row, and these.
    pub(crate) fn project(&self, p_c: &Vector3<f64>) -> Option<(Vector2<f64>, Matrix2<f64>, Vector2<f64>)> {
        let at_once = self.project_at_once(p_c)?;
        match self.rows.is_global() {
            true => Some(at_once),
            // Turned to the row where it would be seen at once, it is off by far less than a row.
            false => self.project_at_once(&self.rows.at_row(p_c, at_once.0.y)),
        }
    }

    fn project_at_once(&self, p_c: &Vector3<f64>) -> Option<(Vector2<f64>, Matrix2<f64>, Vector2<f64>)> {
        if p_c.z < 1e-3 {
            return None;
        }
        let xy = p_c.xy() / p_c.z;
        (xy.norm() <= self.field).then(|| {
            let (px, px_by_xy) = self.model.project_normalized(&xy);
            (px, px_by_xy, xy)
        })
    }

    /// Rotation of this camera that belongs to one of the body: both take current to previous coordinates.
    pub fn rotation_of(&self, rot_prev_cur_b: &UnitQuaternion<f64>) -> UnitQuaternion<f64> {
        self.pose_b_c.rotation.inverse() * rot_prev_cur_b * self.pose_b_c.rotation
    }
}

/// Predicts where the direction `xy` of `from` appears in `to`, for a rotation and a translation in units
/// of the depth: `p_to = rotation * [x y 1]^T + shift`.
#[must_use]
pub fn predict(
    from: &RigCamera,
    to: &RigCamera,
    xy: &Vector2<f64>,
    rotation: &Rotation3<f64>,
    shift: &Vector3<f64>,
) -> Option<Prediction> {
    let p_to = rotation * Vector3::new(xy.x, xy.y, 1.0) + shift;
    let (px, px_by_xy, xy_to) = to.project(&p_to)?;
    let by_p = Matrix2x3::new(1.0, 0.0, -xy_to.x, 0.0, 1.0, -xy_to.y) / p_to.z;
    let xy_by_xy = by_p * rotation.matrix().fixed_columns::<2>(0);
    let (_, from_px_by_xy) = from.model.project_normalized(xy);
    let warp = px_by_xy * xy_by_xy * from_px_by_xy.try_inverse()?;
    Some(Prediction { px, warp: warp.cast() })
}

/// The way from one camera of a pair to the other.
#[derive(Clone, Copy, Debug)]
pub struct Baseline {
    /// `R` from the first camera to the second.
    pub rotation: Rotation3<f64>,
    /// Position of the first camera in the second, m.
    pub translation: Vector3<f64>,
}

impl Baseline {
    /// Between two mounted cameras.
    #[must_use]
    pub fn between(from: &RigCamera, to: &RigCamera) -> Self {
        let pose_to_from = to.pose_b_c.inverse() * from.pose_b_c;
        Self {
            rotation: pose_to_from.rotation.to_rotation_matrix(),
            translation: pose_to_from.translation.vector,
        }
    }

    /// Depth and epipolar distance of a pair of views: with `a = R [x y 1]^T`, the second view says
    /// `a.xy + rho t.xy = xy' (a.z + rho t.z)`, two equations for `rho`; what they leave over lies across the
    /// epipolar line. `None` without a baseline across the ray.
    #[must_use]
    pub fn triangulate(
        &self,
        xy_from: &Vector2<f64>,
        xy_to: &Vector2<f64>,
        focal_px: f64,
    ) -> Option<StereoGeometry> {
        let a = self.rotation * Vector3::new(xy_from.x, xy_from.y, 1.0);
        let along = self.translation.xy() - xy_to * self.translation.z;
        let offset = a.xy() - xy_to * a.z;
        let length2 = along.norm_squared();
        if length2 < 1e-8 || a.z < 1e-3 {
            return None;
        }
        let across = along.perp(&offset) / length2.sqrt();
        Some(StereoGeometry {
            inverse_depth: -along.dot(&offset) / length2,
            epipolar_px: (across / a.z).abs() * focal_px,
        })
    }
}
