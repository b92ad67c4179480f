//! The files of the page.

use axum::http::{StatusCode, Uri, header};
use axum::response::{IntoResponse, Response};
use rust_embed::RustEmbed;

#[derive(RustEmbed)]
#[folder = "web"]
#[exclude = "tests/*"]
#[exclude = "package.json"]
#[exclude = "*.md"]
struct Assets;

/// A file of the page, the page itself for the root.
pub async fn serve(uri: Uri) -> Response {
    let path = match uri.path().trim_start_matches('/') {
        "" => "index.html",
        path => path,
    };
    match Assets::get(path) {
        Some(file) => {
            let kind = file.metadata.mimetype().to_owned();
            ([(header::CONTENT_TYPE, kind)], file.data).into_response()
        }
        None => (StatusCode::NOT_FOUND, "there is no such file\n").into_response(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_is_embedded_and_names_nothing_outside() {
        let page = Assets::get("index.html").expect("the page is there");
        let text = String::from_utf8(page.data.into_owned()).unwrap();
        assert!(!text.contains("http://") && !text.contains("https://"), "the page must not need a network");
    }
}
