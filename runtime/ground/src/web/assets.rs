//! The files of the page.

use axum::http::{StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};

/// Name, media type and contents of each file, in the order of names (`build.rs`).
const FILES: &[(&str, &str, &[u8])] = include!(concat!(env!("OUT_DIR"), "/page.rs"));

/// A file of the page, the page itself for the root.
pub async fn serve(uri: Uri) -> Response {
    let path = match uri.path().trim_start_matches('/') {
        "" => "index.html",
        path => path,
    };
    match file(path) {
        Some((media_type, contents)) => ([(header::CONTENT_TYPE, media_type)], contents).into_response(),
        None => (StatusCode::NOT_FOUND, "there is no such file\n").into_response(),
    }
}

/// Media type and contents of a file.
fn file(path: &str) -> Option<(&'static str, &'static [u8])> {
    let at = FILES.binary_search_by(|(name, ..)| (*name).cmp(path)).ok()?;
    let (_, media_type, contents) = FILES[at];
    Some((media_type, contents))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_is_embedded_and_names_nothing_outside() {
        let (media_type, page) = file("index.html").expect("the page is there");
        let text = std::str::from_utf8(page).unwrap();
        assert_eq!(media_type, "text/html");
        assert!(!text.contains("http://") && !text.contains("https://"), "the page must not need a network");
    }

    #[test]
    fn tests_of_the_page_and_files_outside_are_not_served() {
        for path in ["tests/ring.test.js", "package.json", "README.md", "../Cargo.toml", "js", "js/"] {
            assert_eq!(file(path), None, "{path}");
        }
    }
}
