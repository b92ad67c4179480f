//! The channels of a log, which are topics, and the schemas that stand beside them.

use plumbline_record::schema;
use std::sync::OnceLock;

/// A channel of the log.
pub use plumbline_record::topics::Topic as Channel;

/// Descriptors of the messages that Foxglove draws.
pub const FOXGLOVE: &[u8] = include_bytes!("../../generated/foxglove.descriptors");

/// The `FileDescriptorSet` that the schema of a channel is in.
#[must_use]
pub fn descriptors(channel: Channel) -> &'static [u8] {
    static OWN: OnceLock<Vec<u8>> = OnceLock::new();
    if channel.is_drawn() { FOXGLOVE } else { OWN.get_or_init(schema::descriptors) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::options::ImageRecording;
    use prost::Message as _;
    use prost_types::FileDescriptorSet;

    #[test]
    fn every_schema_is_in_its_descriptors() {
        for images in [ImageRecording::Png, ImageRecording::Raw] {
            for channel in Channel::LOGGED {
                let set = FileDescriptorSet::decode(descriptors(channel)).unwrap();
                let names = set.file.iter().flat_map(|file| {
                    file.message_type.iter().map(move |m| format!("{}.{}", file.package(), m.name()))
                });
                let names: Vec<String> = names.collect();
                assert!(names.iter().any(|name| name == channel.schema(images)), "{channel:?}: {names:?}");
            }
        }
    }
}
