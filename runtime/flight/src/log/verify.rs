//! `verify`: a recorded flight is executed again, and every output compared bit for bit.

use super::LogError;
use super::build_id::BuildId;
use super::channel::Channel;
use super::comparison::{ComparedOutputs, Comparison};
use super::cursor::Cursor;
use super::execute::LogOrders;
use super::known::{KnownMap, known_map};
use super::reader::Ending;
use crate::pipeline::effect::Effect;
use crate::pipeline::listener::{Several, Subscriber};
use crate::pipeline::machine::Machine;
use crate::pipeline::places::MapStage;
use crate::pipeline::team::Team;
use plumbline_config::options::ImageRecording;
use plumbline_drivers::StereoSource;
use plumbline_record::compare::Difference;
use plumbline_record::{Dropped, EntryKind};
use serde::Serialize;
use std::path::Path;
use std::sync::Arc;

/// Channels read by an execution: all with the images of the log, all but the last two with those of a data set.
const READ: &[Channel] = &[
    Channel::Imu,
    Channel::Frame,
    Channel::FrameOrder,
    Channel::CorrectionOrder,
    Channel::ResetOrder,
    Channel::MapOrder,
    Channel::InstantOrder,
    Channel::MapEstimate,
    Channel::Instant,
    Channel::Estimate,
    Channel::Odometry,
    Channel::Left,
    Channel::Right,
];

/// Result of a verification.
#[derive(Clone, Debug, Serialize)]
pub struct Verification {
    /// Every output that was compared is the same in every bit, and every input is the one recorded.
    pub identical: bool,
    /// The log holds the whole flight, and all of it was compared.
    pub complete: bool,
    /// The first output that differs.
    pub difference: Option<Difference>,
    /// An input is not the one that was recorded, by the running hash over the inputs.
    pub inputs_changed: bool,
    /// Inertial samples executed.
    pub readings: u64,
    /// Frames that were refused in flight.
    pub frames_refused: u64,
    /// Estimates that are the same in every bit.
    pub estimates_identical: u64,
    /// Odometry that is the same in every bit.
    pub odometry_identical: u64,
    /// Poses in the map that are the same in every bit.
    pub map_poses_identical: u64,
    /// States at instants that are the same in every bit.
    pub instants_identical: u64,
    /// Outputs of the execution that are not in the log.
    pub not_recorded: u64,
    /// Outputs of the log whose inputs it does not hold.
    pub not_executed: u64,
    /// The log breaks off: the recorder was killed, or could not write.
    pub truncated: bool,
    /// The log is damaged, or lacks inputs: what is wrong, and where. Only what comes before was executed.
    pub damage: Option<String>,
    /// Time of data that was executed, s.
    pub executed_s: f64,
    /// The log ends with the room that it was given, before the flight.
    pub ended_for_room: bool,
    /// SHA-256 over the bits of all estimates of the execution, as in a report.
    pub estimate_digest: String,
    /// SHA-256 over the bits of all odometry of the execution, as in a report.
    pub odometry_digest: String,
    /// True if the map was executed only up to a fault of the program.
    pub map_ends_at_fault: bool,
    /// SHA-256 over the bits of the pose of the odometry in the map, as in a report; `None` where places were off, or where
    /// the map ends at a fault.
    pub map_digest: Option<String>,
    /// The recording was made by this very executable.
    pub same_build: bool,
    /// SHA-256 of the configuration.
    pub config_hash: String,
}

/// Executes the log at `path` again, with its own images or those of `images`, and the map that it went on with. `progress` is told the part
/// that is done, from 0 to 1.
///
/// # Errors
/// When the log cannot be read, lacks an input, or cannot be executed.
pub fn verify(
    path: &Path,
    images: Option<Box<dyn StereoSource>>,
    known: Option<KnownMap>,
    progress: &mut dyn FnMut(f64),
) -> Result<Verification, LogError> {
    verify_before(path, images, known, &mut (), progress)
}

/// As [`verify`], while `witness` listens to the execution.
///
/// # Errors
/// As [`verify`].
pub fn verify_before(
    path: &Path,
    images: Option<Box<dyn StereoSource>>,
    known: Option<KnownMap>,
    witness: &mut dyn Subscriber,
    progress: &mut dyn FnMut(f64),
) -> Result<Verification, LogError> {
    let wanted = if images.is_some() { &READ[..READ.len() - 2] } else { READ };
    let log = Cursor::open(path, wanted)?;
    let about = log.reader().about().clone();
    if about.part != 0 {
        let reason = "its beginning was deleted to keep the newest (recorder.keep = \"newest\"), and without it \
                      the flight cannot be executed again";
        return Err(LogError::unusable(path, reason));
    }
    if images.is_none() && about.images == ImageRecording::None {
        let reason = "was recorded without images; give the data set it was recorded from with --images";
        return Err(LogError::unusable(path, reason));
    }
    let known = known_map(path, &about, known)?;
    let (team, mut comparison) = (Team::default(), Comparison::default());
    let compared = comparison.clone();
    let mut listeners = Several(vec![&mut comparison, witness]);
    let mut machine =
        Machine::new(&about.config, (known, Some(Arc::default())), Effect::ByOrder, &team, &mut listeners);
    let mut orders = LogOrders::new(log, images, compared.clone(), progress);
    machine.run(&mut orders, about.first_reset_counter)?;
    orders.read_to_end()?;
    let is_same_build = about.build.is_same_executable(BuildId::current());
    Ok(summed_up(&orders, &machine, &mut compared.outputs(), (is_same_build, about.config_hash)))
}

fn summed_up(
    orders: &LogOrders<'_>,
    machine: &Machine<'_>,
    outputs: &mut ComparedOutputs,
    (same_build, config_hash): (bool, String),
) -> Verification {
    let log = orders.log().reader();
    let (ending, dropped, inputs_changed) = (log.ending(), log.dropped(), log.is_seal_broken());
    let damage = orders.break_off().map(str::to_owned);
    let is_log_complete = ending == Ending::Flight && damage.is_none();
    // Where outputs differ the execution ended, and the others have no partners for it.
    let first = outputs.difference().cloned();
    outputs.finish(is_log_complete);
    let ComparedOutputs { estimates, odometry, map, instants, map_ends_at_fault } = &*outputs;
    let difference = first.or_else(|| outputs.difference().cloned());
    let not_recorded = estimates.missing + odometry.missing + map.missing + instants.missing;
    let unexplained = is_log_complete && not_recorded > dropped_outputs(&dropped);
    Verification {
        identical: difference.is_none() && !inputs_changed && !unexplained,
        complete: is_log_complete && not_recorded == 0 && difference.is_none(),
        inputs_changed,
        readings: orders.readings(),
        frames_refused: orders.refused,
        estimates_identical: estimates.identical,
        odometry_identical: odometry.identical,
        map_poses_identical: map.identical,
        instants_identical: instants.identical,
        map_ends_at_fault: *map_ends_at_fault && machine.window().map().is_some(),
        map_digest: machine.window().map().and_then(MapStage::digest),
        not_recorded,
        not_executed: estimates.left_over() + odometry.left_over() + map.left_over() + instants.left_over(),
        truncated: ending == Ending::Truncated,
        executed_s: orders.span_s(),
        damage,
        ended_for_room: ending == Ending::Room,
        estimate_digest: machine.window().digest(),
        odometry_digest: machine.tick().digest(),
        same_build,
        config_hash,
        difference,
    }
}

/// Outputs that the recorder itself says are missing.
fn dropped_outputs(dropped: &Dropped) -> u64 {
    let outputs = [EntryKind::Estimate, EntryKind::Odometry, EntryKind::MapEstimate, EntryKind::Instant];
    outputs.iter().map(|kind| dropped.of(*kind)).sum()
}
