//! `gantry new` as a process: what it makes, and what it refuses. `tests/test_e2e` builds and runs
//! what it makes.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};

fn new(folder: &Path, words: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_gantry"))
        .args(["new", "consumer"])
        .args(words)
        .current_dir(folder)
        .output()
        .unwrap()
}

fn refusal(folder: &Path, code: i32, words: &[&str]) -> String {
    let output = new(folder, words);
    assert_eq!(output.status.code(), Some(code), "{words:?}: {output:?}");
    assert!(output.stdout.is_empty(), "{output:?}");
    String::from_utf8(output.stderr).unwrap()
}

/// Files below a folder, relative to it, sorted.
fn files(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    let mut open = vec![folder.to_path_buf()];
    while let Some(at) = open.pop() {
        for entry in at.read_dir().unwrap() {
            let path = entry.unwrap().path();
            match path.is_dir() {
                true => open.push(path),
                false => found.push(path.strip_prefix(folder).unwrap().to_path_buf()),
            }
        }
    }
    found.sort();
    found
}

fn repository() -> PathBuf {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/../.."));
    root.canonicalize().unwrap()
}

#[test]
fn a_rust_project_depends_on_the_checkout_and_has_its_versions() {
    let folder = tempfile::tempdir().unwrap();
    let output = new(folder.path(), &["my_net", "--lang", "rust"]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let said = String::from_utf8(output.stdout).unwrap();
    for word in [
        "made my_net (Rust)",
        "cd my_net",
        "cargo test",
        "up launch.toml",
    ] {
        assert!(said.contains(word), "{said}");
    }
    let project = folder.path().join("my_net");
    let wanted = [
        ".gitignore",
        "Cargo.lock",
        "Cargo.toml",
        "README.md",
        "launch.schema.json",
        "launch.toml",
        "src/detect.rs",
        "src/main.rs",
        "tests/simulator.rs",
    ];
    assert_eq!(files(&project), wanted.map(PathBuf::from));
    let read = |name: &str| std::fs::read_to_string(project.join(name)).unwrap();
    let manifest: toml::Table = read("Cargo.toml").parse().unwrap();
    let path =
        |table: &str, name: &str| PathBuf::from(manifest[table][name]["path"].as_str().unwrap());
    assert_eq!(
        path("dependencies", "consumer_kit"),
        repository().join("consumers/consumer_kit")
    );
    assert_eq!(
        path("dev-dependencies", "test_kit"),
        repository().join("tests/test_kit")
    );
    let of_gantry = |name: &str| std::fs::read_to_string(repository().join(name)).unwrap();
    assert_eq!(read("Cargo.lock"), of_gantry("Cargo.lock"));
    assert_eq!(
        read("launch.schema.json"),
        of_gantry("launch/launch.schema.json")
    );
}

#[test]
fn a_python_project_requires_the_package_of_the_checkout_or_of_a_repository() {
    let folder = tempfile::tempdir().unwrap();
    let requirement = |name: &str, words: &[&str]| {
        let words = [&[name, "--lang", "python"], words].concat();
        let output = new(folder.path(), &words);
        assert_eq!(output.status.code(), Some(0), "{output:?}");
        let text =
            std::fs::read_to_string(folder.path().join(name).join("pyproject.toml")).unwrap();
        let project: toml::Table = text.parse().unwrap();
        project["project"]["dependencies"][0]
            .as_str()
            .unwrap()
            .to_owned()
    };
    let found = requirement("net_a", &[]);
    let package = repository().join("consumers/consumer_python");
    assert_eq!(found, format!("gantry-sim @ file://{}", package.display()));
    let git = ["--git", "https://git.example.org/gantry.git", "--rev", "v1"];
    assert_eq!(
        requirement("net_b", &git),
        "gantry-sim @ git+https://git.example.org/gantry.git@v1#subdirectory=consumers/consumer_python"
    );
    let names = files(&folder.path().join("net_a"));
    for name in [
        "net_a/__main__.py",
        "net_a/detect.py",
        "tests/test_simulator.py",
        "conftest.py",
    ] {
        assert!(names.contains(&PathBuf::from(name)), "{names:?}");
    }
}

#[test]
fn a_project_in_cpp_finds_headers_and_library_of_the_checkout() {
    let folder = tempfile::tempdir().unwrap();
    let output = new(folder.path(), &["my_net", "--lang", "cpp"]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let said = String::from_utf8(output.stdout).unwrap();
    for word in [
        "made my_net (C++)",
        "cmake --build build",
        "ctest",
        "up launch.toml",
    ] {
        assert!(said.contains(word), "{said}");
    }
    let project = folder.path().join("my_net");
    let wanted = [
        ".gitignore",
        "CMakeLists.txt",
        "README.md",
        "launch.schema.json",
        "launch.toml",
        "src/detect.hpp",
        "src/main.cpp",
        "tests/detect_test.cpp",
        "tests/simulator_test.cpp",
    ];
    assert_eq!(files(&project), wanted.map(PathBuf::from));
    let lists = std::fs::read_to_string(project.join("CMakeLists.txt")).unwrap();
    let prefix = repository().join("consumers/consumer_c");
    assert!(prefix.join("include/gantry/gantry.hpp").is_file());
    assert!(
        lists.contains(&format!(
            "set(GANTRY_PREFIX [=[{}]=] CACHE",
            prefix.display()
        )),
        "{lists}"
    );
}

#[test]
fn names_and_places_that_cannot_be_are_refused_in_one_sentence() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let python = |name| [name, "--lang", "python"];
    for (name, reason) in [
        ("My-Net", "lower-case letters, digits or '_'"),
        ("lambda", "Python uses it"),
        ("simd", "Gantry uses it"),
    ] {
        let message = refusal(at, 2, &python(name));
        assert!(
            message.contains(name) && message.contains(reason),
            "{message}"
        );
    }
    std::fs::create_dir(at.join("used")).unwrap();
    std::fs::write(at.join("used/notes"), "mine").unwrap();
    assert!(refusal(at, 1, &python("used")).contains("exists and is not empty"));
    assert!(refusal(at, 1, &python("used/notes")).contains("is a file"));
    std::fs::create_dir(at.join("empty")).unwrap();
    assert_eq!(new(at, &python("empty")).status.code(), Some(0));

    let inside = repository().join("my_net");
    let message = refusal(at, 1, &python(inside.to_str().unwrap()));
    assert!(
        message.contains("Gantry's own checkout") && message.contains("../my_net"),
        "{message}"
    );
    assert!(!inside.exists());

    let message = refusal(at, 1, &["net", "--lang", "rust", "--checkout", "empty"]);
    assert!(message.contains("--checkout is empty"), "{message}");
    assert!(refusal(at, 2, &["net"]).contains("--lang"));
    assert!(refusal(at, 2, &["net", "--lang", "cobol"]).contains("rust, python, cpp"));
    let git = [
        "net",
        "--lang",
        "cpp",
        "--git",
        "https://git.example.org/gantry.git",
    ];
    assert!(refusal(at, 2, &git).contains("a project in C++ is linked with the library"));
    assert!(refusal(at, 2, &["union", "--lang", "cpp"]).contains("C++ uses it"));
    assert!(refusal(at, 2, &["net", "--lang", "rust", "--rev", "v1"]).contains("--git"));
    assert_eq!(
        files(at)
            .iter()
            .filter(|path| path.starts_with("net"))
            .count(),
        0
    );
}
