//! The images of a calibration: a folder with `cam0/` and, for a stereo pair, `cam1/`.
//!
//! Images of one time have one name in both folders. The PNG files lie in the folder of the camera or in `data/` within it,
//! as those of a EuRoC data set do; `mav0/` around them is found as well.

use super::recording::is_chosen;
use plumbline_config::GrayImage;
use plumbline_drivers::DriverError;
use plumbline_drivers::euroc::read_gray_png;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Sides of the images that are taken, px.
const SIDES_PX: std::ops::RangeInclusive<usize> = 64..=8192;

/// Why there are no images to calibrate with.
#[derive(Debug, thiserror::Error)]
pub enum ImagesError {
    /// The folder is not laid out as expected.
    #[error("{}: {reason}", path.display())]
    Layout {
        /// The folder.
        path: PathBuf,
        /// Missing part, and the cure.
        reason: String,
    },
    /// A folder cannot be read.
    #[error("{}: cannot be read ({source}); check its permissions", path.display())]
    Io {
        /// The folder.
        path: PathBuf,
        /// Error of the system.
        source: std::io::Error,
    },
    /// An image cannot be read.
    #[error(transparent)]
    Image(#[from] DriverError),
}

impl ImagesError {
    fn layout(path: &Path, reason: impl Into<String>) -> Self {
        Self::Layout { path: path.to_owned(), reason: reason.into() }
    }
}

/// Images that both cameras took at one time: files, read when they are asked for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Moment {
    /// The name that both files share, without its ending.
    pub name: String,
    /// Files of the left and the right camera; `None` if an image is missing.
    pub files: [Option<PathBuf>; 2],
}

/// The images of a folder, in the order of their names.
#[derive(Clone, Debug)]
pub struct Images {
    /// One or two.
    pub cameras: usize,
    /// At most as many as were asked for, spread evenly.
    pub moments: Vec<Moment>,
    /// Number of images in all.
    pub total: usize,
    /// Moments with an image of one camera alone.
    pub unpaired: usize,
}

impl Images {
    /// Lists the images of a folder, `most` of them at most, or those of its left camera alone.
    ///
    /// # Errors
    /// When the folder is not laid out as expected.
    pub fn list(folder: &Path, most: usize, mono: bool) -> Result<Self, ImagesError> {
        if !folder.is_dir() {
            let reason =
                "is not a folder; name one that holds cam0/ and, for two cameras, cam1/ with PNG images";
            return Err(ImagesError::layout(folder, reason));
        }
        let root = if folder.join("mav0").is_dir() { folder.join("mav0") } else { folder.to_owned() };
        let left = pngs(&root, "cam0")?.ok_or_else(|| {
            ImagesError::layout(folder, "holds no cam0/; put the left camera's PNG images there")
        })?;
        let right = if mono { None } else { pngs(&root, "cam1")? };
        let cameras = if right.is_some() { 2 } else { 1 };
        let mut moments: BTreeMap<String, [Option<PathBuf>; 2]> = BTreeMap::new();
        for (camera, files) in [left, right.unwrap_or_default()].into_iter().enumerate() {
            for (name, file) in files {
                moments.entry(name).or_default()[camera] = Some(file);
            }
        }
        let moments: Vec<Moment> = moments.into_iter().map(|(name, files)| Moment { name, files }).collect();
        let unpaired = moments.iter().filter(|m| m.files[..cameras].iter().any(Option::is_none)).count();
        if cameras == 2 && unpaired == moments.len() {
            let reason = "no image of cam0/ has the name of one of cam1/; give images of one time one name";
            return Err(ImagesError::layout(folder, reason));
        }
        let total = moments.len();
        Ok(Self { cameras, moments: spread(moments, most), total, unpaired })
    }
}

/// Selects at most `most` moments, evenly spread.
fn spread(moments: Vec<Moment>, most: usize) -> Vec<Moment> {
    let count = moments.len();
    let chosen = moments.into_iter().enumerate().filter(|(k, _)| is_chosen(*k, count, most));
    chosen.map(|(_, moment)| moment).collect()
}

/// The PNG files of a camera by their names; `None` without its folder.
fn pngs(root: &Path, camera: &str) -> Result<Option<BTreeMap<String, PathBuf>>, ImagesError> {
    let folder = root.join(camera);
    if !folder.is_dir() {
        return Ok(None);
    }
    let folder = if folder.join("data").is_dir() { folder.join("data") } else { folder };
    let mut files = BTreeMap::new();
    for path in listed(&folder)?.into_iter().filter(|path| is_png(path)) {
        if let Some(name) = path.file_stem() {
            files.insert(name.to_string_lossy().into_owned(), path.clone());
        }
    }
    if files.is_empty() {
        return Err(ImagesError::layout(&folder, "holds no PNG image; convert others to PNG first"));
    }
    Ok(Some(files))
}

/// Files of a folder.
fn listed(folder: &Path) -> Result<Vec<PathBuf>, ImagesError> {
    let io = |source| ImagesError::Io { path: folder.to_owned(), source };
    folder.read_dir().map_err(io)?.map(|entry| Ok(entry.map_err(io)?.path())).collect()
}

fn is_png(file: &Path) -> bool {
    file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("png"))
}

/// Reads an image.
///
/// # Errors
/// When it cannot be read.
pub fn read(file: &Path) -> Result<GrayImage, ImagesError> {
    Ok(read_gray_png(file, SIDES_PX)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn folder(files: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for file in files {
            let path = folder.path().join(file);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, "").unwrap();
        }
        folder
    }

    fn names(images: &Images) -> Vec<&str> {
        images.moments.iter().map(|m| m.name.as_str()).collect()
    }

    #[test]
    fn images_of_one_name_are_of_one_time_in_any_layout() {
        let plain =
            folder(&["cam0/1.png", "cam0/2.png", "cam0/3.PNG", "cam0/notes.txt", "cam1/2.png", "cam1/3.png"]);
        let images = Images::list(plain.path(), 60, false).unwrap();
        assert_eq!(
            (images.cameras, images.total, images.unpaired, names(&images)),
            (2, 3, 1, vec!["1", "2", "3"])
        );
        assert!(images.moments[0].files[1].is_none() && images.moments[2].files[1].is_some());
        assert_eq!(Images::list(plain.path(), 60, true).unwrap().cameras, 1);
        let euroc = folder(&["mav0/cam0/data/10.png", "mav0/cam0/data.csv", "mav0/cam1/data/10.png"]);
        let images = Images::list(euroc.path(), 60, false).unwrap();
        assert_eq!((images.cameras, names(&images)), (2, vec!["10"]));
    }

    #[test]
    fn of_many_images_some_are_taken_all_over_the_recording() {
        let many: Vec<String> = (0..100).map(|k| format!("cam0/{k:03}.png")).collect();
        let many: Vec<&str> = many.iter().map(String::as_str).collect();
        let images = Images::list(folder(&many).path(), 10, false).unwrap();
        assert_eq!((images.cameras, images.total, images.moments.len()), (1, 100, 10));
        let taken: Vec<usize> = names(&images).iter().map(|name| name.parse().unwrap()).collect();
        assert!(taken.windows(2).all(|pair| pair[1] - pair[0] == 10), "{taken:?}");
    }

    #[test]
    fn what_is_laid_out_otherwise_is_refused_with_the_cure() {
        let refusal = |files: &[&str]| Images::list(folder(files).path(), 9, false).unwrap_err().to_string();
        assert!(refusal(&["left/1.png"]).contains("holds no cam0/"));
        assert!(refusal(&["cam0/1.jpg"]).contains("convert"));
        assert!(refusal(&["cam0/1.png", "cam1/2.png"]).contains("one name"));
        let missing = Images::list(Path::new("/nowhere"), 9, false).unwrap_err().to_string();
        assert!(missing.contains("/nowhere") && missing.contains("cam1/"), "{missing}");
    }
}
