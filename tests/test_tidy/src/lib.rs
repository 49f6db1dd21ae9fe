//! Repository rules that clippy cannot hold, as tests (see `tests/it/tidy.rs`).

#![forbid(unsafe_code)]

pub mod circles;
pub mod messages;
pub mod modules;

use std::path::{Path, PathBuf};

/// Root of the repository.
pub fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../..")
        .canonicalize()
        .expect("repository root")
}

/// Every file below the root with one of `extensions`, without build products and hidden folders;
/// sorted.
pub fn files(extensions: &[&str]) -> Vec<PathBuf> {
    let mut found = Vec::new();
    walk(&repository(), &mut found);
    found.retain(|path| {
        path.extension()
            .is_some_and(|e| extensions.contains(&e.to_string_lossy().as_ref()))
    });
    found.sort();
    found
}

fn walk(dir: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(dir).expect("readable folder").flatten() {
        let name = entry.file_name().to_string_lossy().into_owned();
        let path = entry.path();
        if path.is_dir() {
            // Only the root's own folder of build products: a module may be called `target`, too.
            let is_product = name == "target" && dir == repository();
            if !(is_product || name == "shared" || name.starts_with('.') || name == "__pycache__") {
                walk(&path, found);
            }
        } else {
            found.push(path);
        }
    }
}

/// The path relative to the root, for messages.
pub fn relative(path: &Path) -> String {
    path.strip_prefix(repository())
        .unwrap_or(path)
        .display()
        .to_string()
}
