use super::super::factor::Linearization;
use super::super::feature::Estimated;
use super::super::line::HostedLine;
use super::super::manhattan::ManhattanOptions;
use super::super::state::{NavState, RIG_DIM, Rig};
use super::super::test_views::{Lifted, isometry, vector};
use super::*;
use nalgebra::{SVector, Vector4};
use proptest::prelude::*;

/// A structural line, nearly along its direction or far from it.
#[derive(Clone, Debug)]
struct Scene {
    rig: Rig,
    host: NavState,
    camera: usize,
    line: HostedLine,
    manhattan: Manhattan,
}

impl Scene {
    fn residual(&self) -> Vector2<f64> {
        let host = Lifted::camera(&self.rig, &self.host, self.camera);
        residual(&self.manhattan, structural(&self.line), &host, None).expect("has a direction")
    }

    /// Residual and Jacobians by one call.
    fn linearized(&self) -> (Vector2<f64>, StructuralJacobians<Jacobians<4>>, Lifted) {
        let host = Lifted::camera(&self.rig, &self.host, self.camera);
        let mut jacobians = StructuralJacobians { feature: Jacobians::zeros(), heading: Vector2::zeros() };
        let request = Linearization { at: &host, jacobians: &mut jacobians };
        let r = residual(&self.manhattan, structural(&self.line), &host, Some(request));
        let poses = (&self.host, None);
        let lifted = Lifted::of(&jacobians.feature, &self.rig, poses, (self.camera, self.camera));
        (r.expect("has a direction"), jacobians, lifted)
    }
}

fn structural(line: &HostedLine) -> (&Matrix3<f64>, Axis) {
    (&line.axes, line.axis.expect("is a structural line"))
}

fn options() -> ManhattanOptions {
    ManhattanOptions { verticals: true, vanishing_directions: true, sigma_rad: 0.002 }
}

fn scenes() -> impl Strategy<Value = Scene> {
    let rig = (isometry(0.1, 2.0), isometry(0.15, 0.1));
    let line = (vector(2.0), vector(1.0));
    (rig, isometry(3.0, 2.0), line, -3.0..3.0f64, 0usize..3, 0usize..2).prop_filter_map(
        "the line has a plane",
        |(rig, host, (n, v), heading, axis, camera)| {
            let line = HostedLine::of(&n, &(v - n * (n.dot(&v) / n.norm_squared())))?;
            Some(Scene {
                rig: Rig {
                    pose_b_c0: rig.0,
                    pose_c0_c1: rig.1,
                    time_offset_s: 0.0,
                    intrinsics: Default::default(),
                },
                host: NavState {
                    p_o_b: host.translation.vector,
                    rot_o_b: host.rotation,
                    ..NavState::default()
                },
                camera,
                line: HostedLine { axis: Some(Axis::ALL[axis]), ..line },
                manhattan: Manhattan { options: options(), heading_rad: Some(heading), verticals: 0 },
            })
        },
    )
}

/// Central difference of the residual under a change of the scene by `h`.
fn numeric(scene: &Scene, change: impl Fn(&mut Scene, f64)) -> Vector2<f64> {
    const H: f64 = 1e-6;
    let at = |h: f64| {
        let mut moved = scene.clone();
        change(&mut moved, h);
        moved.residual()
    };
    (at(H) - at(-H)) / (2.0 * H)
}

fn is_close(analytic: &Vector2<f64>, numeric: &Vector2<f64>) -> bool {
    (analytic - numeric).norm() < 1e-5 * (1.0 + numeric.norm())
}

/// Turns everything about gravity by `h`.
fn turn_all(scene: &mut Scene, h: f64) {
    let turn = nalgebra::UnitQuaternion::from_axis_angle(&Vector3::z_axis(), h);
    scene.host.rot_o_b = turn * scene.host.rot_o_b;
    scene.manhattan.turn(h);
}

proptest! {
    #[test]
    fn jacobians_agree_with_numeric_differentiation(scene in scenes()) {
        let (r, StructuralJacobians { feature: j, heading: by_heading }, lifted) = scene.linearized();
        prop_assert_eq!(r, scene.residual(), "the same with and without Jacobians");
        for k in 0..6 {
            let by_host = numeric(&scene, |s, h| {
                let mut d = SVector::<f64, 15>::zeros();
                d[k] = h;
                s.host = s.host.plus(&d);
            });
            prop_assert!(is_close(&lifted.host.column(k).into(), &by_host), "host {k}");
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
            prop_assert!(is_close(&j.landmark.column(k).into(), &by_line), "line {k}");
        }
        prop_assert!(is_close(&by_heading, &numeric(&scene, |s, h| s.manhattan.turn(h))), "heading");
    }

    #[test]
    fn yaw_of_the_whole_stays_unobservable(scene in scenes(), elsewhere in -0.1..0.1f64) {
        prop_assert!(numeric(&scene, turn_all).norm() < 1e-5);
        // By the Jacobians as well, and wherever the heading has been linearized.
        let mut scene = scene;
        scene.manhattan.turn(elsewhere);
        let (_, StructuralJacobians { heading: by_heading, .. }, lifted) = scene.linearized();
        let up_b = scene.host.rot_o_b.inverse() * Vector3::z();
        let by_yaw = lifted.host.fixed_view::<2, 3>(0, 3) * up_b;
        prop_assert!((by_yaw + by_heading).norm() < 1e-9 * (1.0 + by_yaw.norm()));
    }
}

/// A line of direction `v_o` that a level camera sees two metres off, below itself.
fn seen(v_o: Vector3<f64>, axis: Option<Axis>) -> HostedLine {
    seen_at(0.9, v_o, axis)
}

/// A line of direction `v_o` that a level camera sees two metres off, `down_m` below the camera.
fn seen_at(down_m: f64, v_o: Vector3<f64>, axis: Option<Axis>) -> HostedLine {
    let p_c = Vector3::new(0.4, down_m, 2.0);
    let v_c = level().transpose() * v_o;
    HostedLine { axis, ..HostedLine::of(&p_c.cross(&v_c), &v_c).expect("has a plane") }
}

fn axis_of(manhattan: &Manhattan, line: &HostedLine) -> Option<Axis> {
    manhattan.axis_of(&line.axes, line.axis, &level())
}

/// A camera that looks along x of `O`.
fn level() -> Matrix3<f64> {
    Matrix3::new(0.0, 0.0, 1.0, -1.0, 0.0, 0.0, 0.0, -1.0, 0.0)
}

#[test]
fn lines_belong_to_the_direction_they_have() {
    let manhattan = Manhattan { options: options(), heading_rad: Some(0.7), verticals: 0 };
    let heading = |degrees: f64| {
        let (sin, cos) = (0.7 + degrees.to_radians()).sin_cos();
        Vector3::new(cos, sin, 0.0)
    };
    let axis = |v: Vector3<f64>| axis_of(&manhattan, &seen(v, None));
    assert_eq!(axis(Vector3::z()), Some(Axis::Vertical));
    assert_eq!(axis(heading(0.0)), Some(Axis::Along));
    assert_eq!(axis(-heading(0.1)), Some(Axis::Along));
    assert_eq!(axis(heading(90.0)), Some(Axis::Across));
    assert_eq!(axis(heading(30.0)), None);
    assert_eq!(axis(Vector3::new(0.5, 0.0, 0.8)), None);
    let level_line = seen_at(0.1, heading(0.0), None);
    assert_eq!(axis_of(&manhattan, &level_line), None, "level with the camera it does not tell");
}

#[test]
fn a_line_at_the_edge_of_the_gate_does_not_come_and_go() {
    let manhattan = Manhattan { options: options(), heading_rad: Some(0.7), verticals: 0 };
    let v = Vector3::new(0.7_f64.cos(), 0.7_f64.sin(), 0.01);
    assert_eq!(axis_of(&manhattan, &seen(v, None)), None);
    assert_eq!(axis_of(&manhattan, &seen(v, Some(Axis::Along))), Some(Axis::Along));
}

#[test]
fn what_is_switched_off_says_nothing() {
    let off = ManhattanOptions { verticals: false, vanishing_directions: false, ..options() };
    let manhattan = Manhattan { options: off, heading_rad: Some(0.7), verticals: 0 };
    assert!(Axis::ALL.iter().all(|axis| manhattan.direction_o(*axis).is_none()));
    let line = seen(Vector3::z(), Some(Axis::Vertical));
    let host = CameraPose::new(Matrix3::identity(), Vector3::zeros());
    assert!(residual(&manhattan, structural(&line), &host, None).is_none());
    assert_eq!(axis_of(&manhattan, &line), None);
}
