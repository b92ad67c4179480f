//! The local socket of a flight, by the client that every language has.

use crate::errors::{ArgumentError, BusyError, ConnectionLost, RunError};
use crate::estimator::reset_kind;
use crate::table::state;
use plumbline_client::{ClientError, Local};
use plumbline_config::Timestamp;
use plumbline_record::layout;
use plumbline_record::local::record::{Kind, Kinds};
use plumbline_record::local::request::{At, MAX_PATIENCE_MS, Request, RequestStatus};
use plumbline_record::protobuf::decode;
use plumbline_record::said::FullEstimate;
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::{Mutex, MutexGuard};
use std::time::{Duration, Instant};

/// Period of the check for Ctrl-C.
const SIGNAL_PERIOD: Duration = Duration::from_millis(50);
/// Longest time that is waited for an answer, s.
const ANSWER_LIMIT_S: f64 = 10.0;
/// Longest wait that is taken as one: a century.
const MAX_WAIT_S: f64 = 3e9;

/// Connection to a flight: see `plumbline.Connection`.
#[pyclass(frozen, module = "plumbline._native")]
pub struct Connection {
    local: Mutex<Option<Local>>,
    #[pyo3(get)]
    may_command: bool,
}

fn lost(error: &ClientError) -> PyErr {
    ConnectionLost::new_err(error.to_string())
}

fn seconds(name: &str, seconds: f64) -> PyResult<Duration> {
    if (0.0..=MAX_WAIT_S).contains(&seconds) {
        return Ok(Duration::from_secs_f64(seconds));
    }
    Err(ArgumentError::new_err(format!("{name}: expected seconds from 0 on, got {seconds}")))
}

impl Connection {
    fn lock(&self) -> PyResult<MutexGuard<'_, Option<Local>>> {
        let busy =
            |_| BusyError::new_err("the connection is in use by another thread; make another connection");
        self.local.try_lock().map_err(busy)
    }
}

fn closed() -> PyErr {
    ConnectionLost::new_err("the connection is closed; connect again")
}

#[pymethods]
impl Connection {
    #[new]
    fn new(
        py: Python<'_>,
        path: PathBuf,
        patience_s: f64,
        odometry: bool,
        estimates: bool,
    ) -> PyResult<Self> {
        let patience = seconds("patience_s", patience_s)?;
        let mut kinds = Kinds::default();
        if odometry {
            kinds = kinds.and(Kinds::of(&[Kind::Odometry]));
        }
        if estimates {
            kinds = kinds.and(Kinds::of(&[Kind::FullEstimate]));
        }
        let connected = py.detach(|| {
            let mut local = Local::connect(path, patience)?;
            local.subscribe(kinds)?;
            Ok(local)
        });
        let local = connected.map_err(|error| lost(&error))?;
        Ok(Self { may_command: local.may_command(), local: Mutex::new(Some(local)) })
    }

    /// Next odometry or estimate with the count of losses so far; the first is `None` when none came in time, and the whole is
    /// `None` at the end of the flight.
    fn next(
        &self,
        py: Python<'_>,
        timeout_s: Option<f64>,
        losses: u64,
    ) -> PyResult<Option<(Option<Py<PyAny>>, u64)>> {
        let timeout = timeout_s.map(|timeout| seconds("timeout_s", timeout)).transpose()?;
        let deadline = timeout.and_then(|timeout| Instant::now().checked_add(timeout));
        let mut guard = self.lock()?;
        let local = guard.as_mut().ok_or_else(closed)?;
        let mut losses = losses;
        loop {
            let left = deadline.map(|deadline| deadline.saturating_duration_since(Instant::now()));
            let wait = left.map_or(SIGNAL_PERIOD, |left| left.min(SIGNAL_PERIOD));
            let header = py.detach(|| local.next_header(Some(wait))).map_err(|error| lost(&error))?;
            let Some(header) = header else {
                py.check_signals()?;
                if left.is_some_and(|left| left <= wait) {
                    return Ok(Some((None, losses)));
                }
                continue;
            };
            let (foreign, content) = (|what| lost(&ClientError::Foreign(what)), local.content());
            let record = match Kind::of_kind(header.kind) {
                Some(Kind::Odometry) => state(py, "Odometry", &layout::odometry(content).map_err(foreign)?.0),
                Some(Kind::FullEstimate) => {
                    let FullEstimate { estimate, .. } = decode(content).map_err(foreign)?;
                    state(py, "Estimate", &estimate)
                }
                Some(Kind::Lost) => {
                    let count = content.first_chunk().ok_or("a count is too short").map_err(foreign)?;
                    losses = u64::from_le_bytes(*count);
                    continue;
                }
                Some(Kind::End) => return Ok(None),
                _ => continue,
            };
            return Ok(Some((Some(record?), losses)));
        }
    }

    /// State at an instant.
    fn at(&self, py: Python<'_>, stamp_ns: i64, patience_s: f64, settled: bool) -> PyResult<Py<PyAny>> {
        let patience_ms = seconds("patience_s", patience_s)?.as_millis();
        let patience_ms = u32::try_from(patience_ms).ok().filter(|ms| *ms <= MAX_PATIENCE_MS);
        let patience_ms = patience_ms.ok_or_else(|| {
            let most = f64::from(MAX_PATIENCE_MS) * 1e-3;
            ArgumentError::new_err(format!("patience_s: expected {most} at most, got {patience_s}"))
        })?;
        let at = At { stamp: Timestamp::from_nanos(stamp_ns), patience_ms, is_settled: settled };
        let mut guard = self.lock()?;
        let local = guard.as_mut().ok_or_else(closed)?;
        let told = py.detach(|| local.at(at)).map_err(|error| lost(&error))?;
        let bytes = told.map_err(|answer| RunError::new_err(answer.words))?;
        let (answer, _) = layout::instant(&bytes).map_err(|what| lost(&ClientError::Foreign(what)))?;
        match answer.outcome.refusal() {
            None => state(py, "Instant", &answer),
            Some(why) => Err(RunError::new_err(format!("no state at {stamp_ns} ns: {why}"))),
        }
    }

    /// Resets the estimator of the flight, and waits for its answer.
    fn reset(&self, py: Python<'_>, kind: &str, timeout_s: f64) -> PyResult<String> {
        let request = Request::Reset(reset_kind(kind)?);
        let timeout = seconds("timeout_s", timeout_s.min(ANSWER_LIMIT_S))?;
        let guard = self.lock()?;
        let local = guard.as_ref().ok_or_else(closed)?;
        let answer = py.detach(|| local.command(&request, timeout)).map_err(|error| lost(&error))?;
        match answer.status {
            RequestStatus::Done => Ok(answer.words),
            _ => Err(RunError::new_err(format!("the flight refused the reset: {}", answer.words))),
        }
    }

    fn close(&self) -> PyResult<()> {
        *self.lock()? = None;
        Ok(())
    }
}
