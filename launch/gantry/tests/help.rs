//! Compares the help texts with `tests/golden/help/*.txt` in the root of the repository.
//! `./gantry bless` sets `GANTRY_BLESS=1`, which writes them anew.

use std::path::PathBuf;
use std::process::Command;

fn golden(name: &str) -> PathBuf {
    PathBuf::from(concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../tests/golden/help"
    ))
    .join(format!("{name}.txt"))
}

fn help_of(words: &[&str]) -> String {
    let output = Command::new(env!("CARGO_BIN_EXE_gantry"))
        .args(words)
        .env("COLUMNS", "110")
        .env_remove("RUST_LOG")
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(0), "{words:?}");
    String::from_utf8(output.stdout).unwrap()
}

#[test]
fn help_texts_are_those_that_were_reviewed() {
    let cases: [(&str, &[&str]); 20] = [
        ("gantry", &["--help"]),
        ("gantry_up", &["up", "--help"]),
        ("gantry_topic", &["topic", "--help"]),
        ("gantry_topic_list", &["topic", "list", "--help"]),
        ("gantry_topic_info", &["topic", "info", "--help"]),
        ("gantry_topic_hz", &["topic", "hz", "--help"]),
        ("gantry_topic_bw", &["topic", "bw", "--help"]),
        ("gantry_topic_delay", &["topic", "delay", "--help"]),
        ("gantry_topic_echo", &["topic", "echo", "--help"]),
        ("gantry_topic_top", &["topic", "top", "--help"]),
        ("gantry_top", &["top", "--help"]),
        ("gantry_graph", &["graph", "--help"]),
        ("gantry_doctor", &["doctor", "--help"]),
        ("gantry_new", &["new", "--help"]),
        ("gantry_new_consumer", &["new", "consumer", "--help"]),
        ("gantry_carla-root", &["carla-root", "--help"]),
        ("gantry_map", &["map", "--help"]),
        ("gantry_map_check", &["map", "check", "--help"]),
        ("gantry_map_export", &["map", "export", "--help"]),
        ("gantry_map_import", &["map", "import", "--help"]),
    ];
    let mut wrong = Vec::new();
    for (name, words) in cases {
        let (path, help) = (golden(name), help_of(words));
        if std::env::var_os("GANTRY_BLESS").is_some() {
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(&path, &help).unwrap();
        } else if std::fs::read_to_string(&path).unwrap_or_default() != help {
            wrong.push(format!("--- {name}\n{help}"));
        }
    }
    assert!(
        wrong.is_empty(),
        "help changed; look at it, then run ./gantry bless\n{}",
        wrong.join("\n")
    );
}

#[test]
fn completions_and_the_man_page_are_printed() {
    assert!(help_of(&["completions", "bash"]).contains("gantry"));
    assert!(help_of(&["man"]).starts_with(".ie"), "troff");
}

#[test]
fn an_unknown_word_is_refused_with_the_known_ones() {
    let output = Command::new(env!("CARGO_BIN_EXE_gantry"))
        .arg("fly")
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(2));
    let message = String::from_utf8(output.stderr).unwrap();
    assert!(
        message.starts_with("error: there is no program \"gantry-fly\"")
            && message.contains("up, new, topic, top, graph, doctor"),
        "{message}"
    );
}

#[test]
fn a_reader_that_leaves_early_is_no_failure() {
    let script = format!(
        "{} man | head -c 10 > /dev/null; exit ${{PIPESTATUS[0]}}",
        env!("CARGO_BIN_EXE_gantry")
    );
    assert_eq!(
        Command::new("bash")
            .args(["-c", &script])
            .status()
            .unwrap()
            .code(),
        Some(0)
    );
}
