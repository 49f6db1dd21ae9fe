//! No import inside a crate points up or round in a circle.

use std::collections::BTreeMap;
use std::path::PathBuf;

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

/// The reader and the search find what they are there for, in a crate made of these files.
fn circles_of(sources: &[(&str, &str)]) -> (Vec<Vec<String>>, Vec<Vec<String>>) {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (name, text) in sources {
        let path = folder.path().join(name);
        std::fs::create_dir_all(path.parent().expect("files lie in a folder")).expect("folder");
        std::fs::write(path, text).expect("file");
    }
    let name = |path: &std::path::Path| {
        let inside = path.strip_prefix(folder.path()).expect("inside");
        inside.display().to_string()
    };
    let of = read_crate(&folder.path().join("lib.rs"), &name);
    (file_circles(&of), folder_circles(&of))
}

#[test]
fn circles_between_files_are_found_through_re_exports_paths_and_macros() {
    let lib = "mod a;\nmod b;\nmod c;\npub use a::A;\npub use b::B;\npub use c::C;";
    let found = |a: &str, b: &str| {
        let c = "pub struct C;";
        circles_of(&[("lib.rs", lib), ("a.rs", a), ("b.rs", b), ("c.rs", c)]).0
    };
    let circle = vec![vec!["a.rs".to_owned(), "b.rs".to_owned()]];
    let (by_use, by_export) = (
        "use crate::b::B; pub struct A(B);",
        "pub struct B(crate::A);",
    );
    assert_eq!(found(by_use, by_export), circle);
    let in_macro = "pub struct B; fn f() { println!(\"{:?}\", crate::a::A::new()); }";
    assert_eq!(found(by_use, in_macro), circle);
    assert!(found(by_use, "use crate::C; pub struct B(C);").is_empty());
    let in_tests = "pub struct B; #[cfg(test)] mod tests { use crate::A; }";
    assert!(found(by_use, in_tests).is_empty(), "unit tests look at all");
}

#[test]
fn an_import_from_the_declaring_file_is_a_circle() {
    let lib = ("lib.rs", "mod a;");
    let a = ("a.rs", "mod part;\npub struct A;");
    let (circles, _) = circles_of(&[lib, a, ("a/part.rs", "use super::A;")]);
    assert_eq!(circles, [["a.rs", "a/part.rs"]]);
    let (circles, _) = circles_of(&[lib, a, ("a/part.rs", "pub struct Part;")]);
    assert!(circles.is_empty());
}

#[test]
fn circles_between_folders_are_found_where_files_have_none() {
    let sources = [
        ("lib.rs", "mod x;\nmod y;"),
        ("x.rs", "pub mod top;\npub mod low;"),
        ("x/top.rs", "use crate::y::low::Low;"),
        ("x/low.rs", "pub struct Low;"),
        ("y.rs", "pub mod top;\npub mod low;"),
        ("y/top.rs", "use crate::x::low::Low;"),
        ("y/low.rs", "pub struct Low;"),
    ];
    let (files, folders) = circles_of(&sources);
    assert!(files.is_empty(), "{files:?}");
    assert_eq!(folders, [["x", "y"]]);
}

/// Crates of many ideas, of which a reader takes one room at a time.
const ROOMY: [&str; 3] = [
    "schemas/schema_bus/src",
    "simd/simd/src",
    "consumers/consumer_perception/src",
];
/// Most source files on one level of them.
const MAX_FILES: usize = 15;

#[test]
fn no_room_has_more_files_than_a_reader_keeps_in_mind() {
    let mut rooms: BTreeMap<PathBuf, usize> = BTreeMap::new();
    for file in files(&["rs"]) {
        let room = file.parent().expect("a file lies in a folder").to_owned();
        if ROOMY
            .iter()
            .any(|of| room.starts_with(repository().join(of)))
        {
            *rooms.entry(room).or_default() += 1;
        }
    }
    assert!(rooms.len() > 2 * ROOMY.len(), "{} rooms", rooms.len());
    let wrong: Vec<String> = rooms
        .iter()
        .filter(|(_, n)| **n > MAX_FILES)
        .map(|(room, n)| format!("{}: {n} files", relative(room)))
        .collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// A reader that sees nothing would find no circles.
#[test]
fn arrows_of_this_workspace_are_seen() {
    let all = crates();
    assert!(all.len() >= 26, "{} crates", all.len());
    for of in all.iter().filter(|of| of.files.len() > 7) {
        let named = of.arrows.values().filter(|names| !names.is_empty()).count();
        assert!(named >= of.files.len() / 2, "{}: {named} arrows", of.root);
    }
}
