//! Every example of every help text, and every command of the pages in `docs/how-to`, is read by the
//! programs that it calls: bash takes the lines apart, and in place of each program a script asks the
//! real one with `--check-arguments`, so that nothing is started. Other commands do nothing.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

use test_kit::sandbox::{binary_path, repository};
use test_kit::{PATIENCE, Sandbox, output_within};

use super::help::{PROGRAMS, helps};
use super::{pages_of, text};

/// The script that a command line meets in place of a program. The flag stands before a `--`, behind
/// which other programs' words begin.
const STAND_IN: &str = r#"#!/bin/bash
words=() flag=--check-arguments
for word in "$@"; do
    [[ $word == -- && $flag ]] && words+=("$flag") flag=
    words+=("$word")
done
call=CALLS/$BASHPID-$RANDOM
printf '%s\0' NAME "$@" > "$call.words"
REAL "${words[@]}" $flag < /dev/null > "$call.said" 2>&1
printf '%s' $? > "$call.code"
"#;
/// What a shell of its own needs: other commands succeed, and `ssh` runs here what it would there.
const SHELL: &str = "command_not_found_handle() { :; }
ssh() { while [[ $1 == -* ]]; do shift 2; done; shift; \"$@\"; }
";

/// A call of a program of ours.
#[derive(Debug)]
struct Call {
    words: Vec<String>,
    /// What the program says about the words, and its exit code.
    said: String,
    code: String,
}

impl Call {
    /// The program, also if `gantry` is asked for it, and its words.
    fn program(&self) -> (String, &[String]) {
        let words: Vec<&str> = self.words.iter().map(String::as_str).collect();
        match words[..] {
            ["gantry", word, ..] if PROGRAMS.contains(&&*format!("gantry-{word}")) => {
                (format!("gantry-{word}"), &self.words[2..])
            }
            _ => (self.words[0].clone(), &self.words[1..]),
        }
    }

    /// Values of a flag that takes one.
    fn values(&self, flag: &str) -> Vec<&str> {
        let behind = self.words.windows(2).filter(|pair| pair[0] == flag);
        behind.map(|pair| pair[1].as_str()).collect()
    }
}

/// A folder with a stand-in for each program.
struct Shell {
    sandbox: Sandbox,
}

impl Shell {
    fn new() -> Shell {
        let sandbox = Sandbox::new("examples");
        let bin = sandbox.path("bin");
        std::fs::create_dir(&bin).expect("an empty sandbox");
        for program in PROGRAMS {
            let script = STAND_IN
                .replace("NAME", program)
                .replace("CALLS", text(&sandbox.path("calls")))
                .replace("REAL", text(&binary_path(program)));
            let file = bin.join(program);
            std::fs::write(&file, script).expect("the sandbox can be written to");
            let mode = std::os::unix::fs::PermissionsExt::from_mode(0o755);
            std::fs::set_permissions(&file, mode).expect("it is this test's own");
        }
        // In the repository `./gantry` builds the programs before it calls them.
        std::os::unix::fs::symlink(bin.join("gantry"), sandbox.path("gantry")).expect("a link");
        Shell { sandbox }
    }

    /// The calls of our programs in these command lines.
    fn calls(&self, lines: &str) -> Vec<Call> {
        let folder = self.sandbox.path("calls");
        std::fs::create_dir_all(&folder).expect("a folder");
        let status = Command::new("/bin/bash")
            .args(["-c", &format!("{SHELL}{lines}\nwait")])
            .current_dir(self.sandbox.dir())
            .env("PATH", self.sandbox.path("bin"))
            .env("HOME", self.sandbox.dir())
            .env_remove("GANTRY_DOMAIN")
            .stdin(Stdio::null())
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .status();
        status.expect("there is a bash");
        let entries = std::fs::read_dir(&folder).expect("the folder");
        let files = entries.map(|entry| entry.expect("readable").path());
        let words = files.filter(|file| file.extension().is_some_and(|it| it == "words"));
        let read = |file: &Path| std::fs::read_to_string(file).expect("the stand-in wrote it");
        let calls = words.map(|file| Call {
            words: read(&file)
                .split_terminator('\0')
                .map(str::to_owned)
                .collect(),
            said: read(&file.with_extension("said")),
            code: read(&file.with_extension("code")),
        });
        let calls = calls.collect();
        std::fs::remove_dir_all(folder).expect("it is this test's own");
        calls
    }

    /// Checks command lines, of which `n_ours` call programs of ours.
    fn check(&self, place: &str, lines: &str, n_ours: usize) {
        let calls = self.calls(lines);
        assert!(calls.len() >= n_ours, "{place}: {lines}\n{calls:?}");
        for call in &calls {
            let words = call.words.join(" ");
            assert_eq!(call.code, "0", "{place}: {words}\n{}", call.said);
            self.check_launch(place, call);
        }
    }

    /// Checks what arguments say about launch files as `gantry up` reads them.
    fn check_launch(&self, place: &str, call: &Call) {
        let (program, words) = call.program();
        let mut files: Vec<&str> = Vec::new();
        for word in words.iter().filter(|word| word.starts_with("launch/")) {
            let there = repository().join(word).is_file();
            assert!(there, "{place}: there is no {word}");
            files.push(word);
        }
        let is_up = program == "gantry" && words.first().is_some_and(|word| word == "up");
        if !is_up && program != "simd" {
            // Recipes, suites and others that are no launch files.
            files.clear();
        }
        let sensors = call.values("--sensor");
        let sensors = sensors.iter().filter(|spec| spec.contains('='));
        let sets: Vec<String> = call
            .values("--set")
            .iter()
            .map(|set| (*set).to_owned())
            .chain(sensors.map(|spec| format!("sensor.{spec}")))
            .collect();
        if files.is_empty() && sets.is_empty() {
            return;
        }
        if files.is_empty() {
            files.push("launch/quickstart.toml");
        }
        let sets = sets.iter().flat_map(|set| ["--set", set.as_str()]);
        let mut command = Command::new(binary_path("gantry"));
        command
            .arg("up")
            .args(files)
            .args(["--dry-run", "--view", "none"])
            .args(sets)
            .current_dir(repository())
            .env("HOME", self.sandbox.dir());
        let output = output_within(&mut command, PATIENCE);
        let said = String::from_utf8_lossy(&output.stderr);
        let words = call.words.join(" ");
        assert!(output.status.success(), "{place}: {words}\n{said}");
    }
}

/// Whether a command line begins with a program of ours.
fn is_ours(line: &str) -> bool {
    let word = line.split_whitespace().next().unwrap_or_default();
    PROGRAMS.contains(&word.trim_start_matches("./"))
}

#[test]
fn every_example_of_every_help_text_is_understood() {
    let shell = Shell::new();
    let mut n = 0;
    for (path, help) in helps() {
        let Some((_, examples)) = help.split_once("\nExamples:\n") else {
            continue;
        };
        let list = examples.split("\n\n").next().unwrap_or_default();
        // The end of a comment for which a line of a help text had no room.
        let lines = list.lines().map(str::trim).filter(|line| *line != "…");
        for line in lines {
            // Behind two spaces it is said what the example does.
            let command = line.split("  ").next().unwrap_or_default();
            let place = format!("{} --help", path.join(" "));
            // The script that the example before it makes is tried by the tests of carla-root.
            let is_made = command.starts_with("~/gantry-carla/CarlaUE4.sh ");
            shell.check(&place, command, usize::from(!is_made));
            n += 1;
        }
    }
    assert!(n > 80, "{n} examples");
}

/// The ```sh blocks of a page.
fn blocks(page: &Path) -> Vec<String> {
    let page = std::fs::read_to_string(page).expect("a page");
    let parts = page.split("\n```sh\n").skip(1);
    parts
        .map(|part| part.split("\n```").next().unwrap_or_default().to_owned())
        .collect()
}

#[test]
fn every_command_of_the_how_to_pages_is_understood() {
    let shell = Shell::new();
    let mut n = 0;
    let pages: Vec<PathBuf> = pages_of("docs/how-to");
    for page in pages {
        for block in blocks(&page) {
            let n_ours = block.lines().filter(|line| is_ours(line)).count();
            shell.check(text(&page), &block, n_ours);
            n += n_ours;
        }
    }
    assert!(n > 25, "{n} commands");
}

#[test]
fn the_stand_ins_see_through_quotes_pipes_and_lists_and_refuse_what_programs_refuse() {
    let shell = Shell::new();
    let lines = "cd nowhere && simd --map x; gantry view --fly | nothing; ssh -L 1:a:1 there gantry-record info 'a b' &\n";
    let mut calls: Vec<String> = shell
        .calls(lines)
        .iter()
        .map(|it| it.words.join("|"))
        .collect();
    calls.sort();
    assert_eq!(calls, ["gantry-record|info|a b", "gantry|view|--fly"]);
    let refused = shell.calls("gantry-export a.mcap --format kity --out a");
    assert!(
        refused[0].code == "2" && refused[0].said.contains("kity"),
        "{refused:?}"
    );
    let there = shell.calls("gantry bench perception a.toml -- python --no-such-flag");
    assert_eq!(there[0].code, "0", "{there:?}");
    assert_eq!(there[0].program().0, "gantry-bench");
}
