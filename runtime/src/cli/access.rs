//! Options that routers and ground stations share: who we are on the network, and whom we let in.

use crate::net::Endpoints;
use clap::Args;
use plumbline_config::options::{LoginConfig, TlsConfig};
use std::path::PathBuf;

/// Certificates, names and passwords.
#[derive(Clone, Debug, Default, Args)]
#[command(next_help_heading = "Access")]
pub struct AccessArgs {
    /// Certificate of the authority that signed everybody's (PEM), for endpoints that begin with tls/.
    #[arg(long, value_name = "PEM", requires_all = ["certificate", "key"])]
    pub authority: Option<PathBuf>,
    /// Our certificate (PEM), as `plumbline keys` writes it; its role says what we may do.
    #[arg(long, value_name = "PEM", requires = "authority")]
    pub certificate: Option<PathBuf>,
    /// Its private key (PEM).
    #[arg(long, value_name = "PEM", requires = "authority")]
    pub key: Option<PathBuf>,
    /// Our name, where passwords are asked for.
    #[arg(long, requires = "password_file")]
    pub user: Option<String>,
    /// File that holds our password on its first line.
    #[arg(long, value_name = "FILE", requires = "user")]
    pub password_file: Option<PathBuf>,
    /// File with a line name:password for everyone who may connect to us.
    #[arg(long, value_name = "FILE")]
    pub users_file: Option<PathBuf>,
    /// Name from the users file that may give commands; may be repeated.
    #[arg(long, value_name = "NAME", requires = "users_file")]
    pub operator: Vec<String>,
}

impl AccessArgs {
    /// Where to listen and connect, with these keys; `vehicle` may be a pattern.
    #[must_use]
    pub fn endpoints(&self, vehicle: &str, listen: &[String], connect: &[String]) -> Endpoints {
        let path = |path: &Option<PathBuf>| path.clone().unwrap_or_default();
        Endpoints {
            vehicle: vehicle.to_owned(),
            listen: listen.to_vec(),
            connect: connect.to_vec(),
            tls: TlsConfig {
                authority: path(&self.authority),
                certificate: path(&self.certificate),
                key: path(&self.key),
            },
            login: LoginConfig {
                user: self.user.clone().unwrap_or_default(),
                password_file: path(&self.password_file),
                users_file: path(&self.users_file),
                operators: self.operator.clone(),
            },
            ..Endpoints::default()
        }
    }
}
