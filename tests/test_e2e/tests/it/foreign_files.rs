//! Files that come from anybody: recordings made byte by byte with lies in them, and pipes and
//! devices where a file should be. Every program says in a sentence what is wrong, and ends.

use std::os::unix::fs::symlink;

use nix::sys::stat::Mode;
use nix::unistd::mkfifo;
use test_e2e::{SMALL_RIG, python_package, spawn_consumer, spawn_daemon, venv_program};
use test_kit::{Ended, Sandbox};

/// Words of a program; `{}` stands for the file, `{out}` for a new one.
struct Use {
    program: &'static str,
    words: &'static [&'static str],
}

const fn of(program: &'static str, words: &'static [&'static str]) -> Use {
    Use { program, words }
}

/// Whatever reads a recording.
const READERS: [Use; 9] = [
    of("gantry-replay", &["{}", "--rate", "max"]),
    of("gantry-record", &["info", "{}"]),
    of("gantry-record", &["cat", "{}", "--json"]),
    of("gantry-record", &["recover", "{}", "{out}"]),
    of("gantry-record", &["trim", "{}", "{out}", "--to", "20s"]),
    of("gantry-record", &["merge", "{}", "{}", "{out}"]),
    of("gantry-record", &["convert", "{}", "{out}.rrd"]),
    of(
        "gantry-export",
        &["{}", "--format", "coco", "--out", "{out}"],
    ),
    of("gantry-rerun", &["{}"]),
];

/// Whatever reads another file that people write or get.
const OTHERS: [Use; 9] = [
    of("gantry", &["up", "{}"]),
    of("gantry", &["up", "includes.toml", "--dry-run"]),
    of("gantry", &["map", "import", "{}", "--data", "{out}"]),
    of("gantry-dataset", &["make", "{}", "--dry-run"]),
    of("gantry-dataset", &["verify", "set"]),
    of("gantry-bench", &["perception", "{}", "--dry-run"]),
    of("gantry-bench", &["show", "{}"]),
    of("gantry-rerun", &["plain.mcap", "--sensor", "{}"]),
    of("simd", &["--launch", "{}"]),
];

fn run(sandbox: &Sandbox, it: &Use, file: &str, n: usize) -> Ended {
    let out = format!("out-{n}");
    let words: Vec<String> = it
        .words
        .iter()
        .map(|word| word.replace("{}", file).replace("{out}", &out))
        .collect();
    let words: Vec<&str> = words.iter().map(String::as_str).collect();
    match it.program {
        "gantry-replay" | "gantry-rerun" => spawn_consumer(sandbox, it.program, &words).wait(),
        _ => sandbox.spawn(it.program, &words).wait(),
    }
}

#[test]
fn crafted_recordings_are_errors_or_read_as_far_as_they_go() {
    let sandbox = Sandbox::new("crafted");
    let mut n = 0;
    for (name, bytes) in test_fuzz::crafted::recordings() {
        let file = format!("{name}.mcap");
        std::fs::write(sandbox.path(&file), bytes).unwrap();
        for it in &READERS {
            n += 1;
            let ended = run(&sandbox, it, &file, n);
            let which = format!("{} {:?} of {name}: {:?}", it.program, it.words, ended.lines);
            // Rust ends with 101 after a panic, and a signal is negative.
            assert!((0..101).contains(&ended.code()), "{which}");
            assert!(!ended.says("panicked"), "{which}");
            if ended.code() != 0 {
                assert!(!ended.lines.is_empty(), "{which}");
            }
        }
    }
}

/// In Python all of it is `Exception`s: a panic would pass through `except Exception`.
#[test]
fn crafted_recordings_are_exceptions_in_python() {
    let sandbox = Sandbox::new("crafted-python");
    let mut names = Vec::new();
    for (name, bytes) in test_fuzz::crafted::recordings() {
        std::fs::write(sandbox.path(name), bytes).unwrap();
        names.push(name);
    }
    let script = sandbox.write(
        "read_all.py",
        r#"import sys, gantry
for name in sys.argv[1:]:
    try:
        drive = gantry.Recording(name)
        for part in ("start", "end", "topics", "metadata", "attachments"):
            value = getattr(drive, part)
            _ = value() if callable(value) else value
        n = sum(1 for _ in drive.samples())
        print(name, "read", n)
    except Exception as error:
        print(name, "refused", error)
print("all")
"#,
    );
    let package = python_package();
    let env = [("PYTHONPATH", package.to_str().unwrap())];
    let words = [&[script.to_str().unwrap()][..], &names].concat();
    let ended = sandbox
        .spawn_program("python", &venv_program("python"), &words, &env)
        .wait()
        .expect_code(0);
    assert!(ended.says("all"), "{:?}", ended.lines);
    assert!(ended.says("plain read 2"), "{:?}", ended.lines);
}

#[test]
fn pipes_and_devices_are_no_files_to_any_program() {
    let sandbox = Sandbox::new("no-files");
    let (_, plain) = test_fuzz::crafted::recordings().swap_remove(0);
    std::fs::write(sandbox.path("plain.mcap"), plain).unwrap();
    mkfifo(&sandbox.path("pipe"), Mode::S_IRWXU).unwrap();
    symlink("/dev/zero", sandbox.path("zero")).unwrap();
    let mut n = 1000;
    for (file, kind) in [("pipe", "a named pipe"), ("zero", "a device")] {
        let include = format!("version = 1\ninclude = [\"{file}\"]\n");
        std::fs::write(sandbox.path("includes.toml"), include).unwrap();
        let manifest = sandbox.path("set/manifest.json");
        std::fs::create_dir_all(manifest.parent().unwrap()).unwrap();
        let _ = std::fs::remove_file(&manifest);
        symlink(sandbox.path(file), &manifest).unwrap();
        for it in READERS.iter().chain(&OTHERS) {
            n += 1;
            let ended = run(&sandbox, it, file, n);
            let which = format!("{} {:?} of {file}: {:?}", it.program, it.words, ended.lines);
            assert!((1..101).contains(&ended.code()), "{which}");
            assert!(ended.says(&format!("it is {kind}, not a file")), "{which}");
        }
        // Maps and journals are given to a simulator with a launch file of its own.
        let map = format!("{file}.xodr");
        symlink(sandbox.path(file), sandbox.path(&map)).unwrap();
        let map = sandbox.path(&map);
        // Which maps there are is looked up first, and what is no file is none of them.
        for (words, sentence) in [
            (["--map", map.to_str().unwrap()], "not found"),
            (["--journal", sandbox.path(file).to_str().unwrap()], kind),
        ] {
            let ended = spawn_daemon(&sandbox, SMALL_RIG, &words).wait();
            let which = format!("simd {words:?}: {:?}", ended.lines);
            assert!((1..101).contains(&ended.code()), "{which}");
            assert!(ended.says(sentence), "{which}");
        }
    }
}
