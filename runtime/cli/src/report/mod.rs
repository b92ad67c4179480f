//! `plumbline report`: one archive to send with a question.

mod archive;
mod health;
mod privacy;

use super::{Usage, check_outputs, doctor, say};
use anyhow::{Context, Result};
use archive::ReportArchive;
use clap::Args;
use health::health_csv;
use plumbline_config::ValidConfig;
use plumbline_drivers::BagTopics;
use plumbline_estimator::Estimate;
use plumbline_flight::log::build_id::BuildId;
use plumbline_flight::log::channel::Channel;
use plumbline_flight::log::cursor::Cursor;
use plumbline_flight::log::{LogReader, inventory};
use privacy::{LEFT_OUT, Secrets};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};

/// Seconds of sensor data that are judged.
const DOCTOR_S: f64 = 60.0;
const EXAMPLES: &str = "The archive (.tar.gz) holds: the configuration, versions, health over time, and the findings of `plumbline doctor` about the \
sensor data.

Left out: certificates, keys, addresses, paths, serial numbers, names of hosts and users, and images. Look at it before you send it: it is text.

Example:
  plumbline report log.mcap --out report.tar.gz
A recording is flown into a log first: plumbline replay RECORDING --record log.mcap";

/// Arguments of `plumbline report`.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub struct ReportArgs {
    /// Flight log.
    #[arg(value_name = "LOG.mcap")]
    pub log: PathBuf,
    /// Archive to write.
    #[arg(long, value_name = "OUT.tar.gz")]
    pub out: PathBuf,
    /// Leave addresses, paths and names in the configuration and in texts. Keys and certificates are never read.
    #[arg(long)]
    pub with_addresses: bool,
}

/// Data of the flight that the report is made of.
struct Known {
    config: ValidConfig,
    rows: Vec<Estimate>,
    about: Value,
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
    super::simulated::check_recorded(&args.log)?;
    let known = known(&args.log)?;
    let secrets = match args.with_addresses {
        true => Secrets::default(),
        false => Secrets::of_machine(&args.log),
    };
    let written = || args.out.display().to_string();
    let mut archive = ReportArchive::create(&args.out).with_context(written)?;
    for (name, text) in files(args, &known, &secrets)? {
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

/// Reads the log.
fn known(path: &Path) -> Result<Known> {
    let mut reader = LogReader::open(path)?;
    let about = reader.about().clone();
    let held = match inventory::take(&mut reader) {
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
    let about_json = json!({ "this_build": own_build(), "log": log });
    Ok(Known { config: about.config, rows: logged_states(path)?, about: about_json })
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
fn files(args: &ReportArgs, known: &Known, secrets: &Secrets) -> Result<[(&'static str, String); 5]> {
    let toml = known.config.to_toml()?;
    Ok([
        ("README.txt", readme(args, secrets)),
        ("config.toml", if args.with_addresses { toml } else { privacy::redacted(&toml) }),
        ("about.json", secrets.scrubbed(&serde_json::to_string_pretty(&known.about)?)),
        ("health.csv", health_csv(&known.rows)),
        ("doctor.txt", secrets.scrubbed(&doctor_words(args, known))),
    ])
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
health.csv   state, resets, health, quality and standard deviation, a row a second
doctor.txt   what `plumbline doctor` says of the sensor data

Left out: certificates, keys, images{left_out}. In the configuration they read \"{LEFT_OUT}\".
",
        secrets.scrubbed(&args.log.display().to_string()),
        env!("CARGO_PKG_VERSION")
    )
}

/// Findings of the doctor about the sensor data, or the reason why there are none.
fn doctor_words(args: &ReportArgs, known: &Known) -> String {
    let (log, topics) = (args.log.display().to_string(), BagTopics::default());
    match doctor::of_recording(&log, known.config.clone(), &topics, DOCTOR_S) {
        Ok(lines) => lines.join("\n") + "\n",
        Err(error) => format!("not looked at: {}\n", super::one_line(&error)),
    }
}
