//! Interface types of ROS 2: name and fields listed once, from which follow the bytes on the wire, the name in keys and the
//! hash of the definition.
//!
//! [`message!`] declares a structure with the fields of a `.msg` file in their order. Serde writes them in that order
//! ([`super::cdr`]); [`InterfaceType::of`] describes them as REP-2016 does and hashes the description. A process test compares
//! every hash with the one that `rosbags` computes from the definitions of ROS.

use plumbline_record::digest::hash_of;
use serde::Serialize;
use std::collections::BTreeMap;

/// Offsets of a type's number for a fixed array, a bounded and an unbounded sequence of it
/// (`type_description_interfaces/msg/FieldType`).
const ARRAY: u8 = 48;
const BOUNDED_SEQUENCE: u8 = 96;
const SEQUENCE: u8 = 144;

/// Type of a field as a description has it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FieldType {
    id: u8,
    capacity: usize,
    nested: &'static str,
}

impl FieldType {
    /// Type that ROS builds in, by its number.
    #[must_use]
    pub const fn built_in(id: u8) -> Self {
        Self { id, capacity: 0, nested: "" }
    }

    /// Type with a definition of its own.
    #[must_use]
    pub const fn nested(nested: &'static str) -> Self {
        Self { id: 1, capacity: 0, nested }
    }

    const fn repeated(self, offset: u8, capacity: usize) -> Self {
        Self { id: self.id + offset, capacity, nested: self.nested }
    }
}

/// Descriptions by the name of their type.
pub type Descriptions = BTreeMap<&'static str, Vec<(&'static str, FieldType)>>;

/// Type that a field can have.
pub trait Member {
    /// Type of the field.
    fn field_type() -> FieldType;
    /// Adds the descriptions that the type refers to.
    fn describe(_descriptions: &mut Descriptions) {}
}

/// Type with a definition: a message, or one half of a service.
pub trait Interface: Member {
    /// Name of the definition, such as `nav_msgs/msg/Path`.
    const NAME: &'static str;
}

macro_rules! built_in {
    ($($type:ty = $id:literal),* $(,)?) => {
        $(impl Member for $type {
            fn field_type() -> FieldType {
                FieldType::built_in($id)
            }
        })*
    };
}

built_in!(u8 = 3, i32 = 6, u32 = 7, i64 = 8, f64 = 11, bool = 15, &str = 17, String = 17);

impl<T: Member> Member for Vec<T> {
    fn field_type() -> FieldType {
        T::field_type().repeated(SEQUENCE, 0)
    }
    fn describe(descriptions: &mut Descriptions) {
        T::describe(descriptions);
    }
}

impl<T: Member, const N: usize> Member for [T; N] {
    fn field_type() -> FieldType {
        T::field_type().repeated(ARRAY, N)
    }
    fn describe(descriptions: &mut Descriptions) {
        T::describe(descriptions);
    }
}

/// Sequence of at most one element, as an option: events of services have their halves so.
impl<T: Member> Member for Option<T> {
    fn field_type() -> FieldType {
        T::field_type().repeated(BOUNDED_SEQUENCE, 1)
    }
    fn describe(descriptions: &mut Descriptions) {
        T::describe(descriptions);
    }
}

/// Square matrix by rows: `float64[36]`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Rows6(pub [[f64; 6]; 6]);

impl Member for Rows6 {
    fn field_type() -> FieldType {
        <[f64; 36]>::field_type()
    }
}

/// Gives a type the name and the fields of its definition.
macro_rules! describe {
    ($name:ident $(<$life:lifetime>)? = $ros:literal { $($field:ident: $type:ty),* $(,)? }) => {
        impl $(<$life>)? $crate::ros::interface::Member for $name $(<$life>)? {
            fn field_type() -> $crate::ros::interface::FieldType {
                $crate::ros::interface::FieldType::nested($ros)
            }
            fn describe(descriptions: &mut $crate::ros::interface::Descriptions) {
                let fields = vec![$((
                    stringify!($field),
                    <$type as $crate::ros::interface::Member>::field_type(),
                )),*];
                if descriptions.insert($ros, fields).is_none() {
                    $(<$type as $crate::ros::interface::Member>::describe(descriptions);)*
                }
            }
        }
        impl $(<$life>)? $crate::ros::interface::Interface for $name $(<$life>)? {
            const NAME: &'static str = $ros;
        }
    };
}

/// Declares messages: a structure of each, with the name and the fields of its definition.
macro_rules! message {
    ($(
        $(#[$about:meta])*
        struct $name:ident $(<$life:lifetime>)? = $ros:literal { $($field:ident: $type:ty),* $(,)? }
    )*) => {$(
        $(#[$about])*
        #[derive(Clone, Debug, PartialEq, serde::Serialize)]
        pub struct $name $(<$life>)? { $(pub(super) $field: $type),* }
        $crate::ros::interface::describe!($name $(<$life>)? = $ros { $($field: $type),* });
    )*};
}

pub(super) use {describe, message};

/// Names of a type, and the hash of its definition.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InterfaceType {
    /// Name of the definition, such as `nav_msgs/msg/Path`.
    pub name: String,
    /// Name as DDS mangles it, which keys have.
    pub dds_name: String,
    /// SHA-256 of the description (REP-2016).
    pub hash: String,
}

impl InterfaceType {
    /// Names and hash of `T`.
    #[must_use]
    pub fn of<T: Interface>() -> Self {
        let mut descriptions = Descriptions::new();
        T::describe(&mut descriptions);
        let own = descriptions.remove(T::NAME).unwrap_or_default();
        Self::new(T::NAME, &hash(T::NAME, &own, &descriptions))
    }

    /// Names of the type `name`, whose definition has this hash.
    #[must_use]
    pub fn new(name: &str, hash: &str) -> Self {
        let (package, own) = name.rsplit_once('/').unwrap_or(("", name));
        let dds_name = format!("{}::dds_::{own}_", package.replace('/', "::"));
        Self { name: name.into(), dds_name, hash: hash.into() }
    }
}

/// Hash of the description of `name`, as JSON that is written letter by letter as `rosidl` writes it.
fn hash(name: &str, own: &[(&'static str, FieldType)], referenced: &Descriptions) -> String {
    let referenced: Vec<String> = referenced.iter().map(|(name, fields)| description(name, fields)).collect();
    let json = format!(
        r#"{{"type_description": {}, "referenced_type_descriptions": [{}]}}"#,
        description(name, own),
        referenced.join(", ")
    );
    format!("RIHS01_{}", hash_of(&json))
}

fn description(name: &str, fields: &[(&'static str, FieldType)]) -> String {
    let field = |(name, FieldType { id, capacity, nested }): &(&str, FieldType)| {
        format!(
            r#"{{"name": "{name}", "type": {{"type_id": {id}, "capacity": {capacity}, "string_capacity": 0, "nested_type_name": "{nested}"}}}}"#
        )
    };
    let fields: Vec<String> = fields.iter().map(field).collect();
    format!(r#"{{"type_name": "{name}", "fields": [{}]}}"#, fields.join(", "))
}
