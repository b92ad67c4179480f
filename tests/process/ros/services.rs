//! The path, and the services that reset a vehicle.

use super::*;

#[test]
fn the_path_is_what_was_computed() {
    let Some(python) = interpreter(PACKAGES) else { return };
    let seen = fly(&python, &[], Machine::Before);
    let paths = seen.samples("/drone_1/path");
    assert!(paths.iter().all(|sample| sample["same_bytes"] == true));
    let newest = paths.last().expect("there are samples");
    check_path(&seen, newest);
    let poses = |path: &Value| path["message"]["poses"].as_array().unwrap().len();
    assert!((2..=5).contains(&paths.len()) && poses(newest) > poses(paths[0]), "{}", paths.len());
}

/// Poses of the vehicle, in order of time, as they were computed.
fn check_path(seen: &Seen, sample: &Value) {
    let path = &sample["message"];
    let poses = path["poses"].as_array().unwrap();
    assert!(poses.len() >= 5, "{} poses", poses.len());
    assert_eq!(path["header"]["stamp"], poses[poses.len() - 1]["header"]["stamp"]);
    let stamps: Vec<i64> = poses.iter().map(|pose| stamp_ns(&pose["header"])).collect();
    assert!(stamps.is_sorted());
    for (pose, stamp) in poses.iter().zip(stamps) {
        assert_eq!(pose["header"]["frame_id"], "odom");
        is_computed(&seen.computed, stamp, &pose["pose"]["position"], &pose["pose"]["orientation"]);
    }
}

#[test]
fn a_client_of_ros_resets_the_estimate() {
    let Some(python) = interpreter(PACKAGES) else { return };
    let changes = [("ros.reset", "true"), ("network.commands", "\"anybody\"")];
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
