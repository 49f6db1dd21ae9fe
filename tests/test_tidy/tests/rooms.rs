//! No import inside a crate points up or round in a circle.

use test_tidy::circles::{file_circles, folder_circles};
use test_tidy::modules::{CrateFiles, read_crate};
use test_tidy::{files, relative, repository};

fn crates() -> Vec<CrateFiles> {
    files(&["toml"])
        .iter()
        .filter(|path| path.file_name().is_some_and(|n| n == "Cargo.toml"))
        .filter(|path| path.parent() != Some(repository().as_path()))
        .flat_map(|manifest| {
            let src = manifest
                .parent()
                .expect("a manifest lies in a folder")
                .join("src");
            [src.join("lib.rs"), src.join("main.rs")]
        })
        .filter(|root| root.exists())
        .map(|root| read_crate(&root, &relative))
        .collect()
}

/// The circle's files and, for each arrow inside it, some of the names that make it.
fn describe(of: &CrateFiles, circle: &[String]) -> String {
    let mut text = format!("{}: {} files in a circle\n", of.root, circle.len());
    for ((from, to), names) in &of.arrows {
        if circle.contains(from) && circle.contains(to) {
            let names: Vec<&str> = names.iter().take(6).map(String::as_str).collect();
            let why = if names.is_empty() {
                "mod".to_owned()
            } else {
                names.join(", ")
            };
            text += &format!("  {from} -> {to}: {why}\n");
        }
    }
    text
}

#[test]
fn no_file_imports_from_above_or_in_a_circle() {
    let wrong: Vec<String> = crates()
        .iter()
        .flat_map(|of| {
            file_circles(of)
                .into_iter()
                .map(|circle| describe(of, &circle))
        })
        .collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn no_folder_imports_in_a_circle() {
    let mut wrong = Vec::new();
    for of in crates() {
        for circle in folder_circles(&of) {
            wrong.push(format!(
                "{}: {} modules in a circle: {}",
                of.root,
                circle.len(),
                circle.join(", ")
            ));
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
