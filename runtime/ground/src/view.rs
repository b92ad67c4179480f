//! The fleet drawn in a terminal.

mod keyboard;

use super::fleet::{Fleet, lock};
use super::terminal::is_gone;
use super::vehicle::VehicleState;
use super::{NO_VEHICLE, REDRAW, quit};
use crossterm::event::{self, Event, KeyCode, KeyModifiers};
use keyboard::Keyboard;
use ratatui::Frame;
use ratatui::backend::Backend as _;
use ratatui::layout::{Constraint, Layout, Rect};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Paragraph, Wrap};
use std::io;
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

/// Lines that one vehicle takes, border included.
const VEHICLE_LINES: u16 = FIGURES + 2;
/// Lines of numbers.
const FIGURES: u16 = 6;

/// Shows the fleet until `is_over`, or q or Ctrl-C, or the terminal is gone. `about` stands in the last line; lines of
/// the log have to wait meanwhile.
///
/// # Errors
/// When the terminal cannot be used.
pub fn show(
    fleet: &Mutex<Fleet>,
    about: &str,
    is_over: &impl Fn() -> bool,
    stop: &AtomicBool,
) -> io::Result<()> {
    let keyboard = Keyboard::open()?;
    let mut terminal = ratatui::try_init()?;
    let outcome = (|| -> io::Result<bool> {
        terminal.hide_cursor()?;
        while !is_over() {
            terminal.autoresize()?;
            // A terminal at the end of a slow line must not hold up what comes from the network.
            draw(&mut terminal.get_frame(), &lock(fleet), about, Instant::now());
            terminal.flush()?;
            terminal.swap_buffers();
            terminal.backend_mut().flush()?;
            if !keyboard.wait(REDRAW) {
                return Ok(true);
            }
            obey_keys(stop)?;
        }
        Ok(false)
    })();
    let has_gone = match &outcome {
        Ok(has_gone) => *has_gone,
        Err(error) => is_gone(error),
    };
    if has_gone {
        // Nothing is left to be restored, and nobody to be told so.
        std::mem::forget(terminal);
        quit(stop);
        return Ok(());
    }
    let restored = ratatui::try_restore();
    outcome.and(restored)
}

/// Takes the keys that were pressed.
fn obey_keys(stop: &AtomicBool) -> io::Result<()> {
    while event::poll(Duration::ZERO)? {
        let Event::Key(key) = event::read()? else { continue };
        let interrupt = key.code == KeyCode::Char('c') && key.modifiers.contains(KeyModifiers::CONTROL);
        if interrupt || key.code == KeyCode::Char('q') {
            quit(stop);
        }
    }
    Ok(())
}

/// Draws the fleet as of `now`, the log below it, and `about` in the last line.
pub fn draw(frame: &mut Frame<'_>, fleet: &Fleet, about: &str, now: Instant) {
    let whole = frame.area();
    let [upper, foot_area] = Layout::vertical([Constraint::Fill(1), Constraint::Length(1)]).areas(whole);
    let mut rows = vec![Constraint::Length(VEHICLE_LINES); fleet.vehicles.len().max(1)];
    rows.push(Constraint::Fill(1));
    let areas = Layout::vertical(rows).split(upper);
    if fleet.vehicles.is_empty() {
        let words = [NO_VEHICLE, &fleet.network].join("\n");
        let words = Paragraph::new(words).wrap(Wrap { trim: false });
        frame.render_widget(words.block(Block::bordered()), areas[0]);
    }
    for ((name, vehicle), area) in fleet.vehicles.iter().zip(areas.iter()) {
        draw_vehicle(frame, name, vehicle, now, *area);
    }
    // What is counted comes last: a narrow terminal cuts it off.
    let about = if about.is_empty() { String::new() } else { format!("   {about}") };
    let counts = format!("malformed messages: {}   refused messages: {}", fleet.malformed, fleet.refused);
    let foot = format!(" q: quit{about}   {counts}");
    frame.render_widget(Line::styled(foot, Style::new().add_modifier(Modifier::DIM)), foot_area);
}

/// Draws the numbers of a vehicle.
fn draw_vehicle(frame: &mut Frame<'_>, name: &str, vehicle: &VehicleState, now: Instant, area: Rect) {
    let block = Block::bordered().title(title(name, vehicle, now));
    let inner = block.inner(area);
    frame.render_widget(block, area);
    frame.render_widget(Paragraph::new(figures(vehicle, now)), inner);
}

fn title(name: &str, vehicle: &VehicleState, now: Instant) -> Line<'static> {
    let presence = vehicle.presence(now);
    let (colour, use_words) = match presence {
        "tracking" if vehicle.is_usable(now) => (Color::Green, ""),
        "tracking" => (Color::Yellow, ", not for use"),
        "initialising" | "blind" => (Color::Yellow, ""),
        _ => (Color::Red, ""),
    };
    Line::from(vec![
        Span::raw(format!(" {name} ")),
        Span::styled(format!("{presence}{use_words}"), Style::new().fg(colour).add_modifier(Modifier::BOLD)),
        Span::raw(format!("  quality {}  resets {} ", vehicle.quality_words(now), vehicle.resets)),
    ])
}

fn figures(vehicle: &VehicleState, now: Instant) -> Vec<Line<'static>> {
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
    let label =
        |text: &'static str| Span::styled(format!("{text:<10}"), Style::new().add_modifier(Modifier::DIM));
    [
        ("position", vehicle.position_words()),
        ("attitude", vehicle.attitude_words()),
        ("velocity", velocity),
        ("link", vehicle.link_words(now)),
        ("health", health),
        ("map", vehicle.map_words().unwrap_or_else(|| "none received".to_owned())),
    ]
    .into_iter()
    .map(|(name, text)| Line::from(vec![label(name), Span::raw(text)]))
    .collect()
}

#[cfg(test)]
mod tests {
    use super::super::test_messages::{health, heard, odometry};
    use super::*;
    use plumbline_estimator::places::MapEstimate;
    use plumbline_estimator::{HealthBits, TrackingState};
    use plumbline_record::messages::Health;
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    /// A terminal of the usual width.
    const COLUMNS: u16 = 80;

    fn text(fleet: &Fleet, now: Instant) -> String {
        let mut terminal = Terminal::new(TestBackend::new(COLUMNS, 20)).unwrap();
        terminal.draw(|frame| draw(frame, fleet, "page: http://127.0.0.1:8080", now)).unwrap();
        let buffer = terminal.backend().buffer();
        buffer
            .content()
            .chunks(COLUMNS.into())
            .map(|row| row.iter().map(|c| c.symbol()).collect::<String>() + "\n")
            .collect()
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
