//! Checks commit messages: they must have the form that `test_tidy::messages` asks for.
//!
//! It checks the commits since the last tag, but at most 50, and only those behind the last change of
//! the rule itself ([`RULE`]): a rule cannot bind commits that are older than it. A copy without
//! history (an archive, or a clone of depth 1) has nothing to check. `./gantry check` runs this
//! program; it is no test, because a message in published history cannot be mended.

use std::process::{Command, ExitCode};

use test_tidy::messages::{Commit, faults};
use test_tidy::repository;

/// File that holds the rule. The commit that last changed it is the last one that is not checked.
const RULE: &str = "tests/test_tidy/src/messages.rs";

/// Most commits that are looked at.
const MAX_COMMITS: usize = 50;

/// Output of git in the repository; `None` if there is no git, no history or no answer.
fn git(args: &[&str]) -> Option<String> {
    let output = Command::new("git")
        .arg("-C")
        .arg(repository())
        .args(args)
        .output()
        .ok()?;
    output
        .status
        .success()
        .then(|| String::from_utf8_lossy(&output.stdout).trim().to_owned())
}

/// Hashes of the commits to check, newest first.
fn hashes() -> Vec<String> {
    // An archive may have been unpacked inside somebody else's repository.
    let is_ours = git(&["rev-parse", "--show-toplevel"])
        .and_then(|top| std::fs::canonicalize(top).ok())
        .is_some_and(|top| top == repository());
    let changed = git(&["log", "-1", "--format=%H", "--", RULE]).unwrap_or_default();
    if !is_ours || changed.is_empty() {
        return Vec::new();
    }
    let last_tag = git(&["describe", "--tags", "--abbrev=0"]);
    let range = last_tag.map_or("HEAD".to_owned(), |tag| format!("{tag}..HEAD"));
    let limit = format!("--max-count={MAX_COMMITS}");
    let not_older = format!("^{changed}");
    git(&["rev-list", "--no-merges", &limit, &range, &not_older])
        .unwrap_or_default()
        .lines()
        .map(str::to_owned)
        .collect()
}

fn read(hash: &str) -> Commit {
    let field = |format: &str| {
        git(&["log", "-1", &format!("--format={format}"), hash])
            .unwrap_or_else(|| panic!("git cannot show {hash}"))
    };
    let lines = git(&["show", "--numstat", "-M", "--format=", hash]).unwrap_or_default();
    // Binary files have "-" instead of numbers.
    let count = |line: &str| -> u64 {
        line.split('\t')
            .take(2)
            .filter_map(|number| number.parse::<u64>().ok())
            .sum()
    };
    Commit {
        hash: field("%h"),
        subject: field("%s"),
        body: field("%b"),
        n_changed_lines: lines.lines().map(count).sum(),
    }
}

fn main() -> ExitCode {
    let hashes = hashes();
    let mut n_faults = 0;
    for hash in &hashes {
        let commit = read(hash);
        for fault in faults(&commit) {
            eprintln!("{} {:?}: {fault}", commit.hash, commit.subject);
            n_faults += 1;
        }
    }
    if n_faults == 0 {
        println!("{} commit messages checked", hashes.len());
        ExitCode::SUCCESS
    } else {
        eprintln!("mend the messages with `git commit --amend` or `git rebase -i`");
        ExitCode::FAILURE
    }
}
