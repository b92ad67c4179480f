//! Refusals of names, endpoints, certificates, ROS 2 and the local socket.

use super::validation::{check, refused};
use crate::Config;
use crate::options::TlsConfig;
use std::path::PathBuf;

#[test]
fn names_must_fit_into_keys() {
    for name in ["", "a/b", "a*", "a#", "a?", "a$b", "a b", "größe", "a\n"] {
        check("network.vehicle", "drone-1", |c| c.network.vehicle = name.into());
    }
    check("network.vehicle", "1 to 64", |c| c.network.vehicle = "x".repeat(65));
    assert_eq!(refused(|c| c.network.vehicle = "Drone_1-b".into()), []);
}

#[test]
fn endpoints_name_protocol_host_and_port() {
    for bad in
        ["127.0.0.1:7447", "tcp/127.0.0.1", "tcp/:7447", "tcp/h:99999", "ftp/h:1", "tcp/h h:1", "udp/h:1", ""]
    {
        check("network.listen[0]", "tcp/127.0.0.1:7447", |c| c.network.listen = vec![bad.into()]);
    }
    for good in ["tcp/127.0.0.1:7447", "tcp/[::1]:7447", "tcp/ground.local:7447#iface=eth0"] {
        assert_eq!(refused(|c| c.network.connect = vec![good.into()]), []);
    }
    check("network.connect", "17 endpoints", |c| c.network.connect = vec!["tcp/h:1".into(); 17]);
}

/// The three files of a certificate.
fn certified(c: &mut Config) {
    let path = |name: &str| PathBuf::from("keys").join(name);
    c.network.tls = TlsConfig {
        authority: path("ca.pem"),
        certificate: path("v.pem"),
        key: path("v.key"),
        excluded: Vec::new(),
    };
}

#[test]
fn certificates_are_whole_and_there_where_an_endpoint_needs_them() {
    assert_eq!(refused(certified), []);
    let encrypted = |c: &mut Config| c.network.listen = vec!["tls/0.0.0.0:7447".into()];
    check("network.tls", "plumbline keys", encrypted);
    let both = |c: &mut Config| {
        certified(c);
        encrypted(c);
    };
    assert_eq!(refused(both), []);
    check("network.tls.key", "give all three files", |c| {
        certified(c);
        c.network.tls.key = PathBuf::new();
    });
    check("network.tls.authority", "give all three files", |c| {
        certified(c);
        c.network.tls.authority = PathBuf::new();
    });
}

#[test]
fn certificates_that_are_excluded_have_names() {
    for bad in ["", "pilot.1", "operator.0", "operator.x", "vehicle", "vehicle:.1", "vehicle:a/b", "op*"] {
        check("network.tls.excluded[0]", "operator.1", |c| c.network.tls.excluded = vec![bad.into()]);
    }
    for good in ["operator.1", "viewer", "vehicle:hawk_2.12", "router.3", "vehicle:drone"] {
        assert_eq!(refused(|c| c.network.tls.excluded = vec![good.into()]), []);
    }
}

#[test]
fn names_must_be_ones_that_ros_understands() {
    for bad in ["drone", "/a//b", "/a/", "/7", "/a__b", "/a b", "/größe", "//"] {
        check("ros.namespace", "/name/name", |c| c.ros.namespace = bad.into());
    }
    for good in ["", "/", "/a", "/robots/_one_2"] {
        assert_eq!(refused(|c| c.ros.namespace = good.into()), []);
    }
    for bad in ["", "/odom", "a b", "a\n"] {
        check("ros.map_frame", "letters", |c| c.ros.map_frame = bad.into());
        check("ros.odom_frame", "letters", |c| c.ros.odom_frame = bad.into());
        check("ros.base_frame", "letters", |c| c.ros.base_frame = bad.into());
        check("ros.body_frame", "letters", |c| c.ros.body_frame = bad.into());
    }
    check("ros.odom_frame", "`ros.map_frame` too", |c| c.ros.odom_frame = "map".into());
    check("ros.base_frame", "`ros.odom_frame` too", |c| c.ros.base_frame = "odom".into());
    check("ros.body_frame", "`ros.base_frame` too", |c| c.ros.body_frame = "base_link".into());
    check("ros.router", "tcp/127.0.0.1:7447", |c| c.ros.router = "localhost".into());
    check("ros.domain_id", "ROS_DOMAIN_ID", |c| c.ros.domain_id = 233);
}

#[test]
fn the_name_of_the_vehicle_is_a_namespace_only_where_one_is_needed() {
    let named = |enabled: bool, vehicle: &str, namespace: &str| {
        refused(|c| {
            c.ros.enabled = enabled;
            c.network.vehicle = vehicle.into();
            c.ros.namespace = namespace.into();
        })
    };
    assert_eq!(named(true, "drone-1", ""), []);
    assert_eq!(named(false, "7", ""), []);
    assert_eq!(named(true, "7", "/seven"), []);
    assert_eq!(named(true, "7", "")[0].key, "ros.namespace");
}

#[test]
fn the_local_socket_has_a_path_permissions_and_a_group() {
    for bad in ["local", "/run/", "/a\0b"] {
        check("local.path", "/run/plumbline/local", |c| c.local.path = bad.into());
    }
    check("local.path", "at most 100", |c| c.local.path = format!("/{}", "x".repeat(100)));
    for bad in ["", "0o", "rw", "660 ", "1777", "+66"] {
        check("local.mode", "\"0660\"", |c| c.local.mode = bad.into());
    }
    check("local.group", "plumbline", |c| c.local.group = "a b".into());
    let good = |c: &mut Config| {
        (c.local.path, c.local.mode, c.local.group) =
            ("/run/plumbline/local".into(), "0o640".into(), "video".into());
    };
    assert_eq!(refused(good), []);
}
