//! Options that routers and ground stations share: who we are on the network, and whom we let in.

use clap::Args;
use plumbline_config::options::{TlsConfig, is_certificate_name};
use plumbline_link::net::Endpoints;
use plumbline_link::net::certificate::{self, DEFAULT_VEHICLE};
use std::path::{Path, PathBuf};

/// Certificates.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Access")]
pub struct AccessArgs {
    /// Certificate of the common authority (PEM), for endpoints that begin with tls/.
    #[arg(long, value_name = "PEM", requires_all = ["certificate", "key"])]
    pub authority: Option<PathBuf>,
    /// Own certificate (PEM), written by `plumbline keys`. Its name determines the role.
    #[arg(long, value_name = "PEM", requires = "authority")]
    pub certificate: Option<PathBuf>,
    /// Private key of the certificate (PEM), readable by its owner only (chmod 600).
    #[arg(long, value_name = "PEM", requires = "authority")]
    pub key: Option<PathBuf>,
    /// Name of a vehicle whose certificate is accepted; may be repeated. Default: drone, and the vehicles whose
    /// certificates are in the folder of the authority.
    #[arg(long = "fleet", value_name = "NAME", requires = "authority")]
    pub fleet: Vec<String>,
    /// Revoked certificate: operator.1, or operator for all operator certificates; may be repeated.
    #[arg(long, value_name = "NAME", requires = "authority", value_parser = certificate_name)]
    pub excluded: Vec<String>,
}

impl AccessArgs {
    /// Where to listen and connect, with these keys; `vehicle` may be a pattern.
    pub fn endpoints(&self, vehicle: &str, listen: &[String], connect: &[String]) -> Endpoints {
        let path = |path: &Option<PathBuf>| path.clone().unwrap_or_default();
        Endpoints {
            vehicle: vehicle.to_owned(),
            hears: self.hears(vehicle),
            listen: listen.to_vec(),
            connect: connect.to_vec(),
            tls: TlsConfig {
                authority: path(&self.authority),
                certificate: path(&self.certificate),
                key: path(&self.key),
                excluded: self.excluded.clone(),
            },
            ..Endpoints::default()
        }
    }

    /// Vehicles that are accepted, by the names of their certificates.
    fn hears(&self, vehicle: &str) -> Vec<String> {
        let mut names = self.fleet.clone();
        names.push(DEFAULT_VEHICLE.to_owned());
        if !vehicle.contains('*') {
            names.push(vehicle.to_owned());
        }
        let here = |folder: &Path| if folder.as_os_str().is_empty() { ".".into() } else { folder.to_owned() };
        let folder = self.authority.as_deref().and_then(Path::parent).map(here);
        let files = folder.and_then(|folder| std::fs::read_dir(folder).ok()).into_iter().flatten().flatten();
        for file in files {
            let is_vehicles = file
                .file_name()
                .to_str()
                .is_some_and(|name| name.starts_with("vehicle") && name.ends_with(".pem"));
            let name = if is_vehicles { certificate::name_in(&file.path()) } else { None };
            let holder = name.as_deref().and_then(certificate::parse).map(|(holder, _)| holder);
            names.extend(holder.and_then(certificate::vehicle_of).map(str::to_owned));
        }
        names.sort();
        names.dedup();
        names.retain(|name| is_certificate_name(&certificate::vehicle(name)));
        names
    }
}

fn certificate_name(text: &str) -> Result<String, String> {
    match is_certificate_name(text) {
        true => Ok(text.to_owned()),
        false => {
            Err("write operator.1 for one certificate, operator for all of them, vehicle:NAME for a vehicle"
                .into())
        }
    }
}
