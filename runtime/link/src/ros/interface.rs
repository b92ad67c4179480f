//! Interface types of ROS 2: name, and the hash of the description that REP-2016 makes of a definition. A process test compares every
//! hash with the one that `rosbags` computes from the definitions of ROS.

/// Type with a definition: a message or a service.
pub trait Interface {
    /// Name of the definition, such as `nav_msgs/msg/Path`.
    const NAME: &'static str;
    /// SHA-256 of its description, as `ros2 topic info --verbose` prints it.
    const HASH: &'static str;
}

/// Names of a type, and the hash of its definition.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct InterfaceType {
    /// Name of the definition, such as `nav_msgs/msg/Path`.
    pub name: &'static str,
    /// Name as DDS mangles it, which keys have.
    pub dds_name: String,
    /// SHA-256 of the description (REP-2016).
    pub hash: &'static str,
}

impl InterfaceType {
    /// Names and hash of `T`.
    #[must_use]
    pub fn of<T: Interface>() -> Self {
        Self::new(T::NAME, T::HASH)
    }

    /// Names of the type `name`, whose definition has this hash.
    #[must_use]
    pub fn new(name: &'static str, hash: &'static str) -> Self {
        let (package, own) = name.rsplit_once('/').unwrap_or(("", name));
        Self { name, dds_name: format!("{}::dds_::{own}_", package.replace('/', "::")), hash }
    }
}
