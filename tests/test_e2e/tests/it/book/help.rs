//! Help texts, completions and man pages of every program and all of its subcommands, and
//! `docs/reference/programs.md`, which is made from the help texts and on which they are reviewed.

use std::process::{Command, Output};

use test_kit::sandbox::binary_path;
use test_kit::{PATIENCE, Sandbox, output_within};

/// All programs that users start.
pub(super) const PROGRAMS: [&str; 14] = [
    "gantry",
    "simd",
    "gantry-render",
    "gantry-drive",
    "gantry-view",
    "gantry-record",
    "gantry-replay",
    "gantry-desk",
    "gantry-rerun",
    "gantry-export",
    "gantry-dataset",
    "gantry-bench",
    "gantry-carla",
    "gantry-bridge",
];
/// Subcommands that every program has.
const EVERYWHERE: [&str; 2] = ["completions", "help"];

fn run(program: &str, words: &[&str]) -> Output {
    let mut command = Command::new(binary_path(program));
    command
        .args(words)
        .env("COLUMNS", "110")
        .env_remove("RUST_LOG")
        .env_remove("NO_COLOR")
        .env_remove("GANTRY_DOMAIN")
        // Programs of this machine's that are none of the repository's stay out of the list.
        .env("PATH", "/usr/bin:/bin");
    let output = output_within(&mut command, PATIENCE);
    assert_eq!(output.status.code(), Some(0), "{program} {words:?}");
    output
}

fn printed(program: &str, words: &[&str]) -> String {
    let text = String::from_utf8(run(program, words).stdout).expect("help is UTF-8");
    assert!(!text.contains('\x1b'), "{program} {words:?} colours a pipe");
    text
}

/// The subcommands that a help text lists.
fn subcommands(help: &str) -> Vec<String> {
    let Some((_, rest)) = help.split_once("\nCommands:\n") else {
        return Vec::new();
    };
    let list = rest.split("\n\n").next().unwrap_or_default();
    list.lines()
        .filter_map(|line| line.strip_prefix("  "))
        .filter(|line| !line.starts_with(' '))
        .filter_map(|line| line.split_whitespace().next())
        .filter(|word| !EVERYWHERE.contains(word))
        .map(str::to_owned)
        .collect()
}

/// Help texts by the words that lead to them, parents first.
pub(super) fn helps() -> Vec<(Vec<String>, String)> {
    let mut found = Vec::new();
    let mut todo: Vec<Vec<String>> = PROGRAMS.map(|name| vec![name.to_owned()]).to_vec();
    todo.reverse();
    while let Some(path) = todo.pop() {
        let words: Vec<&str> = path[1..]
            .iter()
            .map(String::as_str)
            .chain(["--help"])
            .collect();
        let help = printed(&path[0], &words);
        for word in subcommands(&help).into_iter().rev() {
            todo.push([&path[..], &[word]].concat());
        }
        found.push((path, help));
    }
    found
}

#[test]
fn help_texts_are_those_of_the_page() {
    let sandbox = Sandbox::new("help");
    let folder = sandbox.path("texts");
    std::fs::create_dir(&folder).expect("the sandbox is this test's own");
    let helps = helps();
    assert!(helps.len() > 30, "{}", helps.len());
    for (path, help) in helps {
        let name = path.join("_") + ".txt";
        assert!(help.contains("\nUsage: "), "{name} says no usage");
        std::fs::write(folder.join(name), help).expect("the sandbox can be written to");
    }
    super::check_generated("docs/reference/programs.md", "book_programs.py", &folder);
}

/// The page tells these once for all, so that an option of one program among them would be nowhere.
#[test]
fn common_options_are_the_same_everywhere_but_for_the_domain() {
    let common = |program: &str| {
        let help = printed(program, &["--help"]);
        let (_, rest) = help.split_once("\nCommon options:\n").expect(program);
        let (options, _) = rest.split_once("\nEnvironment:\n").expect(program);
        let verbose = options.find("  -v, --verbose").expect(program);
        options[verbose..].to_owned()
    };
    for program in PROGRAMS {
        assert_eq!(common(program), common("gantry"), "{program}");
    }
}

/// Whether these words meet other programs on the bus; all others read and write files, or have a
/// domain of their own for each run.
fn is_on_a_domain(path: &[String]) -> bool {
    let words: Vec<&str> = path.iter().map(String::as_str).collect();
    match words[..] {
        ["gantry-export" | "gantry-dataset", ..] => false,
        ["gantry-bench", ref words @ ..] => matches!(words, ["ages" | "topics" | "tick"]),
        ["gantry-record", ref words @ ..] => matches!(words, [] | ["dump"]),
        _ => true,
    }
}

/// An option that does nothing is none.
#[test]
fn only_what_meets_others_on_the_bus_takes_a_domain() {
    for (path, help) in helps() {
        let has = help.contains("--domain <NAME>");
        assert_eq!(has, is_on_a_domain(&path), "{path:?}\n{help}");
    }
    for words in [
        &["gantry-bench", "perception", "launch/bench/smoke.toml"][..],
        &["gantry-bench", "reaction", "launch/bench/reaction.toml"],
        &["gantry-bench", "compare", "a.json", "b.json"],
        &["gantry-bench", "show", "a.json"],
        &["gantry-dataset", "verify", "set"],
        &[
            "gantry-export",
            "a.mcap",
            "--format",
            "kitti",
            "--out",
            "set",
        ],
        &["gantry-record", "info", "a.mcap"],
        &["gantry-record", "cat", "a.mcap"],
    ] {
        let mut command = Command::new(binary_path(words[0]));
        command
            .args(&words[1..])
            .args(["--check-arguments", "--domain", "lab"]);
        let output = output_within(&mut command, PATIENCE);
        let said = String::from_utf8_lossy(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{words:?}: {said}");
        assert!(said.contains("unexpected argument '--domain'"), "{said}");
    }
}

/// The words and lines of the list of programs in a help text.
fn listed(help: &str) -> Vec<(&str, &str)> {
    let heading = "\nPrograms, which gantry WORD starts as gantry-WORD:\n";
    let (_, rest) = help.split_once(heading).expect("the list");
    let list = rest.split("\n\n").next().unwrap_or_default();
    list.lines()
        .map(|line| line.trim().split_once("  ").expect("a word and a line"))
        .map(|(word, line)| (word, line.trim()))
        .collect()
}

/// As cargo lists its own subcommands and those of others.
#[test]
fn the_launcher_lists_the_programs_that_are_installed() {
    let help = printed("gantry", &["--help"]);
    let listed_here = listed(&help);
    let mut ours: Vec<&str> = PROGRAMS
        .iter()
        .filter_map(|program| program.strip_prefix("gantry-"))
        .collect();
    ours.sort_unstable();
    let words: Vec<&str> = listed_here.iter().map(|(word, _)| *word).collect();
    assert_eq!(words, ours);
    for (word, line) in listed_here {
        assert!(line.contains(' ') && !line.contains('/'), "{word}: {line}");
    }
    let sandbox = Sandbox::new("listed");
    let own = sandbox.write("gantry-probe", "#!/bin/sh\n");
    sandbox.write("gantry-no_program", "");
    let mode = std::os::unix::fs::PermissionsExt::from_mode(0o755);
    std::fs::set_permissions(&own, mode).expect("it is ours");
    let mut command = Command::new(binary_path("gantry"));
    command.env("PATH", sandbox.dir()).arg("-h");
    let output = output_within(&mut command, PATIENCE);
    let help = String::from_utf8(output.stdout).expect("help is UTF-8");
    let listed_there = listed(&help);
    assert!(
        listed_there.contains(&("probe", own.to_str().expect("UTF-8"))),
        "{help}"
    );
    assert!(!help.contains("no_program") && listed_there.len() == ours.len() + 1);
}

/// What is typed first is shown by an example.
#[test]
fn every_program_shows_examples() {
    for program in PROGRAMS {
        let help = printed(program, &["--help"]);
        let (_, examples) = help
            .split_once("\nExamples:\n")
            .unwrap_or_else(|| panic!("{program} shows no example"));
        let as_word = program.replacen('-', " ", 1);
        assert!(
            examples.contains(program) || examples.contains(&as_word),
            "{examples}"
        );
    }
}

#[test]
fn completions_and_man_pages_know_every_subcommand() {
    let helps = helps();
    for program in PROGRAMS {
        let own: Vec<_> = helps
            .iter()
            .filter(|(path, _)| path[0] == program)
            .collect();
        for shell in ["bash", "zsh", "fish"] {
            let script = printed(program, &["completions", shell]);
            for word in own.iter().filter_map(|(path, _)| path.get(1)) {
                assert!(
                    script.contains(word.as_str()),
                    "{program}'s {shell} lacks {word}"
                );
            }
        }
        let script = tempfile(&printed(program, &["completions", "bash"]));
        let checked = Command::new("bash").arg("-n").arg(&script.1).status();
        assert!(checked.expect("there is a bash").success(), "{program}");

        let man = script.0.join("man1");
        printed(program, &["man", "--into", man.to_str().expect("UTF-8")]);
        for (path, help) in &own {
            let page = man.join(path.join("-") + ".1");
            let page =
                std::fs::read_to_string(&page).unwrap_or_else(|error| panic!("{page:?}: {error}"));
            assert!(page.contains(".SH NAME"), "{page}");
            // troff writes a hyphen as `\-`.
            let page = page.replace('\\', "");
            for flag in help
                .split_whitespace()
                .filter(|word| word.starts_with("--") && word.len() > 2)
            {
                let flag = flag.trim_end_matches(|c: char| !c.is_ascii_alphanumeric());
                let flag = flag.split(['[', '=', '.']).next().unwrap_or(flag);
                let is_own = help.contains(&format!("\n      {flag}"))
                    || help.contains(&format!(", {flag}"));
                assert!(
                    !is_own || page.contains(flag),
                    "{path:?} lacks {flag} in its man page"
                );
            }
        }
        let n_pages = std::fs::read_dir(&man)
            .expect("the folder was made")
            .count();
        assert_eq!(n_pages, own.len(), "{program}");
        std::fs::remove_dir_all(script.0).expect("removable");
    }
}

/// A folder of this test's own, and a file in it.
fn tempfile(text: &str) -> (std::path::PathBuf, std::path::PathBuf) {
    use std::sync::atomic::{AtomicU32, Ordering};
    static COUNT: AtomicU32 = AtomicU32::new(0);
    let number = COUNT.fetch_add(1, Ordering::Relaxed);
    let folder = std::env::temp_dir().join(format!("gantry-help-{}-{number}", std::process::id()));
    std::fs::create_dir_all(&folder).expect("a folder");
    let file = folder.join("script");
    std::fs::write(&file, text).expect("a file");
    (folder, file)
}
