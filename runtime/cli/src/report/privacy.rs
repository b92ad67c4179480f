//! Removal of private content: addresses, paths, names of hosts and users, serial numbers. Keys of a configuration whose
//! values are kept are listed. All other strings are left out, so a key that is added later is private until it is listed.

use std::path::Path;

/// Placeholder of private content.
pub const LEFT_OUT: &str = "(left out)";

/// Keys whose values are words of the configuration itself.
const KEPT: [&str; 15] = [
    "clock",
    "commands",
    "distribution",
    "flow",
    "format",
    "images",
    "keep",
    "link",
    "lost_pose",
    "mavlink_message",
    "mode",
    "model",
    "pair_by",
    "protocol",
    "stamp",
];

/// The text of a configuration (TOML, one key a line) without its private strings. The scheme of an address is kept.
pub fn redacted(toml: &str) -> String {
    let mut is_kept = false;
    let mut out = String::new();
    for line in toml.lines() {
        let begins_key = line.split_once('=').map(|(key, _)| key.trim()).filter(|key| is_bare(key));
        if let Some(key) = begins_key {
            is_kept = KEPT.contains(&key);
        }
        out += &if is_kept { line.to_owned() } else { without_strings(line) };
        out.push('\n');
    }
    out
}

fn is_bare(key: &str) -> bool {
    !key.is_empty() && key.chars().all(|c| c.is_ascii_alphanumeric() || matches!(c, '_' | '-' | '.'))
}

/// A line with what stands in quotation marks left out, but for the scheme of an address; empty strings stay.
fn without_strings(line: &str) -> String {
    let mut out = String::new();
    let mut rest = line.chars();
    while let Some(c) = rest.next() {
        out.push(c);
        if !matches!(c, '"' | '\'') {
            continue;
        }
        let (mut text, mut is_escaped) = (String::new(), false);
        for next in rest.by_ref() {
            if next == c && !is_escaped {
                break;
            }
            is_escaped = c == '"' && next == '\\' && !is_escaped;
            text.push(next);
        }
        if !text.is_empty() {
            let scheme = text.split_once("://").or_else(|| text.split_once('/')).map(|(scheme, _)| scheme);
            let scheme = scheme.filter(|scheme| {
                ["serial", "iio", "tcp", "udp", "tls", "quic", "unixsock-stream"].contains(scheme)
            });
            scheme.iter().for_each(|scheme| out += &format!("{scheme}: "));
            out += LEFT_OUT;
        }
        out.push(c);
    }
    out
}

/// Words that must not leave this machine.
#[derive(Debug, Default)]
pub struct Secrets {
    /// Each with what stands in its place, the longest first.
    words: Vec<(String, &'static str)>,
}

impl Secrets {
    /// Secrets of this machine, and the folder of `input`.
    pub fn of_machine(input: &Path) -> Self {
        let read = |path: &str| std::fs::read_to_string(path).ok();
        let hosts = ["/proc/sys/kernel/hostname", "/etc/hostname", "/etc/machine-id"].map(read);
        let users = ["USER", "LOGNAME"].map(|name| std::env::var(name).ok());
        let homes =
            [std::env::var("HOME").ok(), std::env::current_dir().ok().map(|path| path.display().to_string())];
        let folders = [input.canonicalize().unwrap_or_default().parent(), input.parent()]
            .map(|folder| folder.map(|folder| folder.display().to_string()));
        let hosts = hosts.into_iter().flatten().map(|word| (word, "(host)"));
        let users = users.into_iter().flatten().map(|word| (word, "(user)"));
        let folders = homes.into_iter().chain(folders).flatten().map(|word| (word, "(folder)"));
        Self::of(hosts.chain(users).chain(folders))
    }

    fn of(words: impl Iterator<Item = (String, &'static str)>) -> Self {
        // A word of two letters, or `root`, says nothing and stands in others.
        let is_telling = |word: &str| word.len() > 2 && !["root", "localhost", "user"].contains(&word);
        let words = words.map(|(word, place)| (word.trim().to_owned(), place));
        let mut words: Vec<_> = words.filter(|(word, _)| is_telling(word)).collect();
        words.sort_by(|a, b| b.0.len().cmp(&a.0.len()).then_with(|| a.0.cmp(&b.0)));
        words.dedup();
        Self { words }
    }

    /// `text` without them, and without addresses of the Internet and of network cards.
    pub fn scrubbed(&self, text: &str) -> String {
        let text = self.words.iter().fold(text.to_owned(), |text, (word, place)| text.replace(word, place));
        let mut out = String::new();
        let mut token = String::new();
        let flush = |token: &mut String, out: &mut String| {
            out.push_str(if is_address(token) { "(address)" } else { token.as_str() });
            token.clear();
        };
        for c in text.chars() {
            if c.is_ascii_alphanumeric() || matches!(c, '.' | ':') {
                token.push(c);
            } else {
                flush(&mut token, &mut out);
                out.push(c);
            }
        }
        flush(&mut token, &mut out);
        out
    }
}

/// True if a word is an IPv4 address (with or without a port) or that of a network card.
fn is_address(token: &str) -> bool {
    let host = token.split(':').next().unwrap_or_default();
    let parts: Vec<&str> = token.split(':').collect();
    let is_card =
        parts.len() == 6 && parts.iter().all(|part| part.len() == 2 && u8::from_str_radix(part, 16).is_ok());
    is_card
        || host.parse::<std::net::Ipv4Addr>().is_ok()
        || token.matches(':').count() > 2 && token.parse::<std::net::Ipv6Addr>().is_ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use plumbline_config::Config;

    #[test]
    fn strings_that_are_not_listed_are_left_out_and_figures_stay() {
        let mut config: Config = Config::preset("euroc").unwrap().into();
        config.driver.imu.connect = "serial:///dev/serial/by-id/usb-ACME_0815-if00:921600".into();
        config.network.listen = vec!["tls/10.1.2.3:7447".into()];
        config.network.vehicle = "hawk-7".into();
        config.network.tls.key = "/home/ann/secret.pem".into();
        let text = toml::to_string(&config).unwrap();
        let told = redacted(&text);
        for secret in ["ACME", "0815", "10.1.2.3", "hawk", "ann", "pem", "7447"] {
            assert!(text.contains(secret) && !told.contains(secret), "{secret}: {told}");
        }
        for kept in [
            "model = \"radial-tangential\"",
            "connect = \"serial: (left out)\"",
            "sigma_px = ",
            "images = \"png\"",
        ] {
            assert!(told.contains(kept), "{kept}: {told}");
        }
        let keys = |text: &str| {
            text.lines().map(|line| line.split('=').next().unwrap_or_default().to_owned()).collect::<Vec<_>>()
        };
        assert_eq!(keys(&text), keys(&told));
    }

    #[test]
    fn quotes_escapes_and_lists_do_not_let_a_secret_through() {
        let toml = "connect = \"a\\\"secret\"\nlisten = [\n    \"tcp/secret:1\",\n    'secret',\n]\nmodel = \"equidistant\"\nuser = \"\"\n";
        let told = redacted(toml);
        assert!(
            !told.contains("secret") && told.contains("user = \"\"") && told.contains("equidistant"),
            "{told}"
        );
    }

    #[test]
    fn names_folders_and_addresses_are_taken_out_of_texts() {
        let words = [
            ("hawk", "(host)"),
            ("/home/ann/flights", "(folder)"),
            ("/home/ann", "(folder)"),
            ("me", "(user)"),
        ];
        let secrets = Secrets::of(words.into_iter().map(|(word, place)| (word.to_owned(), place)));
        let told = secrets.scrubbed("/home/ann/flights/a.mcap on hawk, 10.0.0.7:14540, aa:bb:cc:00:11:22, fe80::1:2, version 0.1.0, 12:30");
        assert_eq!(told, "(folder)/a.mcap on (host), (address), (address), (address), version 0.1.0, 12:30");
    }
}
