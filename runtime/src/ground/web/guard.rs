//! What a browser may be made to do: pages of other origins get nothing, and nothing changes by a link.

use super::Station;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::sync::Arc;

/// Longest body of a request, bytes.
pub const MAX_BODY_BYTES: usize = 4_096;
/// The page needs nothing but itself.
const POLICY: &str = "default-src 'self'; img-src 'self' blob: data:; style-src 'self'; script-src 'self'; \
                      connect-src 'self'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'";

/// Refuses requests that were made for another host or by another origin.
pub async fn check(State(station): State<Arc<Station>>, request: Request, next: Next) -> Response {
    let refusal = refusal(&station, request.method(), request.headers(), request.uri().path());
    let mut response = match refusal {
        Some(reason) => (StatusCode::FORBIDDEN, reason).into_response(),
        None => next.run(request).await,
    };
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_SECURITY_POLICY, HeaderValue::from_static(POLICY));
    headers.insert(header::X_CONTENT_TYPE_OPTIONS, HeaderValue::from_static("nosniff"));
    headers.insert(header::REFERRER_POLICY, HeaderValue::from_static("no-referrer"));
    headers.insert(header::CACHE_CONTROL, HeaderValue::from_static("no-cache"));
    response
}

fn refusal(station: &Station, method: &Method, headers: &HeaderMap, path: &str) -> Option<&'static str> {
    let host = text(headers, &header::HOST).unwrap_or_default();
    if station.address.ip().is_loopback() && !is_loopback(host) {
        // A name that was made to point here.
        return Some("this station is served to its own host alone; open it by 127.0.0.1 or localhost\n");
    }
    if *method == Method::GET && path != "/ws" {
        return None;
    }
    let is_ours = text(headers, &header::ORIGIN).is_none_or(|origin| origin == format!("http://{host}"));
    if !is_ours {
        return Some("a page of another origin may not do this\n");
    }
    let is_json =
        text(headers, &header::CONTENT_TYPE).is_some_and(|kind| kind.starts_with("application/json"));
    (*method == Method::POST && !is_json).then_some("send application/json\n")
}

fn text<'a>(headers: &'a HeaderMap, name: &header::HeaderName) -> Option<&'a str> {
    headers.get(name).and_then(|value| value.to_str().ok())
}

/// Whether a Host header such as `localhost:8080` names this host.
pub fn is_loopback(host: &str) -> bool {
    crate::net::security::is_loopback(host) || crate::net::security::is_loopback(&format!("{host}:80"))
}

#[cfg(test)]
mod tests {
    use super::is_loopback;

    #[test]
    fn hosts_are_told_apart() {
        for host in ["localhost:8080", "127.0.0.1:8080", "127.0.0.1", "[::1]:8080", "localhost"] {
            assert!(is_loopback(host), "{host}");
        }
        for host in ["evil.example:8080", "10.0.0.1:8080", "", "localhost.evil:8080"] {
            assert!(!is_loopback(host), "{host}");
        }
    }
}
