//! Opens a device as the configuration wants it: format, size, rate, controls, buffers.

use super::controls::{self, ControlError, ExposureProbe};
use super::convert::{Converter, RawLayout};
use super::format::{Arrangement, PixelFormat, candidates, fourcc_text};
use super::node;
use super::offers;
use super::sys::abi::{CAP_TIME_PER_FRAME, FIELD_NONE, Format, KIND_CAPTURE_MPLANE, PlanarFormat, Zero};
use super::sys::calls;
use super::sys::queue::Queue;
use crate::DriverError;
use plumbline_config::options::V4l2Config;
use rustix::fd::{AsFd as _, BorrowedFd};
use rustix::io::Errno;
use std::path::PathBuf;

/// A rate is the one that was asked for within this share.
const RATE_TOLERANCE: f64 = 0.01;
/// Formats that messages list, at most.
const MAX_LISTED: usize = 24;

/// Device to open and the format required of it.
#[derive(Clone, Debug)]
pub(crate) struct Wanted {
    pub(crate) path: PathBuf,
    /// The key that names it.
    pub(crate) key: &'static str,
    /// Size of each camera's image, px.
    pub(crate) size_px: (usize, usize),
    /// True if it must give the images of both cameras.
    pub(crate) both: bool,
    /// Frames per second.
    pub(crate) rate_hz: f64,
    pub(crate) options: V4l2Config,
}

/// A device that streams.
#[derive(Debug)]
pub(crate) struct Stream {
    pub(crate) queue: Queue,
    pub(crate) converter: Converter,
    /// Probe of its exposure.
    pub(crate) probe: Option<ExposureProbe>,
}

/// Reason why a device does not stream.
#[derive(Debug)]
pub(crate) enum OpenError {
    /// It is not there, or went away meanwhile: it may come.
    Absent(String),
    /// It cannot do what it is asked to.
    Refused(DriverError),
}

impl OpenError {
    /// Error of the system at this device, with what was being done.
    fn from_errno(wanted: &Wanted, doing: &str, error: Errno) -> Self {
        let path = wanted.path.display();
        let key = wanted.key;
        let refused = |message: &str| Self::Refused(DriverError::refused(&wanted.path, message));
        match error {
            Errno::NOENT | Errno::NODEV | Errno::NXIO | Errno::NOTDIR => Self::Absent(format!(
                "{path}: there is no such device now; plug the camera in, or let `{key}` name another of \
                 `plumbline devices`"
            )),
            Errno::ACCESS | Errno::PERM => refused(
                "permission denied; add the user to the group video (`usermod -aG video USER`) and log in again",
            ),
            Errno::BUSY => {
                refused("another program uses the camera; end it (`fuser -v` with the path names it)")
            }
            Errno::NOSPC => refused(
                "the USB has not bandwidth enough for it; put the cameras on controllers of their own, or choose \
                 MJPEG or a lower rate",
            ),
            Errno::PIPE => refused(
                "its media pipeline is not set up; link its entities and set their formats with `media-ctl` first",
            ),
            error => refused(&format!("{doing} failed: {error}")),
        }
    }
}

/// Opens the device and starts its stream.
pub(crate) fn open(wanted: &Wanted) -> Result<Stream, OpenError> {
    let failed = |doing: &'static str| move |error| OpenError::from_errno(wanted, doing, error);
    let fd = node::open(&wanted.path).map_err(failed("opening it"))?;
    let kind = capture_kind(wanted, fd.as_fd())?;
    let layout = set_format(wanted, fd.as_fd(), kind)?;
    set_rate(wanted, fd.as_fd(), kind, &layout)?;
    controls::apply(fd.as_fd(), &wanted.options).map_err(|error| match error {
        ControlError::Refused(message) => OpenError::Refused(DriverError::refused(&wanted.path, message)),
        ControlError::Device(error) => failed("setting a control")(error),
    })?;
    let probe = ExposureProbe::new(fd.as_fd(), &wanted.options);
    let queue = Queue::start(fd, kind, wanted.options.buffers).map_err(failed("starting the stream"))?;
    Ok(Stream { queue, converter: Converter::new(layout.raw), probe })
}

fn capture_kind(wanted: &Wanted, fd: BorrowedFd<'_>) -> Result<u32, OpenError> {
    let refused = |message: &str| OpenError::Refused(DriverError::refused(&wanted.path, message));
    let capability = match calls::capability(fd) {
        Err(Errno::NOTTY | Errno::INVAL) => {
            return Err(refused("is no video device; `plumbline devices` lists those that are there"));
        }
        result => result.map_err(|error| OpenError::from_errno(wanted, "asking what it is", error))?,
    };
    node::capture_kind(&capability).ok_or_else(|| {
        refused(
            "brings no images (one of a camera's nodes does, mostly that whose name ends in index0; the others \
             carry metadata)",
        )
    })
}

/// A format as the driver has set it.
struct Granted {
    fourcc: u32,
    raw: RawLayout,
}

/// The first format that can be had in the size.
fn set_format(wanted: &Wanted, fd: BorrowedFd<'_>, kind: u32) -> Result<Granted, OpenError> {
    let offered = offers::fourccs(fd, kind);
    for (fourcc, format) in candidates(wanted.options.format) {
        let Some(arrangement) = Arrangement::of(format, wanted.both) else { continue };
        if !offered.contains(&fourcc) {
            continue;
        }
        let (width_px, height_px) = wanted.size_px;
        let size = (arrangement.device_width_px(width_px) as u32, height_px as u32);
        let set = try_format(fd, kind, fourcc, size);
        if let Some(stride) =
            set.map_err(|error| OpenError::from_errno(wanted, "setting the format", error))?
        {
            let raw = RawLayout { format, arrangement, width_px, height_px, stride };
            return Ok(Granted { fourcc, raw });
        }
    }
    Err(OpenError::Refused(DriverError::refused(&wanted.path, no_format(wanted, fd, kind))))
}

/// Asks for a format; its stride where the driver grants it as it is.
fn try_format(
    fd: BorrowedFd<'_>,
    kind: u32,
    fourcc: u32,
    (width, height): (u32, u32),
) -> Result<Option<usize>, Errno> {
    // Strides are left 0: some drivers keep a larger one that they are shown.
    let (is_granted, stride) = if kind == KIND_CAPTURE_MPLANE {
        let mut format =
            PlanarFormat { kind, width, height, fourcc, field: FIELD_NONE, plane_count: 1, ..Zero::ZERO };
        calls::set_planar_format(fd, &mut format)?;
        let PlanarFormat { width: w, height: h, fourcc: f, field, planes, .. } = format;
        ((w, h, f) == (width, height, fourcc) && field <= FIELD_NONE, planes[0].stride)
    } else {
        let mut format = Format { kind, width, height, fourcc, field: FIELD_NONE, ..Zero::ZERO };
        calls::set_format(fd, &mut format)?;
        let Format { width: w, height: h, fourcc: f, field, stride, .. } = format;
        ((w, h, f) == (width, height, fourcc) && field <= FIELD_NONE, stride)
    };
    let row = PixelFormat::from_fourcc(fourcc).and_then(PixelFormat::bytes_per_pixel);
    // A driver that leaves the stride out has no padding.
    let stride = if stride == 0 { row.unwrap_or(0) * width as usize } else { stride as usize };
    Ok(is_granted.then_some(stride))
}

/// Error for a device without the wanted format, with what it offers instead.
fn no_format(wanted: &Wanted, fd: BorrowedFd<'_>, kind: u32) -> String {
    let (width, height) = wanted.size_px;
    let what = if wanted.both { " for two cameras (side by side, or Y8I)" } else { "" };
    let mut offers: Vec<String> = offers::fourccs(fd, kind)
        .into_iter()
        .filter(|fourcc| PixelFormat::from_fourcc(*fourcc).is_some())
        .map(|fourcc| format!("{} {}", fourcc_text(fourcc), offers::sizes(fd, fourcc)))
        .collect();
    offers.truncate(MAX_LISTED);
    let offers = if offers.is_empty() { "no format that is read here".to_owned() } else { offers.join("; ") };
    format!(
        "has no image of {width} x {height} px{what} in `driver.v4l2.format`; it offers {offers}. Set width_px and \
         height_px of `[[camera]]` (and calibrate in that size), or `driver.v4l2.format`"
    )
}

/// Sets the rate, where the driver lets it be set.
fn set_rate(wanted: &Wanted, fd: BorrowedFd<'_>, kind: u32, granted: &Granted) -> Result<(), OpenError> {
    let failed = |error| OpenError::from_errno(wanted, "setting the rate", error);
    let mut parameters = match calls::parameters(fd, kind) {
        Err(Errno::NOTTY | Errno::INVAL) => return Ok(()),
        result => result.map_err(failed)?,
    };
    if parameters.capability & CAP_TIME_PER_FRAME == 0 {
        return Ok(());
    }
    let RawLayout { arrangement, width_px, height_px, .. } = granted.raw;
    let size = (arrangement.device_width_px(width_px) as u32, height_px as u32);
    let offered = offers::intervals(fd, granted.fourcc, size);
    (parameters.numerator, parameters.denominator) = offered.nearest(wanted.rate_hz);
    calls::set_parameters(fd, &mut parameters).map_err(failed)?;
    let given = f64::from(parameters.denominator) / f64::from(parameters.numerator.max(1));
    if (given / wanted.rate_hz - 1.0).abs() > RATE_TOLERANCE {
        let message = format!(
            "gives {given:.4} frames per second of {} {} x {} px where rate_hz of `[[camera]]` says {}; it offers \
             {offered}",
            fourcc_text(granted.fourcc),
            size.0,
            size.1,
            wanted.rate_hz
        );
        return Err(OpenError::Refused(DriverError::refused(&wanted.path, message)));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::path::Path;

    fn wanted(path: &Path) -> Wanted {
        Wanted {
            path: path.to_owned(),
            key: "driver.v4l2.left",
            size_px: (640, 480),
            both: false,
            rate_hz: 30.0,
            options: V4l2Config::default(),
        }
    }

    #[test]
    fn a_device_that_is_not_there_may_come_and_what_is_no_camera_never_will() {
        let absent = open(&wanted(Path::new("/dev/v4l/by-path/not-there"))).unwrap_err();
        let OpenError::Absent(message) = absent else { panic!("{absent:?}") };
        assert!(message.contains("driver.v4l2.left") && message.contains("plumbline devices"), "{message}");
        let file = tempfile::NamedTempFile::new().unwrap();
        let refused = open(&wanted(file.path())).unwrap_err();
        let OpenError::Refused(error) = refused else { panic!("{refused:?}") };
        assert!(error.to_string().contains("is no video device"), "{error}");
    }
}
