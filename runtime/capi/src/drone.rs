//! The drone's half: programs beside a flight.
#![allow(unsafe_code)]

use crate::call::call;
use crate::estimator::reset_kind;
use crate::handles::Registry;
use crate::pointers::{self, Out, out};
use crate::status::{CallFailure, Error, Status};
use crate::types::{Frame, Frames, Imu, ImuAbout, ImuSample, Local, Record, RecordContent, RecordKind};
use plumbline_client::{FrameSender, ImuLine, SensorAbout, monotonic_ns};
use plumbline_config::Timestamp;
use plumbline_record::layout;
use plumbline_record::local::record::Kind;
use plumbline_record::local::request::{Answer, At, MAX_PATIENCE_MS, Request, RequestStatus};
use std::ffi::c_char;
use std::ptr::without_provenance_mut;
use std::time::{Duration, Instant};

static LOCALS: Registry<plumbline_client::Local> = Registry::new();
static FRAMES: Registry<FrameSender> = Registry::new();
static IMUS: Registry<ImuLine> = Registry::new();

fn ms(count: u32) -> Duration {
    Duration::from_millis(count.into())
}

/// Returns the time by CLOCK_MONOTONIC, ns: what frames and inertial samples of a flight are stamped by.
#[unsafe(no_mangle)]
pub extern "C" fn plumbline_monotonic_ns() -> i64 {
    monotonic_ns()
}

/// Connects to the local socket of a flight (local.path), which may come into being within `patience_ms`. Free the
/// connection with plumbline_local_free.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plumbline_local_connect(
    path: *const c_char,
    patience_ms: u32,
    local: *mut *mut Local,
    error: *mut Error,
) -> Status {
    call(error, || {
        let to = out(local, "the place for the connection")?;
        let connection = plumbline_client::Local::connect(pointers::path(path)?, ms(patience_ms))?;
        to.write(without_provenance_mut(LOCALS.add(connection)));
        Ok(Status::Ok)
    })
}

/// Frees a connection to the local socket.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plumbline_local_free(local: *mut Local, error: *mut Error) -> Status {
    call(error, || LOCALS.free(local.addr()).map(|()| Status::Ok))
}

/// Waits for the next odometry, estimate or count of losses. Returns PLUMBLINE_STATUS_TIMEOUT when none came within
/// `timeout_ms`, and PLUMBLINE_STATUS_FLIGHT_ENDED at the end of the flight.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plumbline_local_read(
    local: *mut Local,
    timeout_ms: u32,
    record: *mut Record,
    error: *mut Error,
) -> Status {
    call(error, || {
        let to = out(record, "the place for the record")?;
        LOCALS.with(local.addr(), |local| read(local, ms(timeout_ms), to))
    })
}

fn read(
    local: &mut plumbline_client::Local,
    timeout: Duration,
    to: Out<Record>,
) -> Result<Status, CallFailure> {
    let end = Instant::now() + timeout;
    while let Some(header) = local.next_header(Some(end.saturating_duration_since(Instant::now())))? {
        let content = local.content();
        let record = match Kind::of_kind(header.kind) {
            Some(Kind::Odometry) => pointers::from_record(content)
                .map(|odometry| (RecordKind::Odometry, RecordContent { odometry })),
            Some(Kind::Estimate) => pointers::from_record(content)
                .map(|estimate| (RecordKind::Estimate, RecordContent { estimate })),
            Some(Kind::Lost) => content
                .first_chunk()
                .map(|count| (RecordKind::Lost, RecordContent { lost: u64::from_le_bytes(*count) })),
            Some(Kind::End) => return Ok(Status::FlightEnded),
            _ => continue,
        };
        let short =
            || CallFailure::new(Status::Foreign, "a record is shorter than its layout; check the path");
        let (kind, content) = record.ok_or_else(short)?;
        to.write(Record { kind, content });
        return Ok(Status::Ok);
    }
    Ok(Status::Timeout)
}

/// Writes the state at the instant `stamp_ns` of the last three seconds, such as that of a camera's trigger, by the clock of the
/// odometry. The flight waits at most `patience_ms`, up to 2000, for its inertial samples to reach the instant; where
/// `settled` is not 0, for the estimate after it too. Returns PLUMBLINE_STATUS_NO_POSE where there is no state: outcome says
/// why. Records go on coming.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plumbline_local_at(
    local: *mut Local,
    stamp_ns: i64,
    patience_ms: u32,
    settled: u32,
    instant: *mut crate::types::Instant,
    error: *mut Error,
) -> Status {
    call(error, || {
        let to = out(instant, "the place for the state")?;
        if patience_ms > MAX_PATIENCE_MS || settled > 1 {
            let text = format!("patience_ms is at most {MAX_PATIENCE_MS}, and settled 0 or 1");
            return Err(CallFailure::new(Status::BadArgument, text));
        }
        let stamp = Timestamp::from_nanos(stamp_ns);
        let at = At { stamp, patience_ms, is_settled: settled == 1 };
        let told = LOCALS.with(local.addr(), |local| Ok(local.at(at)?))?;
        let bytes = told.map_err(|answer| CallFailure::new(Status::Refused, answer.words))?;
        let foreign = |what: &str| CallFailure::new(Status::Foreign, what);
        let (answer, _) = layout::instant(&bytes).map_err(foreign)?;
        to.write(pointers::from_record(&bytes).ok_or_else(|| foreign("a state at an instant is too short"))?);
        Ok(if answer.outcome.refusal().is_none() { Status::Ok } else { Status::NoPose })
    })
}

/// Resets the estimator of the flight before its next frame; `kind` is a plumbline_reset. Records go on coming.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plumbline_local_reset(
    local: *mut Local,
    kind: u32,
    timeout_ms: u32,
    error: *mut Error,
) -> Status {
    call(error, || {
        let kind = reset_kind(kind)?;
        command(local, &Request::Reset(kind), timeout_ms)?;
        Ok(Status::Ok)
    })
}

/// Saves the map of the flight to the file of `--save-map`. `keyframes` may be null; else the number of keyframes that
/// were saved is written there.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plumbline_local_save_map(
    local: *mut Local,
    timeout_ms: u32,
    keyframes: *mut u32,
    error: *mut Error,
) -> Status {
    call(error, || {
        let answer = command(local, &Request::SaveMap, timeout_ms)?;
        if let Some(to) = Out::wanted(keyframes) {
            to.write(answer.value);
        }
        Ok(Status::Ok)
    })
}

fn command(local: *mut Local, request: &Request, timeout_ms: u32) -> Result<Answer, CallFailure> {
    LOCALS.with(local.addr(), |local| {
        let answer = local.command(request, ms(timeout_ms))?;
        match answer.status {
            RequestStatus::Done => Ok(answer),
            _ => Err(CallFailure::new(
                Status::Refused,
                format!("the flight has not done it: {}", answer.words),
            )),
        }
    })
}

/// Connects to the frame socket of a flight (driver.frames.listen), which may come into being within `patience_ms`. Free
/// the connection with plumbline_frames_free.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plumbline_frames_connect(
    path: *const c_char,
    patience_ms: u32,
    frames: *mut *mut Frames,
    error: *mut Error,
) -> Status {
    call(error, || {
        let to = out(frames, "the place for the connection")?;
        let sender = FrameSender::connect(pointers::path(path)?, ms(patience_ms))?;
        to.write(without_provenance_mut(FRAMES.add(sender)));
        Ok(Status::Ok)
    })
}

/// Frees a connection to the frame socket.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plumbline_frames_free(frames: *mut Frames, error: *mut Error) -> Status {
    call(error, || FRAMES.free(frames.addr()).map(|()| Status::Ok))
}

/// Sends a frame to the flight. Images have to have the sizes of its configuration: else it disconnects, and its log says
/// why.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plumbline_frames_send(
    frames: *mut Frames,
    frame: *const Frame,
    error: *mut Error,
) -> Status {
    call(error, || {
        let frame = pointers::read(frame, "the frame")?;
        let images = [pointers::image(&frame.left, "left")?, pointers::image(&frame.right, "right")?];
        FRAMES.with(frames.addr(), |sender| {
            sender.send(frame.sequence, Timestamp::from_nanos(frame.stamp_ns), images)?;
            Ok(Status::Ok)
        })
    })
}

/// Makes a line for an inertial sensor, and a symbolic link `path` to it: driver.imu.connect of the flight is
/// serial://PATH:921600, and its protocol is plumbline. A thread of the library answers what the flight asks. Free the
/// line with plumbline_imu_free.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plumbline_imu_open(
    path: *const c_char,
    about: *const ImuAbout,
    imu: *mut *mut Imu,
    error: *mut Error,
) -> Status {
    call(error, || {
        let to = out(imu, "the place for the line")?;
        let about = pointers::read(about, "what the sensor is")?;
        let figures = [about.rate_hz, about.gyro_range_rad_s, about.accel_range_m_s2];
        if !figures.iter().all(|figure| figure.is_finite() && *figure > 0.0) {
            let text = "rate and ranges of the sensor have to be finite and above zero; give those of [imu]";
            return Err(CallFailure::new(Status::BadArgument, text));
        }
        let [rate_hz, gyro_range_rad_s, accel_range_m_s2] = figures;
        let about = SensorAbout { rate_hz, gyro_range_rad_s, accel_range_m_s2 };
        let line = ImuLine::open(pointers::path(path)?, about)?;
        to.write(without_provenance_mut(IMUS.add(line)));
        Ok(Status::Ok)
    })
}

/// Frees the line of an inertial sensor, and removes its link.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plumbline_imu_free(imu: *mut Imu, error: *mut Error) -> Status {
    call(error, || IMUS.free(imu.addr()).map(|()| Status::Ok))
}

/// Sends an inertial sample, as soon as it was measured. One that no flight reads is dropped.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plumbline_imu_send(
    imu: *mut Imu,
    sample: *const ImuSample,
    error: *mut Error,
) -> Status {
    call(error, || {
        let sample = pointers::read(sample, "the sample")?.of_estimator();
        IMUS.with(imu.addr(), |line| {
            line.send(&sample)?;
            Ok(Status::Ok)
        })
    })
}
