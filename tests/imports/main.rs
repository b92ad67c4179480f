//! Rules between the crates that the compiler does not check: within a crate no modules of one folder import each other in a
//! circle, the modules of the estimator follow the flow of the data, a flight is built from no network, and functions of the
//! runtime fit on a screen.

mod arrows;
mod sources;

use arrows::{Arrows, against, arrows, circles};
use sources::Sources;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The modules of the estimator in the order of the data.
const ESTIMATOR: &str = "geometry shutter origin work_budget image health estimate points lines inertial input admission \
    window initial exchange places front_end odometry propagator facade";

/// Libraries of networks, of which none has a part in a flight.
const NETWORKS: &[&str] = &["axum", "hyper", "plumbline-link", "rcgen", "rustls", "tokio", "zenoh"];

/// Lines of the longest function of the runtime: one screen.
const SCREEN: usize = 60;

fn project() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn crate_of(name: &str) -> Sources {
    Sources::read(&project().join(name))
}

/// The arrows at the top of a crate.
fn top(sources: &Sources) -> Arrows {
    arrows(sources).remove(&Vec::new()).unwrap_or_default()
}

#[test]
fn a_flight_is_built_without_a_network() {
    let mut tree = Command::new(env!("CARGO"));
    tree.args("tree -p plumbline-flight -e normal --prefix none --offline --locked".split(' '));
    let tree = tree.current_dir(project()).output().unwrap();
    let crates = String::from_utf8(tree.stdout).unwrap();
    let names: BTreeSet<&str> = crates.lines().filter_map(|line| line.split(' ').next()).collect();
    assert!(names.contains("plumbline-estimator"), "{}", String::from_utf8_lossy(&tree.stderr));
    let networks: Vec<_> = NETWORKS.iter().filter(|name| names.contains(*name)).collect();
    assert_eq!(networks, Vec::<&&str>::new());
}

#[test]
fn modules_of_the_estimator_follow_the_data() {
    let order: Vec<&str> = ESTIMATOR.split(' ').collect();
    assert_eq!(against(&order, &top(&crate_of("estimator"))), Vec::<String>::new());
}

/// Every circle of a crate, as `folder: a, b`.
fn all_circles(name: &str) -> BTreeSet<String> {
    let words = |path: &[String], circle: &BTreeSet<String>| {
        let members: Vec<_> = circle.iter().map(String::as_str).collect();
        format!("{}: {}", [&[name.to_owned()], path].concat().join("::"), members.join(", "))
    };
    let per_folder = arrows(&crate_of(name));
    per_folder
        .iter()
        .flat_map(|(path, arrows)| circles(arrows).into_iter().map(|c| words(path, &c)))
        .collect()
}

/// Our crates, of which the tests are none.
fn crates() -> Vec<String> {
    let workspace = std::fs::read_to_string(project().join("Cargo.toml")).unwrap();
    let (_, members) = workspace.split_once("members = [").unwrap();
    let names = members.split(']').next().unwrap().split('"').skip(1).step_by(2);
    names.filter(|name| !name.starts_with("tests")).map(str::to_owned).collect()
}

#[test]
fn no_modules_of_a_folder_import_each_other_in_a_circle() {
    let found: BTreeSet<String> = crates().iter().flat_map(|name| all_circles(name)).collect();
    assert_eq!(found, BTreeSet::new());
}

#[test]
fn functions_of_the_runtime_fit_on_a_screen() {
    let crates = ["capi", "cli", "client", "flight", "ground", "lab", "link", "python"]
        .map(|name| format!("runtime/{name}"));
    let mut functions: Vec<_> = crates.iter().flat_map(|name| crate_of(name).functions).collect();
    functions.sort_by_key(|function| std::cmp::Reverse(function.lines));
    functions.retain(|function| function.lines > SCREEN);
    assert_eq!(functions, Vec::new());
}

/// Writes a crate of these files; its sources.
fn made_up(files: &[(&str, &str)]) -> Sources {
    let folder = tempfile::tempdir().unwrap();
    for (file, text) in files {
        let path = folder.path().join("src").join(file);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }
    Sources::read(folder.path())
}

#[test]
fn a_circle_is_found_with_its_file_however_it_is_written() {
    for back in [
        "use crate::top::Thing;",
        "use super::top;",
        "use crate::{top::Thing as Other};",
        "fn f() { crate::top::f(); }",
        "fn f() -> super::top::Thing { todo!() }",
        "fn f() { println!(\"{}\", crate::top::NUMBER); }",
        "mod inner { use super::super::top::Thing; }",
        // Handed on by the root.
        "use crate::Thing;",
    ] {
        let sources = made_up(&[
            ("lib.rs", "pub mod top; mod ground; pub use top::Thing;"),
            ("top.rs", "use crate::ground; pub struct Thing;"),
            ("ground/mod.rs", back),
        ]);
        let arrows = top(&sources);
        assert_eq!(circles(&arrows).len(), 1, "{back}");
        assert_eq!(
            against(&["ground", "top"], &arrows),
            ["src/ground/mod.rs: ground -> top points up"],
            "{back}"
        );
    }
}

#[test]
fn a_function_is_measured_from_its_signature_to_its_end() {
    let sources = made_up(&[("lib.rs", "/// Words.\nfn long(\n    a: u8,\n) {\n    let _ = a;\n}\n")]);
    assert_eq!(sources.functions[0].lines, 5);
}
