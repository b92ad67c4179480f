use super::super::parts::existing_parts;
use super::*;
use plumbline_scene::messages::{CameraCalibration, FrameTransform, FrameTransforms, PoseInFrame, RawImage};

/// Topic and content of the messages of a file.
fn messages(path: &Path) -> Vec<(String, u64, Vec<u8>)> {
    let bytes = std::fs::read(path).unwrap();
    let stream = MessageStream::new(&bytes).unwrap().map(Result::unwrap);
    stream.map(|m| (m.channel.topic.clone(), m.log_time, m.data.into_owned())).collect()
}

fn decoded<T: prost::Message + Default>(messages: &[(String, u64, Vec<u8>)], topic: &str) -> Vec<T> {
    let of_topic = messages.iter().filter(|(other, ..)| other == topic);
    of_topic.map(|(_, _, data)| T::decode(data.as_slice()).unwrap()).collect()
}

#[test]
fn every_file_begins_with_the_rig_before_anything_else() {
    let (_folder, path) = place();
    let limits = Limits { part_bytes: 600_000, ..NO_LIMITS };
    let (_, summary) = record_on(OpenPart::files(), limits, &path, ImageRecording::Raw);
    assert!(summary.parts > 2, "{summary:?}");
    let config = LogReader::open(&path).unwrap().about().config.clone();
    for (_, part) in existing_parts(&path) {
        let messages = messages(&part);
        let topics: Vec<&str> = messages.iter().map(|(topic, ..)| topic.as_str()).collect();
        assert_eq!(topics[..3], ["/calibration/left", "/calibration/right", "/tf_static"], "{topics:?}");
        let first_ns = messages[3].1;
        assert!(messages[..3].iter().all(|(_, time_ns, _)| *time_ns == first_ns && first_ns > 0));
        let calibrations: Vec<CameraCalibration> =
            ["/calibration/left", "/calibration/right"].iter().flat_map(|t| decoded(&messages, t)).collect();
        assert_eq!(calibrations.len(), 2, "once in each file");
        for (calibration, camera) in calibrations.iter().zip(&config.camera) {
            let size = (calibration.width as usize, calibration.height as usize);
            assert_eq!(size, (camera.width_px, camera.height_px));
            assert_eq!([calibration.k[0], calibration.k[4]], camera.focal_px);
        }
    }
}

#[test]
fn images_poses_and_cameras_are_in_one_tree_of_frames_named_by_the_configuration() {
    let (_folder, path) = place();
    let mut flight = flight();
    flight.config = flight
        .config
        .with("test", |config| {
            config.recorder.images = ImageRecording::Raw;
            config.ros.odom_frame = "world".into();
            config.ros.body_frame = "imu".into();
        })
        .unwrap();
    let mut recorder = Recorder::start(&path, &flight.config, (None, 0), WhenFull::Wait).unwrap();
    fly(flight, &Control::default(), &mut recorder);
    assert_eq!(recorder.finish().not_recorded, 0);
    let messages = messages(&path);
    let moving: Vec<FrameTransform> = decoded(&messages, "/tf");
    let fixed: Vec<FrameTransforms> = decoded(&messages, "/tf_static");
    let mut edges: Vec<(String, String)> = moving
        .into_iter()
        .chain(fixed.into_iter().flat_map(|message| message.transforms))
        .map(|t| (t.parent_frame_id, t.child_frame_id))
        .collect();
    edges.sort();
    edges.dedup();
    let named = |parent: &str, child: &str| (parent.to_owned(), child.to_owned());
    let expected =
        [named("imu", "base_link"), named("imu", "left"), named("imu", "right"), named("world", "imu")];
    assert_eq!(edges, expected);
    for (topic, frame) in [("/input/left", "left"), ("/input/right", "right")] {
        let images: Vec<RawImage> = decoded(&messages, topic);
        assert!(images.len() > 10 && images.iter().all(|image| image.frame_id == frame));
    }
    let poses: Vec<PoseInFrame> = decoded(&messages, "/pose");
    assert!(!poses.is_empty() && poses.iter().all(|pose| pose.frame_id == "world"));
}
