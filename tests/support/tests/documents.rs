//! The Markdown documents of the repository: every relative link and every anchor leads somewhere, and what stands in
//! backticks and looks like a file of the repository is one. Nothing is asked of the network.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Folders that hold no documents of ours.
const NOT_OURS: [&str; 6] = ["target", ".git", ".venv", "out", "corpus", "node_modules"];
/// Beginnings of texts in backticks that are paths in the repository.
const ROOTS: &str =
    "config/ estimator/ drivers/ runtime/ tests/ docs/ notes/ scripts/ fuzz/ examples/ .ci/ .config/";

/// All documents below a folder.
fn documents(folder: &Path, found: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> = folder.read_dir().unwrap().map(|entry| entry.unwrap().path()).collect();
    entries.sort();
    for path in entries {
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() && !path.is_symlink() && !NOT_OURS.contains(&name.as_str()) {
            documents(&path, found);
        } else if name.ends_with(".md") {
            found.push(path);
        }
    }
}

/// The lines of a document outside its blocks of code, with their numbers.
fn prose(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut fence: Option<&str> = None;
    (1..).zip(text.lines()).filter(move |(_, line)| {
        let start = line.trim_start();
        let marker = ["```", "~~~"].into_iter().find(|marker| start.starts_with(marker));
        match (fence, marker) {
            (None, Some(marker)) => fence = Some(marker),
            (Some(open), Some(marker)) if open == marker => fence = None,
            (None, None) => return true,
            _ => {}
        }
        false
    })
}

/// A line in its pieces: prose, and what stands in backticks.
fn pieces(line: &str) -> (String, Vec<&str>) {
    let (mut outside, mut inside) = (String::new(), Vec::new());
    for (k, piece) in line.split('`').enumerate() {
        if k % 2 == 0 {
            outside.push_str(piece);
        } else {
            inside.push(piece);
            // Backticks within the text of a link must not tear it apart.
            outside.push_str(&"x".repeat(piece.len()));
        }
    }
    (outside, inside)
}

/// Targets of the links of a line: `[text](target)`, `![image](target)`, `[name]: target`.
fn links(prose: &str) -> Vec<String> {
    let mut found = Vec::new();
    let mut rest = prose;
    while let Some(at) = rest.find("](") {
        rest = &rest[at + 2..];
        let target = rest.split([')', ' ']).next().unwrap_or_default();
        found.push(target.trim_matches(['<', '>']).to_owned());
    }
    if let Some((name, target)) = prose.trim_start().split_once("]: ")
        && name.starts_with('[')
        && !name.starts_with("[^")
    {
        found.push(target.split_whitespace().next().unwrap_or_default().trim_matches(['<', '>']).to_owned());
    }
    found
}

/// The anchors of a document's headings, as GitHub makes them, and those that it sets itself.
fn anchors(text: &str) -> Vec<String> {
    let mut counts: BTreeMap<String, usize> = BTreeMap::new();
    let mut found = Vec::new();
    for (_, line) in prose(text) {
        for name in ["id=\"", "name=\""] {
            found.extend(
                line.split(name).skip(1).filter_map(|rest| rest.split('"').next()).map(str::to_owned),
            );
        }
        let heading = line.trim_start_matches('#');
        if !line.starts_with('#') || !heading.starts_with(' ') {
            continue;
        }
        let kept = |c: &char| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_');
        let plain: String = without_targets(heading.trim()).to_lowercase().chars().filter(kept).collect();
        let slug = plain.replace(' ', "-");
        let count = counts.entry(slug.clone()).or_default();
        found.push(if *count == 0 { slug } else { format!("{slug}-{count}") });
        *count += 1;
    }
    found
}

/// A heading without the targets of its links.
fn without_targets(heading: &str) -> String {
    let mut pieces = heading.split("](");
    let first = pieces.next().unwrap_or_default().to_owned();
    pieces.fold(first, |text, piece| text + piece.split_once(')').map_or("", |(_, after)| after))
}

/// Defect of a link of the document at `from`.
fn broken(from: &Path, text: &str, target: &str) -> Option<String> {
    if target.contains("://") || target.starts_with("mailto:") {
        return None;
    }
    let (file, anchor) = target.split_once('#').unwrap_or((target, ""));
    let path = from.parent().unwrap().join(file.replace("%20", " "));
    if !file.is_empty() && !path.exists() {
        return Some(format!("'{target}' leads to no file"));
    }
    if anchor.is_empty() || !(file.is_empty() || file.ends_with(".md")) {
        return None;
    }
    let there = if file.is_empty() { text.to_owned() } else { std::fs::read_to_string(&path).unwrap() };
    let is_there = anchors(&there).iter().any(|known| known == anchor);
    (!is_there).then(|| format!("'{target}' leads to no heading"))
}

/// The path that stands in backticks, when it looks like one: without the number of a line.
fn repository_path(code: &str) -> Option<&str> {
    let path = code.split(':').next()?;
    let is_plain = path.chars().all(|c| c.is_ascii_alphanumeric() || "._-/".contains(c));
    (is_plain && ROOTS.split(' ').any(|root| path.starts_with(root))).then_some(path)
}

/// Complaints about the document at `path`.
fn complaints(workspace: &Path, path: &Path, text: &str) -> Vec<String> {
    let mut found = Vec::new();
    for (number, line) in prose(text) {
        let (outside, inside) = pieces(line);
        let links = links(&outside).into_iter().filter_map(|target| broken(path, text, &target));
        let missing = inside.into_iter().filter_map(repository_path).filter(|p| !workspace.join(p).exists());
        let missing = missing.map(|path| format!("`{path}` is not a file of the repository"));
        let name = path.strip_prefix(workspace).unwrap_or(path).display();
        found.extend(links.chain(missing).map(|what| format!("{name}:{number}: {what}")));
    }
    found
}

#[test]
fn every_link_and_every_path_of_the_documents_leads_somewhere() {
    let workspace = plumbline_test_support::workspace().canonicalize().unwrap();
    let mut paths = Vec::new();
    documents(&workspace, &mut paths);
    assert!(paths.iter().any(|path| path.ends_with("README.md")), "no documents were found");
    let complaints: Vec<String> = paths
        .iter()
        .flat_map(|path| complaints(&workspace, path, &std::fs::read_to_string(path).unwrap()))
        .collect();
    assert!(complaints.is_empty(), "{}", complaints.join("\n"));
}

#[test]
fn what_leads_nowhere_is_found_and_nothing_else() {
    let folder = tempfile::tempdir().unwrap();
    std::fs::create_dir(folder.path().join("docs")).unwrap();
    std::fs::write(folder.path().join("docs/other.md"), "# One thing\n## `verify` and [more](x.md)\n")
        .unwrap();
    let good = "# Here & there\n[a](docs/other.md#one-thing) [b](#here--there) [`c`](docs/other.md#verify-and-more)\n\
                [d](https://nowhere.example/x.md) `docs/other.md:7` `docs/<name>.md`\n[e]: docs/other.md\n\
                ```\n[f](nowhere.md)\n```\n";
    let path = folder.path().join("README.md");
    assert_eq!(complaints(folder.path(), &path, good), [""; 0]);
    let bad =
        "[a](docs/nowhere.md)\n[b](docs/other.md#nowhere)\n[c](#nowhere)\n`docs/nowhere.rs`\n[d]: no.md\n";
    let found = complaints(folder.path(), &path, bad);
    let lines: Vec<&str> = found.iter().map(|line| line.split(": ").next().unwrap()).collect();
    assert_eq!(
        lines,
        ["README.md:1", "README.md:2", "README.md:3", "README.md:4", "README.md:5"],
        "{found:?}"
    );
}
