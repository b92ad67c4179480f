//! `plumbline campaign`: the built-in set of simulated flights, tabulated.

use super::{Usage, load_config};
use crate::campaign::{Entry, Fault, PATHS, SCENES, TABLE_HEAD};
use crate::report::Report;
use anyhow::{Context, Result};
use clap::Args;
use plumbline_config::Config;
use serde::Serialize;
use std::path::PathBuf;

/// Arguments of `plumbline campaign`.
#[derive(Debug, Args)]
pub struct CampaignArgs {
    /// Folder with `euroc/trajectories`; else the environment variable PLUMBLINE_SHARED, else ../shared.
    #[arg(long)]
    pub shared: Option<PathBuf>,
    /// Only these scenes.
    #[arg(long, value_delimiter = ',')]
    pub scene: Vec<String>,
    /// Only trajectories whose names begin so.
    #[arg(long, value_delimiter = ',')]
    pub path: Vec<String>,
    /// Seeds to fly with.
    #[arg(long, value_delimiter = ',', default_value = "1")]
    pub seed: Vec<u64>,
    /// Length of each flight, seconds.
    #[arg(long, default_value_t = 15.0)]
    pub duration: f64,
    /// Fly each fault once on top (V1_02 in the room unless --path or --scene say otherwise).
    #[arg(long)]
    pub faults: bool,
    /// The left camera alone.
    #[arg(long)]
    pub mono: bool,
    /// Configuration file or preset.
    #[arg(long)]
    pub config: Option<PathBuf>,
    /// Change a key of the configuration, such as estimator.points.sigma_px=0.3; may be repeated.
    #[arg(long = "set", value_name = "KEY=VALUE")]
    pub overrides: Vec<String>,
    /// Keep rendered frames in this folder (about 220 MB for 15 s of stereo).
    #[arg(long)]
    pub cache: Option<PathBuf>,
    /// 1 renders between frames, 2 ahead on another thread.
    #[arg(long, default_value_t = 2)]
    pub threads: usize,
    /// Write all reports (JSON).
    #[arg(long)]
    pub json: Option<PathBuf>,
}

#[derive(Serialize)]
struct Row {
    path: String,
    scene: String,
    fault: String,
    seed: u64,
    report: Report,
}

/// Runs the command.
///
/// # Errors
/// When a flight cannot be simulated.
pub fn run(args: &CampaignArgs) -> Result<()> {
    let base = load_config(args.config.as_deref())?.map_or_else(|| Config::preset("sim"), Ok)?;
    let config = with_overrides(&base, &args.overrides)?;
    let entries = entries(args)?;
    println!("{TABLE_HEAD}");
    let mut rows = Vec::new();
    for entry in &entries {
        let report = entry.fly(Some(&config), args.mono, args.cache.as_ref(), args.threads)?;
        println!("{}", entry.row(&report));
        rows.push(Row {
            path: entry.path.clone(),
            scene: entry.scene.into(),
            fault: format!("{:?}", entry.fault),
            seed: entry.scenario.seed,
            report,
        });
    }
    for (name, _) in SCENES {
        let of_scene: Vec<f64> = rows
            .iter()
            .filter(|r| r.scene == name && r.fault == "None")
            .filter_map(|r| r.report.accuracy.as_ref().map(|a| a.ate_percent))
            .collect();
        if !of_scene.is_empty() {
            println!("mean ATE in {name}: {:.4} %", of_scene.iter().sum::<f64>() / of_scene.len() as f64);
        }
    }
    if let Some(path) = &args.json {
        std::fs::write(path, serde_json::to_string_pretty(&rows)?).with_context(|| format!("{}", path.display()))?;
    }
    Ok(())
}

fn entries(args: &CampaignArgs) -> Result<Vec<Entry>> {
    let shared = args.shared.clone().or_else(|| std::env::var_os("PLUMBLINE_SHARED").map(PathBuf::from));
    let trajectories = shared.unwrap_or_else(|| "../shared".into()).join("euroc/trajectories");
    if !trajectories.is_dir() {
        let message = format!("{}: no such folder; name the shared data with --shared", trajectories.display());
        return Err(Usage(message).into());
    }
    let wanted = |list: &[String], name: &str| list.is_empty() || list.iter().any(|w| name.starts_with(w.as_str()));
    let mut entries = Vec::new();
    for scene in SCENES.into_iter().filter(|(name, _)| wanted(&args.scene, name)) {
        for path in PATHS.into_iter().filter(|(name, _)| wanted(&args.path, name)) {
            for &seed in &args.seed {
                entries.push(Entry::new(&trajectories, path, scene, seed, args.duration, Fault::None));
            }
        }
    }
    if args.faults {
        let path = PATHS.into_iter().find(|(name, _)| wanted(&args.path, name)).unwrap_or(PATHS[0]);
        let scene = SCENES.into_iter().find(|(name, _)| wanted(&args.scene, name)).unwrap_or(SCENES[0]);
        for fault in Fault::ALL {
            entries.push(Entry::new(&trajectories, path, scene, args.seed[0], args.duration, fault));
        }
    }
    Ok(entries)
}

/// The configuration with `key=value` changes, validated.
fn with_overrides(base: &Config, overrides: &[String]) -> Result<Config> {
    let mut table: toml::Table = toml::from_str(&base.to_toml()?)?;
    for text in overrides {
        let bad = || Usage(format!("--set: '{text}' is not of the form key=value"));
        let (key, value) = text.split_once('=').ok_or_else(bad)?;
        let parsed: toml::Table = toml::from_str(&format!("value = {value}")).map_err(|_| bad())?;
        let mut keys: Vec<&str> = key.split('.').collect();
        let last = keys.pop().ok_or_else(bad)?;
        let mut at = &mut table;
        for part in keys {
            at = at.get_mut(part).and_then(toml::Value::as_table_mut).ok_or_else(bad)?;
        }
        at.insert(last.to_owned(), parsed["value"].clone());
    }
    Ok(Config::from_toml_str(&toml::to_string(&table)?, "--set")?)
}
