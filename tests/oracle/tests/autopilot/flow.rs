//! PX4's EKF2 through a loss of the odometry, with the bridge's flow and distance and without: parameters of
//! `docs/rigs/autopilots.md`. Axes: north, east, down, and those of the vehicle, forward, right, down.

mod motion;
mod sensors;

use self::motion::{LOST_S, Motion, REST_S};
use self::sensors::{Bridge, Noise, down_facing, imu_sample, odometry};
use super::ekf2::{filter, sample, stamp_us};
use ekf2::Ekf;
use ekf2::params::{OpticalFlowControl, RangeControl};
use ekf2::types::{BaroSample, FlowSample, RangeSample};
use mavlink::dialects::common::{DISTANCE_SENSOR_DATA, OPTICAL_FLOW_RAD_DATA};
use nalgebra::Vector3;
use plumbline_config::Timestamp;
use plumbline_config::options::FlowMessages;

/// Period of the inertial samples.
const DT_S: f64 = 0.005;
/// `EKF2_OF_DELAY` and `EKF2_RNG_DELAY`: PX4 stamps these messages on arrival.
const DELAY_MS: f32 = 20.0;

/// Largest errors of EKF2 while there is no odometry, and what it fused.
#[derive(Clone, Copy, Debug, Default)]
struct Worst {
    position_m: f64,
    velocity_m_s: f64,
    /// Measurements of flow that were fused, and that were rejected.
    fused: usize,
    rejected: usize,
}

fn flow_filter() -> Ekf<'static> {
    let mut filter = filter();
    let mut params = filter.params_mut();
    params.set_of_ctrl(OpticalFlowControl::Enabled);
    params.set_of_delay_ms(DELAY_MS);
    params.set_of_quality_min(50);
    params.set_of_noise_min(0.05);
    params.set_range_ctrl(RangeControl::Conditional);
    params.set_range_aid_max_hgt_m(10.0);
    params.set_range_delay_ms(DELAY_MS);
    filter.set_optical_flow_limits(4.0, 0.22, 11.0);
    filter.set_rangefinder_limits(0.22, 11.0);
    filter.set_in_air_status(false);
    filter.set_vehicle_at_rest(true);
    filter
}

/// Sample that PX4 makes of a message that arrived at `arrival` (`EKF2::UpdateFlowSample`): rates of the opposite sign, at the middle
/// of the interval.
fn flow_sample(m: &OPTICAL_FLOW_RAD_DATA, arrival: Timestamp) -> FlowSample {
    let rate = |integral: f32| -integral / (m.integration_time_us as f32 * 1e-6);
    let gyro = [m.integrated_xgyro, m.integrated_ygyro, m.integrated_zgyro].map(rate);
    let middle_us = stamp_us(arrival) - u64::from(m.integration_time_us / 2);
    FlowSample::new(middle_us, [m.integrated_x, m.integrated_y].map(rate), gyro, m.quality)
}

fn range_sample(m: &DISTANCE_SENSOR_DATA, arrival: Timestamp) -> RangeSample {
    RangeSample::new(stamp_us(arrival), f32::from(m.current_distance) * 0.01, -1)
}

/// Flies `motion`, without odometry from [`LOST_S`] on.
fn fly(motion: &Motion, flow: FlowMessages) -> Worst {
    let config = down_facing();
    let (mut filter, mut bridge, mut noise) = (flow_filter(), Bridge::new(&config, flow), Noise::new(7));
    let (mut worst, mut samples, mut last_flow) = (Worst::default(), Vec::new(), 0);
    for k in 1..(motion::END_S / DT_S) as i64 {
        let t = DT_S * k as f64;
        let (at, now, is_lost) = (Timestamp::from_nanos((t * 1e9).round() as i64), motion.at(t), t >= LOST_S);
        if k == (REST_S / DT_S) as i64 {
            filter.set_in_air_status(true);
            filter.set_vehicle_at_rest(false);
        }
        let measured = sensors::measured(&now, is_lost, &mut noise);
        samples.push(bridge.in_body(at, &measured));
        if k % 5 == 0 && t > 5.0 {
            filter.set_ev_data(&sample(&odometry(&now, at, is_lost, &mut noise), 0.0));
        }
        if k % 10 == 0 {
            let height_m = sensors::barometer_m(t, &now, &mut noise);
            filter.set_baro_data(&BaroSample::new(stamp_us(at), height_m as f32));
            bridge.frame(at, &now, &samples, !is_lost, &mut noise);
            samples.clear();
        }
        while let Some((arrival, flow, distance)) = bridge.arrived(at) {
            if let Some(flow) = flow {
                filter.set_optical_flow_data(&flow_sample(&flow, arrival));
            }
            if let Some(distance) = distance {
                filter.set_range_data(&range_sample(&distance, arrival));
            }
        }
        filter.set_imu_data(&imu_sample(at, &measured, DT_S));
        if filter.update() && is_lost {
            let [position_m, velocity_m_s] = errors(&filter, &now);
            worst.position_m = worst.position_m.max(position_m);
            worst.velocity_m_s = worst.velocity_m_s.max(velocity_m_s);
            let source = filter.aid_src_optical_flow();
            if source.timestamp_sample != std::mem::replace(&mut last_flow, source.timestamp_sample) {
                worst.fused += usize::from(source.fused != 0);
                worst.rejected += usize::from(source.innovation_rejected != 0);
            }
        }
    }
    worst
}

fn errors(filter: &Ekf<'_>, truth: &motion::Truth) -> [f64; 2] {
    let p: Vector3<f64> = Vector3::from(filter.position_ned()).cast();
    let v: Vector3<f64> = Vector3::from(filter.velocity_ned()).cast();
    [(p - truth.p).norm(), (v - truth.v).norm()]
}

#[test]
fn px4_holds_position_on_flow_for_ten_seconds_without_odometry() {
    let motions = [
        ("hover at 2 m", Motion { speed_m_s: 0.0, swing_m: 0.0 }),
        ("1 m/s at 2 m", Motion { speed_m_s: 1.0, swing_m: 0.0 }),
        ("hover, 1.5 to 2.5 m", Motion { speed_m_s: 0.0, swing_m: 0.5 }),
        ("1 m/s, 1.5 to 2.5 m", Motion { speed_m_s: 1.0, swing_m: 0.5 }),
    ];
    for (name, motion) in motions {
        let [off, when_lost, always] =
            [FlowMessages::Off, FlowMessages::WhenLost, FlowMessages::Always].map(|flow| fly(&motion, flow));
        for (flow, worst) in [("off", off), ("when-lost", when_lost), ("always", always)] {
            let Worst { position_m, velocity_m_s, fused, rejected } = worst;
            println!(
                "{name} | {flow} | {position_m:.2} m, {velocity_m_s:.2} m/s | {fused} fused, {rejected} rejected"
            );
        }
        for worst in [when_lost, always] {
            assert!(worst.position_m < 0.5 && worst.velocity_m_s < 0.3, "{name}: {worst:?}");
            assert!(
                worst.fused > 150 && worst.position_m < 0.3 * off.position_m,
                "{name}: {worst:?}, {off:?}"
            );
        }
    }
}
