//! Validity by type: a [`ValidSetup`] or [`ValidConfig`] exists only if its values have passed validation.
//!
//! Both are read like what they hold and cannot be changed. To change one, take the raw value out, change it and
//! validate it again.

use crate::error::ConfigError;
use crate::options::{CameraConfig, Config, EstimatorSetup};
use serde::Serialize;
use std::ops::Deref;

/// Origin that messages name for a setup that was put together in code.
const SETUP_ORIGIN: &str = "setup of the estimator";

/// An [`EstimatorSetup`] that has passed validation: what an estimator is built from.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(transparent)]
pub struct ValidSetup(EstimatorSetup);

impl ValidSetup {
    /// The left camera: validation has seen to it that there is one.
    #[inline]
    pub fn left(&self) -> &CameraConfig {
        &self.0.camera[0]
    }

    /// The raw setup, to be changed and validated again.
    #[must_use]
    pub fn into_inner(self) -> EstimatorSetup {
        self.0
    }
}

impl Deref for ValidSetup {
    type Target = EstimatorSetup;

    #[inline]
    fn deref(&self) -> &EstimatorSetup {
        &self.0
    }
}

impl EstimatorSetup {
    /// Proves the setup valid.
    ///
    /// # Errors
    /// [`ConfigError::Invalid`] with every value that is refused, the reason and the cure.
    pub fn validate(self) -> Result<ValidSetup, ConfigError> {
        ConfigError::if_any(SETUP_ORIGIN, self.violations())?;
        Ok(ValidSetup(self))
    }
}

/// A [`Config`] that has passed validation.
#[derive(Clone, Debug)]
pub struct ValidConfig {
    config: Config,
    /// A copy of its part, so that it can be lent out.
    setup: ValidSetup,
    /// File or other origin, for messages.
    origin: String,
}

/// Configurations with the same values are equal, whatever they were read from.
impl PartialEq for ValidConfig {
    fn eq(&self, other: &Self) -> bool {
        self.config == other.config
    }
}

impl ValidConfig {
    /// The part that concerns the estimator.
    #[inline]
    pub fn setup(&self) -> &ValidSetup {
        &self.setup
    }

    /// The raw configuration, to be changed and validated again.
    #[must_use]
    pub fn into_inner(self) -> Config {
        self.config
    }

    /// This configuration with `change` made to it; `origin` names the change in messages.
    ///
    /// # Errors
    /// When a value is refused then.
    pub fn with(&self, origin: &str, change: impl FnOnce(&mut Config)) -> Result<Self, ConfigError> {
        let mut config = self.config.clone();
        change(&mut config);
        Ok(config.validated(origin)?.in_place_of(self))
    }

    /// This configuration, a changed form of `original`: messages name the file of that one.
    #[must_use]
    pub fn in_place_of(self, original: &Self) -> Self {
        Self { origin: original.origin.clone(), ..self }
    }

    /// File, preset or other origin.
    pub fn origin(&self) -> &str {
        &self.origin
    }
}

impl Deref for ValidConfig {
    type Target = Config;

    #[inline]
    fn deref(&self) -> &Config {
        &self.config
    }
}

impl From<ValidConfig> for Config {
    fn from(valid: ValidConfig) -> Self {
        valid.config
    }
}

impl Config {
    /// Proves the configuration valid; `origin` names its source in messages.
    ///
    /// # Errors
    /// [`ConfigError::Invalid`] with every value that is refused, the reason and the cure.
    pub fn validated(self, origin: &str) -> Result<ValidConfig, ConfigError> {
        ConfigError::if_any(origin, self.violations())?;
        let setup = ValidSetup(self.setup());
        Ok(ValidConfig { config: self, setup, origin: origin.to_owned() })
    }
}
