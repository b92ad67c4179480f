//! Faults of a campaign, by name and dose.

use super::{CampaignArgs, ImuChoice};
use crate::Usage;
use plumbline_lab::campaign::CampaignFault;
use plumbline_simulator::InjectedFault;
use plumbline_simulator::Named;

/// The faults that are asked for and happen in the flight, never none; and those of a set that would begin after its end.
pub fn faults(args: &CampaignArgs) -> Result<(Vec<CampaignFault>, Vec<CampaignFault>), Usage> {
    let end_s = args.choice.duration;
    // With one camera there is no right one to lose, and without the left there is none.
    let possible = |fault: &CampaignFault| !(args.trial.mono && fault.needs_two_cameras());
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
pub fn not_flown(args: &CampaignArgs) -> Result<Option<String>, Usage> {
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
pub fn each_named<const IS_IMU: bool>(wanted: &[String]) -> Result<Vec<Named<IS_IMU>>, Usage> {
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
        assert!(chosen("--faults").contains(&"misalignment:3".to_owned()));
        assert!(!chosen("--faults --imu recorded").iter().any(|name| name.contains("force:")));
        assert!(each_named::<true>(&["force:x".to_owned()]).is_err());
        assert_eq!(each_named::<true>(&["all".to_owned()]).unwrap().len(), CampaignFault::inertial().count());
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
            each_named::<false>(&["all".to_owned()]).unwrap().len(),
            CampaignFault::conditions().count()
        );
    }
}
