//! `gantry up` with the real programs, as a user starts it: files that are whole, exit codes,
//! nothing left behind.

use std::path::Path;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use test_e2e::recording::{gapless, sequences};
use test_e2e::{SMALL_RIG, SMALL_RIG_TOPICS, assert_nothing_left};
use test_kit::{PATIENCE, Process, Sandbox, eventually};

/// The small rig and the processes of the quickstart.
fn pipeline() -> String {
    format!(
        "{SMALL_RIG}
[defaults]
env = {{ DO_NOT_TRACK = \"1\" }}
[process.simd]
cmd = [\"simd\"]
required = true
ready = {{ service = \"world/snapshot\" }}
[process.drive]
cmd = [\"gantry-drive\"]
after = [\"simd\"]
restart = {{ policy = \"on-failure\" }}
"
    )
}

/// Processes whose command line names the sandbox's domain.
fn processes_of(sandbox: &Sandbox) -> Vec<(i32, String)> {
    let entries = std::fs::read_dir("/proc").expect("proc is there");
    let with_command = entries.filter_map(|entry| {
        let pid = entry.ok()?.file_name().to_str()?.parse().ok()?;
        let command = std::fs::read(format!("/proc/{pid}/cmdline")).ok()?;
        Some((pid, String::from_utf8_lossy(&command).replace('\0', " ")))
    });
    let named =
        |(_, command): &(i32, String)| command.split(' ').any(|word| word == sandbox.domain());
    with_command.filter(named).collect()
}

fn pid_of(sandbox: &Sandbox, program: &str) -> Pid {
    let is_it = |command: &str| {
        command
            .split(' ')
            .next()
            .is_some_and(|first| first.rsplit('/').next() == Some(program))
    };
    eventually(&format!("{program} runs"), || {
        processes_of(sandbox)
            .into_iter()
            .find(|(_, command)| is_it(command))
            .map(|(pid, _)| Pid::from_raw(pid))
    })
}

fn assert_clean(sandbox: &Sandbox) {
    assert_eq!(processes_of(sandbox), Vec::new());
    assert_nothing_left(sandbox);
}

fn assert_whole_files(sandbox: &Sandbox) {
    let found = sequences(&sandbox.path("drive.mcap"));
    assert!(gapless(&found, "/world/snapshot").1 > 5);
    for topic in SMALL_RIG_TOPICS {
        let (first, last) = gapless(&found, &format!("/{topic}/gantry"));
        assert!(
            first == 1 && last > 3,
            "{topic} goes from {first} to {last}"
        );
    }
    let bytes = std::fs::read(sandbox.path("drive.rrd")).unwrap();
    assert!(
        bytes.starts_with(b"RRF2") && bytes.len() > 100_000,
        "{} bytes",
        bytes.len()
    );
    let parts = std::fs::read_dir(sandbox.dir())
        .unwrap()
        .flatten()
        .filter(|entry| entry.file_name().to_string_lossy().ends_with(".part"));
    assert_eq!(parts.count(), 0);
}

fn size(path: &Path) -> u64 {
    std::fs::metadata(path).map_or(0, |file| file.len())
}

#[test]
fn some_seconds_give_a_recording_and_a_view_and_leave_nothing() {
    let sandbox = Sandbox::new("up");
    sandbox
        .up(
            &pipeline(),
            &[
                "--for",
                "5s",
                "--record",
                "drive.mcap",
                "--view",
                "save:drive.rrd",
            ],
        )
        .wait()
        .expect_code(0);
    assert_whole_files(&sandbox);
    assert_clean(&sandbox);
}

#[test]
fn ctrl_c_in_the_middle_ends_well_with_whole_files() {
    let sandbox = Sandbox::new("ctrl-c");
    let gantry = sandbox.up(
        &pipeline(),
        &["--record", "drive.mcap", "--view", "save:drive.rrd"],
    );
    // The map and some frames; the viewer writes as it goes.
    eventually("files grow", || {
        (size(&sandbox.path("drive.mcap.part")) > 5_000_000
            && size(&sandbox.path("drive.rrd")) > 500_000)
            .then_some(())
    });
    gantry.signal(Signal::SIGINT);
    gantry.wait().expect_code(0);
    assert_whole_files(&sandbox);
    assert_clean(&sandbox);
}

#[test]
fn a_killed_simulator_ends_the_pipeline_with_a_failure_and_no_leftovers() {
    let sandbox = Sandbox::new("up-kill");
    let mut gantry = sandbox.up(&pipeline(), &["--view", "save:drive.rrd"]);
    gantry.wait_line("processes are up");
    kill(pid_of(&sandbox, "simd"), Signal::SIGKILL).unwrap();
    let ended = gantry.wait();
    assert_ne!(ended.code(), 0, "{:?}", ended.lines);
    assert!(ended.says("simd is required"), "{:?}", ended.lines);
    assert_clean(&sandbox);
}

#[test]
fn a_killed_driver_is_restarted_and_drives_on() {
    let sandbox = Sandbox::new("up-driver");
    let mut gantry = sandbox.up(&pipeline(), &["--view", "none"]);
    gantry.wait_line("driving vehicles=5");
    let first = pid_of(&sandbox, "gantry-drive");
    kill(first, Signal::SIGKILL).unwrap();
    gantry.wait_line("drive ended with signal SIGKILL");
    eventually("it drives again", || {
        (gantry
            .lines()
            .iter()
            .filter(|line| line.contains("driving vehicles=5"))
            .count()
            >= 2)
            .then_some(())
    });
    assert_ne!(pid_of(&sandbox, "gantry-drive"), first);
    gantry.stop().expect_code(0);
    assert_clean(&sandbox);
}

/// A GPU that fails ends the daemon; it is started again, and the driver drives on.
#[test]
fn a_daemon_whose_gpu_fails_is_restarted_and_its_clients_go_on() {
    let sandbox = Sandbox::new("up-gpu");
    let file = sandbox.path("lose");
    let launch = pipeline().replace(
        "cmd = [\"simd\"]\nrequired = true\n",
        &format!(
            "cmd = [\"simd\", \"--lose-gpu-when\", {file:?}]\nrestart = {{ policy = \"on-failure\" }}\n"
        ),
    );
    let mut gantry = sandbox.up(&launch, &["--view", "none"]);
    gantry.wait_line("driving vehicles=5");
    let driver = pid_of(&sandbox, "gantry-drive");
    std::fs::write(&file, "").unwrap();
    gantry.wait_line("simd ended with exit code 4");
    eventually("it is driven again", || {
        let lines = gantry.lines();
        let n = lines
            .iter()
            .filter(|line| line.contains("driving vehicles=5"));
        (n.count() >= 2).then_some(())
    });
    assert_eq!(pid_of(&sandbox, "gantry-drive"), driver);
    gantry.stop().expect_code(0);
    assert_clean(&sandbox);
}

#[test]
fn a_dry_run_tells_everything_and_starts_nothing() {
    let sandbox = Sandbox::new("up-dry");
    let ended = sandbox
        .up(
            &pipeline(),
            &[
                "--dry-run",
                "--record",
                "drive.mcap",
                "--set",
                "scenario.seed=9",
            ],
        )
        .wait()
        .expect_code(0);
    for text in [
        "seed = 9",
        "[sensor.roof]",
        "Shared memory",
        "ego/front/rgb (frames of up to 24576 bytes; 8 readers, 2 wait and 3 are held)",
    ] {
        assert!(ended.says(text), "{text:?} is not in {:?}", ended.lines);
    }
    assert!(!sandbox.path("drive.mcap.part").exists() && !sandbox.path("drive.mcap").exists());
    assert_eq!(sandbox.leftovers(), Vec::<String>::new());
}

#[test]
fn what_is_wrong_is_said_before_anything_starts() {
    let sandbox = Sandbox::new("up-wrong");
    let ended = sandbox
        .up(&pipeline().replace("rate_hz = 10", "rate_hs = 10"), &[])
        .wait()
        .expect_code(2);
    assert!(
        ended.says("unknown key \"rate_hs\"") && ended.says("did you mean \"rate_hz\"?"),
        "{:?}",
        ended.lines
    );
    let ended = sandbox
        .up(
            &pipeline().replace("\"gantry-drive\"", "\"gantry-drove\""),
            &[],
        )
        .wait()
        .expect_code(2);
    assert!(
        ended.says("there is no program \"gantry-drove\""),
        "{:?}",
        ended.lines
    );
    let ended = sandbox
        .up(&pipeline(), &["--set", "sensor.front.rate_hz=7"])
        .wait()
        .expect_code(2);
    assert!(ended.says("rate_hz"), "{:?}", ended.lines);
    std::fs::write(sandbox.path("there.mcap"), "mine").unwrap();
    let ended = sandbox
        .up(&pipeline(), &["--record", "there.mcap", "--for", "1s"])
        .wait();
    assert_ne!(ended.code(), 0, "{:?}", ended.lines);
    assert_eq!(
        std::fs::read_to_string(sandbox.path("there.mcap")).unwrap(),
        "mine",
        "nobody's file is overwritten"
    );
    assert_clean(&sandbox);
}

/// `./gantry` in a folder of its own, with a cargo that "builds" by handing out the programs that
/// are built already; the viewer's build waits for a file `go`, and fails if there is one `fail`.
fn first_run(sandbox: &Sandbox, more: &[&str]) -> Process {
    use std::os::unix::fs::PermissionsExt as _;
    let tree = sandbox.path("tree");
    for folder in ["bin", "target/release"] {
        std::fs::create_dir_all(tree.join(folder)).expect("a folder");
    }
    let repository = test_kit::sandbox::repository();
    for file in ["gantry", "requirements.txt"] {
        std::fs::copy(repository.join(file), tree.join(file)).expect("a copy");
    }
    std::os::unix::fs::symlink(repository.join(".venv"), tree.join(".venv")).expect("a link");
    let built = test_kit::sandbox::binary_path("simd");
    let built = built.parent().expect("a program is in a folder").display();
    let cargo = format!(
        "#!/bin/sh\necho \"cargo $*\" >>../cargo.log\n\
         give() {{ for name; do cp -f {built}/$name target/release/.$name && mv target/release/.$name target/release/$name; done; }}\n\
         case \"$*\" in\n\
         --version*) echo 'cargo 9.9.9 (made up)' ;;\n\
         *--bin=simd*) give simd gantry gantry-drive ;;\n\
         *--bin=gantry-desk*) give gantry-desk ;;\n\
         *--bin=gantry-view*) printf '   Building [===>   ] 7/9: made-up\\r' >&2\n\
         until [ -e ../go ]; do sleep 0.1; done\n\
         [ ! -e ../fail ] || {{ echo 'error: could not compile `made-up`' >&2; exit 101; }}\n\
         give gantry-view ;;\n\
         esac\n"
    );
    let file = tree.join("bin/cargo");
    std::fs::write(&file, cargo).expect("a program");
    std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o755)).expect("ours");
    let drive = sandbox.path("drive.rrd");
    let launch = sandbox.write(
        "test.toml",
        &format!(
            "{}[process.view]\ncmd = [\"gantry-view\", \"--save\", {:?}]\nafter = [\"simd\"]\n",
            pipeline(),
            drive.to_str().unwrap()
        ),
    );
    let data = sandbox.path("data");
    let words = [
        "up",
        launch.to_str().unwrap(),
        "--data",
        data.to_str().unwrap(),
        "--domain",
        sandbox.domain(),
    ];
    let path = format!(
        "{}:{}",
        tree.join("bin").display(),
        std::env::var("PATH").expect("there is one")
    );
    let target = tree.join("target");
    let env = [
        ("PATH", path.as_str()),
        ("CARGO_TARGET_DIR", target.to_str().unwrap()),
    ];
    let words = [&words[..], more].concat();
    sandbox.spawn_program("./gantry", &tree.join("gantry"), &words, &env)
}

/// Whether what a line of output names is a page for a browser.
fn assert_is_a_page(line: &str) {
    use std::io::{Read as _, Write as _};
    let (_, address) = line.split_once("http://").expect("an address");
    let (host, path) = address.trim().split_once('/').expect("a path");
    let mut browser = std::net::TcpStream::connect(host).expect("somebody listens");
    browser
        .set_read_timeout(Some(PATIENCE))
        .expect("a time above 0");
    write!(
        browser,
        "GET /{path} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n\r\n"
    )
    .expect("it takes the question");
    let mut answer = String::new();
    browser.read_to_string(&mut answer).expect("an answer");
    assert!(answer.starts_with("HTTP/1.1 200"), "{answer}");
    assert!(
        answer.contains("<!doctype html>") || answer.contains("<!DOCTYPE html>"),
        "{answer}"
    );
}

#[test]
fn the_world_runs_while_the_viewer_is_built_and_the_viewer_joins() {
    let sandbox = Sandbox::new("first_run");
    let mut up = first_run(&sandbox, &[]);
    up.wait_line("the world starts now; its viewer is still being built");
    up.wait_line("gantry-view is being built: 7 of 9 crates");
    pid_of(&sandbox, "simd");
    assert!(
        !sandbox.path("drive.rrd").exists(),
        "no viewer shows it yet"
    );
    up.wait_line("until the viewer is there, the world is on a page");
    let page = up.wait_line("open http://127.0.0.1:");
    assert_is_a_page(&page);
    let desk = pid_of(&sandbox, "gantry-desk");
    sandbox.write("go", "");
    let drive = sandbox.path("drive.rrd");
    eventually("the viewer has joined", || {
        drive
            .metadata()
            .is_ok_and(|file| file.len() > 10_000)
            .then_some(())
    });
    assert_eq!(
        pid_of(&sandbox, "gantry-desk"),
        desk,
        "who looks at it goes on"
    );
    kill(pid_of(&sandbox, "gantry"), Signal::SIGINT).expect("it runs");
    up.wait().expect_code(0);
    eventually("the page ends with the run", || {
        kill(desk, None).is_err().then_some(())
    });
    assert_clean(&sandbox);
    let asked = std::fs::read_to_string(sandbox.path("cargo.log")).expect("cargo was asked");
    let [world, desk, viewer] = ["simd", "gantry-desk", "gantry-view"].map(|program| {
        let found = asked.find(&format!("--bin={program}"));
        found.unwrap_or_else(|| panic!("{program} was built: {asked}"))
    });
    assert!(world < desk && desk < viewer, "{asked}");

    // The second time everything is there: nothing is built in the background.
    std::fs::remove_file(sandbox.path("tree/.venv")).unwrap();
    let again = first_run(&sandbox, &["--dry-run"]).wait().expect_code(0);
    assert!(!again.says("is still being built"), "{:?}", again.lines);
    let asked_again = std::fs::read_to_string(sandbox.path("cargo.log")).unwrap();
    let news = &asked_again[asked.len()..];
    assert!(
        !news.lines().any(|line| line.ends_with("--workspace")),
        "{news}"
    );
}

#[test]
fn a_viewer_that_cannot_be_built_is_a_sentence_and_the_world_goes_on() {
    let sandbox = Sandbox::new("first_run_fails");
    sandbox.write("go", "");
    sandbox.write("fail", "");
    let mut up = first_run(&sandbox, &[]);
    up.wait_line("gantry-view could not be built, so that nothing shows this run");
    assert!(
        up.lines()
            .iter()
            .any(|line| line.contains("could not compile `made-up`"))
    );
    up.wait_line("view ended with exit code 1");
    assert!(up.is_running(), "the world goes on");
    kill(pid_of(&sandbox, "gantry"), Signal::SIGINT).expect("it runs");
    up.wait();
    assert_clean(&sandbox);
}
