//! The files of a new project, which `templates/` holds with `{{…}}` for what differs.

use std::path::PathBuf;

use anyhow::Context as _;
use launch_cli::files::MAX_SETTINGS_BYTES;

use super::origin::Origin;
use crate::cli::Lang;
use crate::programs;

/// Launch file of all languages.
const LAUNCH: &str = include_str!("../../templates/launch.toml");
/// JSON schema of launch files, for editors.
const SCHEMA: &str = include_str!("../../../launch.schema.json");

const RUST: [(&str, &str); 6] = [
    (
        "Cargo.toml",
        include_str!("../../templates/rust/Cargo.toml.in"),
    ),
    (
        "README.md",
        include_str!("../../templates/rust/README.md.in"),
    ),
    (
        ".gitignore",
        include_str!("../../templates/rust/gitignore.in"),
    ),
    (
        "src/main.rs",
        include_str!("../../templates/rust/src/main.rs"),
    ),
    (
        "src/detect.rs",
        include_str!("../../templates/rust/src/detect.rs"),
    ),
    (
        "tests/simulator.rs",
        include_str!("../../templates/rust/tests/simulator.rs"),
    ),
];

const PYTHON: [(&str, &str); 9] = [
    (
        "pyproject.toml",
        include_str!("../../templates/python/pyproject.toml"),
    ),
    (
        "README.md",
        include_str!("../../templates/python/README.md.in"),
    ),
    (
        ".gitignore",
        include_str!("../../templates/python/gitignore.in"),
    ),
    (
        "conftest.py",
        include_str!("../../templates/python/conftest.py"),
    ),
    (
        "{{name}}/__init__.py",
        include_str!("../../templates/python/package/__init__.py"),
    ),
    (
        "{{name}}/__main__.py",
        include_str!("../../templates/python/package/__main__.py"),
    ),
    (
        "{{name}}/detect.py",
        include_str!("../../templates/python/package/detect.py"),
    ),
    (
        "tests/test_detect.py",
        include_str!("../../templates/python/tests/test_detect.py"),
    ),
    (
        "tests/test_simulator.py",
        include_str!("../../templates/python/tests/test_simulator.py"),
    ),
];

const CPP: [(&str, &str); 7] = [
    (
        "CMakeLists.txt",
        include_str!("../../templates/cpp/CMakeLists.txt.in"),
    ),
    (
        "README.md",
        include_str!("../../templates/cpp/README.md.in"),
    ),
    (
        ".gitignore",
        include_str!("../../templates/cpp/gitignore.in"),
    ),
    (
        "src/main.cpp",
        include_str!("../../templates/cpp/src/main.cpp"),
    ),
    (
        "src/detect.hpp",
        include_str!("../../templates/cpp/src/detect.hpp"),
    ),
    (
        "tests/detect_test.cpp",
        include_str!("../../templates/cpp/tests/detect_test.cpp"),
    ),
    (
        "tests/simulator_test.cpp",
        include_str!("../../templates/cpp/tests/simulator_test.cpp"),
    ),
];

/// The files of the project `name` with their texts; paths are relative to its folder.
///
/// # Errors
/// If the checkout's lock file cannot be read.
pub fn files(name: &str, lang: Lang, origin: &Origin) -> anyhow::Result<Vec<(PathBuf, String)>> {
    let (templates, cmd): (&[_], _) = match lang {
        // Cargo builds it if need be, and becomes the program.
        Lang::Rust => (
            &RUST,
            r#"["cargo", "run", "--release", "--quiet"]"#.to_owned(),
        ),
        Lang::Python => (&PYTHON, format!("[\"python\", \"-m\", \"{name}\"]")),
        Lang::Cpp => (&CPP, format!("[\"build/{name}\"]")),
    };
    let programs = programs::own_folder().context("cannot tell where this program is")?;
    let shown =
        |folder: Option<PathBuf>| folder.map_or_else(String::new, |it| it.display().to_string());
    let values = [
        ("{{name}}", name.to_owned()),
        ("{{cmd}}", cmd),
        ("{{origin}}", origin.to_string()),
        (
            "{{consumer_kit}}",
            origin.crate_dependency("consumers/consumer_kit"),
        ),
        ("{{test_kit}}", origin.crate_dependency("tests/test_kit")),
        ("{{gantry}}", origin.python_requirement()),
        ("{{install_note}}", origin.install_note().to_owned()),
        ("{{prefix}}", shown(origin.prefix())),
        ("{{programs}}", programs.display().to_string()),
    ];
    let filled = |text: &str| {
        values.iter().fold(text.to_owned(), |text, (key, value)| {
            text.replace(key, value)
        })
    };
    let mut files = vec![
        (PathBuf::from("launch.toml"), filled(LAUNCH)),
        ("launch.schema.json".into(), SCHEMA.to_owned()),
    ];
    for (path, text) in templates {
        files.push((filled(path).into(), filled(text)));
    }
    if let (Lang::Rust, Some(checkout)) = (lang, origin.checkout()) {
        // The versions that Gantry was tested with; cargo drops what the project does not need.
        let lock = checkout.join("Cargo.lock");
        let text = launch_cli::files::read_text(&lock, MAX_SETTINGS_BYTES)
            .with_context(|| format!("cannot read {}", lock.display()))?;
        files.push(("Cargo.lock".into(), text));
    }
    Ok(files)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn nothing_is_left_to_fill_in_and_all_toml_can_be_read() {
        let origins = [
            Origin::Checkout(concat!(env!("CARGO_MANIFEST_DIR"), "/../..").into()),
            Origin::Git {
                url: "https://example.org/gantry".into(),
                rev: Some("abc".into()),
            },
            Origin::Installed("/opt/gantry".into()),
        ];
        for (lang, origin) in [Lang::Rust, Lang::Python, Lang::Cpp]
            .iter()
            .flat_map(|lang| origins.iter().map(move |origin| (*lang, origin)))
        {
            let files = files("my_net", lang, origin).unwrap();
            for (path, text) in &files {
                let name = path.to_str().unwrap();
                assert!(
                    !text.contains("{{") || name == "launch.schema.json",
                    "{name}:\n{text}"
                );
                assert!(!name.contains("{{"), "{name}");
                if name.ends_with(".toml") {
                    text.parse::<toml::Table>()
                        .unwrap_or_else(|error| panic!("{name}: {error}"));
                }
                if name == "launch.toml" {
                    launch_spec::Launch::parse(text, name)
                        .unwrap_or_else(|errors| panic!("{errors}"));
                    assert!(text.starts_with("#:schema ./launch.schema.json\n"));
                }
            }
            let has_lock = files.iter().any(|(path, _)| path.ends_with("Cargo.lock"));
            assert_eq!(has_lock, lang == Lang::Rust && origin.checkout().is_some());
        }
    }
}
