//! The fleet drawn in a terminal: rows of text in place of those before, until the command ends.

use super::fleet::Fleet;
use super::terminal::is_gone;
use super::vehicle::VehicleState;
use super::{NO_VEHICLE, REDRAW};
use parking_lot::Mutex;
use rustix::termios::{Winsize, tcgetwinsize};
use std::io::{self, Write as _};
use std::time::Instant;

/// Control sequences of xterm: another screen without a cursor, and back.
const BEGIN: &str = "\x1b[?1049h\x1b[?25l";
const END: &str = "\x1b[?25h\x1b[?1049l";
/// Looks of rows, as parameters of SGR (ECMA-48, 8.3.117).
const PLAIN: &str = "0";
const DIM: &str = "2";
const RED: &str = "1;31";
const GREEN: &str = "1;32";
const YELLOW: &str = "1;33";

/// A row of text and its look.
type Row = (&'static str, String);

/// Shows the fleet until `is_over`, or the terminal is gone. `about` stands in the last row; lines of the log have to wait
/// meanwhile.
///
/// # Errors
/// When the terminal cannot be used.
pub fn show(fleet: &Mutex<Fleet>, about: &str, is_over: &impl Fn() -> bool) -> io::Result<()> {
    let mut out = io::stdout().lock();
    let mut draw = || {
        out.write_all(BEGIN.as_bytes())?;
        while !is_over() {
            let size = tcgetwinsize(&out)?;
            // A terminal at the end of a slow line must not hold up what comes from the network.
            let screen = screen(&fleet.lock(), about, Instant::now(), size);
            out.write_all(screen.as_bytes())?;
            out.flush()?;
            std::thread::sleep(REDRAW);
        }
        out.write_all(END.as_bytes())?;
        out.flush()
    };
    match draw() {
        Err(error) if is_gone(&error) => Ok(()),
        outcome => outcome,
    }
}

/// The whole screen as of `now`, for a terminal of this size: the vehicles, and what is counted in the last row.
fn screen(fleet: &Fleet, about: &str, now: Instant, size: Winsize) -> String {
    let (columns, height) = (usize::from(size.ws_col), usize::from(size.ws_row));
    let mut rows = rows(fleet, now, columns);
    rows.resize(height.saturating_sub(1), (PLAIN, String::new()));
    // What is counted comes last: a narrow terminal cuts it off.
    let about = if about.is_empty() { String::new() } else { format!("   {about}") };
    let (malformed, refused) = (fleet.malformed, fleet.refused);
    let counts = format!("malformed messages: {malformed}   refused messages: {refused}");
    rows.push((DIM, format!(" Ctrl-C: quit{about}   {counts}")));
    let drawn = |(look, text): &Row| {
        format!("\x1b[{look}m{}\x1b[0m\x1b[K", text.chars().take(columns).collect::<String>())
    };
    format!("\x1b[H{}", rows.iter().map(drawn).collect::<Vec<_>>().join("\r\n"))
}

/// The rows of all vehicles; where there is none, what is tried to reach one, in rows of so many columns.
fn rows(fleet: &Fleet, now: Instant, columns: usize) -> Vec<Row> {
    if fleet.vehicles.is_empty() {
        let words: Vec<char> = fleet.network.chars().collect();
        let network = words.chunks(columns.max(1)).map(|row| (PLAIN, row.iter().collect()));
        return [(PLAIN, NO_VEHICLE.to_owned())].into_iter().chain(network).collect();
    }
    let of_vehicle = |(name, vehicle): (&String, &VehicleState)| {
        let blank = (PLAIN, String::new());
        [title(name, vehicle, now)].into_iter().chain(figures(vehicle, now)).chain([blank])
    };
    fleet.vehicles.iter().flat_map(of_vehicle).collect()
}

fn title(name: &str, vehicle: &VehicleState, now: Instant) -> Row {
    let look = match vehicle.presence(now) {
        "tracking" if vehicle.is_usable(now) => GREEN,
        "tracking" | "initialising" | "blind" => YELLOW,
        _ => RED,
    };
    let (quality, resets) = (vehicle.quality_words(now), vehicle.resets);
    (look, format!("{name} {}  quality {quality}  resets {resets}", vehicle.presence_words(now)))
}

fn figures(vehicle: &VehicleState, now: Instant) -> [Row; 6] {
    let v = vehicle.v_o_b;
    let velocity = match vehicle.pose_o_b {
        Some(_) => format!("{:+8.2} {:+8.2} {:+8.2} m/s  speed {:.2} m/s", v.x, v.y, v.z, v.norm()),
        None => "unknown".to_owned(),
    };
    let health = format!(
        "{}; frame {:.1} ms; lost {}, dropped {}",
        vehicle.health_summary(now),
        vehicle.news.frame_ms,
        vehicle.odom.lost + vehicle.state.lost,
        vehicle.news.dropped
    );
    [
        ("position", vehicle.position_words()),
        ("attitude", vehicle.attitude_words()),
        ("velocity", velocity),
        ("link", vehicle.link_words(now)),
        ("health", health),
        ("map", vehicle.map_words().unwrap_or_else(|| "none received".to_owned())),
    ]
    .map(|(name, text)| (PLAIN, format!("{name:<10}{text}")))
}

#[cfg(test)]
mod tests {
    use super::super::test_messages::{health, heard, odometry};
    use super::*;
    use plumbline_estimator::places::MapEstimate;
    use plumbline_estimator::{HealthBits, TrackingState};
    use plumbline_record::messages::Health;
    use std::time::Duration;

    fn text(fleet: &Fleet, now: Instant) -> String {
        let size = Winsize { ws_col: 80, ws_row: 20, ws_xpixel: 0, ws_ypixel: 0 };
        screen(fleet, "page: http://127.0.0.1:8080", now, size)
    }

    #[test]
    fn a_pose_without_a_valid_estimate_is_none() {
        let (mut fleet, now) = (Fleet::default(), Instant::now());
        fleet.alive("drone", true);
        let mut message = odometry(1, 0.0, 0).message;
        (message.quality, message.state) = (-1, TrackingState::Failed);
        let message = heard(1, message);
        fleet.odom("drone", &message, 100, now, 0);
        let shown = text(&fleet, now);
        for part in ["position  no pose", "attitude  unknown", "velocity  unknown", "no valid estimate"] {
            assert!(shown.contains(part), "no '{part}' in\n{shown}");
        }
    }

    #[test]
    fn a_vehicle_is_shown_with_pose_attitude_quality_and_faults() {
        let mut fleet = Fleet::default();
        let now = Instant::now();
        fleet.alive("drone", true);
        let mut message = odometry(1, 0.0, 0).message;
        (message.quality, message.v_o_b.x) = (87, 0.5);
        message.pose_o_b = nalgebra::Isometry3::translation(1.25, -2.5, 0.75);
        fleet.odom("drone", &heard(1, message), 100, now, 0);
        let mounted = Some(nalgebra::UnitQuaternion::identity());
        let mut health =
            health(1, Health { bits: HealthBits(1 << 3), rot_v_b: mounted, ..Health::default() });
        fleet.health("drone", &health, 100, now);
        let correction = MapEstimate { keyframes: 2, ..MapEstimate::default() };
        fleet.vehicle("drone").unwrap().corrected.apply_correction(heard(0, correction));
        let shown = text(&fleet, now);
        let attitude = "roll   +0.0°  pitch  +0.0°  heading 000°";
        for part in [
            "drone",
            "tracking",
            "quality 87 %",
            "+1.250",
            "-2.500",
            attitude,
            "1σ 0.000 m",
            "speed 0.50 m/s",
            "latency 0.0 ms",
            "few features",
            "map       2 keyframes, place in the map not known yet",
        ] {
            assert!(shown.contains(part), "'{part}' is missing in\n{shown}");
        }
        // Without a mounting there is no attitude, and the operator learns why, once.
        let notices = vec!["mounting unknown: set it".to_owned()];
        (health.message.rot_v_b, health.message.sensors.notices) = (None, notices);
        for sequence in [2, 3] {
            health.envelope.sequence = sequence;
            fleet.health("drone", &health, 100, now);
        }
        let shown = text(&fleet, now);
        assert!(
            shown.contains("attitude  unknown") && shown.contains("few features, mounting unknown"),
            "{shown}"
        );
        let announced = fleet.events.iter().filter(|event| event.text == "mounting unknown: set it");
        assert_eq!(announced.count(), 1);
        assert!(text(&fleet, now + Duration::from_secs(1)).contains("stale"));
        let mut doubtful = odometry(2, 0.0, 0).message;
        doubtful.quality = 19;
        fleet.odom("drone", &heard(2, doubtful), 100, now, 0);
        assert!(text(&fleet, now).contains("tracking, not for use"));
        // Of a vehicle that is gone nothing is said that sounds well.
        let gone = text(&fleet, now + Duration::from_secs(9));
        assert!(gone.contains("lost") && gone.contains("quality -"), "{gone}");
        assert!(gone.contains("health unknown") && !gone.contains("no faults"), "{gone}");
    }

    #[test]
    fn the_absence_of_vehicles_is_shown_with_what_is_tried() {
        let mut fleet = Fleet::default();
        fleet.network = "Connecting to tcp/127.0.0.1:7447".into();
        let shown = text(&fleet, Instant::now());
        for part in [NO_VEHICLE, "Connecting to tcp/127.0.0.1:7447", "page: http://127.0.0.1:8080"] {
            assert!(shown.contains(part), "'{part}' is missing in\n{shown}");
        }
    }
}
