//! `plumbline simulate`: a simulated flight as a EuRoC data set.

use super::scenario::{ScenarioArgs, parse_scene};
use super::{Usage, load_config, say};
use anyhow::{Context, Result};
use clap::Args;
use indicatif::ProgressBar;
use plumbline_drivers::euroc::{WriteInputs, write};
use plumbline_flight::flight::{preset_for, scenario_config};
use plumbline_simulator::Simulator;
use plumbline_simulator::{InjectedFrames, InjectedImu};
use std::path::PathBuf;

const EXAMPLES: &str = "Examples:
  plumbline simulate FOLDER --path hand-held --duration 15
  plumbline simulate FOLDER --path V1_02 --imu recorded --start 15
                                               samples of a real sensor, and images along its path
  plumbline simulate FOLDER --fault image-frozen:left@5+3
                                               with a fault; `plumbline help faults` lists them";

/// Arguments of `plumbline simulate`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct SimulateArgs {
    /// Directory to write `mav0` into.
    pub out_dir: PathBuf,
    /// Scene of the flight: room, hall, low-texture or far.
    #[arg(long, default_value = "room")]
    pub scene: String,
    /// Configuration file or preset of the simulated rig.
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Simulate the left camera only.
    #[arg(long)]
    pub mono: bool,
    /// Replace an existing data set.
    #[arg(long)]
    pub overwrite: bool,
    /// Simulated flight.
    #[command(flatten)]
    pub scenario: ScenarioArgs,
}

/// Runs the command.
///
/// # Errors
/// When the scenario is impossible or the data set cannot be written.
pub fn run(args: &SimulateArgs) -> Result<()> {
    let scenario = args.scenario.scenario(parse_scene(&args.scene)?)?;
    let config = load_config(args.config.as_deref())?.map_or_else(|| preset_for(&scenario), Ok)?;
    let config = scenario_config(Some(config), args.mono)?;
    let simulator = Simulator::new(&config, &scenario).context("the flight cannot be simulated")?;
    let bar = ProgressBar::new(simulator.frame_count());
    let (faults, seed) = (&args.scenario.faults.fault, scenario.seed);
    faults.iter().try_for_each(|fault| fault.check_cameras(simulator.camera_count())).map_err(Usage)?;
    let sizes_px = simulator.image_sizes();
    let options = args.scenario.faults.in_streams(true)?;
    let stereo = InjectedFrames::start(simulator.stereo(), sizes_px, &options, seed)?;
    let mut stereo = InjectedFrames::start(stereo, sizes_px, faults, seed)?;
    let mut imu = InjectedImu::new(simulator.imu(), &simulator.config().imu, stereo.begin(), faults, seed);
    let mut written_config = simulator.config().clone();
    faults.iter().for_each(|fault| fault.mistake(&mut written_config));
    let mut truth = simulator.truth();
    let inputs =
        WriteInputs { config: &written_config, stereo: &mut stereo, imu: &mut imu, truth: &mut truth };
    let written = write(&args.out_dir, inputs, args.overwrite, &mut |frames| bar.set_position(frames))?;
    bar.finish_and_clear();
    say(format_args!(
        "{}: {} frames, {} images, {} inertial samples, {} true states",
        args.out_dir.display(),
        written.frames,
        written.images,
        written.imu_samples,
        written.truth_rows
    ));
    for fault in args.scenario.faults.words()? {
        say(format_args!("fault: {fault}"));
    }
    Ok(())
}
