//! Rules for the Markdown pages: what they name exists, and their lines can be read.

use std::collections::{BTreeMap, BTreeSet};

use test_tidy::{files, relative, repository};

/// Longest line of a page in characters; tables and code blocks are exempt.
const MAX_LINE_CHARS: usize = 400;
/// `docs/reference/glossary.md` stays short enough to be read at once.
const MAX_GLOSSARY_WORDS: usize = 70;

fn page(name: &str) -> String {
    std::fs::read_to_string(repository().join(name))
        .unwrap_or_else(|error| panic!("{name}: {error}"))
}

/// Lines of prose with their numbers, without tables and code blocks.
fn prose(text: &str) -> Vec<(usize, &str)> {
    let mut in_code = false;
    let mut found = Vec::new();
    for (i, line) in text.lines().enumerate() {
        if line.trim_start().starts_with("```") {
            in_code = !in_code;
        } else if !in_code && !line.trim_start().starts_with('|') {
            found.push((i + 1, line));
        }
    }
    found
}

/// Text between single backticks, line by line and without code blocks.
fn quoted(text: &str) -> Vec<String> {
    let mut in_code = false;
    let mut found = Vec::new();
    for line in text.lines() {
        if line.trim_start().starts_with("```") {
            in_code = !in_code;
        } else if !in_code {
            found.extend(line.split('`').skip(1).step_by(2).map(str::to_owned));
        }
    }
    found
}

/// Whether a quoted word means a path of the repository.
fn is_path(word: &str) -> bool {
    let first = word.split('/').next().unwrap_or_default();
    let is_district = [
        "docs",
        "schemas",
        "sensors",
        "simd",
        "launch",
        "consumers",
        "examples",
        "tests",
    ]
    .contains(&first);
    let is_root_file = !word.contains('/')
        && [".md", ".toml"].iter().any(|end| word.ends_with(end))
        && word.starts_with(|c: char| c.is_ascii_uppercase());
    (is_district && word.contains('/') || is_root_file)
        && !word.contains(['<', '*', ' ', '{', ':', '…', '='])
}

/// Rust text of each crate by its name.
fn crates() -> BTreeMap<String, String> {
    let mut found = BTreeMap::<String, String>::new();
    for path in files(&["rs"]) {
        let name = relative(&path);
        let mut parts = name.split('/').skip(1);
        if let (Some(crate_name), Some("src")) = (parts.next(), parts.next()) {
            *found.entry(crate_name.to_owned()).or_default() +=
                &std::fs::read_to_string(&path).unwrap_or_else(|error| panic!("{name}: {error}"));
        }
    }
    found
}

/// Whether `text` declares an item or a module called `item`.
fn declares(text: &str, item: &str) -> bool {
    ["struct", "enum", "trait", "type", "mod", "fn", "const"]
        .iter()
        .any(|keyword| {
            let declaration = format!("{keyword} {item}");
            text.match_indices(&declaration).any(|(at, _)| {
                let next = text[at + declaration.len()..].chars().next();
                next.is_none_or(|c| !c.is_alphanumeric() && c != '_')
            })
        })
        // Types that a macro makes.
        || text.contains(&format!("    {item}, \"")) || text.contains(&format!("({item}, "))
}

#[test]
fn lines_of_pages_can_be_read() {
    let mut wrong = Vec::new();
    for path in files(&["md"]) {
        let text = page(&relative(&path));
        for (number, line) in prose(&text) {
            let n_chars = line.chars().count();
            if n_chars > MAX_LINE_CHARS {
                wrong.push(format!(
                    "{}:{number}: {n_chars} characters, at most {MAX_LINE_CHARS}",
                    relative(&path)
                ));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn pages_name_files_that_exist() {
    let mut wrong = Vec::new();
    for path in files(&["md"]) {
        let name = relative(&path);
        for word in quoted(&page(&name)) {
            if is_path(&word) && !repository().join(&word).exists() {
                wrong.push(format!("{name}: `{word}` is no file or folder"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Each list of files for a newcomer is short and names every file once.
#[test]
fn reading_orders_of_the_architecture_page_are_short() {
    let text = page("ARCHITECTURE.md");
    let (_, chapter) = text
        .split_once("\n## Where to begin\n")
        .expect("the page has this chapter");
    let chapter = chapter.split("\n## ").next().unwrap_or_default();
    let mut lists: Vec<Vec<&str>> = Vec::new();
    for line in chapter.lines() {
        if line.starts_with("**") {
            lists.push(Vec::new());
        } else if line.starts_with(|c: char| c.is_ascii_digit()) {
            let file = line.split('`').nth(1).unwrap_or_default();
            lists.last_mut().expect("a head comes first").push(file);
        }
    }
    assert_eq!(lists.len(), 4, "four newcomers");
    for list in lists {
        let n_files = list.iter().collect::<BTreeSet<_>>().len();
        assert_eq!(n_files, list.len(), "a file stands twice in {list:?}");
        assert!((3..=10).contains(&n_files), "{n_files} files: {list:?}");
        for file in list {
            assert!(repository().join(file).is_file(), "{file:?} is no file");
        }
    }
}

/// `[text](target)` of every page: files relative to the page, without web addresses.
#[test]
fn links_between_pages_lead_somewhere() {
    let mut wrong = Vec::new();
    for path in files(&["md"]) {
        let name = relative(&path);
        let folder = path.parent().expect("a file has a folder");
        for after in page(&name).split("](").skip(1) {
            let target = after.split(')').next().unwrap_or_default();
            let file = target.split('#').next().unwrap_or_default();
            if !file.is_empty() && !file.contains(':') && !folder.join(file).exists() {
                wrong.push(format!("{name}: {target} is not there"));
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn the_glossary_is_short_and_names_definitions_that_exist() {
    let text = page("docs/reference/glossary.md");
    let rows: Vec<&str> = text
        .lines()
        .filter(|line| line.starts_with("| **"))
        .collect();
    assert!(
        rows.len() <= MAX_GLOSSARY_WORDS,
        "{} words, at most {MAX_GLOSSARY_WORDS}",
        rows.len()
    );
    let crates = crates();
    let mut wrong = Vec::new();
    let mut words: Vec<&str> = Vec::new();
    for row in rows {
        let cells: Vec<&str> = row.split('|').map(str::trim).collect();
        words.push(cells[1]);
        let definition = cells[4].trim_matches('`');
        let Some((crate_name, item)) = definition.split_once("::") else {
            if !repository().join(definition).exists() {
                wrong.push(format!("{}: {definition} is not there", cells[1]));
            }
            continue;
        };
        match crates.get(crate_name) {
            None => wrong.push(format!("{}: there is no crate {crate_name}", cells[1])),
            Some(text) if !declares(text, item) => {
                wrong.push(format!("{}: {crate_name} has no {item}", cells[1]));
            }
            Some(_) => {}
        }
    }
    words.sort_unstable();
    let n_words = words.len();
    words.dedup();
    assert_eq!(words.len(), n_words, "a word stands twice");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}
