//! The schema of the log's messages, made of the tables: descriptors, which stand in every log. A test writes the text of
//! `proto/plumbline/v1/log.proto`, for programs that read the log or the local socket.

use crate::fields::{About, Enumeration, Shape};
use crate::orders::{CorrectionOrder, FrameOrder, MapOrder, ResetOrder};
use crate::parts::{FrameAbout, ImageAbout, Recording};
use crate::row::Message;
use crate::topics::Topic;
use plumbline_drivers::ImuReading;
use plumbline_estimator::places::MapEstimate;
use plumbline_estimator::{Estimate, FrameFigures, Odometry};
use prost::Message as _;
use prost_types::field_descriptor_proto::{Label, Type};
use prost_types::{
    DescriptorProto, EnumDescriptorProto, EnumValueDescriptorProto, FieldDescriptorProto,
    FileDescriptorProto, FileDescriptorSet,
};

/// Package of the messages.
pub const PACKAGE: &str = "plumbline.v1.log";
/// File of the text.
const FILE: &str = "plumbline/v1/log.proto";

/// All messages of the log, in the order of the schema; those of topics that came later at the end.
pub(crate) fn messages() -> Vec<Message> {
    let first = [
        Message::of::<ImuReading>(),
        Message::of::<ImageAbout>(),
        Message::of::<FrameAbout>(),
        Message::of::<FrameOrder>(),
        Message::of::<CorrectionOrder>(),
        Message::of::<ResetOrder>(),
        Message::of::<MapOrder>(),
        Message::of::<FrameFigures>(),
        Message::of::<Estimate>(),
        Message::of::<Odometry>(),
        Message::of::<MapEstimate>(),
        Message::of::<Recording>(),
    ];
    with_topics(first.into(), |package| package == PACKAGE)
}

/// Messages, and those of the topics of a package that are not among them.
pub(crate) fn with_topics(mut all: Vec<Message>, is_package: impl Fn(&str) -> bool) -> Vec<Message> {
    let rows = Topic::ALL.into_iter().map(Topic::row);
    let of_package =
        rows.filter(|row| row.message.rsplit_once('.').is_some_and(|(package, _)| is_package(package)));
    for message in of_package.filter_map(|row| row.schema).map(|schema| schema()) {
        if all.iter().all(|known| known.name != message.name) {
            all.push(message);
        }
    }
    all
}

/// The `FileDescriptorSet` of the messages.
#[must_use]
pub fn descriptors() -> Vec<u8> {
    let messages = messages();
    let file = FileDescriptorProto {
        name: Some(FILE.into()),
        package: Some(PACKAGE.into()),
        message_type: messages.iter().map(message_descriptor).collect(),
        enum_type: messages.iter().flat_map(|m| m.enumerations(false)).take(1).map(enumeration).collect(),
        syntax: Some("proto3".into()),
        ..FileDescriptorProto::default()
    };
    FileDescriptorSet { file: vec![file] }.encode_to_vec()
}

fn message_descriptor(message: &Message) -> DescriptorProto {
    DescriptorProto {
        name: Some(message.name.into()),
        field: message.fields.iter().map(|about| field_descriptor(about)).collect(),
        enum_type: message.enumerations(true).map(enumeration).collect(),
        ..DescriptorProto::default()
    }
}

fn field_descriptor(about: &About) -> FieldDescriptorProto {
    let (kind, of) = kind(about.shape);
    let label = if is_repeated(about.shape) { Label::Repeated } else { Label::Optional };
    FieldDescriptorProto {
        name: Some(about.wire.into()),
        number: i32::try_from(about.tag).ok(),
        label: Some(label.into()),
        r#type: Some(kind.into()),
        type_name: of.map(|of| format!(".{PACKAGE}.{of}")),
        json_name: Some(json_name(about.wire)),
        ..FieldDescriptorProto::default()
    }
}

pub(crate) const fn is_repeated(shape: Shape) -> bool {
    matches!(
        shape,
        Shape::Floats
            | Shape::FloatsIfKnown
            | Shape::Covariance
            | Shape::Singles
            | Shape::Texts
            | Shape::Messages(_)
    )
}

/// Type of a field, and the name of the message or enumeration it has.
pub(crate) const fn kind(shape: Shape) -> (Type, Option<&'static str>) {
    match shape {
        Shape::Uint64 => (Type::Uint64, None),
        Shape::Int64 => (Type::Int64, None),
        Shape::Uint32 => (Type::Uint32, None),
        Shape::Sint32 => (Type::Sint32, None),
        Shape::Flag => (Type::Bool, None),
        Shape::Enumerator(of) => (Type::Enum, Some(of.name)),
        Shape::Double | Shape::Floats | Shape::FloatsIfKnown | Shape::Covariance => (Type::Double, None),
        Shape::Singles => (Type::Float, None),
        Shape::Bytes => (Type::Bytes, None),
        Shape::Text | Shape::Texts => (Type::String, None),
        Shape::Message(name) | Shape::Messages(name) => (Type::Message, Some(name)),
    }
}

fn enumeration(of: &'static Enumeration) -> EnumDescriptorProto {
    let values = (0i32..).zip(of.names).map(|(number, name)| EnumValueDescriptorProto {
        name: Some((*name).into()),
        number: Some(number),
        options: None,
    });
    EnumDescriptorProto {
        name: Some(of.name.rsplit('.').next().unwrap_or(of.name).into()),
        value: values.collect(),
        ..EnumDescriptorProto::default()
    }
}

/// Name of a field in JSON.
fn json_name(wire: &str) -> String {
    let mut parts = wire.split('_');
    let mut name = parts.next().unwrap_or_default().to_owned();
    for part in parts {
        let mut letters = part.chars();
        name.extend(letters.next().map(|letter| letter.to_ascii_uppercase()));
        name.extend(letters);
    }
    name
}
