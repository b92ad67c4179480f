//! `plumbline map`: maps from images with known poses, images located in maps, what is in a map, and the map of a
//! vehicle in flight.

use super::simulated::check_recorded;
use super::topics::TopicArgs;
use super::{Usage, check_outputs, load_config, say};
use anyhow::{Context as _, Result};
use clap::{Args, Subcommand};
use plumbline_drivers::StampedPose;
use plumbline_drivers::tum::write_tum;
use plumbline_estimator::places::{ExtractorOptions, LocatorOptions, MapLimits};
use plumbline_flight::flight::{RecordingKind, open_recording, recording_kind};
use plumbline_flight::places::build::{BuildOptions, LocatedFrame, build, locate};
use plumbline_flight::places::frames::{Choice, RecordedFrames};
use plumbline_flight::places::{MapContents, codec, merge, ply, read_map, write_map};
use plumbline_lab::evaluate::load_trajectory;
use std::fmt::Write as _;
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
    /// Build a map from stereo images with known poses.
    Build(BuildArgs),
    /// Locate each image of a data set in a map, independently of the others.
    Locate(LocateArgs),
    /// List the contents of a map.
    Info {
        /// Map file.
        map: PathBuf,
    },
    /// Join two maps of the same place, by locating the second in the first.
    Merge(MergeArgs),
    /// Export the points and lines of a map as a point cloud.
    Export {
        /// Map file.
        map: PathBuf,
        /// Output file (PLY): points, positions of the keyframes, and lines as edges.
        #[arg(long, value_name = "OUT.ply")]
        ply: PathBuf,
    },
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

/// The images, and which of them.
#[derive(Debug, Args)]
struct ImageArgs {
    /// A EuRoC data set (its IMU may be missing), a flight log with images, or a ROS bag.
    dataset: PathBuf,
    /// Configuration file or preset with the calibration of the cameras. Default: that of the data set or log.
    #[arg(long)]
    config: Option<PathBuf>,
    /// Use every Nth frame.
    #[arg(long, default_value_t = 1, value_parser = clap::value_parser!(u32).range(1..))]
    every: u32,
    /// First frame to use, counted from 0.
    #[arg(long, default_value_t = 0)]
    first: u32,
    /// Topics of a bag.
    #[command(flatten)]
    topics: TopicArgs,
}

impl ImageArgs {
    fn open(&self, max_features: usize) -> Result<RecordedFrames> {
        check_recorded(&self.dataset)?;
        let choice = Choice { every: self.every as usize, offset: self.first as usize };
        let options = ExtractorOptions { max_features, ..ExtractorOptions::default() };
        let config = load_config(self.config.as_deref())?;
        if recording_kind(&self.dataset) == RecordingKind::Dataset {
            return Ok(RecordedFrames::open(&self.dataset, config, choice, &options)?);
        }
        let flight = open_recording(&self.dataset, config, &self.topics.names()?, None, false)?;
        Ok(RecordedFrames::of(flight.stereo, &flight.config, flight.config.camera.len(), choice, &options))
    }
}

#[derive(Debug, Args)]
struct BuildArgs {
    #[command(flatten)]
    images: ImageArgs,
    /// Poses of the body, ground truth or estimated: TUM (plain or .gz), a EuRoC ground truth table, or a EuRoC data
    /// set with ground truth.
    #[arg(long, value_name = "POSES")]
    poses: PathBuf,
    /// Map to write.
    #[arg(long, value_name = "OUT.map")]
    out: PathBuf,
    /// Smallest distance between two keyframes, m; a rotation of 30 degrees counts as one metre.
    #[arg(long, default_value_t = 0.2)]
    spacing: f64,
    #[command(flatten)]
    limits: LimitArgs,
}

#[derive(Debug, Args)]
struct LocateArgs {
    /// Map file.
    map: PathBuf,
    #[command(flatten)]
    images: ImageArgs,
    /// Write the located poses (TUM format), in the frame of the map.
    #[arg(long, value_name = "OUT.tum")]
    trajectory: Option<PathBuf>,
    /// Write one row per frame (CSV): whether it was located, by which keyframe, inliers, standard deviations.
    #[arg(long, value_name = "OUT.csv")]
    csv: Option<PathBuf>,
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
        MapCommand::Build(args) => run_build(args),
        MapCommand::Locate(args) => run_locate(args),
        MapCommand::Info { map } => run_info(map),
        MapCommand::Merge(args) => run_merge(args),
        MapCommand::Export { map, ply } => run_export(map, ply),
    }
}

fn run_build(args: &BuildArgs) -> Result<()> {
    check_outputs([&args.out])?;
    if !(0.0..=1e3).contains(&args.spacing) {
        return Err(Usage(format!("--spacing {}: give metres, 0 or more", args.spacing)).into());
    }
    let poses = load_trajectory(&args.poses)?;
    let limits = args.limits.limits();
    let mut frames = args.images.open(limits.features)?;
    let (map, figures) = build(&mut frames, &poses, &BuildOptions { spacing_m: args.spacing, limits })?;
    let contents = MapContents::of(&map);
    write_map(&args.out, &contents)?;
    say(format_args!(
        "{}: {} keyframes with {} features, of {} frames ({} without a pose, {} like a keyframe that was there)",
        args.out.display(),
        contents.keyframes.len(),
        contents.feature_count(),
        figures.frames,
        figures.without_pose,
        figures.too_near
    ));
    Ok(())
}

fn run_locate(args: &LocateArgs) -> Result<()> {
    check_outputs([&args.trajectory, &args.csv].into_iter().flatten())?;
    let contents = read_map(&args.map)?;
    let limits = contents.limits();
    if limits.keyframes == 0 {
        return Err(
            Usage(format!("{}: contains no keyframe; build the map again", args.map.display())).into()
        );
    }
    let map = contents.into_map(limits);
    let max_features = ExtractorOptions::default().max_features;
    let mut frames = args.images.open(max_features)?;
    let (mut poses, mut rows, mut count) = (Vec::new(), String::from(CSV_HEADER), 0);
    locate(&mut frames, &map, &LocatorOptions::default(), max_features, |frame| {
        count += 1;
        poses.extend(frame.located.as_ref().map(|l| StampedPose { stamp: frame.stamp, pose: l.pose_m_b }));
        push_row(&mut rows, &frame);
    })?;
    if let Some(path) = &args.trajectory {
        write_tum(path, &poses)?;
    }
    if let Some(path) = &args.csv {
        std::fs::write(path, rows).with_context(|| format!("{}", path.display()))?;
    }
    say(format_args!("{} of {count} frames found in {}", poses.len(), args.map.display()));
    Ok(())
}

const CSV_HEADER: &str = "stamp_ns,features,found,keyframe,matches,first_inliers,inliers,spread,variance,sigma_m,sigma_deg,x,y,z,qx,qy,qz,qw\n";

fn push_row(rows: &mut String, frame: &LocatedFrame) {
    let start = (frame.stamp.as_nanos(), frame.features);
    let _ = match &frame.located {
        None => writeln!(rows, "{},{},0{}", start.0, start.1, ",".repeat(15)),
        Some(l) => {
            let (p, q) = (l.pose_m_b.translation.vector, l.pose_m_b.rotation.coords);
            writeln!(
                rows,
                "{},{},1,{},{},{},{},{},{:.3},{:.5},{:.4},{:.6},{:.6},{:.6},{:.9},{:.9},{:.9},{:.9}",
                start.0,
                start.1,
                l.keyframe_id,
                l.matches,
                l.first_inliers,
                l.inliers,
                l.spread,
                l.variance,
                l.sigma_m(),
                l.sigma_rad().to_degrees(),
                p.x,
                p.y,
                p.z,
                q.x,
                q.y,
                q.z,
                q.w
            )
        }
    };
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

fn run_export(path: &Path, out: &PathBuf) -> Result<()> {
    check_outputs([out])?;
    let contents = read_map(path)?;
    let limits = contents.limits();
    let map = contents.into_map(limits);
    std::fs::write(out, ply::ply(&map)).with_context(|| format!("{}", out.display()))?;
    say(format_args!("{}: {} keyframes", out.display(), map.len()));
    Ok(())
}
