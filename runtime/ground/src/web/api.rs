//! HTTP requests of the page: resets, recordings, downloads.

use super::super::command::{self, ResetWords};
use super::super::export::{ExportFormat, export};
use super::super::fleet::lock;
use super::super::map::Map;
use super::Station;
use axum::Json;
use axum::body::{Body, Bytes};
use axum::extract::{Path, State};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use plumbline_record::Severity;
use serde::Deserialize;
use serde_json::json;
use std::sync::Arc;
use tokio::sync::OwnedSemaphorePermit;

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
    bytes: Vec<u8>,
    _place: OwnedSemaphorePermit,
}

impl AsRef<[u8]> for Download {
    fn as_ref(&self) -> &[u8] {
        &self.bytes
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
            "available are trajectory and recording, each as .tum, .csv or .mcap",
        );
    };
    // Held until the last byte is sent.
    let Ok(place) = Arc::clone(&station.downloads).try_acquire_owned() else {
        return answer(StatusCode::SERVICE_UNAVAILABLE, false, "other downloads are going on; try again");
    };
    let found = {
        let fleet = lock(&station.fleet);
        let Some(found) = fleet.vehicles.get(&vehicle) else { return unknown(&vehicle) };
        let samples = match what {
            "trajectory" => Some(found.poses.to_vec()),
            "recording" => found.recording.as_ref().map(super::super::track::Samples::to_vec),
            _ => None,
        };
        // Text has no room for a map.
        let map = if format == ExportFormat::Mcap { found.map.clone() } else { Map::default() };
        samples.map(|samples| (samples, map))
    };
    let Some((samples, map)) = found else {
        return answer(StatusCode::NOT_FOUND, false, "there is no recording yet");
    };
    match export(&vehicle, &samples, &map, format) {
        Ok(bytes) => {
            // Names of vehicles come from the network: only plain characters go into the header.
            let plain: String =
                vehicle.chars().filter(|c| c.is_ascii_alphanumeric() || "-_".contains(*c)).collect();
            let disposition = format!("attachment; filename=\"{plain}-{what}.{}\"", format.ending());
            let kind = format.mime().to_owned();
            let body = Body::from(Bytes::from_owner(Download { bytes, _place: place }));
            ([(header::CONTENT_TYPE, kind), (header::CONTENT_DISPOSITION, disposition)], body).into_response()
        }
        Err(error) => answer(StatusCode::INTERNAL_SERVER_ERROR, false, &error.to_string()),
    }
}
