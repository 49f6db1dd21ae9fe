//! Circles in a crate's import arrows, between files and between folders.

use std::collections::{BTreeMap, BTreeSet};

use crate::modules::CrateFiles;

/// Files that reach one another, each with the arrows that tie them; sorted.
pub fn file_circles(files: &CrateFiles) -> Vec<Vec<String>> {
    let arrows = files
        .arrows
        .keys()
        .map(|(from, to)| (from.as_str(), to.as_str()));
    circles(arrows)
}

/// Sibling modules (each with everything below it) that reach one another, by their paths; sorted.
///
/// A circle between two folders need not be one between files: `rpc/a` may use `feeds/b` and
/// `feeds/c` use `rpc/d`. A reader still cannot read one folder before the other.
pub fn folder_circles(files: &CrateFiles) -> Vec<Vec<String>> {
    let mut by_parent: BTreeMap<Vec<String>, BTreeSet<(String, String)>> = BTreeMap::new();
    for (from, to) in files.arrows.keys() {
        let (from, to) = (&files.files[from], &files.files[to]);
        let shared = from.iter().zip(to).take_while(|(a, b)| a == b).count();
        if shared < from.len() && shared < to.len() {
            by_parent
                .entry(from[..shared].to_vec())
                .or_default()
                .insert((from[..=shared].join("::"), to[..=shared].join("::")));
        }
    }
    by_parent
        .values()
        .flat_map(|arrows| circles(arrows.iter().map(|(a, b)| (a.as_str(), b.as_str()))))
        .collect()
}

/// Strongly connected groups of more than one node (Tarjan's algorithm), sorted.
fn circles<'a>(arrows: impl Iterator<Item = (&'a str, &'a str)>) -> Vec<Vec<String>> {
    let mut next: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for (from, to) in arrows {
        next.entry(from).or_default().push(to);
        next.entry(to).or_default();
    }
    let mut search = Search {
        next: &next,
        order: BTreeMap::new(),
        lowest: BTreeMap::new(),
        stack: Vec::new(),
        found: Vec::new(),
    };
    for node in next.keys() {
        if !search.order.contains_key(node) {
            search.visit(node);
        }
    }
    search.found.sort();
    search.found
}

struct Search<'a, 'b> {
    next: &'b BTreeMap<&'a str, Vec<&'a str>>,
    order: BTreeMap<&'a str, usize>,
    lowest: BTreeMap<&'a str, usize>,
    stack: Vec<&'a str>,
    found: Vec<Vec<String>>,
}

impl<'a> Search<'a, '_> {
    fn visit(&mut self, node: &'a str) {
        let number = self.order.len();
        self.order.insert(node, number);
        self.lowest.insert(node, number);
        self.stack.push(node);
        for &to in &self.next[node] {
            if !self.order.contains_key(to) {
                self.visit(to);
                self.lowest
                    .insert(node, self.lowest[node].min(self.lowest[to]));
            } else if self.stack.contains(&to) {
                self.lowest
                    .insert(node, self.lowest[node].min(self.order[to]));
            }
        }
        if self.lowest[node] == self.order[node] {
            let start = self
                .stack
                .iter()
                .position(|n| *n == node)
                .expect("it was pushed");
            let mut circle: Vec<String> = self.stack.drain(start..).map(str::to_owned).collect();
            if circle.len() > 1 {
                circle.sort();
                self.found.push(circle);
            }
        }
    }
}
