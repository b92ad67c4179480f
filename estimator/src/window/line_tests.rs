use super::super::factor::Linearization;
use super::super::state::{Mount, NavState, RIG_DIM, Rig};
use super::super::test_views::{Lifted, isometry, vector, with_cameras};
use super::*;
use nalgebra::{Isometry3, SVector};
use proptest::prelude::*;

/// A line through two points in front of the host, seen from nearby.
#[derive(Clone, Debug)]
struct Scene {
    rig: Rig,
    host: NavState,
    target: NavState,
    cameras: (usize, usize),
    line: HostedLine,
    measured: LineMeasurement,
    offset: f64,
}

impl Scene {
    /// The line in the observer's camera.
    fn seen(&self) -> Pluecker {
        self.with_cameras(|view| self.line.placed(view.host).seen_from(view.target))
    }

    fn with_cameras<T>(&self, use_it: impl FnOnce(CameraView<'_>) -> T) -> T {
        with_cameras(&self.rig, (&self.host, &self.target), self.cameras, use_it)
    }

    fn residual(&self) -> Option<Vector2<f64>> {
        self.with_cameras(|view| self.line.residual(view, &self.measured, self.step_s(), None))
    }

    fn step_s(&self) -> f64 {
        self.rig.time_offset_s - self.offset
    }

    /// Residual and Jacobians by one call.
    fn linearized(&self) -> (Vector2<f64>, Jacobians<4>, Lifted) {
        let mut jacobians = Jacobians::zeros();
        let residual = self.with_cameras(|view| {
            let request = Linearization { at: view, jacobians: &mut jacobians };
            self.line.residual(view, &self.measured, self.step_s(), Some(request))
        });
        let poses = (&self.host, &self.target);
        let lifted = Lifted::of(&jacobians, &self.rig, poses, self.cameras);
        (residual.expect("is seen"), jacobians, lifted)
    }
}

fn scenes() -> impl Strategy<Value = Scene> {
    let rig = (isometry(0.1, 2.0), isometry(0.15, 0.1));
    let poses = (isometry(3.0, 2.0), isometry(0.4, 0.15), (0usize..2, 0usize..2));
    let ends = prop::array::uniform4(-0.5..0.5f64);
    let depths = (1.0..6.0f64, 1.0..6.0f64);
    let noise = (prop::array::uniform4(-0.02..0.02f64), prop::array::uniform2(-1.0..1.0f64));
    (rig, poses, ends, depths, noise).prop_filter_map(
        "the line is seen",
        |(rig, poses, ends, depths, noise)| {
            let (host, step, cameras) = poses;
            let of = |pose: Isometry3<f64>| NavState {
                p_o_b: pose.translation.vector,
                rot_o_b: pose.rotation,
                ..NavState::default()
            };
            let a = Vector3::new(ends[0], ends[1], 1.0) * depths.0;
            let b = Vector3::new(ends[2], ends[3], 1.0) * depths.1;
            let rig = Rig {
                pose_b_c0: rig.0,
                pose_c0_c1: rig.1,
                time_offset_s: 0.003,
                intrinsics: Default::default(),
            };
            let target_pose = host * step;
            let to_target =
                (target_pose * rig.pose_b_c(cameras.1)).inverse() * host * rig.pose_b_c(cameras.0);
            let see = |p: Vector3<f64>, dx: f64, dy: f64| {
                let q = to_target * nalgebra::Point3::from(p);
                (q.z > 0.3).then(|| Vector2::new(q.x / q.z + dx, q.y / q.z + dy))
            };
            let measured = LineMeasurement {
                ends_xy: [see(a, noise.0[0], noise.0[1])?, see(b, noise.0[2], noise.0[3])?],
                rates: noise.1,
                weights: [900.0, 850.0],
                rows: [SeenByRow::default(); 2],
            };
            let length = (measured.ends_xy[1] - measured.ends_xy[0]).norm();
            let line = HostedLine::of(&a.cross(&b), &(b - a))?;
            let scene = Scene {
                rig,
                host: of(host),
                target: of(target_pose),
                cameras,
                line,
                measured,
                offset: 0.001,
            };
            (length > 0.2 && (b - a).norm() > 0.5 && scene.residual().is_some()).then_some(scene)
        },
    )
}

/// Central difference of the residual under a change of the scene by `h`.
fn numeric(scene: &Scene, change: impl Fn(&mut Scene, f64)) -> Vector2<f64> {
    const H: f64 = 1e-6;
    let at = |h: f64| {
        let mut moved = scene.clone();
        change(&mut moved, h);
        moved.residual().expect("is still seen")
    };
    (at(H) - at(-H)) / (2.0 * H)
}

fn is_close(analytic: &Vector2<f64>, numeric: &Vector2<f64>) -> bool {
    (analytic - numeric).norm() < 1e-4 * (1.0 + numeric.norm())
}

proptest! {
    #[test]
    fn jacobians_agree_with_numeric_differentiation(scene in scenes()) {
        let (r, j, lifted) = scene.linearized();
        prop_assert_eq!(Some(r), scene.residual(), "the same with and without Jacobians");
        let nav = |s: &NavState, k: usize, h: f64| {
            let mut d = SVector::<f64, 15>::zeros();
            d[k] = h;
            s.plus(&d)
        };
        for k in 0..6 {
            let by_host = numeric(&scene, |s, h| s.host = nav(&s.host, k, h));
            prop_assert!(is_close(&lifted.host.column(k).into(), &by_host), "host {k}");
            let by_target = numeric(&scene, |s, h| s.target = nav(&s.target, k, h));
            prop_assert!(is_close(&lifted.target.column(k).into(), &by_target), "target {k}");
        }
        for k in 0..=Rig::TIME_OFFSET {
            let by_rig = numeric(&scene, |s, h| {
                let mut d = SVector::<f64, RIG_DIM>::zeros();
                d[k] = h;
                s.rig = s.rig.plus(&d);
            });
            prop_assert!(is_close(&lifted.rig.column(k).into(), &by_rig), "rig {k}");
        }
        for k in 0..4 {
            let by_line = numeric(&scene, |s, h| {
                let mut d = Vector4::zeros();
                d[k] = h;
                s.line = s.line.plus(&d);
            });
            prop_assert!(is_close(&j.landmark.column(k).into(), &by_line), "landmark {k}");
        }
    }

    #[test]
    fn a_line_hosted_elsewhere_is_the_same_line(scene in scenes()) {
        let Pluecker { n, v } = scene.seen();
        let moved = scene.with_cameras(|view| scene.line.hosted_by_target(view)).expect("is seen");
        let Pluecker { n: m, v: w } = moved.pluecker();
        prop_assert!(n.normalize().cross(&m.normalize()).norm() < 1e-9);
        prop_assert!(v.normalize().cross(&w.normalize()).norm() < 1e-9);
        prop_assert!((n.norm() / v.norm() - m.norm() / w.norm()).abs() < 1e-9 * (1.0 + n.norm() / v.norm()));
    }

    #[test]
    fn rates_are_those_of_a_moving_camera(scene in scenes(), rate_b in vector(1.0), v_b in vector(2.0)) {
        let motion = CameraMotion::of(&Mount::of(&scene.rig, scene.cameras.1), &rate_b, &v_b);
        let with = scene.with_cameras(|view| scene.line.with_rate(view, &scene.measured, &motion));
        let rates = with.expect("is seen").rates;
        let at = |dt: f64| {
            let mut moved = scene.clone();
            let rot = moved.target.rot_o_b;
            moved.target.p_o_b += rot * v_b * dt;
            moved.target.rot_o_b = rot * exp_so3(&(rate_b * dt));
            moved.measured.distances(&moved.seen().n).expect("is seen")
        };
        let (after, before) = (at(1e-6), at(-1e-6));
        for k in 0..2 {
            let numeric = (after[k] - before[k]) / 2e-6;
            prop_assert!((numeric - rates[k]).abs() < 1e-5 * (1.0 + numeric.abs()), "{numeric} {}", rates[k]);
        }
    }
}

#[test]
fn a_line_through_the_camera_or_at_infinity_is_told_apart() {
    let v = Vector3::new(1.0, 0.0, 0.0);
    assert!(HostedLine::of(&Vector3::zeros(), &v).is_none(), "through the camera it has no plane");
    // At infinity it is a direction of planes: no distance, but a trace.
    let far = HostedLine { axes: Matrix3::identity(), phi: 0.0 };
    assert!(
        far.depth_at(&Vector2::new(0.1, 0.2)).is_nan() || far.depth_at(&Vector2::new(0.1, 0.2)).is_infinite()
    );
    // A plane across the optical axis does not meet the image: no trace that could be compared.
    let measured = LineMeasurement {
        ends_xy: [Vector2::new(0.0, 0.0), Vector2::new(0.1, 0.0)],
        rates: [0.0; 2],
        weights: [1.0; 2],
        rows: [SeenByRow::default(); 2],
    };
    assert!(measured.distances(&Vector3::new(0.0, 0.0, 1.0)).is_none());
}

#[test]
fn a_line_keeps_its_constraint_over_many_steps() {
    let mut line =
        HostedLine::of(&Vector3::new(0.3, -2.0, 0.4), &Vector3::new(1.0, 0.1, -0.2)).expect("a line");
    for k in 0..10_000 {
        let s = f64::from(k).sin() * 0.3;
        line = line.plus(&Vector4::new(s, -0.5 * s, 0.2 * s, 1e-5));
    }
    let identity = line.axes.tr_mul(&line.axes);
    assert!((identity - Matrix3::identity()).norm() < 1e-12);
}
