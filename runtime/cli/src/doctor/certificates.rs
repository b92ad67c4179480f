//! Check that certificates and keys can be used, today and for a while.

use super::Verdict;
use plumbline_checkup::Fitness;
use plumbline_config::options::TlsConfig;
use plumbline_link::net::security;
use std::fs::File;
use std::io::Read as _;
use std::path::Path;
use std::time::SystemTime;

/// A certificate that ends sooner is told of, days.
const SOON_DAYS: i64 = 30;
const DAY_S: i64 = 86_400;
/// Cure for a certificate, and for an authority, that expires.
const RENEW: &str = "renew it with `plumbline keys FOLDER --renew`";
const BEGIN_ANEW: &str = "make another authority, with new certificates, by `plumbline keys NEW_FOLDER`";
/// Longest file that is read, bytes.
const MAX_BYTES: u64 = 65_536;

/// Looks at the files that `network.tls` names.
pub(super) fn check(tls: &TlsConfig, now: SystemTime) -> Verdict {
    if !tls.is_given() {
        return (Fitness::Good, "none configured: links are not encrypted".into());
    }
    let now_s = now.duration_since(SystemTime::UNIX_EPOCH).map_or(0, |since| since.as_secs() as i64);
    if let Err(error) = security::secret("network.tls.key", &tls.key) {
        return (Fitness::NotFit, error.to_string());
    }
    let mut least = (i64::MAX, &tls.certificate, RENEW);
    for (path, cure) in [(&tls.authority, BEGIN_ANEW), (&tls.certificate, RENEW)] {
        match days_left(path, now_s, cure) {
            Ok(days) if days < least.0 => least = (days, path, cure),
            Ok(_) => {}
            Err(words) => return (Fitness::NotFit, words),
        }
    }
    let (days, path, cure) = least;
    if days < SOON_DAYS {
        return (Fitness::Mind, format!("{}: valid for {days} more days; {cure}", path.display()));
    }
    (Fitness::Good, format!("valid for {days} more days"))
}

/// Whole days until a certificate ends; why it is of no use, with the `cure` for one that has ended.
fn days_left(path: &Path, now_s: i64, cure: &str) -> Result<i64, String> {
    let named = path.display();
    let mut pem = Vec::new();
    File::open(path)
        .and_then(|file| file.take(MAX_BYTES).read_to_end(&mut pem))
        .map_err(|error| format!("{named}: {error}"))?;
    let no_certificate = || format!("{named}: holds no certificate (PEM)");
    let (_, block) = x509_parser::pem::parse_x509_pem(&pem).map_err(|_| no_certificate())?;
    let validity = block.parse_x509().map_err(|_| no_certificate())?.validity().clone();
    if now_s < validity.not_before.timestamp() {
        return Err(format!(
            "{named}: valid from {} only; see whether this computer's clock is right",
            validity.not_before
        ));
    }
    let left_s = validity.not_after.timestamp() - now_s;
    if left_s < 0 {
        return Err(format!("{named}: expired {}; {cure}", validity.not_after));
    }
    Ok(left_s / DAY_S)
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_link::net::keys::{KeysRequest, make};
    use std::fs::Permissions;
    use std::os::unix::fs::PermissionsExt as _;
    use std::time::Duration;

    fn tls(folder: &Path) -> TlsConfig {
        let file = |name: &str| folder.join(name);
        TlsConfig {
            authority: file("authority.pem"),
            certificate: file("vehicle.pem"),
            key: file("vehicle.key"),
            ..TlsConfig::default()
        }
    }

    fn days(n: u64) -> Duration {
        Duration::from_secs(86_400 * n)
    }

    #[test]
    fn dates_and_secrecy_decide() {
        let folder = tempfile::tempdir().unwrap();
        make(&KeysRequest {
            folder: folder.path(),
            roles: &[],
            vehicles: &[],
            hosts: &[],
            days: 90,
            renew: false,
        })
        .unwrap();
        let (tls, now) = (tls(folder.path()), SystemTime::now() + days(1) / 2);
        assert!(matches!(check(&tls, now), (Fitness::Good, words) if words.contains("89 more days")));
        assert!(matches!(check(&tls, now + days(70)), (Fitness::Mind, words) if words.contains("--renew")));
        let expired = check(&tls, now + days(91));
        let is_of_vehicle = |words: &str| words.contains("vehicle.pem: expired") && words.contains("--renew");
        assert!(matches!(&expired, (Fitness::NotFit, words) if is_of_vehicle(words)), "{expired:?}");
        let ended = check(&tls, now + days(3660));
        let is_of_authority =
            |words: &str| words.contains("authority.pem: expired") && words.contains("NEW_FOLDER");
        assert!(matches!(&ended, (Fitness::NotFit, words) if is_of_authority(words)), "{ended:?}");
        let early = check(&tls, now - days(3));
        assert!(matches!(&early, (Fitness::NotFit, words) if words.contains("clock")), "{early:?}");
        std::fs::set_permissions(&tls.key, Permissions::from_mode(0o644)).unwrap();
        assert!(matches!(check(&tls, now), (Fitness::NotFit, words) if words.contains("chmod 600")));
    }

    #[test]
    fn files_that_are_no_certificates_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let tls = tls(folder.path());
        let is_named = |name: &str| matches!(check(&tls, SystemTime::now()), (Fitness::NotFit, words) if words.contains(name));
        assert!(is_named("vehicle.key"));
        std::fs::write(&tls.key, "").unwrap();
        std::fs::set_permissions(&tls.key, Permissions::from_mode(0o600)).unwrap();
        assert!(is_named("authority.pem"));
        std::fs::write(&tls.authority, "no PEM").unwrap();
        assert!(is_named("authority.pem: holds no certificate"));
    }
}
