//! Paths of simulated flights by their names: built in, files, and trajectories of the shared data.

use super::Usage;
use plumbline_simulator::FlightPath;
use std::path::{Path, PathBuf};

/// A built-in path, a file, or the file of the trajectory in the shared data whose name begins so.
///
/// # Errors
/// When there is none, or several.
pub(super) fn flown_path(name: &str) -> Result<String, Usage> {
    flown_path_in(name, &trajectories())
}

fn flown_path_in(name: &str, folder: &Path) -> Result<String, Usage> {
    if !matches!(FlightPath::named(name), FlightPath::Tum(_)) || Path::new(name).exists() {
        return Ok(name.to_owned());
    }
    let known = known_trajectories(folder);
    let found: Vec<&String> =
        known.iter().filter(|known| !name.is_empty() && known.starts_with(name)).collect();
    if let [one] = found.as_slice() {
        return Ok(folder.join(format!("{one}.tum.gz")).display().to_string());
    }
    let names = match known.is_empty() {
        false => format!("a trajectory in {}: {}", folder.display(), known.join(", ")),
        true => {
            "the name of a trajectory in the shared data ($PLUMBLINE_SHARED, or ../shared; not found)".into()
        }
    };
    let what = if found.len() > 1 { "is the beginning of several names" } else { "no such path or file" };
    Err(Usage(format!(
        "--path {name}: {what}; give {}, a TUM file such as FOLDER/NAME.tum.gz, or {names}",
        FlightPath::NAMES.join(", ")
    )))
}

/// Names of the trajectories in a folder.
fn known_trajectories(folder: &Path) -> Vec<String> {
    let files = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let names = files.filter_map(|file| file.file_name().into_string().ok());
    let mut names: Vec<String> =
        names.filter_map(|name| name.strip_suffix(".tum.gz").map(str::to_owned)).collect();
    names.sort();
    names
}

/// The folder of trajectories in the shared data: that of the environment, else `../shared`.
fn trajectories() -> PathBuf {
    let shared = std::env::var_os("PLUMBLINE_SHARED").map_or_else(|| "../shared".into(), PathBuf::from);
    shared.join("euroc/trajectories")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_path_is_built_in_or_a_file_or_the_beginning_of_a_name_in_the_shared_data() {
        let shared = tempfile::tempdir().unwrap();
        let folder = shared.path().join("euroc/trajectories");
        std::fs::create_dir_all(&folder).unwrap();
        for name in ["V1_01_easy", "V1_02_medium"] {
            std::fs::write(folder.join(format!("{name}.tum.gz")), "").unwrap();
        }
        let path = |name: &str| flown_path_in(name, &folder).map_err(|error| error.to_string());
        assert_eq!(path("yaws").unwrap(), "yaws");
        let file = folder.join("V1_02_medium.tum.gz").display().to_string();
        assert_eq!((path("V1_02").unwrap(), path(&file).unwrap()), (file.clone(), file));
        for (name, why) in
            [("V1", "several names"), ("V9", "no such path or file"), ("", "no such path or file")]
        {
            let words = path(name).unwrap_err();
            for part in [why, "hand-held", ".tum.gz", "V1_01_easy, V1_02_medium"] {
                assert!(words.contains(part), "{part}: {words}");
            }
        }
        let words = flown_path_in("V9", Path::new("/nowhere")).unwrap_err().to_string();
        assert!(words.contains("yaws") && words.contains("PLUMBLINE_SHARED"), "{words}");
    }
}
