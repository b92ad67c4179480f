//! RViz 2's view of a vehicle, and the services that reset it.

use super::*;

#[test]
fn rviz_sees_path_landmarks_map_and_tracks() {
    let Some(python) = interpreter(PACKAGES) else { return };
    let seen = fly(&python, &[("ros.tracks", "\"raw\"")], Machine::Before);
    for (topic, ..) in ALL_TOPICS {
        assert!(seen.samples(topic).iter().all(|sample| sample["same_bytes"] == true), "{topic}");
    }
    let paths = seen.samples("/drone_1/path");
    check_path(&seen, newest(&paths), "odom", 1e-8);
    let poses = |path: &Value| path["message"]["poses"].as_array().unwrap().len();
    assert!((2..=5).contains(&paths.len()) && poses(newest(&paths)) > poses(paths[0]), "{}", paths.len());
    // Within seconds the map has corrected next to nothing.
    check_path(&seen, newest(&seen.samples("/drone_1/map/path")), "map", 0.1);
    check_landmarks(&seen);
    check_markers(&seen);
    check_pictures(&seen);
}

fn newest<'a>(samples: &[&'a Value]) -> &'a Value {
    samples.last().expect("there are samples")
}

/// Poses of the vehicle, in order of time, as they were computed.
fn check_path(seen: &Seen, sample: &Value, frame: &str, tolerance_m: f64) {
    let path = &sample["message"];
    let poses = path["poses"].as_array().unwrap();
    assert!(poses.len() >= 5, "{} poses", poses.len());
    assert_eq!(path["header"]["stamp"], poses[poses.len() - 1]["header"]["stamp"]);
    let stamps: Vec<i64> = poses.iter().map(|pose| stamp_ns(&pose["header"])).collect();
    assert!(stamps.is_sorted());
    for (pose, stamp) in poses.iter().zip(stamps) {
        assert_eq!(pose["header"]["frame_id"], frame);
        // Odometry comes with inertial samples; keyframes of the map are taken between two of them, the first one before any.
        let before = seen.computed.range(..=stamp).next_back();
        let (at, computed) = before.or_else(|| seen.computed.first_key_value()).expect("there is odometry");
        assert!((stamp - at).abs() < 60_000_000, "nothing was computed about {stamp}");
        let position = numbers(&pose["pose"]["position"], "x y z");
        let off_m = position.iter().zip(computed).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
        assert!(off_m < tolerance_m, "{off_m} m off at {stamp} in {frame}");
        let rotation = numbers(&pose["pose"]["orientation"], "x y z w");
        let rotation = nalgebra::Quaternion::new(rotation[3], rotation[0], rotation[1], rotation[2]);
        let told = nalgebra::UnitQuaternion::from_quaternion(rotation);
        assert!(told.angle_to(&vehicle_rotation(&computed[3..])) < tolerance_m.max(1e-7));
    }
}

/// Points of a cloud whose fields are those that RViz looks for.
fn points(sample: &Value, frame: &str) -> Vec<[f32; 3]> {
    let cloud = &sample["message"];
    assert_eq!(cloud["header"]["frame_id"], frame);
    let fields = cloud["fields"].as_array().unwrap();
    let fields: Vec<_> = fields.iter().map(|f| (f["name"].as_str().unwrap(), f["offset"].as_u64())).collect();
    assert_eq!(fields, [("x", Some(0)), ("y", Some(4)), ("z", Some(8))]);
    let data = bytes(&cloud["data"]);
    let width = cloud["width"].as_u64().unwrap() as usize;
    assert_eq!((data.len(), &cloud["height"], &cloud["point_step"]), (12 * width, &1.into(), &12.into()));
    let number = |k: usize| f32::from_le_bytes(data[4 * k..4 * k + 4].try_into().unwrap());
    (0..width).map(|k| [0, 1, 2].map(|axis| number(3 * k + axis))).collect()
}

fn bytes(hexadecimal: &Value) -> Vec<u8> {
    let text = hexadecimal.as_str().unwrap().as_bytes();
    let digit = |c: u8| char::from(c).to_digit(16).unwrap() as u8;
    text.chunks(2).map(|pair| 16 * digit(pair[0]) + digit(pair[1])).collect()
}

/// Landmarks of the map are those that were in the window, where the map has them.
fn check_landmarks(seen: &Seen) {
    let windows = seen.samples("/drone_1/landmarks");
    let seen_before: Vec<[f32; 3]> = windows.iter().flat_map(|sample| points(sample, "odom")).collect();
    assert!(windows.len() >= 4 && seen_before.len() > 100, "{} of {}", seen_before.len(), windows.len());
    let clouds = seen.samples("/drone_1/map/landmarks");
    let map = points(newest(&clouds), "map");
    assert!(map.len() > 30 && map.len() >= points(clouds[0], "map").len(), "{} points", map.len());
    let square = |a: &[f32; 3], b: &[f32; 3]| (0..3).map(|k| (a[k] - b[k]).powi(2)).sum::<f32>();
    let is_known = |p: &&[f32; 3]| seen_before.iter().any(|q| square(p, q) < 0.3f32.powi(2));
    let known = map.iter().filter(is_known).count();
    assert!(4 * known > 3 * map.len(), "{known} of {}", map.len());
}

/// Markers by namespace: lines of two ends, keyframes where the map has them.
fn check_markers(seen: &Seen) {
    let markers =
        |topic: &str| newest(&seen.samples(topic))["message"]["markers"].as_array().unwrap().clone();
    let of = |markers: &[Value], ns: &str| {
        let marker = markers.iter().find(|marker| marker["ns"] == ns).unwrap();
        (marker["type"].as_i64().unwrap(), marker["points"].as_array().unwrap().len())
    };
    let window = markers("/drone_1/lines");
    let (kind, ends) = of(&window, "lines");
    assert!(kind == 5 && ends > 0 && ends % 2 == 0, "{kind}: {ends} ends");
    let map = markers("/drone_1/map/markers");
    let (kind, keyframes) = of(&map, "keyframes");
    assert!(kind == 7 && keyframes >= 5, "{keyframes} keyframes");
    assert!(of(&map, "lines").1 > 0 && of(&map, "loops").1 % 2 == 0);
    for marker in window.iter().chain(&map) {
        assert_eq!((&marker["action"], &marker["pose"]["orientation"]["w"]), (&0.into(), &1.0.into()));
        assert!(marker["color"]["a"] == 1.0 && marker["scale"]["x"].as_f64().unwrap() > 0.0);
    }
}

/// Pictures at the rate of a cable, as wide as it carries, grey but for the tracks.
fn check_pictures(seen: &Seen) {
    let pictures = seen.samples("/drone_1/tracks");
    assert!((5..=21).contains(&pictures.len()), "{} pictures", pictures.len());
    let stamps: Vec<i64> = pictures.iter().map(|sample| stamp_ns(&sample["message"]["header"])).collect();
    // One in each fifth of a second: after one that was late comes one that is in time.
    assert!(stamps.windows(3).all(|three| three[2] - three[0] > 190_000_000), "{stamps:?}");
    for sample in pictures {
        let image = &sample["message"];
        let [width, height, step] = ["width", "height", "step"].map(|key| image[key].as_u64().unwrap());
        assert_eq!((&image["encoding"], step), (&"rgb8".into(), 3 * width));
        let pixels = bytes(&image["data"]);
        assert!(width > 200 && width <= 376 && pixels.len() as u64 == step * height);
        let coloured = pixels.chunks(3).filter(|p| p[0] != p[1] || p[1] != p[2]).count();
        assert!(coloured > 100 && 3 * coloured < pixels.len() / 3, "{coloured} of {}", pixels.len() / 3);
    }
}

#[test]
fn a_client_of_ros_resets_the_estimate() {
    let Some(python) = interpreter(PACKAGES) else { return };
    let changes =
        [("ros.reset", "true"), ("network.commands", "\"anybody\""), ("ros.tracks", "\"compressed\"")];
    let services = ["/drone_1/reset", "/drone_1/reset_hard"];
    let seen = fly_and_call(&python, &changes, Machine::Before, &services);
    let servers = seen.entities("SS");
    assert_eq!(servers.len(), 2, "{servers:?}");
    let calls = seen.told["calls"].as_array().unwrap();
    for (k, (service, words)) in services.into_iter().zip(["soft", "hard"]).enumerate() {
        let server = servers.iter().find(|server| server["topic"] == service).unwrap();
        check_endpoint(&seen, server, "std_srvs/srv/Trigger", 10);
        let call = &calls[k];
        let [answer] = &call["answers"].as_array().unwrap()[..] else { panic!("{call}") };
        assert_eq!((&answer["key"], &answer["sequence"]), (&call["key"], &call["number"]));
        assert_eq!((&answer["is_ours"], &answer["same_bytes"]), (&true.into(), &true.into()));
        assert_eq!(answer["response"]["success"], true, "{call}");
        let message = format!("{words} reset done; reset_counter is {}", k + 1);
        assert_eq!(answer["response"]["message"], message);
        let refused = call["refused"].as_array().unwrap();
        let parts = ["not attached", "not attached", "exact key"];
        let is_named = |(refused, part): (&Value, &str)| refused.as_str().unwrap().contains(part);
        assert!(refused.len() == 3 && refused.iter().zip(parts).all(is_named), "{call}");
    }
    // The hard one has started at the origin, with another path.
    let samples = seen.samples(TOPICS[0]);
    let far_m = |sample: &&Value| {
        let p = numbers(&sample["message"]["pose"]["pose"]["position"], "x y z");
        p.iter().map(|x| x * x).sum::<f64>().sqrt()
    };
    let steps: Vec<f64> = samples.windows(2).map(|pair| far_m(&pair[0]) - far_m(&pair[1])).collect();
    let largest = steps.iter().copied().fold(0.0, f64::max);
    assert!(largest > 0.5, "the pose has not gone back to the origin: {largest} m at once");
    check_jpegs(&seen);
}

/// Compressed pictures begin and end as JPEG.
fn check_jpegs(seen: &Seen) {
    let pictures = seen.samples("/drone_1/tracks/compressed");
    assert!(pictures.len() > 5, "{} pictures", pictures.len());
    for sample in pictures {
        let (image, data) = (&sample["message"], bytes(&sample["message"]["data"]));
        assert_eq!(image["format"], "rgb8; jpeg compressed bgr8");
        assert!(data.starts_with(&[0xff, 0xd8]) && data.ends_with(&[0xff, 0xd9]) && data.len() > 2_000);
    }
}

#[test]
fn services_of_ros_need_commands_from_anybody() {
    let folder = tempfile::tempdir().unwrap();
    let config = folder.path().join("vehicle.toml");
    configuration(&config, &[("ros.enabled", "true".to_owned()), ("ros.reset", "true".to_owned())]);
    let flown = plumbline(&[&FLIGHT[..], &["--config", config.to_str().unwrap()]].concat());
    assert_eq!(flown.status.code(), Some(2));
    let words = stderr(&flown);
    assert!(words.contains("`ros.reset`") && words.contains("network.commands"), "{words}");
}

/// Subscriptions in RViz's configuration name what a vehicle called `drone` publishes.
#[test]
fn the_configuration_of_rviz_names_what_is_published() {
    let Some(python) = interpreter("ruamel.yaml") else { return };
    let told = Program::start(&python, "tests/python/rviz_displays.py", &["packaging/ros2/plumbline.rviz"]);
    let told: Value = serde_json::from_str(&told.rest()).unwrap();
    assert_eq!(told["fixed_frame"], "odom");
    let displays = told["displays"].as_array().unwrap();
    let published = ALL_TOPICS.map(|(topic, name, _)| (topic.replace("drone_1", "drone"), name));
    let mut shown = Vec::new();
    for display in displays {
        let (topic, class) = (display["topic"].as_str().unwrap(), display["class"].as_str().unwrap());
        let name = match class {
            "rviz_default_plugins/Odometry" => "nav_msgs/msg/Odometry",
            "rviz_default_plugins/Path" => "nav_msgs/msg/Path",
            "rviz_default_plugins/PointCloud2" => "sensor_msgs/msg/PointCloud2",
            "rviz_default_plugins/MarkerArray" => "visualization_msgs/msg/MarkerArray",
            "rviz_default_plugins/Image" => {
                assert_eq!(topic, "/drone/tracks");
                continue;
            }
            other => panic!("{other}"),
        };
        assert!(published.iter().any(|known| *known == (topic.to_owned(), name)), "{topic}: {name}");
        shown.push(topic.to_owned());
    }
    let not_drawn = ["/drone/pose", "/tf"];
    for (topic, _) in published.iter().filter(|(topic, _)| !not_drawn.contains(&topic.as_str())) {
        assert!(shown.contains(topic), "{topic} is not shown");
    }
}
