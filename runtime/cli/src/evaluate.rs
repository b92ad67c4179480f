//! `plumbline evaluate`: a trajectory against its ground truth.

use super::checks::choice;
use super::say;
use anyhow::{Context as _, Result};
use clap::Args;
use plumbline_lab::evaluate::{
    AlignmentMode, Delta, EvaluateOptions, Evaluation, Statistics, evaluate, load_trajectory,
};
use std::path::PathBuf;

/// Arguments of `plumbline evaluate`.
#[derive(Debug, Args)]
pub struct EvaluateArgs {
    /// Estimated trajectory (TUM).
    pub estimate: PathBuf,
    /// Ground truth: TUM (plain or .gz), a EuRoC ground truth table, or a EuRoC data set.
    pub truth: PathBuf,
    /// Degrees of freedom of the alignment.
    #[arg(long, value_parser = choice(AlignmentMode::NAMED), default_value = "se3")]
    pub align: AlignmentMode,
    /// Interval of the relative errors, frames.
    #[arg(long, default_value_t = 1, conflicts_with = "delta_m")]
    pub delta_frames: usize,
    /// Interval of the relative errors, metres.
    #[arg(long)]
    pub delta_m: Option<f64>,
    /// Compute relative errors from every pose, over overlapping intervals. Default: over consecutive intervals.
    #[arg(long)]
    pub all_pairs: bool,
    /// Largest difference between the stamps of associated poses, seconds.
    #[arg(long, default_value_t = 0.01)]
    pub max_difference: f64,
    /// Seconds to add to the stamps of the estimate, as evo's --t_offset. For live flights, which are stamped by the host's
    /// monotonic clock.
    #[arg(long, value_name = "S", default_value_t = 0.0, value_parser = parse_seconds, allow_hyphen_values = true)]
    pub time_offset: f64,
    /// Print JSON.
    #[arg(long)]
    pub json: bool,
}

fn parse_seconds(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|s: &f64| s.is_finite()).ok_or_else(|| "give a number of seconds".into())
}

/// Runs the command.
///
/// # Errors
/// When a file cannot be read or the trajectories have too little in common.
pub fn run(args: &EvaluateArgs) -> Result<()> {
    let delta = args.delta_m.map_or(Delta::Frames(args.delta_frames), Delta::Metres);
    let options = EvaluateOptions {
        max_difference_s: args.max_difference,
        alignment: args.align,
        delta,
        all_pairs: args.all_pairs,
        time_offset_s: args.time_offset,
    };
    let result = evaluate(&load_trajectory(&args.estimate)?, &load_trajectory(&args.truth)?, &options)
        .with_context(|| format!("{} against {}", args.estimate.display(), args.truth.display()))?;
    if args.json {
        say(format_args!("{}", serde_json::to_string_pretty(&result)?));
    } else {
        print(&result);
    }
    Ok(())
}

fn print(e: &Evaluation) {
    say(format_args!("{:<14}{:>12}{:>12}{:>12}{:>12}{:>12}", "", "rmse", "mean", "median", "std", "max"));
    let row = |name: &str, s: &Statistics| {
        say(format_args!(
            "{name:<14}{:>12.6}{:>12.6}{:>12.6}{:>12.6}{:>12.6}",
            s.rmse, s.mean, s.median, s.std, s.max
        ));
    };
    row("ATE [m]", &e.ate_m);
    if let Some(rotation_deg) = &e.ate_rotation_deg {
        row("ATE [deg]", rotation_deg);
    }
    if let Some(rpe) = &e.rpe {
        row("RPE [m]", &rpe.translation_m);
        row("RPE [deg]", &rpe.rotation_deg);
    }
    say(format_args!(
        "{} pairs over {:.2} m; the estimate covers {:.1} % of the truth",
        e.associated,
        e.path_length_m,
        100.0 * e.completion
    ));
    if e.time_offset_s != 0.0 {
        say(format_args!("stamps of the estimate shifted by {:+.3} s", e.time_offset_s));
    }
    e.doubt.iter().for_each(say);
    if e.ate_rotation_deg.is_none() {
        say(
            "rotation errors unknown: the positions move too little for an alignment by them; use --align origin",
        );
    }
    let percent = 100.0 * e.ate_m.rmse / e.path_length_m.max(1e-9);
    let optional =
        |x: Option<f64>, unit: &str| x.map_or_else(|| "unknown".into(), |x| format!("{x:+.3} {unit}"));
    say(format_args!(
        "ATE {percent:.3} % of the path; scale error {}; yaw drift {}",
        optional(e.scale_error_percent, "%"),
        optional(e.yaw_drift_deg_per_min, "deg/min")
    ));
}
