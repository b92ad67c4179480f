//! The commands, and what of them belongs to all: options, features, who supervises them.

use clap::{Args, Parser, Subcommand};

/// Deterministic real-time visual-inertial odometry for drones.
#[derive(Debug, Parser)]
#[command(name = "plumbline", version = VERSION, after_help = EXAMPLES)]
pub struct Cli {
    /// More log messages (-v, -vv); the environment variable RUST_LOG overrides it.
    #[arg(short, long, action = clap::ArgAction::Count, global = true)]
    pub verbose: u8,
    #[command(subcommand)]
    pub command: Command,
}

/// Version, and what this build leaves out.
const VERSION: &str = if cfg!(feature = "calibration") {
    env!("CARGO_PKG_VERSION")
} else {
    concat!(
        env!("CARGO_PKG_VERSION"),
        " (without OpenCV, which `calibrate camera` needs: `make calibration`)"
    )
};

const EXAMPLES: &str = "Examples:
  plumbline demo                                    a simulated flight, live
  plumbline ground --connect tcp/127.0.0.1:7447     watch the vehicles on a network
  plumbline replay V1_01_easy --trajectory out.tum  a EuRoC data set, as fast as possible
  plumbline replay sim:hall --duration 20           a simulated flight, not written to disk
  plumbline devices                                 list the connected cameras and IMUs
  plumbline setup realsense --out drone.toml        configure a connected camera
  plumbline fly --config drone.toml                 a live flight with these sensors
  plumbline replay V1_01_easy --record log.mcap     record the flight
  plumbline verify log.mcap                         execute it again, and compare all outputs bit for bit
  plumbline evaluate out.tum V1_01_easy             ATE and RPE, computed as evo_ape and evo_rpe do

Exit status: 0 success; 1 the run failed; 2 wrong usage or configuration, or an input that is missing or unusable; 3 an \
internal fault ended a task of a live flight: restart the program, as the systemd unit does; 4 the data do not show all that \
`doctor` asks.";

#[derive(Debug, Subcommand)]
pub enum Command {
    /// Fly a simulated vehicle at 1x, and publish it on the loopback interface.
    Demo(super::demo::DemoArgs),
    /// Fly live with the configured cameras and IMU.
    Fly(super::fly::FlyArgs),
    /// Run the estimator over a recorded or simulated flight.
    Replay(Box<super::replay::ReplayArgs>),
    /// Execute a recorded flight again, and compare every output bit for bit.
    Verify(super::verify::VerifyArgs),
    /// List the contents of a flight log.
    Log(super::log::LogArgs),
    /// Write a simulated flight as a EuRoC data set.
    Simulate(super::simulate::SimulateArgs),
    /// Compare a trajectory with its ground truth.
    Evaluate(super::evaluate::EvaluateArgs),
    /// Join maps, list their contents, or have a vehicle write its map.
    Map(super::map::MapArgs),
    /// Monitor vehicles over the network: a web page, and a view in the terminal.
    Ground(super::ground::GroundArgs),
    /// Relay messages between vehicles and ground stations that cannot reach each other.
    Router(super::router::RouterArgs),
    /// Publish a flight over the network, read from its local socket. `fly` and `replay --publish` start this process
    /// themselves.
    Link(super::link::LinkArgs),
    /// Reset the estimator of a vehicle over the network.
    Reset(super::reset::ResetArgs),
    /// Make certificates for vehicles and ground stations.
    Keys(super::keys::KeysArgs),
    /// List cameras (formats, rates, controls), serial ports and inertial sensors, with their names for the
    /// configuration.
    Devices(super::devices::DevicesArgs),
    /// Set up a connected rig: find it, read its calibration, write a configuration, set emitter and exposure, and run the
    /// doctor.
    Setup(Box<super::setup::SetupArgs>),
    /// Calibrate the sensors: cameras from images of a board, pose of the cameras on the IMU.
    Calibrate(super::calibrate::CalibrateArgs),
    /// Check whether this host and a configuration are fit for a flight.
    Doctor(super::doctor::DoctorArgs),
    /// Check a configuration file, print a preset, or import a calibration.
    Config(super::config::ConfigArgs),
    /// Describe a command, or list the kinds of conditions, faults and errors of inertial sensors.
    Help(HelpArgs),
    /// Print the completion script of a shell.
    Completions {
        /// The shell.
        shell: clap_complete::Shell,
    },
    /// Write the manual pages of all commands into a folder, for `man`.
    Man(super::man::ManArgs),
}

impl Command {
    /// True if messages reach this process over Zenoh as long as it runs.
    pub fn has_network(&self) -> bool {
        matches!(self, Self::Demo(_) | Self::Ground(_) | Self::Router(_) | Self::Link(_))
    }

    /// Name of a command that runs under a supervisor, which starts it again after a fault.
    pub fn supervised(&self) -> Option<&'static str> {
        match self {
            Self::Ground(_) => Some("the ground station"),
            Self::Router(_) => Some("the router"),
            _ => None,
        }
    }
}

/// Arguments of `plumbline help`.
#[derive(Debug, Args)]
pub struct HelpArgs {
    /// Command, such as `config import`; table of kinds: `conditions`, `faults` or `imu-errors`; or `all`, the list of
    /// every command.
    pub topic: Vec<String>,
}
