//! Protection against browsers: pages of other origins get nothing, and nothing changes by a link.

use super::Station;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, HeaderValue, Method, StatusCode, header};
use axum::middleware::Next;
use axum::response::{IntoResponse, Response};
use std::net::IpAddr;
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
    let host = match own_host(headers, station.address.ip().is_loopback(), &station.names) {
        Ok(host) => host,
        Err(reason) => return Some(reason),
    };
    if *method == Method::GET && path != "/ws" {
        return None;
    }
    if !is_same_origin(headers, host) || is_cross_site(headers) {
        return Some("a page of another origin may not do this\n");
    }
    let is_json =
        text(headers, &header::CONTENT_TYPE).is_some_and(|kind| kind.starts_with("application/json"));
    (*method == Method::POST && !is_json).then_some("send application/json\n")
}

/// The host that a request names, where it is this one; else the reason of a refusal. A name that somebody made to point here
/// would let his page be of the same origin.
pub fn own_host<'a>(
    headers: &'a HeaderMap,
    is_local: bool,
    names: &[String],
) -> Result<&'a str, &'static str> {
    if headers.get_all(header::HOST).iter().count() > 1 {
        return Err("send one Host header\n");
    }
    match text(headers, &header::HOST).unwrap_or_default() {
        host if is_loopback(host) || (!is_local && is_ours(host, names)) => Ok(host),
        _ if is_local => {
            Err("this station is served to its own host alone; open it by 127.0.0.1 or localhost\n")
        }
        _ => {
            Err("open this station by its address or host name, or start it with --http-name and this name\n")
        }
    }
}

/// True if no other origin is named; one that cannot be read is another.
fn is_same_origin(headers: &HeaderMap, host: &str) -> bool {
    let ours = format!("http://{host}");
    headers.get_all(header::ORIGIN).iter().all(|origin| origin.as_bytes() == ours.as_bytes())
}

/// True if a browser marks the request as coming from another site, as it does even where it names no origin.
fn is_cross_site(headers: &HeaderMap) -> bool {
    let own = ["same-origin", "none"];
    headers
        .get_all("sec-fetch-site")
        .iter()
        .any(|site| !own.iter().any(|own| site.as_bytes() == own.as_bytes()))
}

fn text<'a>(headers: &'a HeaderMap, name: &header::HeaderName) -> Option<&'a str> {
    headers.get(name).and_then(|value| value.to_str().ok())
}

/// True if a Host header such as `localhost:8080` names this host.
pub fn is_loopback(host: &str) -> bool {
    plumbline_link::net::security::is_loopback(host)
        || plumbline_link::net::security::is_loopback(&format!("{host}:80"))
}

/// True if a Host header such as `192.168.1.7:8080` is an address, or one of these names.
fn is_ours(host: &str, names: &[String]) -> bool {
    let is_port = |port: &str| port.bytes().all(|c| c.is_ascii_digit());
    let name = host.rsplit_once(':').filter(|(_, port)| is_port(port)).map_or(host, |(name, _)| name);
    let address = name.strip_prefix('[').and_then(|name| name.strip_suffix(']')).unwrap_or(name);
    address.parse::<IpAddr>().is_ok() || names.iter().any(|other| other.eq_ignore_ascii_case(name))
}

/// The names of this host on its network.
pub fn own_names() -> Vec<String> {
    let name = std::fs::read_to_string("/proc/sys/kernel/hostname").unwrap_or_default();
    let name = name.trim();
    if name.is_empty() { Vec::new() } else { vec![name.to_owned(), format!("{name}.local")] }
}

#[cfg(test)]
mod tests {
    use super::{is_cross_site, is_loopback, is_ours, is_same_origin};
    use axum::http::{HeaderMap, HeaderValue, header::ORIGIN};

    #[test]
    fn an_origin_that_is_not_ascii_is_another() {
        let is_same = |origins: &[&[u8]]| {
            let mut headers = HeaderMap::new();
            for origin in origins {
                headers.append(ORIGIN, HeaderValue::from_bytes(origin).unwrap());
            }
            is_same_origin(&headers, "localhost:8080")
        };
        assert!(is_same(&[]) && is_same(&[b"http://localhost:8080"]));
        assert!(!is_same(&[b"http://evil.example"]) && !is_same(&[b"null"]));
        assert!(!is_same(&["http://b\u{fc}cher.example".as_bytes()]) && !is_same(&[&[0xff, 0xfe]]));
        assert!(!is_same(&[b"http://localhost:8080", b"http://evil.example"]));
    }

    #[test]
    fn requests_from_other_sites_are_told_without_an_origin() {
        let is_cross = |sites: &[&'static str]| {
            let mut headers = HeaderMap::new();
            for site in sites {
                headers.append("sec-fetch-site", HeaderValue::from_static(site));
            }
            is_cross_site(&headers)
        };
        assert!(!is_cross(&[]) && !is_cross(&["same-origin"]) && !is_cross(&["none"]));
        assert!(is_cross(&["cross-site"]) && is_cross(&["same-site"]) && is_cross(&["none", "cross-site"]));
    }

    #[test]
    fn hosts_are_told_apart() {
        for host in ["localhost:8080", "127.0.0.1:8080", "127.0.0.1", "[::1]:8080", "localhost"] {
            assert!(is_loopback(host), "{host}");
        }
        for host in ["evil.example:8080", "10.0.0.1:8080", "", "localhost.evil:8080"] {
            assert!(!is_loopback(host), "{host}");
        }
    }

    #[test]
    fn a_station_for_others_is_opened_by_address_or_by_a_name_of_its_own() {
        let names = ["tower".to_owned(), "tower.local".to_owned()];
        for host in ["192.168.1.7:8080", "10.0.0.1", "[fe80::1]:8080", "tower:8080", "Tower.local"] {
            assert!(is_ours(host, &names), "{host}");
        }
        for host in ["evil.example:8080", "tower.evil.example", "", "1.2.3.4.evil.example:8080", "10.0.0.1:x"]
        {
            assert!(!is_ours(host, &names), "{host}");
        }
    }
}
