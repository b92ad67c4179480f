//! An artificial horizon in characters: the ground is filled, the sky is empty, the vehicle is the mark in the middle.
//!
//! The ground's edge is drawn in eighths of a character. With the right wing down it rises to the right, with the nose
//! up it sinks, as it is seen from the vehicle.

use super::super::attitude::Attitude;
use ratatui::Frame;
use ratatui::layout::Rect;
use ratatui::style::{Color, Style};

/// Characters from side to side, and from top to bottom; odd, so that there is a middle.
pub const COLUMNS: u16 = 21;
pub const ROWS: u16 = 5;
/// Pitch that a row stands for, degrees.
const DEG_PER_ROW: f64 = 10.0;
/// A character is this much wider than high.
const ASPECT: f64 = 0.5;
/// Filled from below by eighths.
const EIGHTHS: [char; 9] = [' ', '▁', '▂', '▃', '▄', '▅', '▆', '▇', '█'];
const SKY: Color = Color::Rgb(38, 92, 140);
const GROUND: Color = Color::Rgb(124, 84, 48);
const MARK: Color = Color::LightYellow;

/// Draws it into the upper left corner of `area`, as far as there is room.
pub fn draw(frame: &mut Frame<'_>, attitude: &Attitude, area: Rect) {
    let buffer = frame.buffer_mut();
    for row in 0..ROWS.min(area.height) {
        for column in 0..COLUMNS.min(area.width) {
            let ground = ground_share(attitude, column, row);
            let (mut symbol, mut style) = (symbol(attitude, ground), Style::new().fg(GROUND).bg(SKY));
            if let Some(mark) = mark(column, row) {
                symbol = mark;
                style = Style::new().fg(MARK).bg(if ground > 0.5 { GROUND } else { SKY });
            }
            if let Some(cell) = buffer.cell_mut((area.x + column, area.y + row)) {
                cell.set_char(symbol).set_style(style);
            }
        }
    }
}

/// Share of a character that the ground fills, by its middle column.
fn ground_share(attitude: &Attitude, column: u16, row: u16) -> f64 {
    let (sin, cos) = attitude.roll_deg.to_radians().sin_cos();
    // From the middle, in heights of a character: x to the right, y up to the lower edge of this one.
    let x = (f64::from(column) - f64::from(COLUMNS / 2)) * ASPECT;
    let bottom = f64::from(ROWS / 2) - f64::from(row) - 0.5;
    // The sky's direction on the screen is (-sin, cos); the horizon is where -x sin + y cos equals -pitch.
    let horizon = (x * sin - attitude.pitch_deg / DEG_PER_ROW) / cos;
    let below = (horizon - bottom).clamp(0.0, 1.0);
    if cos > 0.0 { below } else { 1.0 - below }
}

/// The character whose ground has this share: below, or above when the vehicle is on its back.
fn symbol(attitude: &Attitude, ground: f64) -> char {
    if attitude.roll_deg.abs() <= 90.0 {
        return EIGHTHS[(ground * 8.0).round() as usize];
    }
    match ground {
        share if share >= 0.75 => '█',
        share if share >= 0.25 => '▀',
        _ => ' ',
    }
}

/// The vehicle: wings, and a point between them.
fn mark(column: u16, row: u16) -> Option<char> {
    let from_middle = column.abs_diff(COLUMNS / 2);
    match (row == ROWS / 2, from_middle) {
        (true, 0) => Some('◆'),
        (true, 3..=6) => Some('━'),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    fn at(roll_deg: f64, pitch_deg: f64) -> Attitude {
        Attitude { roll_deg, pitch_deg, heading_deg: 0.0 }
    }

    fn drawn(attitude: &Attitude) -> String {
        let mut terminal = Terminal::new(TestBackend::new(COLUMNS, ROWS)).unwrap();
        terminal.draw(|frame| draw(frame, attitude, frame.area())).unwrap();
        let cells = terminal.backend().buffer().content();
        cells
            .chunks(COLUMNS.into())
            .map(|row| row.iter().map(|c| c.symbol()).collect::<String>() + "\n")
            .collect()
    }

    #[test]
    fn a_level_vehicle_has_half_sky_and_half_ground() {
        let expected = "                     \n                     \n▄▄▄▄━━━━▄▄◆▄▄━━━━▄▄▄▄\n\
                        █████████████████████\n█████████████████████\n";
        assert_eq!(drawn(&at(0.0, 0.0)), expected);
    }

    #[test]
    fn a_raised_nose_lowers_the_horizon_and_a_lowered_right_wing_raises_it_on_the_right() {
        let (left, right) = (2, COLUMNS - 3);
        let filled = |attitude: &Attitude, column| -> f64 {
            (0..ROWS).map(|row| ground_share(attitude, column, row)).sum()
        };
        // A row stands for ten degrees.
        assert!((filled(&at(0.0, 10.0), left) - 1.5).abs() < 1e-9);
        assert!((filled(&at(0.0, -15.0), right) - 4.0).abs() < 1e-9);
        // Eight columns from the middle, each half as wide as a row is high: 4 rows times the tangent.
        let banked = at(20.0, 0.0);
        let rise = 4.0 * 20.0_f64.to_radians().tan();
        assert!((filled(&banked, right) - (2.5 + rise)).abs() < 1e-9);
        assert!((filled(&banked, left) - (2.5 - rise)).abs() < 1e-9);
    }

    #[test]
    fn on_its_back_the_vehicle_has_the_ground_above() {
        let shown = drawn(&at(180.0, 0.0));
        let rows: Vec<&str> = shown.lines().collect();
        assert!(rows[0].chars().all(|c| c == '█') && rows[4].chars().all(|c| c == ' '), "{shown}");
        assert!(rows[2].starts_with('▀'), "{shown}");
    }

    #[test]
    fn every_attitude_can_be_drawn() {
        for roll in -18..=18 {
            for pitch in -9..=9 {
                drawn(&at(f64::from(roll) * 10.0, f64::from(pitch) * 10.0));
            }
        }
    }
}
