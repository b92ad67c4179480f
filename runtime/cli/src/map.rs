//! `plumbline map`: contents of maps, maps joined, and the map of a vehicle in flight.

use super::{check_outputs, say};
use anyhow::Result;
use clap::{Args, Subcommand};
use plumbline_estimator::places::MapLimits;
use plumbline_flight::places::{MapContents, codec, merge, read_map, write_map};
use std::path::{Path, PathBuf};

/// Arguments of `plumbline map`.
#[derive(Debug, Args)]
pub struct MapArgs {
    #[command(subcommand)]
    command: MapCommand,
}

#[derive(Debug, Subcommand)]
enum MapCommand {
    /// Request that a vehicle writes its map now; it must fly with --save-map.
    Save(super::remote::RemoteArgs),
    /// List the contents of a map.
    Info {
        /// Map file.
        map: PathBuf,
    },
    /// Join two maps of the same place, by locating the second in the first.
    Merge(MergeArgs),
}

/// Limits of a map.
#[derive(Debug, Args)]
struct LimitArgs {
    /// Largest number of keyframes. Above it, the most redundant keyframe is dropped.
    #[arg(long, default_value_t = 2000, value_parser = clap::value_parser!(u32).range(1..=i64::from(codec::MAX_KEYFRAMES)))]
    max_keyframes: u32,
    /// Largest number of features of a keyframe.
    #[arg(long, default_value_t = 400, value_parser = clap::value_parser!(u32).range(20..=i64::from(codec::MAX_FEATURES)))]
    max_features: u32,
}

impl LimitArgs {
    fn limits(&self) -> MapLimits {
        MapLimits { keyframes: self.max_keyframes as usize, features: self.max_features as usize }
    }
}

#[derive(Debug, Args)]
struct MergeArgs {
    /// First map; the result is in its frame.
    first: PathBuf,
    /// Second map, which is joined to the first.
    second: PathBuf,
    /// Map to write.
    #[arg(long, value_name = "OUT.map")]
    out: PathBuf,
    #[command(flatten)]
    limits: LimitArgs,
}

/// Runs the command.
///
/// # Errors
/// When a file cannot be used, or nothing comes of it.
pub fn run(args: &MapArgs) -> Result<()> {
    match &args.command {
        MapCommand::Save(remote) => remote.give(plumbline_ground::command::save_map),
        MapCommand::Info { map } => run_info(map),
        MapCommand::Merge(args) => run_merge(args),
    }
}

fn run_info(path: &Path) -> Result<()> {
    let map = read_map(path)?;
    let sessions: std::collections::BTreeSet<u32> = map.keyframes.iter().map(|k| k.session).collect();
    let points = map.keyframes.iter().flat_map(|k| &k.features).filter(|f| f.is_point()).count();
    say(format_args!(
        "{}: format {}, descriptors of kind {}",
        path.display(),
        codec::VERSION,
        codec::DESCRIPTOR_KIND
    ));
    say(format_args!("keyframes  {} of {} flight(s)", map.keyframes.len(), sessions.len()));
    say(format_args!("features   {}, of which {points} are points", map.feature_count()));
    say(format_args!("lines      {}", map.line_count()));
    let places = || map.keyframes.iter().map(|k| k.pose_m_b.translation.vector);
    if let Some(first) = places().next() {
        let (low, high) = places().fold((first, first), |(l, h), p| (l.inf(&p), h.sup(&p)));
        let span = |i: usize| format!("{:.2}..{:.2}", low[i], high[i]);
        say(format_args!("positions  x {} y {} z {} m", span(0), span(1), span(2)));
    }
    Ok(())
}

fn run_merge(args: &MergeArgs) -> Result<()> {
    check_outputs([&args.out])?;
    let (first, second) = (read_map(&args.first)?, read_map(&args.second)?);
    let map = first.clone().into_map(first.limits());
    let Some(fit) = merge::fit(&map, &second) else {
        anyhow::bail!(
            "{}: not found in {}: fewer than {} of its {} keyframes agree on a place; are they of one place?",
            args.second.display(),
            args.first.display(),
            merge::MIN_AGREEING,
            second.keyframes.len()
        );
    };
    let merged = MapContents::of(&merge::merged(first, second, &fit, args.limits.limits()));
    write_map(&args.out, &merged)?;
    let p = fit.pose_a_b.translation.vector;
    say(format_args!(
        "{}: {} keyframes; {} of the second map's were found in the first, {} agree that it lies at {:.3} {:.3} {:.3} m, turned by {:.2} degrees",
        args.out.display(),
        merged.keyframes.len(),
        fit.located,
        fit.agreeing,
        p.x,
        p.y,
        p.z,
        fit.pose_a_b.rotation.angle().to_degrees()
    ));
    Ok(())
}
