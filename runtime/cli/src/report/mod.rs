//! `plumbline report`: one archive to send with a question.

mod archive;
mod events;
mod privacy;

use super::plot::{flown_subject, logged_states};
use super::progress::Progress;
use super::topics::TopicArgs;
use super::{Usage, check_outputs, doctor, load_config, say, stop_on_signal, sweep};
use anyhow::{Context, Result, ensure};
use archive::ReportArchive;
use clap::{Args, ValueEnum};
use events::{events, events_csv, health_csv, is_within, samples_csv, spans, states_csv};
use plumbline_config::{ImageView, Timestamp, ValidConfig};
use plumbline_drivers::{BagTopics, StereoFrame};
use plumbline_estimator::Estimate;
use plumbline_flight::flight::plausibility::watch::Watch;
use plumbline_flight::flight::{
    KeptStates, RecordingKind, Truth, fly, inertial_samples, open_recording, recording_kind,
};
use plumbline_flight::log::LogReader;
use plumbline_flight::log::build_id::BuildId;
use plumbline_flight::log::inventory;
use plumbline_flight::pipeline::{Control, RunOptions};
use plumbline_lab::picture::RgbImage;
use plumbline_lab::plot::{self, SIZE_PX};
use plumbline_lab::report::{Report, late_findings};
use plumbline_lab::sweep::{Common, Subject};
use privacy::{LEFT_OUT, Secrets};
use serde_json::{Value, json};
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// Seconds of sensor data that are judged.
const DOCTOR_S: f64 = 60.0;
/// Seconds between the images of an event, and most images of an archive.
const IMAGE_EVERY_S: f64 = 5.0;
const MAX_IMAGES: usize = 100;

const EXAMPLES: &str = "The archive (.tar.gz) holds: the configuration, versions, what happened and when, health over time, the findings of the flight \
and of `plumbline doctor` about the sensor data, a plot, and a minute of states and inertial samples around each event at a reduced rate.

Left out: certificates, keys, passwords, addresses, paths, serial numbers, names of hosts and users, and images. Look at it before you send it: it is text.

Examples:
  plumbline report log.mcap --out report.tar.gz               a flight log, as it was flown
  plumbline report V1_01_easy --out report.tar.gz             a recording, which is flown first
  plumbline report log.mcap --out report.tar.gz --with images   some images around each event too";

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
    /// Include what is left out otherwise: `images` (one every five seconds around each event), `addresses` (the configuration
    /// as it is, with addresses, paths and names). Keys and certificates are never read.
    #[arg(long, value_enum, value_delimiter = ',')]
    pub with: Vec<Private>,
    /// Topics of a bag.
    #[command(flatten)]
    pub topics: TopicArgs,
}

/// Private content that is included on request only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum Private {
    /// Images around each event.
    Images,
    /// Addresses, paths and names in the configuration and in texts.
    Addresses,
}

/// Data of the flight that the report is made of.
struct Known {
    config: ValidConfig,
    rows: Vec<Estimate>,
    truth: Truth,
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
    let secrets = match args.with.contains(&Private::Addresses) {
        true => Secrets::default(),
        false => Secrets::of_machine(&args.source),
    };
    let files = files(args, &topics, &known)?;
    let written = || args.out.display().to_string();
    let mut archive = ReportArchive::create(&args.out).with_context(written)?;
    for File { name, content } in files {
        let content = match content {
            Content::Text(text) => secrets.scrubbed(&text).into_bytes(),
            Content::Table(text) => text.into_bytes(),
            Content::Binary(bytes) => bytes,
        };
        archive.add(&name, &content).with_context(written)?;
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

/// A file of the archive.
struct File {
    name: String,
    content: Content,
}

/// Content of a file.
enum Content {
    /// Words that may name places and machines.
    Text(String),
    /// Figures and names of our own alone.
    Table(String),
    /// Pixels.
    Binary(Vec<u8>),
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
        return Ok(Known { config: about.config, rows, truth: Truth::None, about: about_json, report: None });
    }
    let config = load_config(args.config.as_deref())?;
    let common = Common { config, topics: topics.clone(), ..Common::default() };
    let flight = sweep::subject(&args.source, None)?.open(&common, None, None)?;
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
    Ok(Known { config: flown.config, rows, truth: flown.truth, about, report: Some(report) })
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

/// All files but images.
fn files(args: &ReportArgs, topics: &BagTopics, known: &Known) -> Result<Vec<File>> {
    let events = events(&known.rows);
    let spans = spans(&events);
    let toml = known.config.to_toml()?;
    let toml = if args.with.contains(&Private::Addresses) { toml } else { privacy::redacted(&toml) };
    let text = |name: &str, text: String| File { name: name.into(), content: Content::Text(text) };
    let table = |name: &str, text: String| File { name: name.into(), content: Content::Table(text) };
    let mut files = vec![
        table("config.toml", toml),
        text("about.json", serde_json::to_string_pretty(&known.about)?),
        table("events.csv", events_csv(&events)),
        table("health.csv", health_csv(&known.rows)),
        table("states_around_events.csv", states_csv(&known.rows, &spans)),
        text("doctor.txt", doctor_words(args, topics, known)),
    ];
    files.extend(
        known
            .report
            .as_ref()
            .map(serde_json::to_string_pretty)
            .transpose()?
            .map(|report| text("report.json", report)),
    );
    if let Some(samples) = samples_around(args, topics, known, &spans) {
        files.push(table("imu_around_events.csv", samples));
    }
    let work = WorkFolder::create()?;
    if let Some(drawing) = drawn(args, known, &work)? {
        files.push(text("flight.svg", drawing));
    }
    if args.with.contains(&Private::Images) {
        files.extend(images(args, topics, known, &spans, &work)?);
    }
    files.insert(0, text("README.txt", readme(args, known, events.len(), &files)));
    Ok(files)
}

/// A folder for pictures on their way into the archive; gone with the value.
struct WorkFolder(PathBuf);

impl WorkFolder {
    fn create() -> Result<Self> {
        let path = std::env::temp_dir().join(format!("plumbline-report-{}", std::process::id()));
        std::fs::create_dir_all(&path).with_context(|| path.display().to_string())?;
        Ok(Self(path))
    }
}

impl Drop for WorkFolder {
    fn drop(&mut self) {
        // Left over in a temporary folder, it harms nobody.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Words that say what the archive holds.
fn readme(args: &ReportArgs, known: &Known, events: usize, files: &[File]) -> String {
    let name = Path::new(&args.source)
        .file_name()
        .map_or_else(|| args.source.clone(), |name| name.to_string_lossy().into_owned());
    let span_s = known
        .rows
        .first()
        .zip(known.rows.last())
        .map_or(0.0, |(first, last)| last.stamp.seconds_since(first.stamp));
    let mut text = format!(
        "Report of {name} by plumbline {}: {} estimates over {span_s:.1} s, {events} events.\nTimes are seconds after the first estimate.\n\n",
        env!("CARGO_PKG_VERSION"),
        known.rows.len()
    );
    for file in files {
        let _ = writeln!(text, "{:<28}{}", file.name, about_file(&file.name));
    }
    let kept = |private: Private, words: &str| (!args.with.contains(&private)).then(|| words.to_owned());
    let left_out = ["certificates, keys and passwords".to_owned()].into_iter();
    let left_out = left_out
        .chain(kept(Private::Addresses, "addresses, paths, serial numbers, names of hosts and users"));
    let left_out: Vec<String> = left_out.chain(kept(Private::Images, "images")).collect();
    let _ =
        write!(text, "\nLeft out: {}. In the configuration they read \"{LEFT_OUT}\".\n", left_out.join("; "));
    text
}

fn about_file(name: &str) -> &'static str {
    match name {
        "config.toml" => "configuration of the flight",
        "about.json" => "versions of the program, of the kernel, and of what wrote the log",
        "events.csv" => "resets, losses, gaps and health bits, with their times",
        "health.csv" => "health, quality and standard deviation, a row a second",
        "states_around_events.csv" => {
            "all columns of the estimates 30 s before and after each event, four a second"
        }
        "imu_around_events.csv" => "inertial samples there: means and largest sizes of 50 ms",
        "doctor.txt" => "what `plumbline doctor` says of the sensor data",
        "report.json" => "report of the flight, with warnings",
        "flight.svg" => "the flight, drawn",
        _ => "images, left and right",
    }
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

/// Inertial samples around the events; `None` of a simulated flight.
fn samples_around(
    args: &ReportArgs,
    topics: &BagTopics,
    known: &Known,
    spans: &[(f64, f64)],
) -> Option<String> {
    let first = known.rows.first()?.stamp;
    let path = Path::new(&args.source);
    if args.source.starts_with("sim:") || spans.is_empty() {
        return None;
    }
    match inertial_samples(path, topics) {
        Ok((samples, _)) => Some(samples_csv(&samples, first, spans)),
        // The doctor says what is wrong with them.
        Err(_) => None,
    }
}

/// The flight as SVG; `None` without a pose.
fn drawn(args: &ReportArgs, known: &Known, work: &WorkFolder) -> Result<Option<String>> {
    let name = Path::new(&args.source)
        .file_name()
        .map_or_else(|| args.source.clone(), |name| name.to_string_lossy().into_owned());
    let Some(subject) = flown_subject(&name, &known.rows, &known.truth)? else { return Ok(None) };
    let path = work.0.join("flight.svg");
    plot::write(&subject, &path, SIZE_PX)?;
    Ok(Some(std::fs::read_to_string(&path).with_context(|| path.display().to_string())?))
}

/// Images around the events, left and right side by side.
fn images(
    args: &ReportArgs,
    topics: &BagTopics,
    known: &Known,
    spans: &[(f64, f64)],
    work: &WorkFolder,
) -> Result<Vec<File>> {
    let Some(first) = known.rows.first().map(|row| row.stamp) else { return Ok(Vec::new()) };
    ensure!(
        matches!(sweep::subject(&args.source, None)?, Subject::Recorded { .. }),
        Usage("--with images: a simulated flight has none to keep; leave it out".into())
    );
    let flight = open_recording(Path::new(&args.source), Some(known.config.clone()), topics, None, false)?;
    let mut sizes_px = [(0, 0); 2];
    for (size, camera) in sizes_px.iter_mut().zip(&known.config.camera) {
        *size = (camera.model().width_px, camera.model().height_px);
    }
    let (mut stereo, mut frame) = (flight.stereo, StereoFrame::new(sizes_px));
    let (mut files, mut next_s) = (Vec::new(), f64::NEG_INFINITY);
    while files.len() < MAX_IMAGES && stereo.next_frame(&mut frame)? {
        let time_s = since(frame.stamp, first);
        if time_s >= next_s && is_within(spans, time_s) {
            next_s = time_s + IMAGE_EVERY_S;
            let path = work.0.join("image.png");
            side_by_side(&frame).write_png(&path)?;
            let content = Content::Binary(std::fs::read(&path).with_context(|| path.display().to_string())?);
            files.push(File { name: format!("images/{time_s:08.2}.png"), content });
        }
    }
    Ok(files)
}

fn since(stamp: Timestamp, first: Timestamp) -> f64 {
    stamp.seconds_since(first).max(0.0)
}

fn side_by_side(frame: &StereoFrame) -> RgbImage {
    let views: Vec<ImageView<'_>> = (0..2).filter_map(|camera| frame.image(camera)).collect();
    let width = views.iter().map(ImageView::width).sum();
    let height = views.iter().map(ImageView::height).max().unwrap_or(0);
    let mut picture = RgbImage::new(width, height, [0; 3]);
    let mut left = 0;
    for view in &views {
        picture.gray(view, left, 0, 1.0);
        left += view.width();
    }
    picture
}
