//! PLUMBLINE: certificates that are refused by their names, although an authority has signed them.

use std::sync::Arc;

use rustls::{
    client::danger::HandshakeSignatureValid,
    pki_types::{CertificateDer, UnixTime},
    server::danger::{ClientCertVerified, ClientCertVerifier},
    CertificateError, DigitallySignedStruct, DistinguishedName, Error, SignatureScheme,
};
use x509_parser::prelude::{FromDer, X509Certificate};

use crate::places::{Bounds, Places};

/// Key of an endpoint's configuration: common names, separated by `|`. One without a number at its end (`operator`) stands for
/// all of its numbers (`operator.1`).
pub(crate) const EXCLUDED_NAMES: &str = "excluded_names";

/// Names of certificates that are refused.
#[derive(Clone, Debug, Default)]
pub(crate) struct Excluded(Vec<String>);

impl Excluded {
    pub(crate) fn parse(names: Option<&str>) -> Self {
        let names = names.unwrap_or_default().split('|');
        Self(names.filter(|name| !name.is_empty()).map(str::to_owned).collect())
    }

    /// Whether a certificate of this common name is refused.
    pub(crate) fn refuses(&self, name: &str) -> bool {
        let holder = name.rsplit_once('.').map_or(name, |(holder, _)| holder);
        self.0.iter().any(|other| other == name || other == holder)
    }

    fn refuses_certificate(&self, certificate: &CertificateDer<'_>) -> bool {
        // One that cannot be read is refused like one that is excluded.
        names(certificate).is_none_or(|names| names.iter().any(|name| self.refuses(name)))
    }
}

/// Common names of a certificate; `None` when one cannot be read.
fn names(certificate: &CertificateDer<'_>) -> Option<Vec<String>> {
    let (_, certificate) = X509Certificate::from_der(certificate.as_ref()).ok()?;
    let names = certificate.subject().iter_common_name();
    names.map(|name| name.as_str().ok().map(str::to_owned)).collect()
}

/// A verifier of clients that refuses some of those that another one accepts: certificates that are excluded, and those
/// that have no place.
#[derive(Debug)]
pub(crate) struct ExcludingVerifier {
    pub(crate) verifier: Arc<dyn ClientCertVerifier>,
    pub(crate) excluded: Excluded,
    pub(crate) places: Places,
    pub(crate) bounds: Option<Bounds>,
}

impl ClientCertVerifier for ExcludingVerifier {
    fn offer_client_auth(&self) -> bool {
        self.verifier.offer_client_auth()
    }

    fn client_auth_mandatory(&self) -> bool {
        self.verifier.client_auth_mandatory()
    }

    fn root_hint_subjects(&self) -> &[DistinguishedName] {
        self.verifier.root_hint_subjects()
    }

    fn verify_client_cert(
        &self,
        end_entity: &CertificateDer<'_>,
        intermediates: &[CertificateDer<'_>],
        now: UnixTime,
    ) -> Result<ClientCertVerified, Error> {
        let verified = self.verifier.verify_client_cert(end_entity, intermediates, now)?;
        if self.excluded.refuses_certificate(end_entity) {
            return Err(Error::InvalidCertificate(CertificateError::Revoked));
        }
        // The alert says "access denied" to the peer.
        let name = names(end_entity).and_then(|names| names.into_iter().next());
        match self.places.has_room(self.bounds.as_ref(), name.as_deref().unwrap_or_default()) {
            true => Ok(verified),
            false => Err(Error::InvalidCertificate(CertificateError::ApplicationVerificationFailure)),
        }
    }

    fn verify_tls12_signature(
        &self,
        message: &[u8],
        cert: &CertificateDer<'_>,
        dss: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        self.verifier.verify_tls12_signature(message, cert, dss)
    }

    fn verify_tls13_signature(
        &self,
        message: &[u8],
        cert: &CertificateDer<'_>,
        dss: &DigitallySignedStruct,
    ) -> Result<HandshakeSignatureValid, Error> {
        self.verifier.verify_tls13_signature(message, cert, dss)
    }

    fn supported_verify_schemes(&self) -> Vec<SignatureScheme> {
        self.verifier.supported_verify_schemes()
    }
}
