//! Names of certificates: who holds one, and which of its holder's it is.
//!
//! `viewer.1` is the first certificate of a viewer, `vehicle:hawk.3` the third of the vehicle `hawk`, after two renewals.
//! Zenoh compares the whole name with those of its rules and knows no patterns, so the numbers are few enough to be listed.

use std::path::Path;
use x509_parser::pem::parse_x509_pem;

/// Highest number of a certificate: renewed every 90 days, six years.
pub const MAX_NUMBER: u32 = 24;
/// The vehicle that the certificate of the role is for: the one that a configuration names unless it is told otherwise.
pub const DEFAULT_VEHICLE: &str = "drone";
/// The holder that gives commands.
pub const OPERATOR: &str = "operator";
/// Prefix of certificate holders that are vehicles.
const VEHICLE: &str = "vehicle:";

/// The holder that the vehicle of a name is.
pub fn vehicle(name: &str) -> String {
    format!("{VEHICLE}{name}")
}

/// The name of the vehicle that a holder is, if it is one.
pub fn vehicle_of(holder: &str) -> Option<&str> {
    holder.strip_prefix(VEHICLE)
}

/// The name of a certificate.
pub fn common_name(holder: &str, number: u32) -> String {
    format!("{holder}.{number}")
}

/// Holder and number of a certificate by its name.
pub fn parse(common_name: &str) -> Option<(&str, u32)> {
    let (holder, number) = common_name.rsplit_once('.')?;
    Some((holder, number.parse().ok()?))
}

/// The names of a holder's certificates, without those that are excluded: by name, or all of a holder's.
pub fn believed(holder: &str, excluded: &[String]) -> Vec<String> {
    let is_excluded = |name: &String| excluded.iter().any(|other| other == name || other == holder);
    (1..=MAX_NUMBER).map(|number| common_name(holder, number)).filter(|name| !is_excluded(name)).collect()
}

/// The name of a certificate (PEM); `None` when it has none.
pub fn name_of(pem: &[u8]) -> Option<String> {
    let (_, block) = parse_x509_pem(pem).ok()?;
    let certificate = block.parse_x509().ok()?;
    let name = certificate.subject().iter_common_name().next()?.as_str().ok()?.to_owned();
    Some(name)
}

/// The name of the certificate in a file; `None` when there is none.
pub fn name_in(path: &Path) -> Option<String> {
    name_of(&std::fs::read(path).ok()?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_back() {
        assert_eq!(parse(&common_name(&vehicle("hawk"), 3)), Some(("vehicle:hawk", 3)));
        assert_eq!(vehicle_of("vehicle:hawk"), Some("hawk"));
        assert_eq!(vehicle_of("operator"), None);
        assert!(parse("operator").is_none() && parse("operator.x").is_none());
    }

    #[test]
    fn one_certificate_is_excluded_or_all_of_a_holder() {
        let excluded = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>();
        let left = believed("operator", &excluded(&["operator.1", "viewer"]));
        assert_eq!(left.len(), MAX_NUMBER as usize - 1);
        assert!(!left.contains(&"operator.1".to_owned()) && left.contains(&"operator.2".to_owned()));
        assert!(believed("viewer", &excluded(&["viewer"])).is_empty());
        assert!(believed("vehicle:hawk", &excluded(&["vehicle:hawk"])).is_empty());
    }
}
