//! Beginning of every part of a log: the flight and the part, the configuration, its hash, and the build.

use super::LogError;
use super::build_id::BuildId;
use plumbline_config::options::ImageRecording;
use plumbline_config::{Config, ValidConfig};
use plumbline_record::digest::{config_hash, hash_of};
use sha2::{Digest as _, Sha256};
use std::collections::BTreeMap;
use std::time::SystemTime;

/// Name of the metadata record.
pub const METADATA_NAME: &str = "plumbline";
/// Version of the log's format.
const FORMAT: &str = "1";

/// Keys of configurations that earlier builds recorded, and this one has no use for.
const RETIRED: [&str; 15] = [
    "ros.link",
    "ros.landmarks",
    "ros.map",
    "ros.tracks",
    "ros.reset",
    "driver.imu.trigger_exposure",
    "estimator.initial",
    "network.login",
    "estimator.lines.use_verticals",
    "estimator.lines.use_vanishing_directions",
    "estimator.lines.structure_sigma_deg",
    "estimator.lines.merge",
    "estimator.lines.merge_across_px",
    "estimator.lines.merge_along_px",
    "estimator.lines.merge_angle_deg",
];
/// The table that the configuration of every build has which makes a map.
const PLACES_TABLE: &str = "[estimator.places]";
/// Key of [`PartHeader::known_map`].
const KNOWN_MAP: &str = "known_map_sha256";
/// Key of [`PartHeader::first_reset_counter`]; 0 where it is missing.
const FIRST_RESET_COUNTER: &str = "first_reset_counter";

/// The beginning of a part.
#[derive(Clone, Debug)]
pub struct PartHeader {
    /// Names the flight: all its parts have it in common, and no other flight has it.
    pub flight: String,
    /// Number of the part, from 0.
    pub part: u32,
    /// The configuration of the estimator.
    pub config: ValidConfig,
    /// SHA-256 of the configuration.
    pub config_hash: String,
    /// Recording of images.
    pub images: ImageRecording,
    /// SHA-256 of the map that the flight went on with, where it did.
    pub known_map: Option<String>,
    /// Resets were counted from here on.
    pub first_reset_counter: u32,
    /// Build that wrote the log.
    pub build: BuildId,
}

impl PartHeader {
    /// A new flight with `config`, which must come back from its text as it is.
    ///
    /// # Errors
    /// When it does not.
    pub fn new(config: &ValidConfig) -> Result<Self, LogError> {
        Config::from_toml_str(&config.to_toml()?, "the configuration of the flight")?;
        let seed = format!("{:?} {}", SystemTime::now(), std::process::id());
        Ok(Self {
            flight: Sha256::digest(seed.as_bytes()).iter().take(8).map(|b| format!("{b:02x}")).collect(),
            part: 0,
            config: config.clone(),
            config_hash: config_hash(config),
            images: config.recorder.images,
            known_map: None,
            first_reset_counter: 0,
            build: BuildId::current().clone(),
        })
    }

    /// Metadata of the log.
    ///
    /// # Errors
    /// When the configuration cannot be written as text.
    pub fn to_metadata(&self) -> Result<BTreeMap<String, String>, LogError> {
        let images = match self.images {
            ImageRecording::None => "none",
            ImageRecording::Png => "png",
            ImageRecording::Raw => "raw",
        };
        let mut metadata: BTreeMap<String, String> = [
            ("format", FORMAT.to_owned()),
            ("flight", self.flight.clone()),
            ("part", self.part.to_string()),
            ("config", self.config.to_toml()?),
            ("config_sha256", self.config_hash.clone()),
            ("images", images.to_owned()),
        ]
        .map(|(key, value)| (key.to_owned(), value))
        .into();
        if let Some(hash) = &self.known_map {
            metadata.insert(KNOWN_MAP.into(), hash.clone());
        }
        if self.first_reset_counter > 0 {
            metadata.insert(FIRST_RESET_COUNTER.into(), self.first_reset_counter.to_string());
        }
        self.build.write(&mut metadata);
        Ok(metadata)
    }

    /// From metadata.
    ///
    /// # Errors
    /// When something is missing or does not fit: what it is, in words.
    pub fn from_metadata(metadata: &BTreeMap<String, String>) -> Result<Self, String> {
        let value = |key: &str| metadata.get(key).ok_or_else(|| format!("its metadata has no '{key}'"));
        let format = value("format")?;
        if format != FORMAT {
            return Err(format!("is of log format {format}, and this build reads {FORMAT}"));
        }
        let images = match value("images")?.as_str() {
            "none" => ImageRecording::None,
            "png" => ImageRecording::Png,
            "raw" => ImageRecording::Raw,
            other => return Err(format!("keeps images in an unknown way, '{other}'")),
        };
        let text = value("config")?;
        if hash_of(text) != *value("config_sha256")? {
            return Err("its configuration does not have the hash that was recorded with it".into());
        }
        let current = without_retired(text)?;
        let mut config = Config::from_toml_str(&current, "its configuration").map_err(|e| e.to_string())?;
        if !text.contains(PLACES_TABLE) {
            // Of a build that made no map.
            let off = |config: &mut Config| config.estimator.places.enabled = false;
            config = config.with("its configuration", off).map_err(|e| e.to_string())?;
        }
        Ok(Self {
            flight: value("flight")?.clone(),
            part: value("part")?.parse().map_err(|_| "its part has no number")?,
            config_hash: value("config_sha256")?.clone(),
            images,
            known_map: metadata.get(KNOWN_MAP).cloned(),
            first_reset_counter: metadata
                .get(FIRST_RESET_COUNTER)
                .map_or(Ok(0), |text| text.parse())
                .map_err(|_| "its first_reset_counter is not a number")?,
            build: BuildId::read(metadata),
            config,
        })
    }
}

/// The text of a configuration without [`RETIRED`] keys.
fn without_retired(text: &str) -> Result<String, String> {
    let mut tables: toml::Table = text.parse().map_err(|error: toml::de::Error| error.to_string())?;
    for path in RETIRED {
        let (mut keys, mut table) = (path.split('.').peekable(), Some(&mut tables));
        while let (Some(key), Some(here)) = (keys.next(), table.take()) {
            if keys.peek().is_none() {
                here.remove(key);
            }
            table = here.get_mut(key).and_then(toml::Value::as_table_mut);
        }
    }
    toml::to_string(&tables).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_beginning_of_a_part_comes_back() {
        let about = PartHeader::new(&Config::preset("sim").unwrap()).unwrap();
        let back = PartHeader::from_metadata(&about.to_metadata().unwrap()).unwrap();
        assert_eq!((back.flight, back.part), (about.flight, 0));
        assert_eq!((back.config, back.config_hash), (about.config, about.config_hash));
        assert_eq!(back.build, about.build);
    }

    #[test]
    fn a_changed_configuration_is_refused() {
        let mut metadata = PartHeader::new(&Config::preset("sim").unwrap()).unwrap().to_metadata().unwrap();
        let changed = metadata["config"].replace("max_points = 120", "max_points = 121");
        metadata.insert("config".into(), changed);
        assert!(PartHeader::from_metadata(&metadata).unwrap_err().contains("hash"));
        metadata.remove("config");
        assert!(PartHeader::from_metadata(&metadata).unwrap_err().contains("no 'config'"));
        metadata.insert("format".into(), "2".into());
        assert!(PartHeader::from_metadata(&metadata).unwrap_err().contains("format 2"));
    }

    #[test]
    fn a_configuration_of_an_earlier_build_is_read_without_its_retired_keys() {
        let about = PartHeader::new(&Config::preset("sim").unwrap()).unwrap();
        let mut metadata = about.to_metadata().unwrap();
        let earlier = metadata["config"].replace("[ros]\n", "[ros]\nlandmarks = true\ntracks = \"raw\"\n");
        metadata.insert("config_sha256".into(), hash_of(&earlier));
        metadata.insert("config".into(), earlier);
        assert_eq!(PartHeader::from_metadata(&metadata).unwrap().config, about.config);
    }
}
