//! The headers against the library: each declares what the other has, and C and C++ can read them.

use std::collections::BTreeSet;
use std::path::Path;

use test_kit::sandbox::repository;

use crate::compiler::{compile, include};

/// Names of the functions that lines of `text` with `mark` declare: the last word before the arguments,
/// behind a type that may begin with `gantry_`, too.
fn functions<'a>(text: &'a str, mark: &str) -> BTreeSet<&'a str> {
    let lines = text.lines().filter(|line| line.contains(mark));
    lines
        .filter_map(|line| line.split(['(', '<']).next()?.split_whitespace().last())
        .filter(|name| name.starts_with("gantry_"))
        .collect()
}

#[test]
fn the_header_declares_the_functions_that_the_library_has() {
    let source = repository().join("consumers/consumer_c/src");
    let files = std::fs::read_dir(source).unwrap();
    let rust: String = files
        .map(|file| std::fs::read_to_string(file.unwrap().path()).unwrap())
        .collect();
    let header = std::fs::read_to_string(include().join("gantry/gantry.h")).unwrap();
    // A declaration begins its line; comments and calls are indented.
    let declarations: String = header
        .lines()
        .filter(|line| line.starts_with(|c: char| c.is_ascii_alphabetic()))
        .filter(|line| !line.starts_with("typedef") && !line.starts_with("static inline"))
        .map(|line| line.replace('*', " ") + "\n")
        .collect();
    let declared = functions(&declarations, "(");
    assert_eq!(declared, functions(&rust, "extern \"C\" fn gantry_"));
    assert!(declared.len() > 40, "{declared:?}");
}

#[test]
fn files_for_builds_name_the_version_of_the_library() {
    let lib = repository().join("consumers/consumer_c/lib");
    let version = env!("CARGO_PKG_VERSION");
    for (file, line) in [
        ("pkgconfig/gantry.pc", format!("Version: {version}\n")),
        (
            "cmake/gantry/gantry-config-version.cmake",
            format!("set(PACKAGE_VERSION \"{version}\")\n"),
        ),
    ] {
        let text = std::fs::read_to_string(lib.join(file)).unwrap();
        assert!(text.contains(&line), "{file} lacks {line}");
    }
}

#[test]
fn c_reads_the_header_and_checks_every_size_and_offset() {
    let file = Path::new(env!("CARGO_TARGET_TMPDIR")).join("header.c");
    // Strict C11, and a size that is wrong on purpose, which the compiler must find.
    let check = |wrong: bool| {
        let line = format!(
            "_Static_assert(sizeof(gantry_box2d) == {}, \"\");",
            32 + u32::from(wrong)
        );
        std::fs::write(
            &file,
            format!("#include \"gantry/gantry.h\"\n{line}\nint main(void) {{ return 0; }}\n"),
        )
        .unwrap();
        let words = [
            "-std=c11",
            "-Wall",
            "-Wextra",
            "-Wpedantic",
            "-Werror",
            "-fsyntax-only",
        ];
        compile("cc", &[&words[..], &[file.to_str().unwrap()]].concat())
    };
    assert_eq!(check(false), Ok(()));
    assert!(check(true).is_err());
}
