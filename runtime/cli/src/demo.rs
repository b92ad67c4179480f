//! `plumbline demo`: a simulated flight at real time, estimated live, published on the loopback interface, and
//! watched by a ground station with its page.

use super::exit_status::{FAULT, last_resort};
use super::ground::Background;
use super::link_process::start_socket;
use super::scenario::parse_scene;
use super::{Usage, fly_status, log_lines, stop_on_signal};
use anyhow::{Context as _, Result};
use clap::Args;
use parking_lot::Mutex;
use plumbline_drivers::StereoFrame;
use plumbline_flight::flight::sensor_watch::SensorNotices;
use plumbline_flight::flight::{Outputs, fly, open_simulation, scenario_config};
use plumbline_flight::pipeline::{Control, RunOptions};
use plumbline_ground as ground;
use plumbline_ground::fleet::Fleet;
use plumbline_lab::report::Report;
use plumbline_link::net::Endpoints;
use plumbline_link::net::certificate::DEFAULT_VEHICLE;
use plumbline_link::process::LinkOptions;
use plumbline_simulator::{Scenario, Simulator};
use std::net::{SocketAddr, TcpListener};
use std::sync::Arc;
use std::time::{Duration, Instant};

/// First port that is tried.
const FIRST_PORT: u16 = 7447;
/// Ports that are tried.
const PORTS: u16 = 20;
/// Rendering a stereo frame may take this long beside an estimator on the other core.
const RENDER_BUDGET: Duration = Duration::from_millis(45);
/// Frames rendered to find out.
const TRIAL_FRAMES: u64 = 4;

/// Arguments of `plumbline demo`.
#[derive(Debug, Args)]
pub struct DemoArgs {
    /// Length of the flight, seconds.
    #[arg(long, default_value_t = 300.0)]
    pub duration: f64,
    /// Scene of the flight: room, hall, low-texture or far.
    #[arg(long, default_value = "room")]
    pub scene: String,
    /// Seed of all random draws.
    #[arg(long, default_value_t = 1)]
    pub seed: u64,
    /// Serve the web page at this address.
    #[arg(long, value_name = "ADDRESS", default_value = "127.0.0.1:8080")]
    pub http: SocketAddr,
    /// Size of the images relative to 752x480. Default: the largest of 1 and 0.5 that this machine renders in time.
    #[arg(long)]
    pub resolution: Option<f64>,
}

/// Runs the command.
///
/// # Errors
/// When the flight cannot be simulated or no port is free.
pub fn run(args: &DemoArgs) -> Result<()> {
    log_lines::end_on_panic(FAULT);
    let mut scenario = Scenario {
        scene: parse_scene(&args.scene)?,
        duration_s: args.duration,
        seed: args.seed,
        ..Scenario::default()
    };
    scenario.resolution_scale = match args.resolution {
        Some(scale) => scale,
        None => affordable_resolution(&scenario)?,
    };
    let flight = open_simulation(None, &scenario, false, 0.0, None)?;
    let size = &flight.config.camera[0];
    let endpoint = free_endpoint()?;
    let control = Arc::new(Control::stopped_by(stop_on_signal()?).with_last_resort(last_resort));
    let mut outputs = Outputs::default();
    let link = LinkOptions { listen: vec![endpoint.clone()], ..LinkOptions::default() };
    start_socket(&mut outputs, &flight, &control, Some(link))?;
    println!(
        "Flying for {:.0} s in the {} with {}x{} stereo images.",
        args.duration, args.scene, size.width_px, size.height_px
    );
    let (station, fleet) = (Background::start()?, Arc::new(Mutex::new(Fleet::default())));
    let hears = vec![DEFAULT_VEHICLE.to_owned()];
    let endpoints = Endpoints { vehicle: "*".into(), hears, connect: vec![endpoint], ..Endpoints::default() };
    let line = station.open(&endpoints, &fleet, false, &|| false)?.context("nothing ends the start")?;
    // Another program may have the usual port.
    let page =
        ground::web::bind(args.http).or_else(|_| ground::web::bind(SocketAddr::new(args.http.ip(), 0)))?;
    let address = station.serve(page, &fleet, &line, (true, &[]))?;
    println!("Look at http://{address} (or from another terminal: plumbline ground --no-http)");
    let mut progress = fly_status::start(SensorNotices::default())?;
    let options = RunOptions { speed: Some(1.0), threads: 2 };
    let mut subscribers = outputs.subscribers();
    subscribers.push(&mut progress);
    let flown = fly(flight, &options, &control, subscribers)?;
    outputs.finish();
    progress.finish();
    println!("\n{}", Report::new(&flown).summary());
    station.close(&line);
    Ok(())
}

/// Full resolution if this machine renders it in time, else half.
fn affordable_resolution(scenario: &Scenario) -> Result<f64> {
    let config = scenario_config(None, false)?;
    let simulator = Simulator::new(&config, scenario)?;
    let (mut scratch, mut frame) = (simulator.scratch(), StereoFrame::new(simulator.image_sizes()));
    let start = Instant::now();
    for index in 0..TRIAL_FRAMES {
        simulator.render_frame(index, &mut scratch, &mut frame);
    }
    let each = start.elapsed() / TRIAL_FRAMES as u32;
    if each <= RENDER_BUDGET {
        return Ok(1.0);
    }
    println!(
        "This machine renders a stereo frame in {:.0} ms; the camera takes one every 50 ms: half resolution.",
        each.as_secs_f64() * 1e3
    );
    Ok(0.5)
}

/// An endpoint on the loopback interface that nobody uses.
fn free_endpoint() -> Result<String, Usage> {
    (FIRST_PORT..FIRST_PORT + PORTS)
        .find(|port| TcpListener::bind(("127.0.0.1", *port)).is_ok())
        .map(|port| format!("tcp/127.0.0.1:{port}"))
        .ok_or_else(|| Usage(format!("no free port from {FIRST_PORT} to {}", FIRST_PORT + PORTS - 1)))
}
