//! `plumbline keys`: certificates for vehicles and ground stations.

use super::say;
use anyhow::Result;
use clap::Args;
use plumbline_link::net::certificate;
use plumbline_link::net::keys::{self, KeysRequest, ROLES};
use std::path::PathBuf;

/// Arguments of `plumbline keys`.
#[derive(Debug, Args)]
pub struct KeysArgs {
    /// Folder of the files. If it has no authority, one is created; otherwise the existing authority signs.
    pub folder: PathBuf,
    /// Role of the certificate: vehicle (the one named drone), router, operator (may give commands), viewer (may
    /// watch); may be repeated. Default: all.
    #[arg(long, value_parser = ROLES)]
    pub role: Vec<String>,
    /// Make a certificate for the vehicle of this name, in vehicle-NAME.pem and vehicle-NAME.key; may be repeated.
    #[arg(long, value_name = "NAME")]
    pub vehicle: Vec<String>,
    /// Name or address of the holder on the network; may be repeated. [default: localhost and 127.0.0.1; with --renew
    /// the names in the old certificate]
    #[arg(long, value_name = "NAME")]
    pub host: Vec<String>,
    /// Replace existing certificates under the same file names: those of --role and --vehicle. Default: all. The
    /// authority does not change, so peers need no new copy of it.
    #[arg(long)]
    pub renew: bool,
    /// Days of validity of the certificates. A new authority is valid for ten years.
    #[arg(long, default_value_t = 90, value_parser = clap::value_parser!(u32).range(1..=3650))]
    pub days: u32,
}

/// Runs the command.
///
/// # Errors
/// When a file cannot be written.
pub fn run(args: &KeysArgs) -> Result<()> {
    let request = KeysRequest {
        folder: &args.folder,
        roles: &args.role,
        vehicles: &args.vehicle,
        hosts: &args.host,
        days: args.days,
        renew: args.renew,
    };
    for file in keys::make(&request)? {
        let name = certificate::name_in(&file).filter(|name| certificate::parse(name).is_some());
        match name {
            Some(name) => say(format_args!("{} ({name})", file.display())),
            None => say(file.display()),
        }
    }
    if args.renew {
        say(
            "Give each holder its two new files, and restart it; the authority is the same. The old certificates are good \
             until they end, unless they are excluded (network.tls.excluded, --excluded).",
        );
    } else {
        say(format_args!(
            "Give each holder {} and its own two files; keep {} away from the field.",
            keys::AUTHORITY,
            keys::AUTHORITY_KEY
        ));
    }
    Ok(())
}
