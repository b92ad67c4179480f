//! The estimator's half.
#![allow(unsafe_code)]

use crate::call::call;
use crate::handles::Registry;
use crate::pointers::{self, Out, out};
use crate::status::{CallFailure, Error, Status};
use crate::types::{Estimate, Estimator, Frame, ImuSample, Odometry, Reset};
use plumbline_config::{Config, ConfigError, ImageView, Timestamp, ValidConfig};
use plumbline_estimator::{FrameInput, HealthBits, ImuAdmission, ResetKind};
use plumbline_record::digest::Digest;
use plumbline_record::layout;
use std::ffi::c_char;
use std::ptr::without_provenance_mut;

static ESTIMATORS: Registry<Core> = Registry::new();

/// Object behind a handle.
struct Core {
    estimator: plumbline_estimator::Estimator,
    sizes_px: Vec<(usize, usize)>,
    digest: Digest,
    health: HealthBits,
    /// A record on its way to the caller.
    bytes: Vec<u8>,
}

impl Core {
    fn new(config: &ValidConfig) -> Self {
        Self {
            estimator: plumbline_estimator::Estimator::new(config.setup()),
            sizes_px: config.camera.iter().map(|camera| (camera.width_px, camera.height_px)).collect(),
            digest: Digest::default(),
            health: HealthBits::default(),
            bytes: Vec::with_capacity(layout::ESTIMATE_BYTES),
        }
    }

    fn add_imu(&mut self, sample: &ImuSample, to: Option<Out<Odometry>>) -> Result<Status, CallFailure> {
        let sample = sample.of_estimator();
        let (admission, odometry) = self.estimator.propagate_admitted(&sample);
        if let Some(failure) = refusal(admission) {
            return Err(failure);
        }
        let Some(odometry) = odometry else { return Ok(Status::NoPose) };
        if let Some(to) = to {
            self.bytes.clear();
            layout::put_odometry(&odometry, 0, self.health.0, &mut self.bytes);
            to.write_record(&self.bytes);
        }
        Ok(Status::Ok)
    }

    fn add_frame(&mut self, frame: &Frame, to: Option<Out<Estimate>>) -> Result<Status, CallFailure> {
        let images = [self.image(frame, 0)?, self.image(frame, 1)?];
        let input = FrameInput::new(Timestamp::from_nanos(frame.stamp_ns), images).numbered(frame.sequence);
        let estimate = self.estimator.add_frame(&input);
        self.digest.add(&estimate);
        self.health = estimate.health;
        if let Some(to) = to {
            self.bytes.clear();
            layout::put_estimate(&estimate, 0, &mut self.bytes);
            to.write_record(&self.bytes);
        }
        if estimate.is_refused() {
            let text =
                "the stamp of the frame is not later than that of the frame before; the frame was refused";
            return Err(CallFailure::new(Status::OutOfOrder, text));
        }
        Ok(if estimate.has_pose() { Status::Ok } else { Status::NoPose })
    }

    /// An image that is lent, of the size of its camera.
    fn image<'a>(&self, frame: &Frame, camera: usize) -> Result<Option<ImageView<'a>>, CallFailure> {
        let (image, side) = [(&frame.left, "left"), (&frame.right, "right")][camera];
        let Some(view) = pointers::image(image, side)? else { return Ok(None) };
        let text = match self.sizes_px.get(camera) {
            Some(size) if *size == (view.width(), view.height()) => return Ok(Some(view)),
            Some((width, height)) => format!("the configuration has {width} x {height} px"),
            None => "the configuration has one camera".into(),
        };
        let own = format!("the {side} image has {} x {} px", view.width(), view.height());
        Err(CallFailure::new(Status::ImageSize, format!("{own}, and {text}; they have to agree")))
    }
}

impl ImuSample {
    pub(crate) fn of_estimator(&self) -> plumbline_config::ImuSample {
        plumbline_config::ImuSample {
            stamp: Timestamp::from_nanos(self.stamp_ns),
            gyro: self.gyro_rad_s.into(),
            accel: self.accel_m_s2.into(),
        }
    }
}

/// Failure for a sample that was refused.
fn refusal(admission: ImuAdmission) -> Option<CallFailure> {
    let (status, text) = match admission {
        ImuAdmission::Accepted | ImuAdmission::ClockSet => return None,
        ImuAdmission::NotLater => {
            (Status::OutOfOrder, "its stamp is not later than that of the sample before")
        }
        ImuAdmission::FarAhead => (Status::FarAhead, "its stamp is far later than that of the sample before"),
        ImuAdmission::NotFinite => (Status::NotFinite, "a value is not a finite number"),
        ImuAdmission::OutOfRange => (Status::OutOfRange, "a value is far beyond the sensor's range in [imu]"),
    };
    Some(CallFailure::new(status, format!("the inertial sample was refused: {text}")))
}

fn create(
    config: Result<ValidConfig, ConfigError>,
    estimator: Out<*mut Estimator>,
) -> Result<Status, CallFailure> {
    let config = config.map_err(|error| CallFailure::new(Status::Configuration, error.to_string()))?;
    estimator.write(without_provenance_mut(ESTIMATORS.add(Core::new(&config))));
    Ok(Status::Ok)
}

/// Makes an estimator by a configuration in TOML. Free it with plumbline_estimator_free.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plumbline_estimator_from_toml(
    text: *const c_char,
    estimator: *mut *mut Estimator,
    error: *mut Error,
) -> Status {
    call(error, || {
        let to = out(estimator, "the place for the estimator")?;
        create(Config::from_toml_str(pointers::text(text, "the configuration")?, "configuration"), to)
    })
}

/// Makes an estimator by a configuration file. Free it with plumbline_estimator_free.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plumbline_estimator_from_file(
    path: *const c_char,
    estimator: *mut *mut Estimator,
    error: *mut Error,
) -> Status {
    call(error, || {
        let to = out(estimator, "the place for the estimator")?;
        create(Config::load(pointers::path(path)?), to)
    })
}

/// Frees an estimator.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plumbline_estimator_free(estimator: *mut Estimator, error: *mut Error) -> Status {
    call(error, || ESTIMATORS.free(estimator.addr()).map(|()| Status::Ok))
}

/// Adds an inertial sample, in order of time, and carries the newest estimate forward to its time. `odometry` may be null;
/// it is written where PLUMBLINE_STATUS_OK is returned, and PLUMBLINE_STATUS_NO_POSE is while there is no pose.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plumbline_estimator_add_imu(
    estimator: *mut Estimator,
    sample: *const ImuSample,
    odometry: *mut Odometry,
    error: *mut Error,
) -> Status {
    call(error, || {
        let sample = pointers::read(sample, "the sample")?;
        ESTIMATORS.with(estimator.addr(), |core| core.add_imu(&sample, Out::wanted(odometry)))
    })
}

/// Writes the time up to which inertial samples have to be added before the frame of `image_stamp_ns` is.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plumbline_estimator_imu_needed_until(
    estimator: *mut Estimator,
    image_stamp_ns: i64,
    needed_ns: *mut i64,
    error: *mut Error,
) -> Status {
    call(error, || {
        let to = out(needed_ns, "the place for the time")?;
        ESTIMATORS.with(estimator.addr(), |core| {
            to.write(core.estimator.imu_needed_until(Timestamp::from_nanos(image_stamp_ns)).as_nanos());
            Ok(Status::Ok)
        })
    })
}

/// Adds a frame, whose images are lent for the time of the call and not copied, and computes the estimate at its time.
/// `estimate` may be null; it is written unless an argument is refused. PLUMBLINE_STATUS_NO_POSE is returned while there
/// is no pose.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plumbline_estimator_add_frame(
    estimator: *mut Estimator,
    frame: *const Frame,
    estimate: *mut Estimate,
    error: *mut Error,
) -> Status {
    call(error, || {
        let frame = pointers::read(frame, "the frame")?;
        ESTIMATORS.with(estimator.addr(), |core| core.add_frame(&frame, Out::wanted(estimate)))
    })
}

/// Resets the estimator before the next frame; `kind` is a plumbline_reset.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plumbline_estimator_reset(
    estimator: *mut Estimator,
    kind: u32,
    error: *mut Error,
) -> Status {
    call(error, || {
        let kind = reset_kind(kind)?;
        ESTIMATORS.with(estimator.addr(), |core| {
            core.estimator.reset(kind);
            Ok(Status::Ok)
        })
    })
}

/// Kind of a reset by its number in the header.
pub(crate) fn reset_kind(kind: u32) -> Result<ResetKind, CallFailure> {
    match kind {
        _ if kind == Reset::Soft as u32 => Ok(ResetKind::Soft),
        _ if kind == Reset::Hard as u32 => Ok(ResetKind::Hard),
        _ => Err(CallFailure::new(
            Status::BadArgument,
            format!("{kind} is no kind of reset; 1 is soft, 2 is hard"),
        )),
    }
}

/// Writes the SHA-256 over the bits of all estimates so far, in hexadecimal, into 65 bytes at `digest`: the
/// `estimate_digest` of `plumbline replay` for the same configuration and samples.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn plumbline_estimator_digest(
    estimator: *mut Estimator,
    digest: *mut [c_char; 65],
    error: *mut Error,
) -> Status {
    call(error, || {
        let to = out(digest, "the place for the digest")?;
        ESTIMATORS.with(estimator.addr(), |core| {
            let mut text = [0; 65];
            pointers::write_text(text.as_mut_ptr(), text.len(), &core.digest.hex());
            to.write(text);
            Ok(Status::Ok)
        })
    })
}
