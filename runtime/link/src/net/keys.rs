//! A small certificate authority: certificates whose common name says what their holder may do ([`super::certificate`]).
//!
//! The files of a role are `<role>.pem` and `<role>.key`, those of a vehicle by name `vehicle-<name>.pem` and
//! `vehicle-<name>.key`; `vehicle.pem` is for the vehicle `drone`. Files keep their names when they are renewed, so that no
//! configuration changes; the number in the certificate's name grows, so that the old one can be excluded.

use super::certificate::{self, DEFAULT_VEHICLE, MAX_NUMBER};
use rcgen::{
    BasicConstraints, CertificateParams, DistinguishedName, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer,
    KeyPair, KeyUsagePurpose,
};
use std::fs::OpenOptions;
use std::io::Write as _;
use std::net::IpAddr;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};
use thiserror::Error;
use time::{Duration, OffsetDateTime};
use x509_parser::extensions::GeneralName;

/// Roles that certificates are made for.
pub const ROLES: [&str; 4] = ["vehicle", "router", "operator", "viewer"];
/// Names of a certificate when none are given.
pub const DEFAULT_HOSTS: [&str; 2] = ["localhost", "127.0.0.1"];
/// File of the authority's certificate.
pub const AUTHORITY: &str = "authority.pem";
/// File of the authority's private key.
pub const AUTHORITY_KEY: &str = "authority.key";
/// Validity of an authority, days. Renewal leaves it as it is, so that the holders of its certificate need
/// nothing new.
const AUTHORITY_DAYS: u32 = 3650;

/// Errors of keys and certificates.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum KeysError {
    /// A file cannot be read or written.
    #[error("{path}: {error}")]
    File {
        /// The file.
        path: PathBuf,
        /// Error of the system.
        error: std::io::Error,
    },
    /// What is in the folder, or is not, forbids what is asked.
    #[error("{path}: {message}")]
    Refused {
        /// The file, or the folder.
        path: PathBuf,
        /// Reason and cure.
        message: String,
    },
    /// A name that cannot be part of a file's name and of a key.
    #[error("--vehicle {name}: give letters, digits, - and _, at most {MAX_NAME}")]
    Name {
        /// The name.
        name: String,
    },
    /// A certificate cannot be made.
    #[error("{about}: {error}")]
    Certificate {
        /// Certificate or request concerned.
        about: String,
        /// Error of the certificate.
        error: rcgen::Error,
    },
}

const NOTHING_TO_RENEW: &str = "does not exist, so it cannot be renewed; leave out --renew to create it";
/// Longest name of a vehicle, characters.
pub const MAX_NAME: usize = 40;

/// Keys and certificates to be made.
#[derive(Clone, Debug)]
pub struct KeysRequest<'a> {
    /// Folder of the files.
    pub folder: &'a Path,
    /// Roles.
    pub roles: &'a [String],
    /// Vehicles by name, each with a certificate of its own.
    pub vehicles: &'a [String],
    /// Names and addresses under which holders can be reached; empty: when renewing those of before, else this host.
    pub hosts: &'a [String],
    /// Validity.
    pub days: u32,
    /// Replace the certificates that are there, under the same file names; without roles and vehicles all of the
    /// folder. The authority stays the same, so that who has its certificate needs nothing new.
    pub renew: bool,
}

/// Holder of a certificate.
#[derive(Clone, Debug, PartialEq, Eq)]
struct Holder {
    role: String,
    vehicle: Option<String>,
}

impl Holder {
    fn role(role: &str) -> Self {
        Self { role: role.to_owned(), vehicle: None }
    }

    fn vehicle(name: &str) -> Result<Self, KeysError> {
        let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
        if name.is_empty() || name.len() > MAX_NAME || !name.chars().all(is_plain) {
            return Err(KeysError::Name { name: name.to_owned() });
        }
        Ok(Self { role: "vehicle".into(), vehicle: Some(name.to_owned()) })
    }

    /// Name without the number.
    fn name(&self) -> String {
        match (self.role.as_str(), &self.vehicle) {
            ("vehicle", name) => certificate::vehicle(name.as_deref().unwrap_or(DEFAULT_VEHICLE)),
            (role, _) => role.to_owned(),
        }
    }

    /// File name without its ending.
    fn stem(&self) -> String {
        self.vehicle.as_ref().map_or_else(|| self.role.clone(), |name| format!("{}-{name}", self.role))
    }
}

/// Makes certificates, and the authority that signs them when there is none in the folder. Without `renew` nothing that
/// is there is overwritten, and an authority never is. Returns the files written.
///
/// # Errors
/// When a file cannot be read or written, a name is invalid, a certificate exists already, there is none to renew, or the
/// authority's key is missing.
pub fn make(request: &KeysRequest<'_>) -> Result<Vec<PathBuf>, KeysError> {
    let mut written = Vec::new();
    let path = |name: &str| request.folder.join(name);
    let holders = holders(request)?;
    for holder in &holders {
        let certificate = path(&format!("{}.pem", holder.stem()));
        match (request.renew, certificate.exists()) {
            (true, false) => return Err(refused(&certificate, NOTHING_TO_RENEW)),
            (false, true) => {
                return Err(refused(&certificate, "exists; renew it with --renew, or name another folder"));
            }
            _ => {}
        }
    }
    std::fs::create_dir_all(request.folder).map_err(|error| file_error(request.folder, error))?;
    if !path(AUTHORITY_KEY).exists() {
        if request.renew || path(AUTHORITY).exists() {
            let cure = "does not exist, so nothing can be signed; bring the authority's key back, or name another folder";
            return Err(refused(&path(AUTHORITY_KEY), cure));
        }
        let (certificate, key) = authority().map_err(about("the authority"))?;
        written.push(write(&path(AUTHORITY_KEY), &key, 0o600)?);
        written.push(write(&path(AUTHORITY), &certificate, 0o644)?);
    }
    let read =
        |name: &str| std::fs::read_to_string(path(name)).map_err(|error| file_error(&path(name), error));
    let key = KeyPair::from_pem(&read(AUTHORITY_KEY)?).map_err(about(AUTHORITY_KEY))?;
    let issuer = Issuer::from_ca_cert_pem(&read(AUTHORITY)?, key).map_err(about(AUTHORITY))?;
    for holder in &holders {
        let stem = holder.stem();
        let certificate = path(&format!("{stem}.pem"));
        let hosts = hosts(request, &certificate)?;
        let name = certificate::common_name(&holder.name(), number(holder, &certificate)?);
        let (text, key) = signed(&name, &hosts, request.days, &issuer).map_err(about(&stem))?;
        written.push(write(&path(&format!("{stem}.key")), &key, 0o600)?);
        written.push(write(&certificate, &text, 0o644)?);
    }
    Ok(written)
}

/// Returns the holders that get a certificate.
fn holders(request: &KeysRequest<'_>) -> Result<Vec<Holder>, KeysError> {
    let named = request.vehicles.iter().map(|name| Holder::vehicle(name)).collect::<Result<Vec<_>, _>>()?;
    let mut holders: Vec<Holder> = request.roles.iter().map(|role| Holder::role(role)).chain(named).collect();
    if !holders.is_empty() {
        return Ok(holders);
    }
    if !request.renew {
        return Ok(ROLES.map(Holder::role).into());
    }
    let entries = std::fs::read_dir(request.folder).map_err(|error| file_error(request.folder, error))?;
    for entry in entries.filter_map(Result::ok) {
        let name = entry.file_name().to_string_lossy().into_owned();
        let Some(stem) = name.strip_suffix(".pem") else { continue };
        if ROLES.contains(&stem) {
            holders.push(Holder::role(stem));
        } else if let Some(name) = stem.strip_prefix("vehicle-") {
            holders.push(Holder::vehicle(name)?);
        }
    }
    holders.sort_by_key(Holder::stem);
    if holders.is_empty() {
        return Err(refused(request.folder, NOTHING_TO_RENEW));
    }
    Ok(holders)
}

/// The number of a certificate: the one after that of the file that it replaces.
fn number(holder: &Holder, path: &Path) -> Result<u32, KeysError> {
    let name = certificate::name_in(path).unwrap_or_default();
    let before = certificate::parse(&name).filter(|(other, _)| *other == holder.name());
    match before.map_or(1, |(_, number)| number.saturating_add(1)) {
        number if number > MAX_NUMBER => {
            let words = "has the last certificate number";
            Err(refused(path, &format!("{words}, {MAX_NUMBER}; create a new authority in another folder")))
        }
        number => Ok(number),
    }
}

/// The names of a certificate: those of the request, else of the one that is renewed, else this host's.
fn hosts(request: &KeysRequest<'_>, certificate: &Path) -> Result<Vec<String>, KeysError> {
    if !request.hosts.is_empty() {
        return Ok(request.hosts.to_vec());
    }
    if request.renew {
        let text = std::fs::read(certificate).map_err(|error| file_error(certificate, error))?;
        let hosts = hosts_of(&text).unwrap_or_default();
        if !hosts.is_empty() {
            return Ok(hosts);
        }
    }
    Ok(DEFAULT_HOSTS.map(str::to_owned).into())
}

/// Names and addresses of a certificate (PEM).
fn hosts_of(pem: &[u8]) -> Option<Vec<String>> {
    let (_, block) = x509_parser::pem::parse_x509_pem(pem).ok()?;
    let certificate = block.parse_x509().ok()?;
    let names = &certificate.subject_alternative_name().ok()??.value.general_names;
    let host = |name: &GeneralName<'_>| match name {
        GeneralName::DNSName(name) => Some((*name).to_owned()),
        GeneralName::IPAddress(bytes) => <[u8; 4]>::try_from(*bytes)
            .map(IpAddr::from)
            .or_else(|_| <[u8; 16]>::try_from(*bytes).map(IpAddr::from))
            .ok()
            .map(|address| address.to_string()),
        _ => None,
    };
    Some(names.iter().filter_map(host).collect())
}

fn about(what: &str) -> impl Fn(rcgen::Error) -> KeysError {
    let about = what.to_owned();
    move |error| KeysError::Certificate { about: about.clone(), error }
}

fn refused(path: &Path, message: &str) -> KeysError {
    KeysError::Refused { path: path.to_owned(), message: message.to_owned() }
}

fn file_error(path: &Path, error: std::io::Error) -> KeysError {
    KeysError::File { path: path.to_owned(), error }
}

fn named(name: &str, days: u32) -> CertificateParams {
    let mut params = CertificateParams::default();
    params.distinguished_name = DistinguishedName::new();
    params.distinguished_name.push(DnType::OrganizationName, "Plumbline");
    params.distinguished_name.push(DnType::CommonName, name);
    // Clocks of a field crew differ.
    params.not_before = OffsetDateTime::now_utc() - Duration::days(1);
    params.not_after = OffsetDateTime::now_utc() + Duration::days(i64::from(days));
    params
}

fn authority() -> Result<(String, String), rcgen::Error> {
    let mut params = named("Plumbline authority", AUTHORITY_DAYS);
    params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
    let key = KeyPair::generate()?;
    Ok((params.self_signed(&key)?.pem(), key.serialize_pem()))
}

fn signed(
    name: &str,
    hosts: &[String],
    days: u32,
    issuer: &Issuer<'_, KeyPair>,
) -> Result<(String, String), rcgen::Error> {
    let mut params = named(name, days);
    params.subject_alt_names = CertificateParams::new(hosts.to_vec())?.subject_alt_names;
    params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
    params.extended_key_usages =
        vec![ExtendedKeyUsagePurpose::ServerAuth, ExtendedKeyUsagePurpose::ClientAuth];
    let key = KeyPair::generate()?;
    Ok((params.signed_by(&key, issuer)?.pem(), key.serialize_pem()))
}

/// Writes a file whole or not at all: a vehicle that starts meanwhile reads the old one or the new one.
fn write(path: &Path, text: &str, mode: u32) -> Result<PathBuf, KeysError> {
    let mut partial = path.as_os_str().to_owned();
    partial.push(".partial");
    let partial = PathBuf::from(partial);
    // A link that somebody has put there is not followed.
    let _ = std::fs::remove_file(&partial);
    OpenOptions::new()
        .write(true)
        .create_new(true)
        .mode(mode)
        .open(&partial)
        .and_then(|mut file| file.write_all(text.as_bytes()).and_then(|()| file.sync_all()))
        .and_then(|()| std::fs::rename(&partial, path))
        .map_err(|error| file_error(path, error))?;
    Ok(path.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt as _;

    fn strings(names: &[&str]) -> Vec<String> {
        names.iter().map(|n| (*n).to_owned()).collect()
    }

    fn request<'a>(folder: &'a Path, roles: &'a [String], vehicles: &'a [String]) -> KeysRequest<'a> {
        KeysRequest { folder, roles, vehicles, hosts: &[], days: 2, renew: false }
    }

    #[test]
    fn a_link_in_place_of_a_partial_file_is_not_followed() {
        let folder = tempfile::tempdir().unwrap();
        let other = folder.path().join("other");
        std::fs::write(&other, "kept").unwrap();
        for file in ["viewer.key.partial", "authority.key.partial"] {
            std::os::unix::fs::symlink(&other, folder.path().join(file)).unwrap();
        }
        make(&request(folder.path(), &strings(&["viewer"]), &[])).unwrap();
        assert_eq!(std::fs::read_to_string(&other).unwrap(), "kept");
        let metadata = folder.path().join("viewer.key").symlink_metadata().unwrap();
        assert_eq!((metadata.is_file(), metadata.permissions().mode() & 0o777), (true, 0o600));
    }

    #[test]
    fn an_authority_is_made_once_and_nothing_is_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let first = strings(&["vehicle", "viewer"]);
        assert_eq!(make(&request(folder.path(), &first, &[])).unwrap().len(), 6);
        let second = strings(&["operator"]);
        assert_eq!(make(&request(folder.path(), &second, &[])).unwrap().len(), 2);
        let error = make(&request(folder.path(), &second, &[])).unwrap_err().to_string();
        assert!(error.contains("operator.pem") && error.contains("--renew"), "{error}");
        let name = |file: &str| certificate::name_in(&folder.path().join(file)).unwrap();
        assert_eq!([name("vehicle.pem"), name("operator.pem")], ["vehicle:drone.1", "operator.1"]);
        let mode = std::fs::metadata(folder.path().join("vehicle.key")).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
    }

    #[test]
    fn an_authority_whose_key_is_away_is_not_replaced() {
        let folder = tempfile::tempdir().unwrap();
        make(&request(folder.path(), &[], &[])).unwrap();
        std::fs::remove_file(folder.path().join(AUTHORITY_KEY)).unwrap();
        let files = || {
            let entries = std::fs::read_dir(folder.path()).unwrap().map(|entry| entry.unwrap().path());
            entries
                .map(|path| (std::fs::read(&path).unwrap(), path))
                .collect::<std::collections::BTreeSet<_>>()
        };
        let before = files();
        let hawk = strings(&["hawk"]);
        let added = request(folder.path(), &[], &hawk);
        for refused in [KeysRequest { renew: true, ..request(folder.path(), &[], &[]) }, added] {
            assert!(make(&refused).unwrap_err().to_string().contains("nothing can be signed"));
            assert_eq!(files(), before);
        }
        std::fs::remove_file(folder.path().join(AUTHORITY)).unwrap();
        let renewed = KeysRequest { renew: true, ..request(folder.path(), &[], &[]) };
        assert!(make(&renewed).unwrap_err().to_string().contains("nothing can be signed"));
    }

    #[test]
    fn the_authority_outlives_the_certificates_that_it_signs() {
        let folder = tempfile::tempdir().unwrap();
        make(&request(folder.path(), &strings(&["viewer"]), &[])).unwrap();
        let days = |name: &str| {
            let pem = std::fs::read(folder.path().join(name)).unwrap();
            let (_, block) = x509_parser::pem::parse_x509_pem(&pem).unwrap();
            let validity = block.parse_x509().unwrap().validity().clone();
            (validity.not_after - validity.not_before).unwrap().whole_days()
        };
        // Both begin a day before they are made.
        assert_eq!([days("viewer.pem"), days("authority.pem")], [3, i64::from(AUTHORITY_DAYS) + 1]);
    }

    #[test]
    fn certificates_that_could_not_be_told_apart_are_not_made() {
        let folder = tempfile::tempdir().unwrap();
        let roles = strings(&["viewer"]);
        make(&request(folder.path(), &roles, &[])).unwrap();
        let renewed = KeysRequest { renew: true, ..request(folder.path(), &roles, &[]) };
        for _ in 1..MAX_NUMBER {
            make(&renewed).unwrap();
        }
        assert!(make(&renewed).unwrap_err().to_string().contains("the last certificate number"));
    }
}
