//! The other end of the socket: records as values, and requests.

use super::picture::Shot;
use super::record::{Header, Kind, MAGIC, TooLong};
use super::request::{Answer, Request};
use crate::sensor_board::SensorNews;
use plumbline_estimator::places::{MapEstimate, MapPath};
use plumbline_estimator::{Estimate, MapSnapshot, Odometry, Trail};
use plumbline_record::InstantAnswer;
use plumbline_record::layout;
use plumbline_record::local::incoming::Incoming;
use plumbline_record::messages::{Configuration, LadderRung, Picture};
use plumbline_record::protobuf::decode;
use plumbline_record::said::FullEstimate;
use std::io::{self, ErrorKind, Read, Write as _};
use std::net::Shutdown;
use std::os::unix::net::UnixStream;
use thiserror::Error;

/// What a flight sends.
#[derive(Clone, Debug, PartialEq)]
pub enum LocalRecord {
    /// Greeting; whether commands are taken.
    Hello(bool),
    /// Records that were lost so far.
    Lost(u64),
    /// Answer to a request.
    Answer(Answer),
    /// Odometry, and the time it was handed over, ns since 1970.
    Odometry(Box<Odometry>, i64),
    /// Configuration in force.
    Configuration(Configuration),
    /// Estimate, and the computation of its frame, ms.
    Estimate(Box<Estimate>, f64),
    /// Pose of the odometry frame in the map.
    MapEstimate(MapEstimate),
    /// Keyframes and landmarks of the window.
    Window(MapSnapshot),
    /// State at an instant, and the time it was handed over, ns since 1970; the number is that of the request.
    Instant(Box<InstantAnswer>, i64),
    /// Smoothed trail of the last seconds.
    Trail(Trail),
    /// Corrected path.
    Path(MapPath),
    /// Rung of the degradation ladder.
    Ladder(LadderRung),
    /// State of live sensors.
    Sensors(SensorNews),
    /// Camera picture.
    Picture(Shot),
    /// End of the flight.
    End,
    /// Kind that this reader has no use for, or does not know.
    Other(u16),
}

/// Why no record can be read.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum RecordError {
    /// The other end has closed.
    #[error("the flight has closed the socket")]
    Closed,
    /// It cannot be read.
    #[error("the local socket cannot be read: {0}")]
    Io(#[from] io::Error),
    /// The other end sends what is no record of a flight.
    #[error("the local socket sends what is no record of this version: {0}")]
    Foreign(&'static str),
}

/// Records of a stream of bytes.
#[derive(Debug)]
pub struct Records<R> {
    from: R,
    incoming: Incoming,
}

impl<R: Read> Records<R> {
    /// Records that `from` sends.
    pub fn new(from: R) -> Self {
        Self { from, incoming: Incoming::default() }
    }

    /// Waits for the next record.
    ///
    /// # Errors
    /// When the stream has ended, cannot be read, or is none of a flight.
    pub fn next_record(&mut self) -> Result<LocalRecord, RecordError> {
        loop {
            match self.incoming.next_header() {
                Ok(Some(header)) => {
                    return record(&header, self.incoming.content()).map_err(RecordError::Foreign);
                }
                Ok(None) => self.receive()?,
                Err(TooLong) => return Err(RecordError::Foreign("a record is too long")),
            }
        }
    }

    fn receive(&mut self) -> Result<(), RecordError> {
        match self.from.read(self.incoming.room()) {
            Ok(0) => Err(RecordError::Closed),
            Ok(count) => {
                self.incoming.add(count);
                Ok(())
            }
            Err(error) if error.kind() == ErrorKind::Interrupted => Ok(()),
            Err(error) if error.kind() == ErrorKind::ConnectionReset => Err(RecordError::Closed),
            Err(error) => Err(RecordError::Io(error)),
        }
    }
}

/// Record in the content behind a header.
fn record(header: &Header, content: &[u8]) -> Result<LocalRecord, &'static str> {
    let Some(kind) = Kind::of_kind(header.kind) else { return Ok(LocalRecord::Other(header.kind)) };
    Ok(match kind {
        Kind::Hello => match content.split_first_chunk::<8>() {
            Some((magic, [rights, ..])) if *magic == MAGIC => LocalRecord::Hello(rights & 1 != 0),
            _ => return Err("not the greeting of a flight"),
        },
        Kind::Lost => {
            let count = content.first_chunk().ok_or("a count is too short")?;
            LocalRecord::Lost(u64::from_le_bytes(*count))
        }
        Kind::Result => LocalRecord::Answer(Answer::decode(header.sequence, content)?),
        Kind::Odometry => {
            let (odometry, handed_over_ns) = layout::odometry(content)?;
            LocalRecord::Odometry(Box::new(odometry), handed_over_ns)
        }
        Kind::Instant => {
            let (mut answer, handed_over_ns) = layout::instant(content)?;
            answer.sequence = header.sequence;
            LocalRecord::Instant(Box::new(answer), handed_over_ns)
        }
        Kind::Trail => LocalRecord::Trail(decode(content)?),
        Kind::Configuration => LocalRecord::Configuration(decode(content)?),
        Kind::FullEstimate => {
            let FullEstimate { estimate, frame_ms } = decode(content)?;
            LocalRecord::Estimate(Box::new(estimate), frame_ms)
        }
        Kind::MapEstimate => LocalRecord::MapEstimate(decode(content)?),
        Kind::Window => LocalRecord::Window(decode(content)?),
        Kind::Path => LocalRecord::Path(decode(content)?),
        Kind::Ladder => LocalRecord::Ladder(decode(content)?),
        Kind::Sensors => LocalRecord::Sensors(decode(content)?),
        Kind::Picture => LocalRecord::Picture(decode::<Picture>(content)?.try_into()?),
        Kind::End => LocalRecord::End,
        _ => LocalRecord::Other(header.kind),
    })
}

/// Connection to a flight.
#[derive(Debug)]
pub struct Client {
    records: Records<UnixStream>,
}

impl Client {
    /// Client of a connected stream.
    #[must_use]
    pub fn new(stream: UnixStream) -> Self {
        Self { records: Records::new(stream) }
    }

    /// Waits for the next record.
    ///
    /// # Errors
    /// When the flight has gone, or sends what is no record.
    pub fn next_record(&mut self) -> Result<LocalRecord, RecordError> {
        self.records.next_record()
    }

    /// Content of the record that came last.
    #[must_use]
    pub fn content(&self) -> &[u8] {
        self.records.incoming.content()
    }

    /// Writing end, for another thread.
    ///
    /// # Errors
    /// When the system has no more file descriptors.
    pub fn requests(&self) -> io::Result<Requests> {
        Ok(Requests { stream: self.records.from.try_clone()?, number: 0 })
    }
}

/// Writing end of a connection.
#[derive(Debug)]
pub struct Requests {
    stream: UnixStream,
    number: u64,
}

impl Requests {
    /// Sends a request; its answer carries the number that is returned.
    ///
    /// # Errors
    /// When the flight has gone.
    pub fn send(&mut self, request: &Request) -> io::Result<u64> {
        self.number += 1;
        self.stream.write_all(&request.encode(self.number))?;
        Ok(self.number)
    }

    /// Ends the connection, also for the thread that reads.
    pub fn close(&self) {
        let _ = self.stream.shutdown(Shutdown::Both);
    }
}
