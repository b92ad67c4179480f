//! One rule for the exit status of every command.
//!
//! 0: what was asked for was done. 2: it was asked for wrongly, and asking again in the same way cannot help: arguments,
//! configuration, endpoints, an input that is not there, is not of the kind that was asked for or holds nothing that can be
//! used, an output that may not be written. 3: a task of a live flight ended or stands still by a fault of the program, so that the process is to be
//! started again, as the systemd unit does. 4: `doctor` found nothing wrong, but data that do not show everything. 1: everything else
//! that went wrong.

use super::Usage;
use super::doctor::NotShown;
use super::link_process::LinkProcessError;
use plumbline_config::ConfigError;
use plumbline_drivers::DriverError;
use plumbline_flight::flight::FlightError;
use plumbline_flight::local::LocalError;
use plumbline_flight::log::LogError;
use plumbline_flight::pipeline::RunError;
use plumbline_flight::places::{MapDefect, MapFileError};
use plumbline_lab::calibrate::camera::ImagesError;
use plumbline_lab::evaluate::EvaluateError;
use plumbline_link::net::NetError;
use plumbline_link::net::keys::KeysError;
use plumbline_link::process::NetworkProcessError;
use std::error::Error;
use std::io::ErrorKind;
use std::time::Duration;

/// The run failed.
const FAILED: u8 = 1;
/// Wrong usage or configuration, or an input that is not there.
const USAGE: u8 = 2;

/// A fault of the program ended a live flight.
pub const FAULT: u8 = 3;
/// The data of `doctor` do not show everything that a flight needs.
const NOT_SHOWN: u8 = 4;
/// A run that cannot go on has this long to end: to tell the autopilot, and to write its log.
const LAST_WORDS: Duration = Duration::from_millis(400);

/// Ends the process when a run that cannot go on does not end by itself, as one with a thread that spins cannot.
pub fn last_resort() {
    let ended = std::thread::Builder::new().name("last-resort".into()).spawn(|| {
        std::thread::sleep(LAST_WORDS);
        std::process::exit(FAULT.into());
    });
    if ended.is_err() {
        std::process::exit(FAULT.into());
    }
}

/// The exit status of a command that ended with `error`.
pub fn exit_status(error: &anyhow::Error) -> u8 {
    if error.chain().filter_map(|cause| cause.downcast_ref::<RunError>()).any(RunError::is_fault) {
        return FAULT;
    }
    if error.is::<NotShown>() {
        return NOT_SHOWN;
    }
    if error.chain().any(is_usage) { USAGE } else { FAILED }
}

/// True if a cause is a usage, an input, an endpoint or an output that cannot be what was meant.
fn is_usage(cause: &(dyn Error + 'static)) -> bool {
    if cause.is::<Usage>() || cause.is::<ConfigError>() {
        return true;
    }
    macro_rules! judged {
        ($($kind:ty: |$error:pat_param| $is_usage:expr;)*) => {$(
            if let Some($error) = cause.downcast_ref::<$kind>() {
                return $is_usage;
            }
        )*};
    }
    judged! {
        std::io::Error: |error| {
            matches!(error.kind(), ErrorKind::NotFound | ErrorKind::IsADirectory | ErrorKind::NotADirectory)
        };
        FlightError: |error| error.is_usage();
        EvaluateError: |error| matches!(error, EvaluateError::Read(error) if is_usage(error));
        DriverError: |error| matches!(
            error,
            DriverError::Scenario(_) | DriverError::Refused { .. } | DriverError::ImuAddress(_)
        );
        ImagesError: |error| match error {
            ImagesError::Layout { .. } => true,
            ImagesError::Io { source, .. } => is_usage(source),
            ImagesError::Image(error) => is_usage(error),
        };
        MapFileError: |error| match error {
            MapFileError::Read { source, .. } => is_usage(source),
            MapFileError::Defect { defect, .. } => {
                matches!(defect, MapDefect::Foreign | MapDefect::Version { .. })
            }
            MapFileError::Write { .. } => false,
        };
        LogError: |error| matches!(error, LogError::Exists { .. } | LogError::NotALog { .. });
        NetError: |error| error.is_usage();
        LinkProcessError: |error| matches!(error, LinkProcessError::Refused(failure) if failure.is_usage);
        LocalError: |error| !matches!(error, LocalError::Thread(_));
        NetworkProcessError: |error| error.is_usage();
        KeysError: |error| match error {
            KeysError::Certificate { .. } => false,
            KeysError::File { error, .. } => is_usage(error),
            _ => true,
        };
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use anyhow::{Context as _, anyhow};

    #[test]
    fn wrong_usage_is_told_from_a_run_that_failed_also_below_other_causes() {
        let io = |kind: ErrorKind| anyhow::Error::from(std::io::Error::from(kind)).context("out.tum");
        assert_eq!(exit_status(&io(ErrorKind::NotFound)), 2);
        assert_eq!(exit_status(&io(ErrorKind::StorageFull)), 1);
        let usage =
            Err::<(), _>(Usage("--speed: give a positive number".into())).context("replay").unwrap_err();
        assert_eq!(exit_status(&usage), 2);
        let taken = NetError::Taken { endpoint: "tcp/127.0.0.1:7447".into() };
        assert_eq!(exit_status(&taken.into()), 1);
        let wrong = NetError::Endpoint { endpoint: "x".into(), reason: "names no protocol".into() };
        assert_eq!(exit_status(&wrong.into()), 2);
        assert_eq!(exit_status(&anyhow!("no pose was found")), 1);
        let fault = || RunError::Fault("tick");
        assert_eq!(exit_status(&anyhow::Error::from(FlightError::from(fault())).context("fly")), 3);
        assert_eq!(exit_status(&RunError::Stalled("window").into()), 3);
    }
}
