//! The arguments that name the topics of a ROS bag.

use super::Usage;
use clap::Args;
use plumbline_drivers::BagTopics;

/// Topics of a bag.
#[derive(Clone, Debug, Default, Args)]
pub struct TopicArgs {
    /// Topic of a ROS bag, such as left=/cam0/image_raw, or an accelerometer's own; may be repeated. Default: by message type.
    #[arg(long = "topic", value_name = "left|right|imu|accel=NAME")]
    topics: Vec<String>,
}

impl TopicArgs {
    /// The names.
    ///
    /// # Errors
    /// When an argument is not of that form.
    pub fn names(&self) -> Result<BagTopics, Usage> {
        let mut names = BagTopics::default();
        for topic in &self.topics {
            let named = topic.split_once('=').filter(|(_, name)| !name.trim().is_empty());
            let (to, name) = match named {
                Some(("left", name)) => (&mut names.left, name),
                Some(("right", name)) => (&mut names.right, name),
                Some(("imu", name)) => (&mut names.imu, name),
                Some(("accel", name)) => (&mut names.accel, name),
                _ => {
                    let message =
                        format!("--topic '{topic}': write left=NAME, right=NAME, imu=NAME or accel=NAME");
                    return Err(Usage(message));
                }
            };
            *to = Some(name.trim().to_owned());
        }
        Ok(names)
    }
}
