//! Arrows between the modules of one folder: who imports whom, and where they go round in circles.

use super::sources::{ModulePath, Sources};
use std::collections::{BTreeMap, BTreeSet};

/// Arrows between the children of one module, each with a file that draws it.
pub type Arrows = BTreeMap<(String, String), String>;

/// The arrows of every module of a crate that has children, by its path.
pub fn arrows(sources: &Sources) -> BTreeMap<ModulePath, Arrows> {
    let mut all: BTreeMap<ModulePath, Arrows> = BTreeMap::new();
    for (from, module) in &sources.modules {
        for name in &module.names {
            let to = sources.home(name);
            let shared = from.iter().zip(&to).take_while(|(a, b)| a == b).count();
            if let (Some(a), Some(b)) = (from.get(shared), to.get(shared)) {
                let file = module.file.display().to_string();
                all.entry(from[..shared].to_vec()).or_default().insert((a.clone(), b.clone()), file);
            }
        }
    }
    all
}

/// Groups of nodes that reach each other in both directions.
pub fn circles(arrows: &Arrows) -> Vec<BTreeSet<String>> {
    let nodes: BTreeSet<&String> = arrows.keys().flat_map(|(a, b)| [a, b]).collect();
    let reach: BTreeMap<&String, BTreeSet<&String>> =
        nodes.iter().map(|node| (*node, reachable(arrows, node))).collect();
    let mut groups: BTreeSet<BTreeSet<String>> = BTreeSet::new();
    for (node, from_here) in &reach {
        let group: BTreeSet<String> = from_here
            .iter()
            .filter(|other| *other != node && reach[*other].contains(node))
            .map(|other| (*other).clone())
            .collect();
        if !group.is_empty() {
            groups.insert(group.into_iter().chain([(*node).clone()]).collect());
        }
    }
    groups.into_iter().collect()
}

fn reachable<'a>(arrows: &'a Arrows, from: &String) -> BTreeSet<&'a String> {
    let mut found = BTreeSet::new();
    let mut next = vec![from];
    while let Some(node) = next.pop() {
        for ((_, to), _) in arrows.iter().filter(|((a, _), _)| a == node) {
            if found.insert(to) {
                next.push(to);
            }
        }
    }
    found
}

/// Arrows that do not point to somebody earlier in `order`, in words; a module that has no place in it too.
pub fn against(order: &[&str], arrows: &Arrows) -> Vec<String> {
    let place = |name: &str| order.iter().position(|other| *other == name);
    let mut wrong = Vec::new();
    for ((from, to), file) in arrows {
        match (place(from), place(to)) {
            (Some(a), Some(b)) if b < a => {}
            (Some(_), Some(_)) => wrong.push(format!("{file}: {from} -> {to} points up")),
            (None, _) => wrong.push(format!("{file}: {from} has no place in the order")),
            (_, None) => wrong.push(format!("{file}: {to} has no place in the order")),
        }
    }
    wrong
}
