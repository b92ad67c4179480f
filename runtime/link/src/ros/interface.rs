//! Interface types of ROS 2, by name and by the hash of their definition (REP-2016). A process test compares every hash with the one
//! that `rosbags` computes from the definitions of ROS.

/// Type with a definition: a message or a service.
pub trait Interface {
    /// Name of the definition, such as `nav_msgs/msg/Path`.
    const NAME: &'static str;
    /// SHA-256 of its description, hexadecimal.
    const HASH: &'static str;
}

/// Names of a type, and the hash of its definition.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InterfaceType {
    /// Name of the definition, such as `nav_msgs/msg/Path`.
    pub name: String,
    /// Name as DDS mangles it, which keys have.
    pub dds_name: String,
    /// Hash of the definition, with the version of the way it is computed.
    pub hash: String,
}

impl InterfaceType {
    /// Names and hash of `T`.
    pub fn of<T: Interface>() -> Self {
        Self::new(T::NAME, &format!("RIHS01_{}", T::HASH))
    }

    /// Names of the type `name`, whose definition has this hash.
    pub fn new(name: &str, hash: &str) -> Self {
        let (package, own) = name.rsplit_once('/').unwrap_or(("", name));
        let dds_name = format!("{}::dds_::{own}_", package.replace('/', "::"));
        Self { name: name.into(), dds_name, hash: hash.into() }
    }
}
