//! Names of projects: what is a crate or a package, a process and the first part of topics alike.

use std::path::Path;

use launch_cli::wrong_usage;

use crate::cli::Lang;

/// Longest name of a process in launch files.
const MAX_LEN: usize = 32;

/// Names that Gantry itself uses beside the project: processes of its launch file, first parts of
/// topics, crates and packages.
const OURS: [&str; 19] = [
    "consumer_kit",
    "control",
    "drive",
    "ego",
    "free",
    "gantry",
    "numpy",
    "pytest",
    "record",
    "schema_bus",
    "schema_frames",
    "schema_roads",
    "schema_types",
    "signal_hook",
    "simd",
    "test_kit",
    "view",
    "world",
    "tests",
];

/// Keywords of Rust, its own crates, and folders of its builds, which cargo refuses.
const RUST: [&str; 62] = [
    "abstract",
    "alloc",
    "as",
    "async",
    "await",
    "become",
    "box",
    "break",
    "build",
    "const",
    "continue",
    "core",
    "crate",
    "deps",
    "do",
    "dyn",
    "else",
    "enum",
    "examples",
    "extern",
    "false",
    "final",
    "fn",
    "for",
    "gen",
    "if",
    "impl",
    "in",
    "incremental",
    "let",
    "loop",
    "macro",
    "match",
    "mod",
    "move",
    "mut",
    "override",
    "priv",
    "proc_macro",
    "pub",
    "ref",
    "return",
    "self",
    "static",
    "std",
    "struct",
    "super",
    "test",
    "trait",
    "true",
    "try",
    "type",
    "typeof",
    "union",
    "unsafe",
    "unsized",
    "use",
    "virtual",
    "where",
    "while",
    "yield",
    "rustc",
];

/// Keywords of Python, and modules of its library that are imported while gantry or pytest start.
const PYTHON: [&str; 66] = [
    "and",
    "as",
    "assert",
    "async",
    "asyncio",
    "await",
    "break",
    "class",
    "code",
    "collections",
    "conftest",
    "contextlib",
    "continue",
    "copy",
    "dataclasses",
    "def",
    "del",
    "elif",
    "else",
    "enum",
    "except",
    "finally",
    "for",
    "from",
    "functools",
    "global",
    "if",
    "import",
    "in",
    "inspect",
    "io",
    "is",
    "itertools",
    "json",
    "lambda",
    "logging",
    "math",
    "nonlocal",
    "not",
    "operator",
    "or",
    "os",
    "pass",
    "pathlib",
    "pickle",
    "queue",
    "raise",
    "random",
    "re",
    "return",
    "select",
    "signal",
    "site",
    "socket",
    "statistics",
    "string",
    "struct",
    "subprocess",
    "sys",
    "test",
    "threading",
    "time",
    "try",
    "types",
    "typing",
    "while",
];

/// The project's name, the last part of `path`.
///
/// # Errors
/// What is wrong with it, and what is allowed.
pub fn checked(path: &Path, lang: Lang) -> anyhow::Result<String> {
    let name = path
        .file_name()
        .map(|name| name.to_string_lossy().into_owned())
        .unwrap_or_default();
    let rest = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '_';
    let is_made_of = name.len() <= MAX_LEN
        && name.starts_with(|c: char| c.is_ascii_lowercase())
        && name.chars().all(rest);
    if !is_made_of {
        let shown = if name.is_empty() {
            path.display().to_string()
        } else {
            name
        };
        return Err(wrong_usage(format!(
            "{shown:?} cannot be the name of a project: it must be 1 to {MAX_LEN} lower-case letters, digits or '_', a letter first"
        )));
    }
    let (language, taken): (_, &[&str]) = match lang {
        Lang::Rust => ("Rust", &RUST),
        Lang::Python => ("Python", &PYTHON),
    };
    let owner = match name.as_str() {
        name if OURS.contains(&name) => "Gantry",
        name if taken.contains(&name) => language,
        _ => return Ok(name),
    };
    Err(wrong_usage(format!(
        "{name:?} cannot be the name of a project: {owner} uses it; choose another, e.g. my_{name}"
    )))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn message(path: &str, lang: Lang) -> String {
        let refused = checked(Path::new(path), lang);
        refused.expect_err("the name cannot be").to_string()
    }

    #[test]
    fn the_last_part_of_a_path_is_the_name() {
        for path in [
            "lane_net2",
            "../lane_net2",
            "/tmp/a b/lane_net2",
            "lane_net2/",
        ] {
            assert_eq!(checked(Path::new(path), Lang::Rust).unwrap(), "lane_net2");
        }
    }

    #[test]
    fn names_that_are_no_crate_package_process_and_topic_alike_are_refused() {
        for bad in [
            "Detector", "my-net", "2fast", "_x", "é", "a b", "..", "/", "",
        ] {
            let message = message(bad, Lang::Python);
            assert!(message.contains("lower-case letters"), "{bad}: {message}");
        }
        assert!(checked(Path::new(&"a".repeat(32)), Lang::Rust).is_ok());
        assert!(message(&"a".repeat(33), Lang::Rust).contains("1 to 32"));
    }

    #[test]
    fn names_in_use_are_refused_where_they_are_in_use() {
        assert!(message("simd", Lang::Rust).contains("Gantry uses it"));
        assert!(
            message("match", Lang::Rust).contains("Rust uses it; choose another, e.g. my_match")
        );
        assert!(checked(Path::new("match"), Lang::Python).is_ok());
        assert!(message("lambda", Lang::Python).contains("Python uses it"));
        assert!(checked(Path::new("lambda"), Lang::Rust).is_ok());
    }
}
