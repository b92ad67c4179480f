//! Receivers of a replay while it goes on: recorder, autopilot, local socket, network.

use super::ReplayArgs;
use crate::link_process::start_socket;
use crate::{Usage, check_mounting};
use anyhow::Result;
use plumbline_config::ValidConfig;
use plumbline_flight::flight::{Flight, Outputs};
use plumbline_flight::local::SensorBoard;
use plumbline_flight::log::WhenFull;
use plumbline_flight::pipeline::Control;
use plumbline_link::process::{LinkOptions, has_network};
use std::path::Path;
use std::sync::Arc;

/// Starts those who are told of the flight while it goes on; returns where findings are posted for readers of the local socket.
pub fn start_outputs(
    args: &ReplayArgs,
    flight: &Flight,
    log: Option<&Path>,
    control: &Arc<Control>,
) -> Result<(Outputs, Option<SensorBoard>)> {
    let config = &flight.config;
    let mut outputs = Outputs::default();
    if wants_autopilot(config, args)? {
        outputs.pilot(flight, control)?;
    }
    if let Some(path) = log {
        // A live flight never waits for the recorder, one in virtual time loses nothing.
        let when_full = if args.speed.is_some() { WhenFull::Drop } else { WhenFull::Wait };
        outputs.record(path, flight, when_full)?;
    }
    if let Some(path) = &args.run.save_map {
        outputs.save_map(path, control)?;
    }
    if !args.publish && config.ros.enabled {
        tracing::warn!("ros.enabled is set but has no effect: publishing to ROS 2 needs --publish");
    }
    let link = args.publish.then(|| publishing(args, config)).transpose()?;
    let board = start_socket(&mut outputs, flight, control, link)?;
    Ok((outputs, board))
}

/// Options of the network process.
fn publishing(args: &ReplayArgs, config: &ValidConfig) -> Result<LinkOptions, Usage> {
    let link = args.run.link(false);
    if config.ros.enabled {
        check_mounting(config)?;
    } else if !has_network(&config.network, &link) {
        tracing::warn!(
            "--publish: no endpoint to publish on; give --listen or --connect, or set network.listen"
        );
    }
    Ok(LinkOptions { publish: true, ..link })
}

/// True if an autopilot is configured that can receive odometry: it flies in real time, or not at all.
fn wants_autopilot(config: &ValidConfig, args: &ReplayArgs) -> Result<bool, Usage> {
    if config.autopilot.connect.is_empty() {
        return Ok(false);
    }
    if args.speed.is_none() && args.autopilot.is_some() {
        return Err(Usage("--autopilot: give --speed 1 too; an autopilot needs real time".into()));
    }
    if args.speed.is_none() {
        tracing::warn!("autopilot.connect is set but has no effect: it needs --speed 1");
    }
    Ok(args.speed.is_some())
}
