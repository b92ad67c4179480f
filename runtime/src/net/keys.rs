//! A small certificate authority: certificates whose common name is the role of their holder.

use rcgen::{
    BasicConstraints, CertificateParams, DistinguishedName, DnType, ExtendedKeyUsagePurpose, IsCa, Issuer,
    KeyPair, KeyUsagePurpose,
};
use std::fs::OpenOptions;
use std::io::Write as _;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::{Path, PathBuf};
use thiserror::Error;
use time::{Duration, OffsetDateTime};

/// Roles that certificates are made for.
pub const ROLES: [&str; 4] = ["vehicle", "router", "operator", "viewer"];
/// File of the authority's certificate.
pub const AUTHORITY: &str = "authority.pem";
/// File of the authority's private key.
pub const AUTHORITY_KEY: &str = "authority.key";

/// Why there are no keys.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum KeysError {
    /// A file cannot be read or written.
    #[error("{path}: {error}")]
    File {
        /// The file.
        path: PathBuf,
        /// What the system says.
        error: std::io::Error,
    },
    /// A certificate cannot be made.
    #[error("{about}: {error}")]
    Certificate {
        /// What it was for.
        about: String,
        /// What is wrong.
        error: rcgen::Error,
    },
}

/// What is made.
#[derive(Clone, Debug)]
pub struct Request<'a> {
    /// Folder of the files.
    pub folder: &'a Path,
    /// Roles.
    pub roles: &'a [String],
    /// Names and addresses under which holders can be reached.
    pub hosts: &'a [String],
    /// Validity.
    pub days: u32,
}

/// Makes certificates, and the authority that signs them when there is none in the folder. Nothing that is
/// there is overwritten. Returns the files written.
///
/// # Errors
/// When a file cannot be read or written, or a name is none.
pub fn make(request: &Request<'_>) -> Result<Vec<PathBuf>, KeysError> {
    let mut written = Vec::new();
    let path = |name: &str| request.folder.join(name);
    std::fs::create_dir_all(request.folder).map_err(|error| file_error(request.folder, error))?;
    if !path(AUTHORITY_KEY).exists() {
        let (certificate, key) = authority(request.days).map_err(about("the authority"))?;
        written.push(write(&path(AUTHORITY_KEY), &key, 0o600)?);
        written.push(write(&path(AUTHORITY), &certificate, 0o644)?);
    }
    let read =
        |name: &str| std::fs::read_to_string(path(name)).map_err(|error| file_error(&path(name), error));
    let key = KeyPair::from_pem(&read(AUTHORITY_KEY)?).map_err(about(AUTHORITY_KEY))?;
    let issuer = Issuer::from_ca_cert_pem(&read(AUTHORITY)?, key).map_err(about(AUTHORITY))?;
    for role in request.roles {
        let (certificate, key) = signed(role, request, &issuer).map_err(about(role))?;
        written.push(write(&path(&format!("{role}.key")), &key, 0o600)?);
        written.push(write(&path(&format!("{role}.pem")), &certificate, 0o644)?);
    }
    Ok(written)
}

fn about(what: &str) -> impl Fn(rcgen::Error) -> KeysError {
    let about = what.to_owned();
    move |error| KeysError::Certificate { about: about.clone(), error }
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

fn authority(days: u32) -> Result<(String, String), rcgen::Error> {
    let mut params = named("Plumbline authority", days);
    params.is_ca = IsCa::Ca(BasicConstraints::Constrained(0));
    params.key_usages = vec![KeyUsagePurpose::KeyCertSign, KeyUsagePurpose::CrlSign];
    let key = KeyPair::generate()?;
    Ok((params.self_signed(&key)?.pem(), key.serialize_pem()))
}

fn signed(
    role: &str,
    request: &Request<'_>,
    issuer: &Issuer<'_, KeyPair>,
) -> Result<(String, String), rcgen::Error> {
    let mut params = named(role, request.days);
    params.subject_alt_names = CertificateParams::new(request.hosts.to_vec())?.subject_alt_names;
    params.key_usages = vec![KeyUsagePurpose::DigitalSignature];
    params.extended_key_usages =
        vec![ExtendedKeyUsagePurpose::ServerAuth, ExtendedKeyUsagePurpose::ClientAuth];
    let key = KeyPair::generate()?;
    Ok((params.signed_by(&key, issuer)?.pem(), key.serialize_pem()))
}

/// Writes a file that is not there yet.
fn write(path: &Path, text: &str, mode: u32) -> Result<PathBuf, KeysError> {
    OpenOptions::new()
        .write(true)
        .create_new(true)
        .mode(mode)
        .open(path)
        .and_then(|mut file| file.write_all(text.as_bytes()))
        .map_err(|error| file_error(path, error))?;
    Ok(path.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::PermissionsExt as _;

    #[test]
    fn an_authority_is_made_once_and_nothing_is_overwritten() {
        let folder = tempfile::tempdir().unwrap();
        let hosts = ["localhost".to_owned(), "127.0.0.1".to_owned()];
        let roles = |names: &[&str]| names.iter().map(|n| (*n).to_owned()).collect::<Vec<_>>();
        let request =
            |roles: &'static [String]| Request { folder: folder.path(), roles, hosts: &hosts, days: 2 };
        let first: &'static [String] = roles(&["vehicle", "viewer"]).leak();
        assert_eq!(make(&request(first)).unwrap().len(), 6);
        let second: &'static [String] = roles(&["operator"]).leak();
        assert_eq!(make(&request(second)).unwrap().len(), 2);
        let error = make(&request(second)).unwrap_err().to_string();
        assert!(error.contains("operator.key"), "{error}");
        let mode = std::fs::metadata(folder.path().join("vehicle.key")).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
    }
}
