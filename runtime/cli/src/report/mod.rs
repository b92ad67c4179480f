//! `plumbline report`: one archive to send with a question.

mod archive;
mod events;
mod privacy;

use super::progress::Progress;
use super::simulated::simulated;
use super::topics::TopicArgs;
use super::{Usage, check_outputs, doctor, load_config, say, stop_on_signal};
use anyhow::{Context, Result};
use archive::ReportArchive;
use clap::Args;
use events::{events, events_csv, health_csv};
use plumbline_config::ValidConfig;
use plumbline_drivers::BagTopics;
use plumbline_estimator::Estimate;
use plumbline_flight::flight::plausibility::watch::Watch;
use plumbline_flight::flight::{KeptStates, RecordingKind, fly, open_recording, recording_kind};
use plumbline_flight::log::LogReader;
use plumbline_flight::log::build_id::BuildId;
use plumbline_flight::log::channel::Channel;
use plumbline_flight::log::cursor::Cursor;
use plumbline_flight::log::inventory;
use plumbline_flight::pipeline::{Control, RunOptions};
use plumbline_lab::report::{Report, late_findings};
use privacy::{LEFT_OUT, Secrets};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Seconds of sensor data that are judged.
const DOCTOR_S: f64 = 60.0;
const EXAMPLES: &str = "The archive (.tar.gz) holds: the configuration, versions, what happened and when, health over time, and the findings of the flight \
and of `plumbline doctor` about the sensor data.

Left out: certificates, keys, passwords, addresses, paths, serial numbers, names of hosts and users, and images. Look at it before you send it: it is text.

Examples:
  plumbline report log.mcap --out report.tar.gz     a flight log, as it was flown
  plumbline report V1_01_easy --out report.tar.gz   a recording, which is flown first";

/// Arguments of `plumbline report`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct ReportArgs {
    /// Flight log, EuRoC data set, ROS bag (with --config), or simulated flight (sim:room?duration=10). All but a log are flown
    /// first.
    #[arg(value_name = "LOG|RECORDING")]
    pub source: String,
    /// Archive to write.
    #[arg(long, value_name = "OUT.tar.gz")]
    pub out: PathBuf,
    /// Configuration file or preset of what is flown. Default: as for `plumbline replay`.
    #[arg(long, value_name = "FILE|PRESET")]
    pub config: Option<PathBuf>,
    /// Leave addresses, paths and names in the configuration and in texts. Keys and certificates are never read.
    #[arg(long)]
    pub with_addresses: bool,
    /// Topics of a bag.
    #[command(flatten)]
    pub topics: TopicArgs,
}

/// Data of the flight that the report is made of.
struct Known {
    config: ValidConfig,
    rows: Vec<Estimate>,
    about: Value,
    /// Report of the flight, where it was flown now.
    report: Option<Value>,
}

/// Runs the command.
///
/// # Errors
/// When the source cannot be read or flown, or the archive cannot be written.
pub fn run(args: &ReportArgs) -> Result<()> {
    let name = args.out.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
    if !(name.ends_with(".tar.gz") || name.ends_with(".tgz")) {
        return Err(
            Usage(format!("--out {}: name the archive with the ending .tar.gz", args.out.display())).into()
        );
    }
    check_outputs([&args.out])?;
    let topics = args.topics.names()?;
    let known = known(args, &topics)?;
    let secrets = match args.with_addresses {
        true => Secrets::default(),
        false => Secrets::of_machine(&args.source),
    };
    let written = || args.out.display().to_string();
    let mut archive = ReportArchive::create(&args.out).with_context(written)?;
    for (name, text) in files(args, &topics, &known, &secrets)? {
        archive.add(name, text.as_bytes()).with_context(written)?;
    }
    archive.finish().with_context(written)?;
    let bytes = std::fs::metadata(&args.out).with_context(written)?.len();
    say(format_args!(
        "{}: written, {:.0} kB; look at it before you send it (tar -xzf {name}): README.txt says what it holds",
        args.out.display(),
        (bytes as f64 * 1e-3).ceil()
    ));
    Ok(())
}

/// Reads or flies the source.
fn known(args: &ReportArgs, topics: &BagTopics) -> Result<Known> {
    let path = Path::new(&args.source);
    let own = own_build();
    if path.is_file() && recording_kind(path) == RecordingKind::Log {
        let mut reader = LogReader::open(path)?;
        let about = reader.about().clone();
        let held = inventory::take(&mut reader);
        let held = match held {
            Ok(held) => json!({
                "duration_s": held.duration_s,
                "ending": format!("{:?}", held.ending),
                "dropped": held.dropped.to_string(),
                "inputs_changed": held.inputs_changed,
            }),
            Err(error) => json!({ "damaged": error.to_string() }),
        };
        let build = &about.build;
        let log = json!({
            "flight": about.flight, "part": about.part, "parts": reader.parts(), "images": format!("{:?}", about.images),
            "config_sha256": about.config_hash, "holds": held, "build": as_json(build),
            "is_of_this_build": build.is_same_executable(BuildId::current()),
        });
        let about_json = json!({ "this_build": own, "log": log });
        let rows = logged_states(path)?;
        return Ok(Known { config: about.config, rows, about: about_json, report: None });
    }
    let config = load_config(args.config.as_deref())?;
    let flight = match simulated(&args.source)? {
        Some(simulated) => simulated.open(config, None)?,
        None => open_recording(path, config, topics, None, false)?,
    };
    let control = Control::stopped_by(stop_on_signal()?);
    let mut states = KeptStates::for_flight(&flight);
    let mut progress = Progress::bar(flight.stereo.expected_frames())?;
    let mut watch = Watch::start(&flight.config, false, flight.findings.clone(), None)?;
    let file_defects = flight.file_defects.clone();
    let options = RunOptions { speed: None, threads: 2 };
    let flown = fly(flight, &options, &control, vec![&mut states, &mut progress, &mut watch]);
    progress.finish();
    let flown = flown?;
    let mut findings = watch.finish();
    findings.extend(late_findings(&flown, None, &file_defects, &findings));
    let report = serde_json::to_value(Report::new(&flown).warning_of(findings))?;
    let rows = states.into_rows();
    let about = json!({ "this_build": own });
    Ok(Known { config: flown.config, rows, about, report: Some(report) })
}

/// The estimates that a flight log holds, as they were recorded.
fn logged_states(path: &Path) -> Result<Vec<Estimate>> {
    let mut log = Cursor::open(path, &[Channel::Estimate])?;
    let mut rows = Vec::new();
    while let Some(estimate) = log.next::<Estimate>(Channel::Estimate)? {
        rows.push(estimate);
    }
    Ok(rows)
}

/// This build and the kernel below it.
fn own_build() -> Value {
    let mut build = as_json(BuildId::current());
    let kernel = std::fs::read_to_string("/proc/sys/kernel/osrelease").unwrap_or_default();
    build["kernel"] = json!(kernel.trim());
    build["processors"] = json!(std::thread::available_parallelism().map_or(1, usize::from));
    build
}

fn as_json(build: &BuildId) -> Value {
    json!({
        "version": build.version, "commit": build.commit, "target": build.target, "rustc": build.rustc,
        "executable_sha256": build.executable, "processor": build.processor,
    })
}

/// All files, with their names. Tables have figures and names of our own alone, and need no scrubbing.
fn files(
    args: &ReportArgs,
    topics: &BagTopics,
    known: &Known,
    secrets: &Secrets,
) -> Result<Vec<(&'static str, String)>> {
    let toml = known.config.to_toml()?;
    let mut files = vec![
        ("README.txt", readme(args, secrets)),
        ("config.toml", if args.with_addresses { toml } else { privacy::redacted(&toml) }),
        ("about.json", secrets.scrubbed(&serde_json::to_string_pretty(&known.about)?)),
        ("events.csv", events_csv(&events(&known.rows))),
        ("health.csv", health_csv(&known.rows)),
        ("doctor.txt", secrets.scrubbed(&doctor_words(args, topics, known))),
    ];
    if let Some(report) = &known.report {
        files.push(("report.json", secrets.scrubbed(&serde_json::to_string_pretty(report)?)));
    }
    Ok(files)
}

/// Words that say what the archive holds.
fn readme(args: &ReportArgs, secrets: &Secrets) -> String {
    let left_out = match args.with_addresses {
        true => "",
        false => ", addresses, paths, serial numbers, names of hosts and users",
    };
    format!(
        "Report of {} by plumbline {}. Times are seconds after the first estimate.

config.toml  configuration of the flight
about.json   versions of the program, of the kernel, and of what wrote the log
events.csv   resets, losses, gaps and health bits, with their times
health.csv   health, quality and standard deviation, a row a second
doctor.txt   what `plumbline doctor` says of the sensor data
report.json  report of the flight, with warnings (not of a log)

Left out: certificates, keys, passwords, images{left_out}. In the configuration they read \"{LEFT_OUT}\".
",
        secrets.scrubbed(&args.source),
        env!("CARGO_PKG_VERSION")
    )
}

/// Findings of the doctor about the sensor data, or the reason why there are none.
fn doctor_words(args: &ReportArgs, topics: &BagTopics, known: &Known) -> String {
    if args.source.starts_with("sim:") {
        return "not looked at: the flight is simulated\n".into();
    }
    match doctor::of_recording(&args.source, known.config.clone(), topics, DOCTOR_S) {
        Ok(lines) => lines.join("\n") + "\n",
        Err(error) => format!("not looked at: {}\n", super::one_line(&error)),
    }
}
