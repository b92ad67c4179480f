//! The page of states and health bits.

use plumbline_estimator::HealthBits;
use plumbline_test_support::workspace;

/// Bits that a row such as `| 7, 8 | left, right image missing |` explains, with the last word of their names.
fn explained(row: &str) -> Option<(Vec<u32>, &str)> {
    let mut cells = row.strip_prefix("| ")?.split(" | ");
    let bits: Result<Vec<u32>, _> = cells.next()?.split(", ").map(str::parse).collect();
    Some((bits.ok()?, cells.next()?))
}

#[test]
fn every_health_bit_is_explained_under_its_name() {
    let page = std::fs::read_to_string(workspace().join("docs/health.md")).unwrap();
    let rows: Vec<_> = page.lines().filter_map(explained).collect();
    for (bit, name) in HealthBits::NAMES {
        let number = bit.0.trailing_zeros();
        let (_, words) = rows.iter().find(|(bits, _)| bits.contains(&number)).expect(name);
        for word in name.split(' ') {
            assert!(words.contains(word), "bit {number} is '{name}', and the page calls it '{words}'");
        }
    }
    let count: usize = rows.iter().map(|(bits, _)| bits.len()).sum();
    assert_eq!(count, HealthBits::NAMES.len());
}
