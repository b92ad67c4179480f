//! The channels of a log, which are topics, and the schemas that stand beside them.

use plumbline_config::options::ImageRecording;
use plumbline_record::schema;
use std::borrow::Cow;
use std::sync::OnceLock;

/// A channel of the log.
pub use plumbline_record::topics::Topic as Channel;

/// The `FileDescriptorSet` that the schema of a channel is in, in a log with such images.
pub fn descriptors(channel: Channel, images: ImageRecording) -> Cow<'static, [u8]> {
    static OWN: OnceLock<Vec<u8>> = OnceLock::new();
    let drawn = plumbline_scene::descriptors(channel.schema(images));
    drawn.unwrap_or_else(|| OWN.get_or_init(schema::descriptors).into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use prost::Message as _;
    use prost_types::FileDescriptorSet;

    #[test]
    fn every_schema_is_in_its_descriptors() {
        for images in [ImageRecording::Png, ImageRecording::Raw] {
            for channel in Channel::LOGGED {
                let set = FileDescriptorSet::decode(&*descriptors(channel, images)).unwrap();
                let names = set.file.iter().flat_map(|file| {
                    file.message_type.iter().map(move |m| format!("{}.{}", file.package(), m.name()))
                });
                let names: Vec<String> = names.collect();
                assert!(names.iter().any(|name| name == channel.schema(images)), "{channel:?}: {names:?}");
            }
        }
    }
}
