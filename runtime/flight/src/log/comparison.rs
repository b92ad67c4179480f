//! Comparison of the output of a re-execution with the log.

use super::LogError;
use super::channel::Channel;
use super::cursor::Cursor;
use crate::pipeline::listener::{Listener, Producer, Subscriber};
use parking_lot::{Mutex, MutexGuard};
use plumbline_estimator::places::MapEstimate;
use plumbline_estimator::{Estimate, Odometry};
use plumbline_record::compare::{Difference, Pairing};
use plumbline_record::{InstantAnswer, ResetOrder, Said};
use std::sync::Arc;

/// Outputs of log and re-execution.
#[derive(Debug, Default)]
pub struct ComparedOutputs {
    /// Estimates.
    pub estimates: Pairing<Estimate>,
    /// Odometry.
    pub odometry: Pairing<Odometry>,
    /// Poses of the odometry in the map.
    pub map: Pairing<MapEstimate>,
    /// States at instants.
    pub instants: Pairing<InstantAnswer>,
    /// The map was executed up to a fault of the program alone.
    pub map_ends_at_fault: bool,
}

impl ComparedOutputs {
    /// The first output that differs.
    pub fn difference(&self) -> Option<&Difference> {
        let Self { estimates, odometry, map, instants, .. } = self;
        let of_map = map.difference.as_ref().or(instants.difference.as_ref());
        estimates.difference.as_ref().or(odometry.difference.as_ref()).or(of_map)
    }

    /// Nothing more will come.
    pub fn finish(&mut self, is_log_complete: bool) {
        self.estimates.finish(is_log_complete);
        self.odometry.finish(is_log_complete);
        self.map.finish(is_log_complete);
        self.instants.finish(is_log_complete);
    }

    /// Takes the recorded outputs that were read.
    ///
    /// # Errors
    /// When one is none.
    pub fn take_recorded(&mut self, log: &mut Cursor) -> Result<(), LogError> {
        while let Some(estimate) = log.next_waiting(Channel::Estimate)? {
            self.estimates.recorded(estimate);
        }
        while let Some(odometry) = log.next_waiting(Channel::Odometry)? {
            self.odometry.recorded(odometry);
        }
        while let Some(output) = log.next_waiting(Channel::MapEstimate)? {
            if !self.map_ends_at_fault {
                self.map.recorded(output);
            }
        }
        while let Some(answer) = log.next_waiting(Channel::Instant)? {
            self.instants.recorded(answer);
        }
        Ok(())
    }

    fn take(&mut self, said: &Said) {
        match said {
            Said::Estimate(full) => self.estimates.executed(full.estimate.clone()),
            Said::Odometry(odometry) => self.odometry.executed(odometry.clone()),
            Said::MapEstimate(estimate) => self.map.executed(estimate.clone()),
            Said::Instant(answer) => self.instants.executed(answer.clone()),
            Said::Reset(ResetOrder { is_renewal: true, .. }) => {
                self.map_ends_at_fault = true;
                self.map.forget();
            }
            _ => {}
        }
    }
}

/// Outputs that several stages add to.
#[derive(Clone, Debug, Default)]
pub struct Comparison(Arc<Mutex<ComparedOutputs>>);

impl Comparison {
    /// The outputs so far.
    pub fn outputs(&self) -> MutexGuard<'_, ComparedOutputs> {
        self.0.lock()
    }
}

impl Subscriber for Comparison {
    fn listener(&mut self, _producer: Producer) -> Box<dyn Listener> {
        Box::new(self.clone())
    }
}

impl Listener for Comparison {
    fn said(&mut self, said: &Said) {
        self.outputs().take(said);
    }
}
