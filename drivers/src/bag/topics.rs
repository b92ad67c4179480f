//! Choice of a bag's topics: those that are named, or those about which there can be no doubt.

use super::container::Topic;
use super::holds::Holds;
use super::messages::Kind;
use crate::BagTopics;

/// The inertial topics to fly: one and the same, or gyroscope and accelerometer apart.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct ImuTopics {
    /// Number of the topic with rates of rotation.
    pub(crate) gyro: usize,
    /// Number of the topic with accelerations.
    pub(crate) accel: usize,
    /// Quantities in the messages of the first.
    pub(crate) holds: Holds,
}

/// Usual names of the left and the right camera in topics.
const SIDES: [(&str, &str); 6] = [
    ("left", "right"),
    ("cam0", "cam1"),
    ("cam_0", "cam_1"),
    ("camera0", "camera1"),
    ("camera_0", "camera_1"),
    ("infra1", "infra2"),
];

/// The images of one camera or two: numbers of their topics.
///
/// # Errors
/// When a name is none of a topic with images, or it cannot be told which to take; the message lists the topics.
pub(crate) fn cameras(topics: &[Topic], named: &BagTopics, wanted: usize) -> Result<Vec<usize>, String> {
    let find = |name: &Option<String>| name.as_deref().map(|name| image_topic(topics, name)).transpose();
    let (left, right) = (find(&named.left)?, find(&named.right)?);
    let all = candidates(topics);
    match (left, right) {
        (Some(left), Some(right)) if left == right => Err(format!(
            "{} is named for the left camera and for the right one: name the topic of each, or fly with --mono; {}",
            printable(named.left.as_deref().unwrap_or_default()),
            list(topics)
        )),
        (Some(left), Some(right)) if wanted > 1 => Ok(vec![left, right]),
        (Some(left), None) if wanted > 1 => {
            let partner = pairs(topics, &all).into_iter().find(|pair| pair.0 == left);
            Ok([Some(left), partner.map(|pair| pair.1)].into_iter().flatten().collect())
        }
        (Some(left), _) => Ok(vec![left]),
        (None, Some(_)) => {
            Err(format!("the topic of the right camera is named, that of the left is not; {}", list(topics)))
        }
        (None, None) => detected(topics, &all, wanted),
    }
}

fn detected(topics: &[Topic], all: &[usize], wanted: usize) -> Result<Vec<usize>, String> {
    let pairs = pairs(topics, all);
    match (all, pairs.as_slice()) {
        ([], _) => Err(format!("holds no images; {}", list(topics))),
        ([only], _) => Ok(vec![*only]),
        (_, [(left, right)]) if wanted > 1 => Ok(vec![*left, *right]),
        (_, [(left, _)]) if all.len() == 2 => Ok(vec![*left]),
        _ => Err(format!(
            "holds several topics with images, and it is not plain which to take: name them with --topic left=NAME{}; {}",
            if wanted > 1 { " and --topic right=NAME" } else { "" },
            list(topics)
        )),
    }
}

/// The topics of the inertial samples; `holds` says what is in the messages of a topic.
///
/// # Errors
/// As [`cameras`]; and when there is a gyroscope without an accelerometer, or the other way round.
pub(crate) fn imu(
    topics: &[Topic],
    named: &BagTopics,
    holds: impl Fn(usize) -> Holds,
) -> Result<ImuTopics, String> {
    let all: Vec<usize> = (0..topics.len()).filter(|k| kind(&topics[*k]) == Some(Kind::Imu)).collect();
    let find = |name: &Option<String>| match name {
        None => Ok(None),
        Some(name) => match all.iter().find(|k| topics[**k].name == *name) {
            Some(found) => Ok(Some(*found)),
            None => Err(format!("has no topic '{name}' with sensor_msgs/msg/Imu; {}", list(topics))),
        },
    };
    let choice = ImuChoice { topics, holds: all.iter().map(|k| (*k, holds(*k))).collect() };
    match (find(&named.imu)?, find(&named.accel)?) {
        (Some(imu), None) => choice.completed(imu),
        (Some(imu), Some(accel)) => Ok(choice.pair(imu, accel)),
        (None, Some(accel)) => Ok(choice.pair(choice.partner(accel, Holds::Gyro)?, accel)),
        (None, None) => choice.detected(),
    }
}

/// Topics with inertial messages, and what they hold.
struct ImuChoice<'a> {
    topics: &'a [Topic],
    holds: Vec<(usize, Holds)>,
}

impl ImuChoice<'_> {
    fn of(&self, wanted: Holds) -> Vec<usize> {
        self.holds.iter().filter(|(_, holds)| *holds == wanted).map(|(k, _)| *k).collect()
    }

    fn holds(&self, topic: usize) -> Holds {
        self.holds.iter().find(|(k, _)| *k == topic).map(|(_, holds)| *holds).unwrap_or_default()
    }

    /// Two topics that were named, in whichever order.
    fn pair(&self, gyro: usize, accel: usize) -> ImuTopics {
        let is_swapped = self.holds(gyro) == Holds::Accel && self.holds(accel) == Holds::Gyro;
        let [gyro, accel] = if is_swapped { [accel, gyro] } else { [gyro, accel] };
        ImuTopics { gyro, accel, holds: self.holds(gyro) }
    }

    fn completed(&self, topic: usize) -> Result<ImuTopics, String> {
        let partner = match self.holds(topic) {
            Holds::Both | Holds::Mixed => topic,
            Holds::Gyro => self.partner(topic, Holds::Accel)?,
            Holds::Accel => self.partner(topic, Holds::Gyro)?,
        };
        Ok(self.pair(topic, partner))
    }

    /// The topic that holds what `topic` lacks: the only one, or the one of the same name but for that.
    fn partner(&self, topic: usize, wanted: Holds) -> Result<usize, String> {
        let all = self.of(wanted);
        let (here, there) = if wanted == Holds::Accel { ("gyro", "accel") } else { ("accel", "gyro") };
        let name = &self.topics[topic].name;
        let is_namesake =
            |k: &&usize| name.contains(here) && name.replace(here, there) == self.topics[**k].name;
        if let Some(found) = all.iter().find(is_namesake) {
            return Ok(*found);
        }
        let quantities = ["rates of rotation", "accelerations"];
        let [has, lacks] = if wanted == Holds::Accel { quantities } else { [quantities[1], quantities[0]] };
        match all.as_slice() {
            [only] => Ok(*only),
            [] => Err(format!(
                "{} holds {has} alone: gyroscope and accelerometer are apart, and no topic has the {lacks}; record both \
                 (realsense-ros: unite_imu_method joins them); {}",
                printable(name),
                list(self.topics)
            )),
            _ => Err(format!(
                "{} holds {has} alone, and several topics have {lacks}: name both with --topic imu=NAME (gyroscope) and \
                 --topic accel=NAME; {}",
                printable(name),
                list(self.topics)
            )),
        }
    }

    /// The topics about which there can be no doubt: the only one with both quantities, or one of each. Beside topics of its own
    /// parts, that is one of the same device.
    fn detected(&self) -> Result<ImuTopics, String> {
        let whole = [self.of(Holds::Both), self.of(Holds::Mixed)].concat();
        let (gyro, accel) = (self.of(Holds::Gyro), self.of(Holds::Accel));
        let device =
            |k: &usize| self.topics[*k].name.trim_start_matches('/').split('/').next().unwrap_or_default();
        let is_of_same = |k: &usize| gyro.iter().chain(&accel).all(|part| device(part) == device(k));
        match (whole.as_slice(), gyro.as_slice(), accel.as_slice()) {
            ([], [], []) => {
                Err(format!("holds no inertial samples (sensor_msgs/msg/Imu); {}", list(self.topics)))
            }
            ([only], _, _) if is_of_same(only) => self.completed(*only),
            ([], [only], _) | ([], [], [only]) => self.completed(*only),
            _ => Err(format!(
                "holds several topics with inertial samples: name one with --topic imu=NAME (where gyroscope and accelerometer \
                 are apart, the gyroscope's, and the other with --topic accel=NAME); {}",
                list(self.topics)
            )),
        }
    }
}

fn kind(topic: &Topic) -> Option<Kind> {
    topic.format.map(|format| format.kind)
}

fn is_image(topic: &Topic) -> bool {
    matches!(kind(topic), Some(Kind::Image | Kind::Compressed))
}

fn image_topic(topics: &[Topic], name: &str) -> Result<usize, String> {
    let found = topics.iter().position(|topic| is_image(topic) && topic.name == name);
    found.ok_or_else(|| {
        format!("has no topic '{name}' with images (Image or CompressedImage); {}", list(topics))
    })
}

/// Topics with images: of one that is there raw and compressed the raw one, and none with depths.
fn candidates(topics: &[Topic]) -> Vec<usize> {
    let has = |name: &str| topics.iter().any(|topic| is_image(topic) && topic.name == name);
    let takes = |topic: &Topic| {
        let is_copy = topic.name.strip_suffix("/compressed").is_some_and(has);
        is_image(topic)
            && !is_copy
            && !topic.name.ends_with("compressedDepth")
            && !topic.name.contains("depth")
    };
    (0..topics.len()).filter(|k| takes(&topics[*k])).collect()
}

/// Pairs of topics whose names say that one is left of the other.
fn pairs(topics: &[Topic], all: &[usize]) -> Vec<(usize, usize)> {
    let name = |k: usize| topics[k].name.as_str();
    let is_pair = |left: usize, right: usize| {
        SIDES.iter().any(|(l, r)| name(left).contains(l) && name(left).replace(l, r) == name(right))
    };
    let of_left =
        |left: usize| all.iter().filter(move |right| is_pair(left, **right)).map(move |right| (left, *right));
    all.iter().flat_map(|left| of_left(*left)).collect()
}

/// The topics there are, in words.
fn list(topics: &[Topic]) -> String {
    const MOST: usize = 24;
    let mut names: Vec<String> = topics
        .iter()
        .take(MOST)
        .map(|topic| format!("{} ({})", printable(&topic.name), printable(&topic.type_name)))
        .collect();
    if topics.len() > MOST {
        names.push(format!("and {} more", topics.len() - MOST));
    }
    if names.is_empty() {
        "it holds no topics at all".into()
    } else {
        format!("its topics: {}", names.join(", "))
    }
}

/// Names come from outside and go to a terminal.
pub(super) fn printable(name: &str) -> String {
    name.chars().filter(|c| !c.is_control()).take(80).collect()
}

#[cfg(test)]
mod tests {
    use super::super::messages::Format;
    use super::super::wire::Encoding;
    use super::*;

    fn topics(names: &[(&str, Kind)]) -> Vec<Topic> {
        let topic = |(name, kind): &(&str, Kind)| Topic {
            name: (*name).into(),
            type_name: "t".into(),
            format: Some(Format { kind: *kind, encoding: Encoding::Cdr }),
        };
        names.iter().map(topic).collect()
    }

    fn whole(topic: usize) -> ImuTopics {
        ImuTopics { gyro: topic, accel: topic, holds: Holds::Both }
    }

    #[test]
    fn topics_are_found_where_there_can_be_no_doubt() {
        let euroc = topics(&[
            ("/cam1/image_raw", Kind::Image),
            ("/imu0", Kind::Imu),
            ("/cam0/image_raw", Kind::Image),
        ]);
        let none = BagTopics::default();
        assert_eq!(cameras(&euroc, &none, 2), Ok(vec![2, 0]));
        assert_eq!(cameras(&euroc, &none, 1), Ok(vec![2]));
        assert_eq!(imu(&euroc, &none, |_| Holds::Both), Ok(whole(1)));
        let realsense = topics(&[
            ("/camera/infra1/image_rect_raw", Kind::Image),
            ("/camera/infra1/image_rect_raw/compressed", Kind::Compressed),
            ("/camera/infra2/image_rect_raw", Kind::Image),
            ("/camera/depth/image_rect_raw", Kind::Image),
            ("/camera/color/image_raw", Kind::Image),
        ]);
        assert_eq!(cameras(&realsense, &none, 2), Ok(vec![0, 2]));
        assert!(cameras(&realsense, &none, 1).is_err(), "the colour camera, or the left one?");
        let single = topics(&[("/image", Kind::Compressed)]);
        assert_eq!(cameras(&single, &none, 2), Ok(vec![0]));
    }

    #[test]
    fn doubt_and_wrong_names_list_the_topics() {
        let two = topics(&[("/a", Kind::Image), ("/b", Kind::Image), ("/i", Kind::Imu), ("/j", Kind::Imu)]);
        let none = BagTopics::default();
        let both = |_: usize| Holds::Both;
        for refused in [cameras(&two, &none, 2).unwrap_err(), imu(&two, &none, both).unwrap_err()] {
            assert!(refused.contains("--topic") && refused.contains("/b (t)"), "{refused}");
        }
        let [left, right, imu_name] = ["/b", "/a", "/j"].map(|name| Some(name.to_owned()));
        let named = BagTopics { left, right, imu: imu_name, accel: None };
        assert_eq!((cameras(&two, &named, 2), imu(&two, &named, both)), (Ok(vec![1, 0]), Ok(whole(3))));
        let same = BagTopics { left: Some("/a".into()), right: Some("/a".into()), ..BagTopics::default() };
        assert!(
            cameras(&two, &same, 2)
                .unwrap_err()
                .contains("/a is named for the left camera and for the right one")
        );
        let wrong = BagTopics { left: Some("/i".into()), imu: Some("/a".into()), ..BagTopics::default() };
        assert!(cameras(&two, &wrong, 2).unwrap_err().contains("/i"));
        assert!(imu(&two, &wrong, both).unwrap_err().contains("its topics: /a (t)"));
        assert!(imu(&[], &none, both).unwrap_err().contains("no topics at all"));
    }
}
