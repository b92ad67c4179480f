//! Status of `fly` during the flight: a line that is redrawn each second on a terminal; elsewhere a line of the log when
//! tracking begins, stops or resumes, and once a minute.

use super::progress::{Glance, Progress};
use plumbline_flight::flight::sensor_watch::SensorNotices;
use std::collections::VecDeque;
use std::fmt::Write as _;
use std::io::{IsTerminal as _, Write as _};
use std::time::{Duration, Instant};
use time::OffsetDateTime;

/// Time between two drawings on a terminal.
const REDRAW: Duration = Duration::from_secs(1);
/// Time between two lines of the log.
const LOG_PERIOD: Duration = Duration::from_secs(60);
/// Without an estimate for so long the vehicle is not tracked.
const SILENCE: Duration = Duration::from_secs(1);
/// A change that lasts so long is logged.
const LASTING: Duration = Duration::from_secs(1);
/// Frames whose times are kept: those of a second at 240 Hz.
const MAX_CAME: usize = 240;
/// Longest part of a notice, characters.
const MAX_NOTICE: usize = 90;

/// Shows the status: each second on a terminal, elsewhere in the log; `notices` say what is wrong with the sensors.
///
/// # Errors
/// When the system refuses a thread.
pub fn start(notices: SensorNotices) -> std::io::Result<Progress> {
    let is_terminal = std::io::stdout().is_terminal();
    let mut status = FlyStatus::new(is_terminal, notices, Instant::now());
    let show = move |glance: Option<&Glance>| match glance {
        Some(glance) => status.take(glance, Instant::now()),
        None => status.tick(Instant::now()),
    };
    Progress::start(show, move || print!("{}", if is_terminal { "\n" } else { "" }))
}

/// Status of a flight.
struct FlyStatus {
    is_terminal: bool,
    notices: SensorNotices,
    begin: Instant,
    newest: Option<(Glance, Instant)>,
    tracking: Option<Tracking>,
    /// State that was logged last, and since when there is another one.
    logged: Option<bool>,
    other_since: Option<Instant>,
    drawn: Option<Instant>,
    minute: Instant,
    /// Arrivals of the frames of the last second.
    came: VecDeque<Instant>,
    last_frames: u64,
}

/// Since when there has been a pose.
struct Tracking {
    since: Instant,
    at: OffsetDateTime,
}

impl FlyStatus {
    /// Status for a terminal or for the log; `notices` say what is wrong with the sensors.
    fn new(is_terminal: bool, notices: SensorNotices, now: Instant) -> Self {
        Self {
            is_terminal,
            notices,
            begin: now,
            newest: None,
            tracking: None,
            logged: None,
            other_since: None,
            drawn: None,
            minute: now,
            came: VecDeque::with_capacity(MAX_CAME),
            last_frames: 0,
        }
    }

    /// Takes an estimate.
    fn take(&mut self, glance: &Glance, now: Instant) {
        // Glances may be passed over: each frame between two came by now.
        let new = glance.frames.saturating_sub(self.last_frames).min(MAX_CAME as u64);
        self.last_frames = glance.frames;
        for _ in 0..new {
            if self.came.len() == MAX_CAME {
                self.came.pop_front();
            }
            self.came.push_back(now);
        }
        self.newest = Some((*glance, now));
        if glance.has_pose && self.tracking.is_none() {
            self.tracking = Some(Tracking { since: now, at: OffsetDateTime::now_utc() });
        }
    }

    /// Draws or logs what is due.
    fn tick(&mut self, now: Instant) {
        let is_heard = self.newest.is_some_and(|(glance, at)| glance.has_pose && now - at < SILENCE);
        if !is_heard {
            self.tracking = None;
        }
        self.log_change(now);
        if self.is_terminal && self.drawn.is_none_or(|drawn| now - drawn >= REDRAW) {
            self.drawn = Some(now);
            let mut out = std::io::stdout().lock();
            let _ = write!(out, "\r{}\x1b[K", self.line(now));
            let _ = out.flush();
        }
        if !self.is_terminal && now - self.minute >= LOG_PERIOD {
            self.minute = now;
            tracing::info!("{}", self.line(now));
        }
    }

    /// Logs that tracking has begun, stopped or resumed, once it has been so for a while.
    fn log_change(&mut self, now: Instant) {
        let is_tracking = self.tracking.is_some();
        if self.logged.unwrap_or(false) == is_tracking {
            self.other_since = None;
            return;
        }
        if now - *self.other_since.get_or_insert(now) < LASTING {
            return;
        }
        self.other_since = None;
        match (is_tracking, self.logged) {
            (true, before) => {
                let verb = if before.is_none() { "" } else { "again, " };
                tracing::info!("{verb}{}", self.line(now));
            }
            (false, _) => tracing::warn!("tracking stopped: {}", self.line(now)),
        }
        self.logged = Some(is_tracking);
    }

    /// Frames of the last second.
    fn rate_hz(&self, now: Instant) -> usize {
        self.came.iter().rev().take_while(|at| now.saturating_duration_since(**at) < REDRAW).count()
    }

    /// The status as one line: tracking since, rate, points, quality, place, and what is missing.
    fn line(&self, now: Instant) -> String {
        let mut line = match &self.tracking {
            Some(Tracking { since, at }) => {
                let (hour, minute, second) = at.time().as_hms();
                format!("tracking since {hour:02}:{minute:02}:{second:02}Z ({})", length(now - *since))
            }
            None => format!("not tracking for {}", length(now - self.silent_since())),
        };
        let _ = match &self.newest {
            None => write!(line, "  no frames yet"),
            Some((glance, _)) => write!(line, "  {} frames/s  {} points", self.rate_hz(now), glance.points),
        };
        if let (Some(_), Some((glance, _))) = (&self.tracking, &self.newest) {
            let p = glance.pose_o_b.translation.vector;
            let is_usable = glance.quality >= plumbline_record::QUALITY_TO_USE;
            let (quality, how) = (glance.quality, if is_usable { "" } else { ", not for use" });
            let speed_m_s = glance.v_o_b.norm();
            let _ = write!(
                line,
                "  quality {quality} %{how}  {:.2} {:.2} {:.2} m  {speed_m_s:.2} m/s",
                p.x, p.y, p.z
            );
        }
        for notice in self.notices.read().iter().take(2) {
            let _ = write!(line, "  missing: {notice:.MAX_NOTICE$}");
        }
        line
    }

    fn silent_since(&self) -> Instant {
        self.newest.filter(|(glance, _)| glance.has_pose).map_or(self.begin, |(_, at)| at)
    }
}

/// A length of time: `83 s`, `12 min`, `2 h 5 min`.
fn length(time: Duration) -> String {
    match time.as_secs() {
        s if s < 120 => format!("{s} s"),
        s if s < 7200 => format!("{} min", s / 60),
        s => format!("{} h {} min", s / 3600, s % 3600 / 60),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use nalgebra::{Isometry3, Vector3};

    fn glance(frames: u64, has_pose: bool) -> Glance {
        Glance {
            frames,
            has_pose,
            pose_o_b: Isometry3::translation(1.0, 2.0, 3.0),
            v_o_b: Vector3::x(),
            points: 120,
            quality: 87,
            frame_ms: 4.0,
        }
    }

    #[test]
    fn the_line_says_since_when_how_fast_how_well_and_what_is_missing() {
        let (start, notices) = (Instant::now(), SensorNotices::default());
        let mut status = FlyStatus::new(false, notices.clone(), start);
        let at = |s: f64| start + Duration::from_secs_f64(s);
        assert!(status.line(at(5.0)).starts_with("not tracking for 5 s  no frames yet"));
        for k in 0..200 {
            status.take(&glance(k, k >= 20), at(0.05 * k as f64));
            status.tick(at(0.05 * k as f64));
        }
        notices.set(&["/run/frames: no program sends frames yet (driver.frames.listen)".into()]);
        let line = status.line(at(10.0));
        for part in
            ["tracking since ", "(9 s)", "120 points", "quality 87 %", "missing: /run/frames: no program"]
        {
            assert!(line.contains(part), "{part}: {line}");
        }
        assert_eq!(status.logged, Some(true));
        assert!(line.contains("  20 frames/s") || line.contains("  19 frames/s"), "{line}");
        assert!(status.line(at(11.5)).contains("  0 frames/s"), "{}", status.line(at(11.5)));
        status.take(&Glance { quality: 19, ..glance(200, true) }, at(10.0));
        assert!(status.line(at(10.0)).contains("quality 19 %, not for use"));
        // Silence ends it.
        status.tick(at(12.0));
        status.tick(at(13.5));
        assert_eq!(status.logged, Some(false));
        assert!(status.line(at(14.0)).starts_with("not tracking for 4 s"), "{}", status.line(at(14.0)));
    }
}
