//! HTTP requests of the page: resets, recordings, downloads.

use super::super::command::{self, ResetWords};
use super::super::export::{ExportFormat, export};
use super::super::fleet::{Fleet, lock};
use super::super::track::PoseSample;
use super::Station;
use axum::Json;
use axum::body::{Body, Bytes};
use axum::extract::{Path, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use plumbline_record::Severity;
use serde::Deserialize;
use serde_json::json;
use std::sync::{Arc, Mutex};
use tokio::sync::OwnedSemaphorePermit;

/// Samples that are copied in one go.
const SAMPLES_AT_A_TIME: usize = 20_000;

/// Body of a reset request.
#[derive(Deserialize)]
pub struct ResetRequest {
    kind: ResetWords,
}

/// Body of a request to start or stop a recording.
#[derive(Deserialize)]
pub struct RecordRequest {
    on: bool,
}

fn answer(status: StatusCode, is_ok: bool, text: &str) -> Response {
    (status, Json(json!({"ok": is_ok, "text": text}))).into_response()
}

fn unknown(vehicle: &str) -> Response {
    answer(StatusCode::NOT_FOUND, false, &format!("no vehicle {vehicle:?} was received"))
}

fn off() -> Response {
    let text = "commands are off at this station: it serves other hosts; start it with --allow-commands";
    answer(StatusCode::FORBIDDEN, false, text)
}

/// Resets a vehicle's estimate.
pub async fn reset(
    State(station): State<Arc<Station>>,
    Path(vehicle): Path<String>,
    Json(reset): Json<ResetRequest>,
) -> Response {
    if !station.commands {
        return off();
    }
    let is_known = lock(&station.fleet).vehicles.contains_key(&vehicle);
    let Some(session) = station.connection.session().filter(|_| is_known) else {
        return unknown(&vehicle);
    };
    let outcome = command::reset(session, &vehicle, reset.kind).await;
    let (severity, text) = match &outcome {
        Ok(done) => (Severity::Info, done),
        Err(reason) => (Severity::Error, reason),
    };
    lock(&station.fleet).announce(Some(&vehicle), severity, text.clone());
    match outcome {
        Ok(done) => answer(StatusCode::OK, true, &done),
        Err(reason) => answer(StatusCode::BAD_GATEWAY, false, &reason),
    }
}

/// Starts or stops a recording.
pub async fn record(
    State(station): State<Arc<Station>>,
    Path(vehicle): Path<String>,
    Json(record): Json<RecordRequest>,
) -> Response {
    if !station.commands {
        return off();
    }
    match lock(&station.fleet).vehicles.get_mut(&vehicle) {
        Some(found) => found.set_recording(record.on),
        None => return unknown(&vehicle),
    }
    answer(StatusCode::OK, true, if record.on { "recording started" } else { "recording stopped" })
}

/// A file on its way, and the place that it takes.
struct Download {
    text: String,
    _place: OwnedSemaphorePermit,
}

impl AsRef<[u8]> for Download {
    fn as_ref(&self) -> &[u8] {
        self.text.as_bytes()
    }
}

/// A recording, or everything that is kept, as a file.
pub async fn download(
    State(station): State<Arc<Station>>,
    Path((vehicle, file)): Path<(String, String)>,
) -> Response {
    let Some((what, format)) =
        file.split_once('.').and_then(|(what, end)| Some((what, ExportFormat::of(end)?)))
    else {
        return answer(
            StatusCode::NOT_FOUND,
            false,
            "available are trajectory and recording, each as .tum or .csv",
        );
    };
    // Held until the last byte is sent.
    let Ok(place) = Arc::clone(&station.downloads).try_acquire_owned() else {
        return answer(StatusCode::SERVICE_UNAVAILABLE, false, "other downloads are going on; try again");
    };
    let (fleet, of, name) = (Arc::clone(&station.fleet), vehicle.clone(), what.to_owned());
    // Megabytes are copied and written as text: not on a thread that serves others.
    let made = tokio::task::spawn_blocking(move || {
        let samples = copied(&fleet, &of, &name)?;
        Some(export(&samples, format))
    });
    let Ok(Some(text)) = made.await else {
        if !lock(&station.fleet).vehicles.contains_key(&vehicle) {
            return unknown(&vehicle);
        }
        return answer(StatusCode::NOT_FOUND, false, "there is no recording yet");
    };
    // Names of vehicles come from the network: only plain characters go into the header.
    let plain: String = vehicle.chars().filter(|c| c.is_ascii_alphanumeric() || "-_".contains(*c)).collect();
    let disposition = format!("attachment; filename=\"{plain}-{what}.{}\"", format.ending());
    let body = Body::from(Bytes::from_owner(Download { text, _place: place }));
    ([(header::CONTENT_TYPE, format.mime().to_owned()), (header::CONTENT_DISPOSITION, disposition)], body)
        .into_response()
}

/// Samples of a trajectory or a recording, copied a part at a time: vehicles go on being received meanwhile.
fn copied(fleet: &Mutex<Fleet>, vehicle: &str, what: &str) -> Option<Vec<PoseSample>> {
    let mut copied: Option<(u64, Vec<PoseSample>)> = None;
    loop {
        let fleet = lock(fleet);
        let found = fleet.vehicles.get(vehicle)?;
        let samples = match what {
            "trajectory" => &found.poses,
            "recording" => found.recording.as_ref()?,
            _ => return None,
        };
        let (next, all) = copied.get_or_insert((samples.first(), Vec::new()));
        let part = samples.since(*next).take(SAMPLES_AT_A_TIME);
        if part.len() == 0 {
            return copied.map(|(_, all)| all);
        }
        *next = samples.first().max(*next) + part.len() as u64;
        all.extend(part.copied());
    }
}

#[cfg(test)]
mod tests {
    use super::super::super::connection::StationSession;
    use super::*;
    use std::pin::pin;
    use std::sync::atomic::AtomicU64;
    use std::task::{Context, Waker};
    use tokio::sync::Semaphore;

    #[tokio::test]
    async fn a_download_leaves_the_threads_of_the_page_free() {
        let fleet: Arc<Mutex<Fleet>> = Arc::default();
        lock(&fleet).alive("drone", true);
        let station = Arc::new(Station {
            fleet: Arc::clone(&fleet),
            connection: StationSession::default(),
            commands: false,
            malformed: AtomicU64::new(0),
            pages: Semaphore::new(1),
            address: "127.0.0.1:80".parse().unwrap(),
            names: Vec::new(),
            downloads: Arc::new(Semaphore::new(1)),
        });
        let path = Path(("drone".to_owned(), "trajectory.csv".to_owned()));
        let mut downloading = pin!(download(State(station), path));
        {
            let _taken = lock(&fleet);
            assert!(downloading.as_mut().poll(&mut Context::from_waker(Waker::noop())).is_pending());
        }
        assert_eq!(downloading.await.status(), StatusCode::OK);
    }
}
