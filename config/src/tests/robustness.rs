//! A small fuzzer: arbitrary bytes, and good files with bytes changed, never make a parser panic.

use super::import_euroc::{CAM0, IMU0};
use super::import_kalibr::{EQUIDISTANT, IMU, RADTAN};
use super::{euroc_texts, kalibr_texts};
use crate::{Config, preset_text};
use proptest::prelude::*;

fn parse_all(text: &str) {
    let _ = Config::from_toml_str(text, "fuzz");
    let _ = euroc_texts(text, IMU0);
    let _ = euroc_texts(CAM0, text);
    let _ = kalibr_texts(text, IMU);
    let _ = kalibr_texts(RADTAN, text);
}

/// `text` with some bytes overwritten and cut out.
fn damaged(text: &str, edits: &[(usize, u8, usize)]) -> String {
    let mut bytes = text.as_bytes().to_vec();
    for (at, byte, cut) in edits {
        let at = at % bytes.len().max(1);
        if let Some(place) = bytes.get_mut(at) {
            *place = *byte;
        }
        bytes.drain(at..(at + cut).min(bytes.len()));
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(400))]

    #[test]
    fn arbitrary_bytes(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        parse_all(&String::from_utf8_lossy(&bytes));
    }

    #[test]
    fn arbitrary_structure(text in r#"([a-z\[\]{}:=,.#%&*!|>"'\n 0-9-]|camera|imu|cam0|T_BS|data|- |\[\[){0,120}"#) {
        parse_all(&text);
    }

    #[test]
    fn damaged_files(edits in prop::collection::vec((any::<usize>(), any::<u8>(), 0usize..12), 1..6)) {
        for text in [&*preset_text("euroc").expect("exists"), CAM0, IMU0, RADTAN, EQUIDISTANT, IMU] {
            parse_all(&damaged(text, &edits));
        }
    }
}

#[test]
fn deep_nesting_and_alias_bombs_are_refused() {
    parse_all(&"[".repeat(100_000));
    parse_all(&format!("a = {}", "[".repeat(100_000)));
    parse_all(&format!("a = {}{}", "[".repeat(50_000), "]".repeat(50_000)));
    parse_all(&(0..50_000).map(|_| "- ").collect::<String>());
    parse_all(&format!("{}:", "a.".repeat(100_000)));
    parse_all(&format!("{}a = 1", "a.".repeat(100_000)));
    let bomb = (1..30).fold("a0: &a0 [x, x]\n".to_owned(), |text, i| {
        format!("{text}a{i}: &a{i} [{}]\n", vec![format!("*a{}", i - 1); 9].join(", "))
    });
    parse_all(&bomb);
}
