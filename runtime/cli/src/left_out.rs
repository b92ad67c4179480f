//! Features that a build may leave out, by cargo features: a request for one is refused with the cure.

use super::Usage;

/// Commands, each with the feature that it needs, and whether this build has it.
const COMMANDS: &[(&str, &str, bool)] = &[
    ("ablation", "lab", cfg!(feature = "lab")),
    ("bench", "lab", cfg!(feature = "lab")),
    ("calibrate", "lab", cfg!(feature = "lab")),
    ("campaign", "lab", cfg!(feature = "lab")),
    ("lines", "lab", cfg!(feature = "lab")),
    ("plot", "lab", cfg!(feature = "lab")),
    ("report", "lab", cfg!(feature = "lab")),
    ("shuttle", "lab", cfg!(feature = "lab")),
    ("sweep", "lab", cfg!(feature = "lab")),
    ("demo", "ground", cfg!(feature = "ground")),
    ("ground", "ground", cfg!(feature = "ground")),
    ("reset", "ground", cfg!(feature = "ground")),
    ("map save", "ground", cfg!(feature = "ground")),
    ("config import", "yaml", cfg!(feature = "yaml")),
];

/// Refusal of arguments (without the name of the program) that ask for a command which this build leaves out.
#[must_use]
pub fn command(arguments: impl Iterator<Item = String>) -> Option<Usage> {
    let words: Vec<String> = arguments.skip_while(|word| word.starts_with('-')).take(2).collect();
    let is_asked =
        |name: &str| name.split(' ').eq(words.iter().take(name.split(' ').count()).map(String::as_str));
    let (name, feature, _) = COMMANDS.iter().find(|(name, _, is_here)| !is_here && is_asked(name))?;
    Some(refusal(name, feature))
}

/// Refusal of `what`, which needs a feature that this build lacks.
#[must_use]
pub fn refusal(what: &str, feature: &str) -> Usage {
    Usage(format!(
        "{what}: is not in this build, which was made without the feature `{feature}`; `make build` makes a full one"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn said(line: &str) -> Option<String> {
        command(line.split_whitespace().map(str::to_owned)).map(|usage| usage.to_string())
    }

    #[test]
    fn commands_of_this_build_are_never_refused() {
        for (name, _, is_here) in COMMANDS {
            assert_eq!(said(&format!("-v {name} --help")).is_none(), *is_here, "{name}");
        }
        assert_eq!(said("replay sim:room"), None);
        assert_eq!(said("--help"), None);
        assert_eq!(said(""), None);
    }

    #[test]
    fn every_listed_command_exists_where_its_feature_does() {
        let cli = crate::help::command();
        for (name, _, is_here) in COMMANDS {
            let below = name.split(' ').try_fold(&cli, |above, word| above.find_subcommand(word));
            assert_eq!(below.is_some(), *is_here, "{name}");
        }
    }

    #[test]
    fn a_refusal_names_command_feature_and_cure() {
        let words = refusal("sweep", "lab").to_string();
        assert!(["sweep", "`lab`", "make build"].iter().all(|word| words.contains(word)), "{words}");
    }
}
