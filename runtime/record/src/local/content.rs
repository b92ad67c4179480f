//! Records that a flight sends, as values.

use super::picture::Shot;
use super::record::{Header, Kind, MAGIC};
use super::request::Answer;
use crate::InstantAnswer;
use crate::layout;
use crate::messages::{Configuration, LadderRung, Picture, SensorNews};
use crate::protobuf::decode;
use crate::said::FullEstimate;
use plumbline_estimator::places::{MapEstimate, MapPath};
use plumbline_estimator::{Estimate, MapSnapshot, Odometry, Trail};

/// Record that a flight sends.
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

impl LocalRecord {
    /// Record in the content behind a header.
    ///
    /// # Errors
    /// When the content is not one of its kind: the reason as text.
    pub fn decode(header: &Header, content: &[u8]) -> Result<Self, &'static str> {
        let Some(kind) = Kind::of_kind(header.kind) else { return Ok(Self::Other(header.kind)) };
        Ok(match kind {
            Kind::Hello => match content.split_first_chunk::<8>() {
                Some((magic, [rights, ..])) if *magic == MAGIC => Self::Hello(rights & 1 != 0),
                _ => return Err("not the greeting of a flight"),
            },
            Kind::Lost => {
                let count = content.first_chunk().ok_or("a count is too short")?;
                Self::Lost(u64::from_le_bytes(*count))
            }
            Kind::Result => Self::Answer(Answer::decode(header.sequence, content)?),
            Kind::Odometry => {
                let (odometry, handed_over_ns) = layout::odometry(content)?;
                Self::Odometry(Box::new(odometry), handed_over_ns)
            }
            Kind::Instant => {
                let (mut answer, handed_over_ns) = layout::instant(content)?;
                answer.sequence = header.sequence;
                Self::Instant(Box::new(answer), handed_over_ns)
            }
            Kind::Trail => Self::Trail(decode(content)?),
            Kind::Configuration => Self::Configuration(decode(content)?),
            Kind::FullEstimate => {
                let FullEstimate { estimate, frame_ms } = decode(content)?;
                Self::Estimate(Box::new(estimate), frame_ms)
            }
            Kind::MapEstimate => Self::MapEstimate(decode(content)?),
            Kind::Window => Self::Window(decode(content)?),
            Kind::Path => Self::Path(decode(content)?),
            Kind::Ladder => Self::Ladder(decode(content)?),
            Kind::Sensors => Self::Sensors(decode(content)?),
            Kind::Picture => Self::Picture(decode::<Picture>(content)?.try_into()?),
            Kind::End => Self::End,
            _ => Self::Other(header.kind),
        })
    }
}
