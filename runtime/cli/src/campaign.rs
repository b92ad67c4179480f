//! `plumbline campaign`: the built-in set of simulated flights, tabulated.

use super::choice::FlightChoice;
use super::paired::{self, Against};
use super::{Usage, check_outputs, load_config, one_line, say_unless_closed};
use anyhow::{Context, Result, ensure};
use clap::{Args, ValueEnum};
use plumbline_config::Config;
use plumbline_drivers::InjectedFault;
use plumbline_drivers::simulator::{Family, Named};
use plumbline_flight::flight::with_overrides;
use plumbline_lab::campaign::honest::{HONESTY_HEAD, honesty_row, honesty_summary};
use plumbline_lab::campaign::table::{
    HEALTH_HEAD, RATIO_HEAD, SILENCE_HEAD, TABLE_HEAD, TRUST_HEAD, consistency, health_rows, means,
    ratio_rows, silence_row, trust_row,
};
use plumbline_lab::campaign::{CampaignFault, Entry, Setup, drawn};
use plumbline_lab::report::Report;
use plumbline_lab::report::paired::{PairedComparison, Variant};
use plumbline_lab::sweep::run::fly_each;
use serde::Serialize;
use std::fmt::Display;
use std::path::PathBuf;

/// Arguments of `plumbline campaign`.
#[derive(Debug, Args)]
pub struct CampaignArgs {
    /// Choice of the flights.
    #[command(flatten)]
    pub choice: FlightChoice,
    /// Start times, seconds into the trajectory; every flight is flown from each. Default: a time in full flight.
    #[arg(long, value_delimiter = ',', value_name = "S,S")]
    pub start: Vec<f64>,
    /// Inertial samples: simulated, or recorded along the paths. Recorded samples exist for V1_01, V1_02, V2_01,
    /// V2_02, MH_01, MH_03 and MH_04, and need the preset euroc.
    #[arg(long, value_enum, default_value_t = ImuChoice::Simulated)]
    pub imu: ImuChoice,
    /// Also fly each fault once, along the first trajectory in the first scene of the choice, and report whether the
    /// errors were consistent with the covariance.
    #[arg(long)]
    pub faults: bool,
    /// Fly only faults with these name prefixes, such as blind,imu-gap, and no flight without a fault. Also takes
    /// faults with a dose and a time, such as accel-pulse:x:30@6+0.1 (`plumbline help faults` lists them), and errors of inertial
    /// sensors and conditions, such as force:0.05:1 or blur:10:6 (see --imu-error and --condition); these are flown
    /// in addition to the flights without a fault.
    #[arg(long, value_delimiter = ',', requires = "faults", value_name = "NAME|KIND:DOSE@FROM")]
    pub fault: Vec<String>,
    /// Fly each fault along every flight of the choice, not only along the first.
    #[arg(long, requires = "faults")]
    pub everywhere: bool,
    /// Fly so many flights with drawn failures instead: kind, axis, size, moment and noise, among jitter of stamps, missing
    /// frames, crowds and textures, and tabulate how often each health bit named the right sensor. A thousand flights of 12 s
    /// take half an hour.
    #[arg(long, value_name = "COUNT", conflicts_with_all = ["faults", "imu_error", "condition"])]
    pub drawn: Option<usize>,
    /// Seed of the draws of --drawn.
    #[arg(long, requires = "drawn", default_value_t = 1)]
    pub draw_seed: u64,
    /// Also fly every flight with this error of the inertial sensor, such as force:0.07:2, and compare. `all` is
    /// every error in its usual doses (`plumbline help imu-errors`). May be repeated.
    #[arg(long, value_name = "NAME[:DOSE...]", value_delimiter = ',')]
    pub imu_error: Vec<String>,
    /// Also fly every flight in this condition of light, camera, scene or motion, such as blur:10:6, and compare.
    /// `all` is every condition in its usual doses (`plumbline help conditions`). May be repeated.
    #[arg(long, value_name = "NAME[:DOSE...]", value_delimiter = ',')]
    pub condition: Vec<String>,
    /// Give the estimator a calibration that the seed draws around the true one, with K times the standard deviations
    /// in [rig] of the configuration (before --set).
    #[allow(rustdoc::broken_intra_doc_links)]
    #[arg(long, value_name = "K", default_value_t = 0.0)]
    pub calibration_error: f64,
    /// Tilt of the whole scene of every flight from the vertical, degrees, in a direction drawn by the seed.
    #[arg(long, value_name = "DEG", default_value_t = 0.0, allow_hyphen_values = true)]
    pub lean_deg: f64,
    /// Use the left camera only.
    #[arg(long)]
    pub mono: bool,
    /// Configuration file or preset of the simulated rig and of the estimator.
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Change a key of the estimator's configuration, such as estimator.points.sigma_px=0.3; may be repeated. The
    /// simulated rig keeps its own values.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<String>,
    /// Cache rendered frames in this folder (about 220 MB for 15 s of stereo).
    #[arg(long)]
    pub cache: Option<PathBuf>,
    /// Parallel flights.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=64))]
    pub jobs: u8,
    /// Number of threads of a flight: 1 renders between frames, 2 renders ahead on another thread.
    #[arg(long, default_value_t = 2, value_parser = clap::value_parser!(u8).range(1..=8))]
    pub threads: u8,
    /// Write all reports (JSON).
    #[arg(long, value_name = "OUT.json")]
    pub json: Option<PathBuf>,
    /// Compare with a variant, flight by flight: means, mean paired differences and their bootstrap intervals of 95
    /// %. A variant is a change of the configuration (key=value,key=value, after --set); every flight is also flown
    /// with it. A variant can also be a --json file of the same flights from another build, shown as "before". May be
    /// repeated.
    #[arg(long, value_name = "KEY=VALUE,...|FILE.json")]
    pub against: Vec<String>,
    /// With --against: write the comparison (JSON).
    #[arg(long, value_name = "OUT.json", requires = "against")]
    pub paired_json: Option<PathBuf>,
}

impl CampaignArgs {
    /// True if there are files to write, even if the standard output is closed.
    fn writes_files(&self) -> bool {
        self.json.is_some() || self.paired_json.is_some()
    }
}

/// Where inertial samples come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum ImuChoice {
    /// Computed from the path.
    Simulated,
    /// Recorded along the path.
    Recorded,
}

#[derive(Serialize)]
struct Row<'a> {
    path: &'a str,
    scene: &'a str,
    fault: String,
    seed: u64,
    start_s: f64,
    duration_s: f64,
    report: &'a Report,
}

/// Runs the command.
///
/// # Errors
/// When a flight cannot be simulated.
pub fn run(args: &CampaignArgs) -> Result<()> {
    check_outputs(args.json.iter().chain(&args.paired_json))?;
    let preset = if args.imu == ImuChoice::Recorded { "euroc" } else { "sim" };
    let config = load_config(args.config.as_deref())?.map_or_else(|| Config::preset(preset), Ok)?;
    with_overrides(&config, &args.overrides)?;
    let against = args.against.iter().map(|text| Against::parse(text, &config, &args.overrides));
    let against = against.collect::<Result<Vec<_>>>()?;
    let entries = entries(args)?;
    let setup = Setup {
        config: Some(config),
        overrides: args.overrides.clone(),
        mono: args.mono,
        cache: args.cache.clone(),
        threads: usize::from(args.threads),
    };
    // A closed pipe must not lose the files.
    let say = |line: &dyn Display| say_unless_closed(args.writes_files(), line);
    say(&TABLE_HEAD);
    let flown = fly_all(&entries, &setup, args);
    let reports = || entries.iter().zip(&flown).filter_map(|(e, r)| Some((e, r.as_ref()?)));
    say(&format_args!("\n{}", means(reports())));
    say(&format_args!("\n{}", consistency(reports().map(|(_, report)| report))));
    let faulty: Vec<_> = reports().filter_map(|(entry, report)| trust_row(entry, report)).collect();
    if !faulty.is_empty() {
        say(&format_args!("\n{TRUST_HEAD}\n{}", faulty.join("\n")));
    }
    let silent: Vec<_> = reports().filter_map(|(entry, report)| silence_row(entry, report)).collect();
    for (head, rows) in [(RATIO_HEAD, ratio_rows(reports())), (SILENCE_HEAD, silent)] {
        if !rows.is_empty() {
            say(&format_args!("\n{head}\n{}", rows.join("\n")));
        }
    }
    let honest: Vec<_> = reports().filter_map(|(entry, report)| honesty_row(entry, report)).collect();
    if let Some(summary) = honesty_summary(reports()) {
        say(&format_args!("\n{HONESTY_HEAD}\n{}\n\n{summary}", honest.join("\n")));
    }
    if args.drawn.is_some() {
        let flights: Vec<_> =
            reports().filter_map(|(e, report)| Some((e, report.honesty.as_ref()?))).collect();
        say(&format_args!("\n{}", drawn::tables(&flights)));
    }
    if let Some(line) = not_flown(args)? {
        say(&line);
    }
    let health = health_rows(reports());
    if !health.is_empty() {
        say(&format_args!("\n{HEALTH_HEAD}\n{}", health.join("\n")));
    }
    if let Some(file) = &args.json {
        let rows: Vec<Row<'_>> = reports().map(json_row).collect();
        std::fs::write(file, serde_json::to_string_pretty(&rows)?).context(file.display().to_string())?;
    }
    if !against.is_empty() {
        compare(&entries, &flown, &setup, args, &against)?;
    }
    let failed = flown.iter().filter(|report| report.is_none()).count();
    ensure!(failed == 0, "{failed} of {} flights could not be flown", entries.len());
    Ok(())
}

fn json_row<'a>((entry, report): (&'a Entry, &'a Report)) -> Row<'a> {
    let fault = entry.failure();
    let scenario = &entry.scenario;
    let (start_s, duration_s) = (scenario.start_s, scenario.duration_s);
    Row { path: &entry.path, scene: entry.scene, fault, seed: scenario.seed, start_s, duration_s, report }
}

/// The reports of a variant, for pairing.
fn variant(name: String, entries: &[Entry], flown: &[Option<Report>]) -> Result<Variant> {
    let rows = entries.iter().zip(flown).filter_map(|(e, r)| Some(json_row((e, r.as_ref()?))));
    let rows: Vec<serde_json::Value> = rows.map(serde_json::to_value).collect::<Result<_, _>>()?;
    Ok(Variant::of_rows(name, &rows))
}

/// Flies or reads what is to be compared, and compares.
fn compare(
    entries: &[Entry],
    flown: &[Option<Report>],
    setup: &Setup,
    args: &CampaignArgs,
    against: &[Against],
) -> Result<()> {
    let here = variant(paired::name(&args.overrides), entries, flown)?;
    let mut comparisons = Vec::new();
    for other in against {
        comparisons.push(match other {
            Against::File(before) => PairedComparison::of(before, &here),
            Against::Changes(changes) => {
                let name = paired::name(changes);
                say_unless_closed(args.writes_files(), format_args!("\n{name}\n\n{TABLE_HEAD}"));
                let overrides = args.overrides.iter().chain(changes).cloned().collect();
                let setup = Setup { overrides, ..setup.clone() };
                let flown = fly_all(entries, &setup, args);
                PairedComparison::of(&here, &variant(name, entries, &flown)?)
            }
        });
    }
    paired::write(&comparisons, args.paired_json.as_deref())?;
    paired::say_each(&comparisons)
}

/// Flies the entries, as many at a time as asked for, and prints each as it lands; the reports are in the order of the
/// entries.
fn fly_all(entries: &[Entry], setup: &Setup, args: &CampaignArgs) -> Vec<Option<Report>> {
    let goes_on = args.writes_files();
    fly_each(entries, usize::from(args.jobs), |entry| match entry.fly_as(setup) {
        Ok(report) => {
            say_unless_closed(goes_on, entry.row(&report));
            Some(report)
        }
        Err(error) => {
            eprintln!("plumbline: {} in {}: {}", entry.path, entry.scene, one_line(&error.into()));
            None
        }
    })
}

fn entries(args: &CampaignArgs) -> Result<Vec<Entry>, Usage> {
    let mut entries = match args.imu {
        ImuChoice::Simulated => args.choice.entries(&args.start)?,
        ImuChoice::Recorded => args.choice.recorded_entries(&args.start)?,
    };
    if args.calibration_error > 0.0 {
        entries =
            entries.into_iter().map(|entry| entry.with_calibration_error(args.calibration_error)).collect();
    }
    for entry in &mut entries {
        entry.scenario.lean_deg = args.lean_deg;
    }
    if let Some(count) = args.drawn {
        return drawn::drawn(&entries, count, args.draw_seed).map_err(Usage);
    }
    let sound = entries.clone();
    if args.faults {
        let (faults, _) = faults(args)?;
        if !args.fault.is_empty() && !faults.iter().any(|fault| fault.is_compared()) {
            entries.clear();
        }
        let flights = if args.everywhere { &sound[..] } else { &sound[..1] };
        entries.extend(
            faults.into_iter().flat_map(|fault| flights.iter().map(move |entry| entry.with_fault(fault))),
        );
    }
    let errors = each_named(&args.imu_error)?.into_iter().map(CampaignFault::Inertial);
    let conditions = each_named(&args.condition)?.into_iter().map(CampaignFault::Condition);
    for fault in errors.chain(conditions) {
        entries.extend(sound.iter().map(|entry| entry.with_fault(fault)));
    }
    Ok(entries)
}

/// The faults that are asked for and happen in the flight, never none; and those of a set that would begin after its end.
fn faults(args: &CampaignArgs) -> Result<(Vec<CampaignFault>, Vec<CampaignFault>), Usage> {
    let end_s = args.choice.duration;
    // With one camera there is no right one to lose, and without the left there is none.
    let possible = |fault: &CampaignFault| !(args.mono && fault.needs_two_cameras());
    // Recorded samples have the errors of their sensor.
    let errors = CampaignFault::inertial().filter(|_| args.imu == ImuChoice::Simulated);
    let with_dose = CampaignFault::conditions().chain(CampaignFault::injected());
    let usual: Vec<CampaignFault> =
        CampaignFault::ALL.into_iter().chain(errors).chain(with_dose).filter(possible).collect();
    let happens = |fault: &CampaignFault| fault.injected_from_s().is_none_or(|begin_s| begin_s < end_s);
    if args.fault.is_empty() {
        return Ok(usual.into_iter().partition(happens));
    }
    let (mut chosen, mut late) = (Vec::new(), Vec::new());
    for wanted in &args.fault {
        let kind = wanted.split([':', '@']).next().unwrap_or_default();
        if kind != wanted && (wanted.contains('@') || InjectedFault::kinds().any(|known| known.name == kind))
        {
            chosen.push(CampaignFault::Injected(injected(wanted, end_s)?));
            continue;
        }
        if wanted.contains(':') {
            let fault = wanted.parse().map(CampaignFault::Condition);
            chosen.push(fault.or_else(|_| wanted.parse().map(CampaignFault::Inertial)).map_err(Usage)?);
            continue;
        }
        let prefix = wanted.to_lowercase().replace('-', "");
        let begins =
            |fault: &&CampaignFault| fault.name().to_lowercase().replace('-', "").starts_with(&prefix);
        let (in_flight, after): (Vec<CampaignFault>, Vec<CampaignFault>) =
            usual.iter().filter(begins).partition(|f| happens(f));
        if in_flight.is_empty() {
            return Err(match after.first() {
                Some(fault) => too_late(wanted, fault.injected_from_s().unwrap_or_default(), end_s),
                None => unknown(wanted, &usual),
            });
        }
        chosen.extend(in_flight);
        late.extend(after);
    }
    Ok((chosen, late))
}

/// The line of the faults that were left out because the flight ends before they begin.
fn not_flown(args: &CampaignArgs) -> Result<Option<String>, Usage> {
    let late = if args.faults { faults(args)?.1 } else { Vec::new() };
    let names: Vec<String> = late.into_iter().map(CampaignFault::name).collect();
    Ok((!names.is_empty()).then(|| {
        let end_s = args.choice.duration;
        format!("\nnot flown: {}: begin after the flight's end at {end_s} s", names.join(", "))
    }))
}

/// No fault of `usual` has such a name.
fn unknown(wanted: &str, usual: &[CampaignFault]) -> Usage {
    let mut kinds: Vec<String> = Vec::new();
    for fault in usual {
        let name = fault.name();
        let kind = name.split([':', '@']).next().unwrap_or_default();
        if !kinds.iter().any(|known| known == kind) {
            kinds.push(kind.to_owned());
        }
    }
    Usage(format!("--fault: unknown fault '{wanted}' of such a flight; choose {}", kinds.join(", ")))
}

/// The fault begins when the flight is over.
fn too_late(text: &str, begin_s: f64, end_s: f64) -> Usage {
    Usage(format!(
        "--fault {text}: begins at {begin_s} s, after the flight's end at {end_s} s; give a longer --duration"
    ))
}

/// The fault with a dose that `text` describes, which must begin in a flight of this length.
fn injected(text: &str, duration_s: f64) -> Result<InjectedFault, Usage> {
    let fault: InjectedFault = text.parse().map_err(Usage)?;
    let begin_s = fault.span_s().start;
    if begin_s < duration_s { Ok(fault) } else { Err(too_late(text, begin_s, duration_s)) }
}

/// The errors or conditions of those names.
fn each_named<F: Family>(wanted: &[String]) -> Result<Vec<Named<F>>, Usage> {
    let named = wanted.iter().map(|text| match text.as_str() {
        "all" => Ok(Named::cases().collect()),
        one => one.parse().map(|named| vec![named]).map_err(Usage),
    });
    Ok(named.collect::<Result<Vec<_>, Usage>>()?.into_iter().flatten().collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;
    use plumbline_drivers::simulator::{Conditions, ImuErrors};

    #[derive(Parser)]
    struct Command {
        #[command(flatten)]
        args: CampaignArgs,
    }

    /// Names of the faults that a command line asks for.
    fn chosen(line: &str) -> Vec<String> {
        let args = Command::parse_from(["campaign"].into_iter().chain(line.split_whitespace())).args;
        faults(&args).unwrap().0.into_iter().map(CampaignFault::name).collect()
    }

    #[test]
    fn errors_of_the_sensor_are_chosen_by_name_and_dose() {
        assert_eq!(chosen("--faults --fault force"), ["force:0.03:2", "force:0.07:2"]);
        assert_eq!(chosen("--faults --fault force:0.05:1,blackout"), ["force:0.05:1", "Blackout"]);
        assert!(chosen("--faults").contains(&"clipping:5".to_owned()));
        assert!(!chosen("--faults --imu recorded").iter().any(|name| name.contains("force:")));
        assert!(each_named::<ImuErrors>(&["force:x".to_owned()]).is_err());
        assert_eq!(
            each_named::<ImuErrors>(&["all".to_owned()]).unwrap().len(),
            CampaignFault::inertial().count()
        );
    }

    #[test]
    fn faults_with_a_dose_are_chosen_by_name_target_dose_and_time() {
        assert_eq!(chosen("--faults --fault accel-pulse:z:-20@3+0.3"), ["accel-pulse:z:-20@3+0.3"]);
        assert_eq!(chosen("--faults --fault image-late:left"), ["image-late:left:1@0"]);
        let dead = ["accel-dead:x:1@10", "accel-dead:y:1@10", "accel-dead:z:1@10", "accel-dead:xyz:1@10"];
        assert_eq!(chosen("--faults --fault accel-dead"), dead);
        assert!(chosen("--faults").contains(&"stamp-jitter:4@0".to_owned()));
        assert!(
            !chosen("--faults --mono")
                .iter()
                .any(|name| name.contains("rig-baseline") || name.contains(":right"))
        );
        for (text, cure) in [
            ("accel-dead@20", "longer --duration"),
            ("accel-dead:w@5", "write x, y, z"),
            ("akkel@5", "choose"),
            ("nosuch", "choose Blackout, "),
            ("blind,nosuch", "'nosuch'"),
            ("image-black --duration 8", "begins at 10 s, after the flight's end at 8 s"),
        ] {
            let line = format!("campaign --faults --fault {text}");
            let args = Command::parse_from(line.split_whitespace()).args;
            let message = faults(&args).unwrap_err().0;
            assert!(message.contains(cure), "{message}");
        }
    }

    #[test]
    fn faults_after_the_end_are_left_out_of_a_set_and_listed() {
        for set in ["", "--fault image"] {
            let line = format!("campaign --faults --duration 8 {set}");
            let args = Command::parse_from(line.split_whitespace()).args;
            let (flown, late) = faults(&args).unwrap();
            assert!(flown.iter().all(|fault| fault.injected_from_s().is_none_or(|begin_s| begin_s < 8.0)));
            assert!(!flown.is_empty() && late.iter().any(|fault| fault.name().starts_with("image-black")));
            assert!(not_flown(&args).unwrap().unwrap().contains("image-black"));
        }
        let args = Command::parse_from(["campaign", "--faults"]).args;
        assert_eq!(not_flown(&args).unwrap(), None);
    }

    #[test]
    fn conditions_are_chosen_by_name_and_dose() {
        let people = ["people:33:1.2:0", "people:60:1.2:0", "people:33:1.2:4", "people:60:1.2:4"];
        assert_eq!(chosen("--faults --fault people"), people);
        assert_eq!(chosen("--faults --fault blur:10:6"), ["blur:10:6:1"]);
        assert!(chosen("--faults").contains(&"night:20:4:8".to_owned()));
        assert_eq!(
            each_named::<Conditions>(&["all".to_owned()]).unwrap().len(),
            CampaignFault::conditions().count()
        );
    }
}
