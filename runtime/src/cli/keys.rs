//! `plumbline keys`: certificates for vehicles and ground stations.

use super::say;
use crate::net::keys::{self, ROLES, Request};
use anyhow::Result;
use clap::Args;
use std::path::PathBuf;

/// Arguments of `plumbline keys`.
#[derive(Debug, Args)]
pub struct KeysArgs {
    /// Folder of the files. An authority that is there already signs; without one it is made.
    pub folder: PathBuf,
    /// Whose certificates are made: vehicle, router, operator (may command), viewer (may look). All without.
    #[arg(long, value_parser = ROLES)]
    pub role: Vec<String>,
    /// Name or address under which the holder can be reached; may be repeated.
    #[arg(long, value_name = "NAME", default_values_t = ["localhost".to_owned(), "127.0.0.1".to_owned()])]
    pub host: Vec<String>,
    /// Days of validity.
    #[arg(long, default_value_t = 90, value_parser = clap::value_parser!(u32).range(1..=3650))]
    pub days: u32,
}

/// Runs the command.
///
/// # Errors
/// When a file cannot be written.
pub fn run(args: &KeysArgs) -> Result<()> {
    let all = ROLES.map(str::to_owned);
    let roles = if args.role.is_empty() { &all[..] } else { &args.role[..] };
    let request = Request { folder: &args.folder, roles, hosts: &args.host, days: args.days };
    for file in keys::make(&request)? {
        say(file.display());
    }
    say(format_args!(
        "Give each holder {} and the two files of its role; keep {} away from the field.",
        keys::AUTHORITY,
        keys::AUTHORITY_KEY
    ));
    Ok(())
}
