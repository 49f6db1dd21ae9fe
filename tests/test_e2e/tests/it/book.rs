//! The book, `docs/`, and the projects in `examples/`: every command of Start and Tutorials and of the
//! examples' pages runs, in order, in an empty home; reference pages are what programs and sources
//! say; programs' help, completions and man pages are those that were reviewed, and what help texts
//! and the pages of How-to show is understood by the programs.
//! `GANTRY_BLESS=1` writes generated pages and golden help texts anew.

use std::path::{Path, PathBuf};
use std::time::Duration;

use test_e2e::{assert_nothing_left, python_package, venv_program};
use test_kit::Sandbox;
use test_kit::sandbox::{binary_path, repository};

mod examples;
mod help;

/// Far beyond what a page takes on any machine; each of its commands has a limit of its own.
const LIMIT: Duration = Duration::from_secs(1500);
/// Most blocks of all pages together that are not run, each with its reason.
const MAX_NOT_RUN: usize = 4;

fn text(path: &Path) -> &str {
    path.to_str().expect("paths are UTF-8")
}

/// Runs a page in an empty home, in which `beside` lies; returns how many blocks were not run.
fn run_page(page: &Path, beside: Option<&Path>) -> usize {
    let name = page
        .file_stem()
        .expect("a page has a name")
        .to_string_lossy();
    let sandbox = Sandbox::new(&format!("book-{name}"));
    let bin = binary_path("gantry");
    let python = venv_program("python");
    let folders = [bin.parent(), python.parent()].map(|it| text(it.expect("a folder")));
    let path = format!("{}:{}:/usr/bin:/bin", folders[0], folders[1]);
    let home = sandbox.path("home");
    std::fs::create_dir(&home).expect("an empty home");
    let package = python_package();
    let env = [
        ("HOME", text(&home)),
        ("PATH", path.as_str()),
        ("PYTHONPATH", text(&package)),
        ("GANTRY_DOMAIN", sandbox.domain()),
        ("XDG_DATA_HOME", ""),
        ("DISPLAY", ""),
        ("WAYLAND_DISPLAY", ""),
    ];
    let script = repository().join("tests/test_e2e/python/book.py");
    let mut words = vec![text(&script), text(page), text(&home)];
    words.extend(beside.map(text));
    let ended = sandbox
        .spawn_program("book", &python, &words, &env)
        .wait_longer(LIMIT)
        .expect_code(0);
    assert_nothing_left(&sandbox);
    let last = ended.lines.last().expect("a last line");
    println!("{name}: {}", ended.lines.join("\n  "));
    let words: Vec<&str> = last.split(' ').collect();
    let [n_run, n_left_out] = [words[0], words[words.len() - 4]].map(|it| it.parse::<usize>());
    assert!(n_run.expect("a number") > 0, "{name} has no command");
    n_left_out.expect("a number")
}

fn pages_of(folder: &str) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(repository().join(folder)).expect("a folder of pages");
    let mut pages: Vec<PathBuf> = entries
        .map(|entry| entry.expect("readable").path())
        .filter(|path| path.extension().is_some_and(|it| it == "md"))
        .collect();
    pages.sort();
    pages
}

fn run_pages(folder: &str) {
    let pages = pages_of(folder);
    assert!(pages.len() >= 3, "{pages:?}");
    let n_left_out: usize = pages.iter().map(|page| run_page(page, None)).sum();
    assert!(n_left_out <= MAX_NOT_RUN, "{n_left_out} blocks are not run");
}

#[test]
fn commands_of_start_run() {
    run_pages("docs/start");
}

#[test]
fn commands_of_the_tutorials_run() {
    run_pages("docs/tutorials");
}

#[test]
fn examples_run_as_their_pages_say() {
    let entries = std::fs::read_dir(repository().join("examples")).expect("the folder");
    let mut projects: Vec<PathBuf> = entries
        .map(|entry| entry.expect("readable").path())
        .filter(|path| path.is_dir())
        .collect();
    projects.sort();
    assert!(projects.len() >= 5, "{projects:?}");
    for project in projects {
        let left_out = run_page(&project.join("README.md"), Some(&project));
        assert_eq!(left_out, 0, "{}", project.display());
    }
}

/// Every page is in the table of contents, once, and nothing else is.
#[test]
fn the_table_of_contents_is_complete() {
    let docs = repository().join("docs");
    let contents = std::fs::read_to_string(docs.join("SUMMARY.md")).expect("the contents");
    let mut listed: Vec<String> = contents
        .split("](")
        .skip(1)
        .map(|rest| rest.split(')').next().unwrap_or_default().to_owned())
        .collect();
    let mut there = Vec::new();
    let mut folders = vec![docs.clone()];
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(&folder).expect("readable") {
            let path = entry.expect("readable").path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|it| it == "md") {
                let name = path.strip_prefix(&docs).expect("below docs");
                there.push(text(name).to_owned());
            }
        }
    }
    // Pages of measurements are listed by the one that leads to them.
    there.retain(|page| {
        page != "SUMMARY.md" && (!page.starts_with("benchmarks/") || page.ends_with("README.md"))
    });
    listed.sort();
    there.sort();
    assert_eq!(listed, there);
}

/// Compares a page with what a script makes of its source, or writes it.
fn check_generated(page: &str, script: &str, source: &Path) {
    let sandbox = Sandbox::new("book-page");
    let script = repository().join("tests/test_e2e/python").join(script);
    // From the root, if it is no path of its own.
    let source = repository().join(source);
    let ended = sandbox
        .spawn_program(
            "page",
            &venv_program("python"),
            &[text(&script), text(&source)],
            &[],
        )
        .wait()
        .expect_code(0);
    let made = ended.lines.join("\n") + "\n";
    assert!(made.lines().count() > 200, "{made}");
    let path = repository().join(page);
    if std::env::var_os("GANTRY_BLESS").is_some() {
        std::fs::write(&path, made).expect("the page can be written");
        return;
    }
    let there = std::fs::read_to_string(&path).unwrap_or_default();
    let differs = there.lines().zip(made.lines()).position(|(a, b)| a != b);
    assert!(
        there == made,
        "{page} is not what {} says (from line {:?} on); ./gantry bless writes it anew",
        source.display(),
        differs.map(|line| line + 1)
    );
}

#[test]
fn the_page_of_launch_keys_is_what_the_schema_says() {
    let source = "launch/launch.schema.json";
    check_generated(
        "docs/reference/launch-keys.md",
        "book_launch_keys.py",
        Path::new(source),
    );
}

#[test]
fn the_page_of_the_python_package_is_what_its_docstrings_say() {
    let source = "consumers/consumer_python/python/gantry";
    check_generated(
        "docs/reference/python.md",
        "book_python_api.py",
        Path::new(source),
    );
}
