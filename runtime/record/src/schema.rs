//! The schema of the log's messages, made of the tables: descriptors, which stand in every log. A test writes the text of
//! `proto/plumbline/v1/log.proto`, for programs that read the log or the local socket.

use crate::fields::{About, Enumeration, Outline, Shape};
use crate::topics::Topic;
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

/// All messages of the log. Programs that read logs know the first ones by their bytes: odometry comes before the map.
pub(crate) fn messages() -> Vec<Outline> {
    let mut all = Vec::new();
    add_topics(&mut all, PACKAGE);
    let place = |name: &str| all.iter().position(|message| message.name == name);
    if let (Some(odometry), Some(map)) = (place("Odometry"), place("MapEstimate")) {
        all.swap(odometry, map);
    }
    all
}

/// Adds the messages of the topics of a package, each behind its parts, that are not among them.
pub(crate) fn add_topics(all: &mut Vec<Outline>, package: &str) {
    for row in Topic::ALL.into_iter().map(Topic::row) {
        let is_of_package = row.message.rsplit_once('.').is_some_and(|(of, _)| of == package);
        if let Some(message) = row.schema.filter(|_| is_of_package) {
            add(all, message);
        }
    }
}

fn add(all: &mut Vec<Outline>, message: Outline) {
    if all.contains(&message) {
        return;
    }
    for about in (message.fields)() {
        if let Shape::Message(part) | Shape::Messages(part) = about.shape {
            add(all, *part);
        }
    }
    all.push(message);
}

/// Enumerations that the fields of a message have, those inside the message or those outside it.
pub(crate) fn enumerations(message: &Outline, is_inside: bool) -> impl Iterator<Item = &'static Enumeration> {
    let of = |about: &About| match about.shape {
        Shape::Enumerator(of) => Some(of),
        _ => None,
    };
    (message.fields)().into_iter().filter_map(of).filter(move |of| of.name.contains('.') == is_inside)
}

/// The `FileDescriptorSet` of the messages.
pub fn descriptors() -> Vec<u8> {
    let messages = messages();
    let file = FileDescriptorProto {
        name: Some(FILE.into()),
        package: Some(PACKAGE.into()),
        message_type: messages.iter().map(message_descriptor).collect(),
        enum_type: messages.iter().flat_map(|m| enumerations(m, false)).take(1).map(enumeration).collect(),
        syntax: Some("proto3".into()),
        ..FileDescriptorProto::default()
    };
    FileDescriptorSet { file: vec![file] }.encode_to_vec()
}

fn message_descriptor(message: &Outline) -> DescriptorProto {
    DescriptorProto {
        name: Some(message.name.into()),
        field: (message.fields)().into_iter().map(field_descriptor).collect(),
        enum_type: enumerations(message, true).map(enumeration).collect(),
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
        Shape::Message(of) | Shape::Messages(of) => (Type::Message, Some(of.name)),
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
