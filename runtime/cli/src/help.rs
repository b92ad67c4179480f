//! `plumbline --help` and `plumbline help`: commands by task, every help at 80 columns, and the tables of conditions, faults and
//! errors of inertial sensors.

use super::Usage;
use super::command_line::{Cli, HelpArgs};
use clap::{Command, CommandFactory as _};
use plumbline_simulator::InjectedFault;
use plumbline_simulator::{ImuError, SimulatedCondition};
use std::fmt::Write as _;
use std::io::ErrorKind;

/// Width of a terminal that fits every help.
const COLUMNS: usize = 80;
/// Indent of what continues an example.
const CONTINUED: usize = 6;
/// Width of the names of commands in a list.
const NAMES: usize = 13;

/// Commands that `plumbline --help` lists, by task, each task in the order of use.
const TASKS: [(&str, &[&str]); 4] = [
    ("Fly", &["demo", "setup", "devices", "calibrate", "config", "doctor", "fly"]),
    ("Recordings", &["replay", "verify", "log", "evaluate", "map"]),
    ("Watch", &["ground", "keys"]),
    ("Experiments", &["simulate"]),
];

/// Options of a simulated flight that the help of `simulate` explains, and that of `replay` leaves out.
const OF_SIMULATE: [&str; 8] = [
    "imu",
    "imu_error",
    "calibration_error",
    "lean_deg",
    "laps",
    "time_offset_ms",
    "extrinsics_error_deg",
    "flicker",
];

/// A table that `plumbline help` prints: name, introduction, kinds.
type Table = (&'static str, &'static str, fn() -> String);

/// Kinds that options of several commands take.
const TABLES: [Table; 3] = [
    (
        "conditions",
        "Conditions of light, camera, scene or motion in a simulated flight, such as `--condition blur:10:6`. Omitted doses have \
         the defaults in brackets.",
        SimulatedCondition::help,
    ),
    (
        "faults",
        "Faults in any flight, such as `--fault accel-pulse:x:30@6+0.1`: \
         KIND[:AXES|CAMERA][:DOSE...][@FROM[+DURATION[/PERIOD]]]. FROM is the beginning, DURATION the length, and PERIOD the time \
         after which the fault acts again, all in seconds, FROM since the first frame. Omitted parts have the defaults in \
         brackets; without a duration a fault lasts to the end. Faults act in the order given.",
        InjectedFault::help,
    ),
    (
        "imu-errors",
        "Errors of the simulated inertial sensor, such as `--imu-error force:0.07:2`. Omitted doses have the defaults in \
         brackets.",
        ImuError::help,
    ),
];

/// The command line as it is parsed and helped with: the help of `replay` leaves out what that of `simulate` explains.
pub fn command() -> Command {
    full().mut_subcommand("replay", |replay| {
        let replay =
            OF_SIMULATE.iter().fold(replay, |replay, name| replay.mut_arg(name, |arg| arg.hide(true)));
        let others = OF_SIMULATE.map(|name| format!("--{}", name.replace('_', "-"))).join(", ");
        replay.after_help(format!("Explained by `plumbline simulate --help`: {others}."))
    })
}

/// The whole command line, with commands by task, and laid out for [`COLUMNS`].
pub fn full() -> Command {
    let cli = Cli::command().disable_help_subcommand(true).max_term_width(COLUMNS);
    let more = filled(&format!("More: {}.", other_names(&cli).join(", ")), 0);
    let template = format!(
        "{{about}}\n\n{{usage-heading}} {{usage}}\n\n{}\n{more}\n`plumbline help COMMAND` describes one, `plumbline help all` \
         lists every one.\n\nOptions:\n{{options}}{{after-help}}",
        by_task(&cli)
    );
    cli.help_template(template)
}

/// Prints what is asked for.
///
/// # Errors
/// When there is no such command or table.
pub fn run(args: &HelpArgs) -> anyhow::Result<()> {
    let cli = command();
    let words: Vec<&str> = args.topic.iter().map(String::as_str).collect();
    if words == ["all"] {
        super::say(all(&cli).trim_end());
        return Ok(());
    }
    if let Some((_, about, kinds)) = TABLES.iter().find(|(name, ..)| words == [*name]) {
        super::say(table(about, &kinds()));
        return Ok(());
    }
    if words.iter().try_fold(&cli, |above, word| above.find_subcommand(word)).is_none() {
        let message = format!(
            "help {}: there is no such command, and no such table ({}); `plumbline help all` lists the commands",
            words.join(" "),
            TABLES.map(|(name, ..)| name).join(", ")
        );
        return Err(Usage(message).into());
    }
    match help_of(&words).print() {
        // A reader that has gone, as `head` does, is no failure.
        Err(error) if error.kind() != ErrorKind::BrokenPipe => Err(error.into()),
        _ => Ok(()),
    }
}

/// Help that `--help` prints of the command that these words name; clap has it as an error.
fn help_of(words: &[&str]) -> clap::Error {
    let asked = ["plumbline"].iter().chain(words).chain(&["--help"]);
    match command().try_get_matches_from(asked) {
        Err(help) => help,
        Ok(_) => clap::Error::new(clap::error::ErrorKind::DisplayHelp),
    }
}

/// Every command: by task, then the others, and the tables.
fn all(cli: &Command) -> String {
    let tables = TABLES.iter().map(|(name, about, _)| {
        let subject = about.split(", such as").next().unwrap_or(about);
        filled(&format!("  help {name:12}{subject}"), 19)
    });
    let tables = tables.collect::<Vec<_>>().join("\n");
    format!("{}\nOther commands:\n{}\nTables:\n{tables}\n", by_task(cli), rows(cli, &other_names(cli)))
}

/// Commands of [`TASKS`] that this build has.
fn by_task(cli: &Command) -> String {
    let tasks = TASKS.map(|(task, names)| format!("{task}:\n{}", rows(cli, names)));
    tasks.join("\n")
}

/// Names of the commands that no task lists.
fn other_names(cli: &Command) -> Vec<&str> {
    let is_listed = |name: &str| TASKS.iter().any(|(_, names)| names.contains(&name));
    cli.get_subcommands().map(Command::get_name).filter(|name| !is_listed(name)).collect()
}

/// A row for each command of these names.
fn rows(cli: &Command, names: &[&str]) -> String {
    let mut rows = String::new();
    for found in names.iter().filter_map(|name| cli.find_subcommand(name)) {
        let about = found.get_about().map(ToString::to_string).unwrap_or_default();
        let row = format!("  {:NAMES$}{about}", found.get_name());
        let _ = writeln!(rows, "{}", filled(&row, 2 + NAMES));
    }
    rows
}

/// A table of kinds, each line of `kinds` as `NAME:DOSES - TEXT`.
fn table(about: &str, kinds: &str) -> String {
    let mut text = filled(about, 0);
    for line in kinds.lines() {
        let (name, about) = line.split_once(" - ").unwrap_or((line, ""));
        let _ = write!(text, "\n\n{}", filled(&format!("  {name}"), CONTINUED));
        let indented = format!("{:CONTINUED$}{about}", "");
        let _ = write!(text, "\n{}", filled(&indented, CONTINUED));
    }
    text
}

/// Text broken at blanks into lines of at most [`COLUMNS`] characters; lines after the first are indented by `indent`.
fn filled(text: &str, indent: usize) -> String {
    let (mut lines, mut rest) = (Vec::new(), text.to_owned());
    while rest.chars().count() > COLUMNS {
        let fits = rest.char_indices().nth(COLUMNS).map_or(rest.len(), |(at, _)| at);
        let begin = rest.len() - rest.trim_start().len();
        let Some(at) = rest[..=fits].rfind(' ').filter(|at| *at > begin) else { break };
        lines.push(rest[..at].trim_end().to_owned());
        rest = format!("{:indent$}{}", "", rest[at..].trim_start());
    }
    lines.push(rest);
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Helps of a command and of all below it, each after its words.
    fn helps(command: &Command, words: &[&str], into: &mut Vec<(String, String)>) {
        into.push((words.join(" "), help_of(words).to_string()));
        for below in command.get_subcommands().filter(|below| below.get_name() != "help") {
            helps(below, &[words, &[below.get_name()]].concat(), into);
        }
    }

    fn all_helps() -> Vec<(String, String)> {
        let (cli, mut found) = (command(), Vec::new());
        helps(&cli, &[], &mut found);
        found
    }

    #[test]
    fn every_help_and_every_table_fits_eighty_columns() {
        let tables = TABLES.map(|(name, about, kinds)| (name.to_owned(), table(about, &kinds())));
        let list = [("all".to_owned(), all(&command()))];
        let found = all_helps();
        assert!(found.len() > 25, "{}", found.len());
        for (name, help) in found.into_iter().chain(tables).chain(list) {
            // clap never breaks the line of usage.
            for line in help.lines().filter(|line| !line.starts_with("Usage: ")) {
                assert!(line.chars().count() <= COLUMNS, "{name}: {line}");
            }
        }
    }

    #[test]
    fn help_lists_eighteen_commands_at_most_by_task_and_names_the_others() {
        let help = command().render_long_help().to_string();
        assert!(TASKS.iter().all(|(task, _)| help.contains(&format!("\n{task}:\n"))), "{help}");
        assert!(TASKS.iter().map(|(_, names)| names.len()).sum::<usize>() <= 18);
        let cli = command();
        for (_, names) in TASKS {
            for name in names {
                assert!(cli.find_subcommand(name).is_some(), "{name}");
            }
        }
        for name in cli.get_subcommands().map(Command::get_name) {
            assert!(help.contains(name) && all(&cli).contains(&format!("\n  {name} ")), "{name}");
        }
        for (name, ..) in TABLES {
            assert!(all(&cli).contains(&format!("\n  help {name} ")), "{name}");
        }
    }

    #[test]
    fn options_that_the_help_of_replay_leaves_out_stand_in_that_of_simulate() {
        let found = all_helps();
        let help = |wanted: &str| &found.iter().find(|(name, _)| name == wanted).unwrap().1;
        for name in OF_SIMULATE {
            let option = format!("--{} ", name.replace('_', "-"));
            let is_explained =
                |help: &str| help.lines().any(|line| line.starts_with(&format!("      {}", option.trim())));
            assert!(is_explained(help("simulate")) && !is_explained(help("replay")), "{name}");
            let words = help("replay").split_whitespace().map(|word| word.trim_end_matches([',', '.']));
            assert!(words.clone().any(|word| word == option.trim()), "{name} is not named");
        }
    }

    #[test]
    fn tables_name_every_kind_that_the_options_take() {
        let of = |wanted: &str| {
            let (_, about, kinds) = TABLES.iter().find(|(name, ..)| *name == wanted).unwrap();
            table(about, &kinds())
        };
        for (name, kinds) in [
            ("conditions", &["blur:exposure, ms [6]", "bare-hover:", "intrinsics:"][..]),
            ("faults", &["stamp-jitter:", "gyro-late:AXES [xyz]:ms [20] [@10]", "rig-lens"]),
            ("imu-errors", &["force:", "vibration:"]),
        ] {
            let text = of(name);
            assert!(kinds.iter().all(|kind| text.contains(&format!("\n  {kind}"))), "{name}: {text}");
        }
    }
}
