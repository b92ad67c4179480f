//! Which topics of a bag are flown: those that are named, or those about which there can be no doubt.

use super::container::Topic;
use super::messages::Kind;

/// Names of the topics to fly; where one is not given it is looked for.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct BagTopics {
    /// Images of the left camera.
    pub left: Option<String>,
    /// Images of the right camera.
    pub right: Option<String>,
    /// Inertial samples.
    pub imu: Option<String>,
}

/// What a left camera is called, and what its right one.
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

/// The inertial samples: number of their topic.
///
/// # Errors
/// As [`cameras`].
pub(crate) fn imu(topics: &[Topic], named: &BagTopics) -> Result<usize, String> {
    let of_kind = |topic: &Topic| kind(topic) == Some(Kind::Imu);
    if let Some(name) = &named.imu {
        let found = topics.iter().position(|topic| of_kind(topic) && topic.name == *name);
        return found
            .ok_or_else(|| format!("has no topic '{name}' with sensor_msgs/msg/Imu; {}", list(topics)));
    }
    let all: Vec<usize> = (0..topics.len()).filter(|k| of_kind(&topics[*k])).collect();
    match all.as_slice() {
        [only] => Ok(*only),
        [] => Err(format!("holds no inertial samples (sensor_msgs/msg/Imu); {}", list(topics))),
        _ => Err(format!(
            "holds several topics with inertial samples: name one with --topic imu=NAME; {}",
            list(topics)
        )),
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
fn printable(name: &str) -> String {
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
        assert_eq!(imu(&euroc, &none), Ok(1));
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
        for refused in [cameras(&two, &none, 2).unwrap_err(), imu(&two, &none).unwrap_err()] {
            assert!(refused.contains("--topic") && refused.contains("/b (t)"), "{refused}");
        }
        let named = BagTopics { left: Some("/b".into()), right: Some("/a".into()), imu: Some("/j".into()) };
        assert_eq!((cameras(&two, &named, 2), imu(&two, &named)), (Ok(vec![1, 0]), Ok(3)));
        let wrong = BagTopics { left: Some("/i".into()), imu: Some("/a".into()), ..BagTopics::default() };
        assert!(cameras(&two, &wrong, 2).unwrap_err().contains("/i"));
        assert!(imu(&two, &wrong).unwrap_err().contains("its topics: /a (t)"));
        assert!(imu(&[], &none).unwrap_err().contains("no topics at all"));
    }
}
