//! The fleet drawn in a terminal.

mod above;

use super::fleet::Fleet;
use super::listen::lock;
use super::vehicle::Vehicle;
use super::{REDRAW, quit};
use anyhow::Result;
use crossterm::event::{self, Event, KeyCode, KeyModifiers};
use ratatui::Frame;
use ratatui::backend::Backend as _;
use ratatui::layout::{Constraint, Layout};
use ratatui::style::{Color, Modifier, Style};
use ratatui::text::{Line, Span};
use ratatui::widgets::{Block, Paragraph};
use std::sync::Mutex;
use std::sync::atomic::AtomicBool;
use std::time::Instant;

/// Lines that one vehicle takes, border included.
const VEHICLE_LINES: u16 = 7;
/// Lines from which on the view from above is worth its place.
const MIN_ABOVE_LINES: u16 = 6;

/// Shows the fleet until `is_over`, or q, Escape or Ctrl-C.
///
/// # Errors
/// When the terminal cannot be used.
pub fn show(fleet: &Mutex<Fleet>, is_over: &impl Fn() -> bool, stop: &AtomicBool) -> Result<()> {
    let mut terminal = ratatui::try_init()?;
    terminal.hide_cursor()?;
    let outcome = (|| {
        while !is_over() {
            terminal.autoresize()?;
            // A terminal at the end of a slow line must not hold up what comes from the network.
            draw(&mut terminal.get_frame(), &lock(fleet), Instant::now());
            terminal.flush()?;
            terminal.swap_buffers();
            terminal.backend_mut().flush()?;
            if event::poll(REDRAW)?
                && let Event::Key(key) = event::read()?
            {
                let interrupt =
                    key.code == KeyCode::Char('c') && key.modifiers.contains(KeyModifiers::CONTROL);
                if interrupt || matches!(key.code, KeyCode::Char('q') | KeyCode::Esc) {
                    quit(stop);
                }
            }
        }
        Ok(())
    })();
    ratatui::restore();
    outcome
}

/// Draws the fleet as of `now`.
pub fn draw(frame: &mut Frame<'_>, fleet: &Fleet, now: Instant) {
    let mut rows = vec![Constraint::Length(VEHICLE_LINES); fleet.vehicles.len().max(1)];
    rows.push(Constraint::Fill(1));
    rows.push(Constraint::Length(1));
    let areas = Layout::vertical(rows).split(frame.area());
    if fleet.vehicles.is_empty() {
        frame.render_widget(Paragraph::new("no vehicle heard yet").block(Block::bordered()), areas[0]);
    }
    for ((name, vehicle), area) in fleet.vehicles.iter().zip(areas.iter()) {
        frame.render_widget(panel(name, vehicle, now), *area);
    }
    let above = areas[areas.len() - 2];
    if above.height >= MIN_ABOVE_LINES {
        above::draw(frame, fleet, above);
    }
    let foot = format!(" q quits   malformed {}   refused {}", fleet.malformed, fleet.refused);
    frame.render_widget(Line::styled(foot, Style::new().add_modifier(Modifier::DIM)), areas[areas.len() - 1]);
}

fn panel(name: &str, vehicle: &Vehicle, now: Instant) -> Paragraph<'static> {
    let presence = vehicle.presence(now);
    let colour = match presence {
        "tracking" => Color::Green,
        "initialising" | "blind" => Color::Yellow,
        _ => Color::Red,
    };
    let p = vehicle.pose_o_b.map(|pose| pose.translation.vector);
    let position = p.map_or_else(
        || "no pose".to_owned(),
        |p| format!("{:+8.3} {:+8.3} {:+8.3} m   sigma {:.3} m", p.x, p.y, p.z, vehicle.sigma_m()),
    );
    let attitude = vehicle.attitude_deg().map_or_else(
        || "no attitude".to_owned(),
        |[roll, pitch, yaw]| format!("roll {roll:+6.1}  pitch {pitch:+6.1}  yaw {yaw:+6.1} deg"),
    );
    let v = vehicle.v_o_b;
    let health =
        if vehicle.health_words.is_empty() { "healthy".to_owned() } else { vehicle.health_words.join(", ") };
    let label =
        |text: &'static str| Span::styled(format!("{text:<10}"), Style::new().add_modifier(Modifier::DIM));
    let lines = vec![
        Line::from(vec![label("position"), Span::raw(position)]),
        Line::from(vec![label("attitude"), Span::raw(attitude)]),
        Line::from(vec![
            label("velocity"),
            Span::raw(format!("{:+6.2} {:+6.2} {:+6.2} m/s   speed {:.2}", v.x, v.y, v.z, v.norm())),
        ]),
        Line::from(vec![
            label("link"),
            Span::raw(format!(
                "odom {:.0} Hz  state {:.0} Hz  latency {:.2} ms  lost {}  dropped {}",
                vehicle.odom.rate_hz(now),
                vehicle.state.rate_hz(now),
                vehicle.latency_ms.unwrap_or(0.0),
                vehicle.odom.lost + vehicle.state.lost,
                vehicle.dropped
            )),
        ]),
        Line::from(vec![label("health"), Span::raw(format!("{health}; frame {:.1} ms", vehicle.frame_ms))]),
    ];
    let title = Line::from(vec![
        Span::raw(format!(" {name} ")),
        Span::styled(presence.to_owned(), Style::new().fg(colour).add_modifier(Modifier::BOLD)),
        Span::raw(format!("  quality {}  resets {} ", vehicle.quality, vehicle.resets)),
    ]);
    Paragraph::new(lines).block(Block::bordered().title(title))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::net::proto;
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;
    use std::time::Duration;

    fn text(fleet: &Fleet, now: Instant) -> String {
        let mut terminal = Terminal::new(TestBackend::new(90, 18)).unwrap();
        terminal.draw(|frame| draw(frame, fleet, now)).unwrap();
        let buffer = terminal.backend().buffer();
        buffer
            .content()
            .chunks(90)
            .map(|row| row.iter().map(|c| c.symbol()).collect::<String>() + "\n")
            .collect()
    }

    #[test]
    fn a_vehicle_is_shown_with_pose_quality_and_what_ails_it() {
        let mut fleet = Fleet::default();
        let now = Instant::now();
        fleet.alive("drone", true);
        let message = proto::Odom {
            header: Some(proto::Header { sequence: 1, quality: 87, ..proto::Header::default() }),
            state: proto::TrackingState::Tracking.into(),
            pose: Some(proto::Pose {
                position_o_b: Some(proto::Vector3 { x: 1.25, y: -2.5, z: 0.75 }),
                rotation_o_b: Some(proto::Quaternion { x: 0.0, y: 0.0, z: 0.0, w: 1.0 }),
            }),
            velocity_o_b: Some(proto::Vector3 { x: 0.5, y: 0.0, z: 0.0 }),
            ..proto::Odom::default()
        };
        fleet.odom("drone", &message, 100, now, 0);
        let health = proto::Health {
            header: message.header,
            state: message.state,
            bits: 1 << 3,
            ..proto::Health::default()
        };
        fleet.health("drone", &health, 100, now);
        let shown = text(&fleet, now);
        for part in
            ["drone", "tracking", "quality 87", "+1.250", "-2.500", "few features", "from above", "● drone"]
        {
            assert!(shown.contains(part), "'{part}' is missing in\n{shown}");
        }
        assert!(text(&fleet, now + Duration::from_secs(1)).contains("stale"));
        assert!(text(&fleet, now + Duration::from_secs(9)).contains("lost"));
    }

    #[test]
    fn nobody_heard_is_said() {
        assert!(text(&Fleet::default(), Instant::now()).contains("no vehicle heard yet"));
    }
}
