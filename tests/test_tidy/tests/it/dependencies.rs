//! Outside crates keep to `deny.toml`: their licences and where they come from. cargo-deny reads the
//! same file and knows more; this holds where it is not installed, in a second.

use std::collections::{BTreeMap, BTreeSet};
use std::process::Command;

use test_tidy::repository;

/// Most crates of which there are two versions or more: each is built twice.
const MAX_DOUBLE: usize = 60;

/// Most outside packages that `Cargo.lock` names. A sixth of them are for other systems or for benches
/// of others, and never built here.
const MAX_LOCKED: usize = 800;

fn deny() -> toml::Table {
    let text = std::fs::read_to_string(repository().join("deny.toml")).expect("deny.toml");
    text.parse().expect("deny.toml is TOML")
}

fn words(table: &toml::Value) -> BTreeSet<String> {
    let words = table.as_array().expect("a list of texts").iter();
    words
        .map(|word| word.as_str().expect("a text").to_owned())
        .collect()
}

/// Packages for Linux, by `cargo metadata` and without the network.
fn packages() -> Vec<serde_json::Value> {
    let cargo = std::env::var("CARGO").unwrap_or("cargo".into());
    let made = Command::new(cargo)
        .args(["metadata", "--format-version", "1", "--locked", "--offline"])
        .args(["--filter-platform", "x86_64-unknown-linux-gnu"])
        .current_dir(repository())
        .output()
        .expect("cargo can be run");
    assert!(
        made.status.success(),
        "{}",
        String::from_utf8_lossy(&made.stderr)
    );
    let mut all: serde_json::Value = serde_json::from_slice(&made.stdout).expect("JSON");
    let serde_json::Value::Array(packages) = all["packages"].take() else {
        panic!("cargo metadata lists packages")
    };
    packages
}

/// Whether an SPDX expression can be met by allowed licences; `/` is the old way to write OR.
fn is_allowed(expression: &str, allowed: &BTreeSet<String>) -> bool {
    let spaced = expression.replace('/', " OR ");
    let spaced = spaced.replace('(', " ( ").replace(')', " ) ");
    let words: Vec<&str> = spaced.split_whitespace().collect();
    let mut at = 0;
    let found = any_of(&words, &mut at, allowed);
    found && at == words.len()
}

fn any_of(words: &[&str], at: &mut usize, allowed: &BTreeSet<String>) -> bool {
    let mut found = all_of(words, at, allowed);
    while words.get(*at) == Some(&"OR") {
        *at += 1;
        found |= all_of(words, at, allowed);
    }
    found
}

fn all_of(words: &[&str], at: &mut usize, allowed: &BTreeSet<String>) -> bool {
    let mut found = one(words, at, allowed);
    while words.get(*at) == Some(&"AND") {
        *at += 1;
        found &= one(words, at, allowed);
    }
    found
}

fn one(words: &[&str], at: &mut usize, allowed: &BTreeSet<String>) -> bool {
    let Some(word) = words.get(*at) else {
        return false;
    };
    *at += 1;
    if *word == "(" {
        let found = any_of(words, at, allowed);
        *at += 1;
        return found;
    }
    let mut licence = (*word).to_owned();
    if words.get(*at) == Some(&"WITH") {
        licence += &format!(" WITH {}", words[*at + 1]);
        *at += 2;
    }
    allowed.contains(&licence)
}

#[test]
fn outside_crates_have_allowed_licences_and_sources() {
    let deny = deny();
    let licences = words(&deny["licenses"]["allow"]);
    let registries = words(&deny["sources"]["allow-registry"]);
    let mut wrong = Vec::new();
    for package in packages() {
        let text = |key: &str| package[key].as_str().unwrap_or_default().to_owned();
        let source = text("source");
        if source.is_empty() {
            continue;
        }
        let name = format!("{} {}", text("name"), text("version"));
        let registry = source.strip_prefix("registry+").unwrap_or_default();
        if !registries.contains(registry) {
            wrong.push(format!("{name} comes from {source}"));
        }
        if !is_allowed(&text("license"), &licences) {
            wrong.push(format!("{name} has the licence {:?}", text("license")));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn few_crates_are_built_in_two_versions() {
    let mut versions: BTreeMap<String, BTreeSet<String>> = BTreeMap::new();
    for package in packages() {
        let text = |key: &str| package[key].as_str().unwrap_or_default().to_owned();
        versions
            .entry(text("name"))
            .or_default()
            .insert(text("version"));
    }
    let double: Vec<_> = versions.iter().filter(|(_, all)| all.len() > 1).collect();
    assert!(
        double.len() <= MAX_DOUBLE,
        "{} crates: {double:?}",
        double.len()
    );
}

#[test]
fn few_outside_packages_are_locked() {
    let text = std::fs::read_to_string(repository().join("Cargo.lock")).expect("Cargo.lock");
    let lock: toml::Table = text.parse().expect("Cargo.lock is TOML");
    let all = lock["package"].as_array().expect("a list of packages");
    let n_outside = all.iter().filter(|one| one.get("source").is_some()).count();
    assert!(n_outside > 0, "none is found");
    assert!(n_outside <= MAX_LOCKED, "{n_outside} are locked");
}

#[test]
fn expressions_of_licences_are_understood() {
    let allowed: BTreeSet<String> = ["MIT", "Apache-2.0 WITH LLVM-exception", "ISC"]
        .map(str::to_owned)
        .into();
    for met in [
        "MIT",
        "GPL-3.0 OR MIT",
        "MIT/GPL-3.0",
        "(MIT OR GPL-3.0) AND ISC",
        "Apache-2.0 WITH LLVM-exception OR GPL-3.0",
    ] {
        assert!(is_allowed(met, &allowed), "{met}");
    }
    for unmet in ["", "GPL-3.0", "MIT AND GPL-3.0", "Apache-2.0", "(MIT) GPL"] {
        assert!(!is_allowed(unmet, &allowed), "{unmet}");
    }
}
