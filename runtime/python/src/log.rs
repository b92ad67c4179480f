//! Flight logs as arrays.

use crate::config::PyConfig;
use crate::errors::of_data;
use crate::table;
use plumbline_config::ImuSample;
use plumbline_drivers::ImuReading;
use plumbline_estimator::places::MapEstimate;
use plumbline_estimator::{Estimate, Odometry};
use plumbline_flight::log::channel::Channel;
use plumbline_flight::log::reader::Ending;
use plumbline_flight::log::{LogError, LogReader};
use plumbline_record::parts::FrameAbout;
use plumbline_record::protobuf::decode;
use plumbline_scene::messages::{Log, log};
use prost::Message as _;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::{Path, PathBuf};

/// Content of a log, but for its images.
#[derive(Default)]
struct Content {
    imu: Vec<ImuSample>,
    frames: Vec<(u64, i64)>,
    estimates: Vec<Estimate>,
    odometry: Vec<Odometry>,
    map: Vec<MapEstimate>,
    events: Vec<Event>,
}

/// Stamp in ns, level and text of an event.
type Event = (i64, &'static str, String);

impl Content {
    /// Adds a message.
    fn add(&mut self, channel: Channel, payload: &[u8]) -> Result<(), &'static str> {
        match channel {
            Channel::Imu => self.imu.push(decode::<ImuReading>(payload)?.sample),
            Channel::Frame => {
                let about: FrameAbout = decode(payload)?;
                self.frames.push((about.sequence, about.stamp.as_nanos()));
            }
            Channel::Estimate => self.estimates.push(decode(payload)?),
            Channel::Odometry => self.odometry.push(decode(payload)?),
            Channel::MapEstimate => self.map.push(decode(payload)?),
            Channel::Event => self.events.push(event(payload)?),
            _ => {}
        }
        Ok(())
    }
}

fn event(payload: &[u8]) -> Result<Event, &'static str> {
    let event = Log::decode(payload).map_err(|_| "not a message of its schema")?;
    let stamp_ns = i64::try_from(event.timestamp.unwrap_or_default().total_nanos()).unwrap_or(i64::MAX);
    let level = match event.level() {
        log::Level::Warning => "warning",
        log::Level::Error | log::Level::Fatal => "error",
        _ => "info",
    };
    Ok((stamp_ns, level, event.message))
}

/// Reads a log up to its end or its first damage, which is described.
fn read(path: &Path) -> Result<(LogReader, Content, Option<String>), LogError> {
    let mut reader = LogReader::open(path)?;
    let mut content = Content::default();
    let damage = loop {
        let (channel, payload) = match reader.next_message() {
            Ok(None) => break None,
            Ok(Some(message)) => (message.channel, message.payload),
            Err(error @ LogError::Damaged { .. }) => break Some(error.to_string()),
            Err(error) => return Err(error),
        };
        if let Err(what) = content.add(channel, payload) {
            let reason = format!("{} holds {what}; it was not written by a recorder", channel.channel());
            return Err(LogError::Unusable { path: path.to_owned(), reason });
        }
    };
    Ok((reader, content, damage))
}

/// Reads a flight log: see `plumbline.read_log`.
#[pyfunction]
pub fn read_log(py: Python<'_>, path: PathBuf) -> PyResult<Bound<'_, PyDict>> {
    let (reader, content, damage) = py.detach(|| read(&path)).map_err(|error| of_data(&error))?;
    let ending = match (&damage, reader.ending()) {
        (Some(_), _) => "damaged",
        (None, Ending::Flight) => "flight",
        (None, Ending::Room) => "room",
        (None, Ending::Truncated | Ending::Unknown) => "truncated",
    };
    let values = PyDict::new(py);
    values.set_item("config", PyConfig::from(reader.about().config.clone()))?;
    values.set_item("flight", &reader.about().flight)?;
    values.set_item("estimates", table::estimates(py, &content.estimates)?)?;
    values.set_item("odometry", table::odometry(py, &content.odometry)?)?;
    values.set_item("map", table::map(py, &content.map)?)?;
    values.set_item("imu", table::imu(py, &content.imu)?)?;
    let (sequences, stamps) = content.frames.iter().copied().unzip::<u64, i64, Vec<_>, Vec<_>>();
    values.set_item("frame", crate::arrays::column(py, &sequences, &[])?)?;
    values.set_item("frame_stamp_ns", crate::arrays::column(py, &stamps, &[])?)?;
    values.set_item("events", content.events)?;
    values.set_item("ending", ending)?;
    values.set_item("damage", damage)?;
    values.set_item("dropped", reader.dropped().total())?;
    values.set_item("inputs_changed", reader.is_seal_broken())?;
    Ok(values)
}
