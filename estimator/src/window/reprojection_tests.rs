use super::super::factor::Linearization;
use super::super::state::{NavState, RIG_DIM, Rig};
use super::super::test_views::{Lifted, isometry, with_cameras};
use super::*;
use nalgebra::{Isometry3, SVector};
use proptest::prelude::*;

#[derive(Clone, Debug)]
struct Scene {
    rig: Rig,
    host: NavState,
    target: NavState,
    cameras: (usize, usize),
    point: InversePoint,
    measured: PointMeasurement,
    offset: f64,
}

impl Scene {
    fn with_cameras<T>(&self, use_it: impl FnOnce(CameraView<'_>) -> T) -> T {
        with_cameras(&self.rig, (&self.host, &self.target), self.cameras, use_it)
    }

    fn residual(&self) -> Vector2<f64> {
        self.with_cameras(|view| self.point.residual(view, &self.measured, self.step_s(), None)).unwrap()
    }

    fn step_s(&self) -> f64 {
        self.rig.time_offset_s - self.offset
    }

    /// Residual and Jacobians by one call.
    fn linearized(&self) -> (Vector2<f64>, Jacobians<3>, Lifted) {
        let mut jacobians = Jacobians::zeros();
        let residual = self.with_cameras(|view| {
            let request = Linearization { at: view, jacobians: &mut jacobians };
            self.point.residual(view, &self.measured, self.step_s(), Some(request))
        });
        let poses = (&self.host, &self.target);
        let lifted = Lifted::of(&jacobians, &self.rig, poses, self.cameras);
        (residual.unwrap(), jacobians, lifted)
    }
}

prop_compose! {
    fn scene()(
        pose_b_c0 in isometry(0.1, 2.0),
        pose_c0_c1 in isometry(0.15, 0.1),
        host in isometry(3.0, 2.0),
        step in isometry(0.5, 0.2),
        cameras in (0usize..2, 0usize..2),
        xy in prop::array::uniform2(-0.6..0.6f64),
        rho in 0.0..0.8f64,
        rate in prop::array::uniform2(-1.0..1.0f64),
        offset in -0.01..0.01f64,
    ) -> Scene {
        let nav = |pose: Isometry3<f64>| NavState { p_o_b: pose.translation.vector, rot_o_b: pose.rotation, ..NavState::default() };
        Scene {
            rig: Rig { pose_b_c0, pose_c0_c1, time_offset_s: 0.003, intrinsics: Default::default() },
            host: nav(host),
            target: nav(host * step),
            cameras,
            point: InversePoint { xy: Vector2::from(xy), rho },
            measured: PointMeasurement {
                xy: Vector2::new(0.1, -0.1),
                xy_rate: Vector2::from(rate),
                weight: Matrix2::new(900.0, 20.0, 30.0, 1000.0),
                row: SeenByRow::default(),
            },
            offset,
        }
    }
}

/// Central difference of the residual under the perturbation that `perturb` applies.
fn numeric(scene: &Scene, perturb: impl Fn(&mut Scene, f64)) -> Vector2<f64> {
    let h = 1e-6;
    let (mut plus, mut minus) = (scene.clone(), scene.clone());
    perturb(&mut plus, h);
    perturb(&mut minus, -h);
    (plus.residual() - minus.residual()) / (2.0 * h)
}

proptest! {
    #[test]
    fn jacobians_agree_with_numeric_differentiation(scene in scene()) {
        let (r, j, lifted) = scene.linearized();
        prop_assert_eq!(r, scene.residual(), "the same with and without Jacobians");
        let tolerance = 1e-2;
        for k in 0..6 {
            let mut d = SVector::<f64, 15>::zeros();
            d[k] = 1.0;
            let by_host = numeric(&scene, |s, h| s.host = s.host.plus(&(d * h)));
            let by_target = numeric(&scene, |s, h| s.target = s.target.plus(&(d * h)));
            prop_assert!((by_host - lifted.host.column(k)).norm() < tolerance, "host {k}");
            prop_assert!((by_target - lifted.target.column(k)).norm() < tolerance, "target {k}");
        }
        for k in 0..=Rig::TIME_OFFSET {
            let mut d = SVector::<f64, RIG_DIM>::zeros();
            d[k] = 1.0;
            let by_rig = numeric(&scene, |s, h| s.rig = s.rig.plus(&(d * h)));
            prop_assert!((by_rig - lifted.rig.column(k)).norm() < tolerance, "rig {k}");
        }
        let by_x = numeric(&scene, |s, h| s.point.xy.x += h);
        let by_y = numeric(&scene, |s, h| s.point.xy.y += h);
        let by_rho = numeric(&scene, |s, h| s.point.rho += h);
        prop_assert!((by_x - j.landmark.column(0)).norm() < tolerance);
        prop_assert!((by_y - j.landmark.column(1)).norm() < tolerance);
        prop_assert!((by_rho - j.landmark.column(2)).norm() < tolerance);
    }
}
