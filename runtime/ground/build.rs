//! Lists the files of the page, which are embedded: name, media type, contents.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};

/// The folder of the page.
const PAGE: &str = "web";
/// Files for those who edit or test the page alone, left out.
const LEFT_OUT: &[&str] = &["tests", "package.json", "README.md"];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    println!("cargo:rerun-if-changed={PAGE}");
    let root = std::env::current_dir()?.join(PAGE);
    let mut files = Vec::new();
    collect(&root, &mut files)?;
    let mut rows = Vec::new();
    for file in &files {
        let name = file.strip_prefix(&root)?.to_str().ok_or("a name is not UTF-8")?;
        rows.push((name, media_type(file), file));
    }
    rows.sort();
    let mut table = String::from("&[\n");
    for (name, media_type, file) in rows {
        writeln!(table, "    ({name:?}, {media_type:?}, include_bytes!({file:?})),")?;
    }
    table.push_str("]\n");
    std::fs::write(Path::new(&std::env::var("OUT_DIR")?).join("page.rs"), table)?;
    Ok(())
}

/// All files below a folder.
fn collect(folder: &Path, files: &mut Vec<PathBuf>) -> std::io::Result<()> {
    for entry in std::fs::read_dir(folder)? {
        let entry = entry?;
        if LEFT_OUT.iter().any(|name| entry.file_name() == *name) {
            continue;
        }
        match entry.file_type()?.is_dir() {
            true => collect(&entry.path(), files)?,
            false => files.push(entry.path()),
        }
    }
    Ok(())
}

/// The media type by the ending of a file's name. A browser runs no module whose type is not that of scripts.
fn media_type(file: &Path) -> &'static str {
    match file.extension().and_then(|ending| ending.to_str()) {
        Some("html") => "text/html",
        Some("css") => "text/css",
        Some("js") => "text/javascript",
        Some("svg") => "image/svg+xml",
        _ => "application/octet-stream",
    }
}
