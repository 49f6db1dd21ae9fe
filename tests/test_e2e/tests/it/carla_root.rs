//! The folder that stands in for a CARLA: programs start its script, give it CARLA's arguments, and
//! kill it as they kill CARLA.

use std::collections::BTreeSet;
use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::sync::atomic::{AtomicU32, Ordering};

use nix::sys::signal::{Signal, kill, killpg};
use nix::unistd::Pid;
use test_e2e::carla::run_script;
use test_kit::sandbox::binary_path;
use test_kit::{PATIENCE, Process, Sandbox, eventually, output_within};

/// Makes the folder with servers of a small town.
fn make(sandbox: &Sandbox) -> PathBuf {
    let root = sandbox.path("carla");
    let data = sandbox.path("data");
    let [dir, data] = [&root, &data].map(|path| path.to_str().expect("paths are UTF-8"));
    sandbox
        .spawn("gantry", &["carla-root", dir, "--data", data])
        .wait()
        .expect_code(0);
    root
}

/// Two ports beside each other that are free now and nobody else's in this process. They are below
/// those that the kernel gives to connections, so that no client takes one of them before a server
/// begins, or between two.
fn two_ports() -> u16 {
    static NEXT: AtomicU32 = AtomicU32::new(0);
    let is_free = |port| TcpListener::bind(("127.0.0.1", port)).is_ok();
    eventually("two ports beside each other", || {
        let number = std::process::id() + NEXT.fetch_add(1, Ordering::Relaxed);
        let port = 20_000 + 2 * (number % 6_000) as u16;
        (is_free(port) && is_free(port + 1)).then_some(port)
    })
}

/// A caller as evaluators are: a shell in a session of its own starts the script and waits for it.
fn start(sandbox: &Sandbox, root: &Path, port: u16, more: &str) -> Process {
    let line = format!(
        "{}/CarlaUE4.sh -RenderOffScreen -nosound -carla-rpc-port={port} -graphicsadapter=0 {more} ; exit $?",
        root.display()
    );
    let mut process =
        sandbox.spawn_program("caller", Path::new("setsid"), &["sh", "-c", &line], &[]);
    process.wait_line(&format!("listening on 127.0.0.1:{port}"));
    process
}

/// Kills the process group of a caller.
fn kill_group(process: &Process) {
    killpg(Pid::from_raw(process.pid().cast_signed()), Signal::SIGKILL).expect("the group lives");
}

/// Processes whose command line names this domain or port.
fn processes_of(port: u16) -> BTreeSet<i32> {
    let mut found = BTreeSet::new();
    for entry in std::fs::read_dir("/proc").expect("/proc").flatten() {
        let Some(pid) = entry
            .file_name()
            .to_str()
            .and_then(|name| name.parse().ok())
        else {
            continue;
        };
        let words = std::fs::read(entry.path().join("cmdline")).unwrap_or_default();
        let line = String::from_utf8_lossy(&words).replace('\0', " ");
        if line.contains(&format!("carla_{port}"))
            || line.contains(&format!("-carla-rpc-port={port}"))
        {
            found.insert(pid);
        }
    }
    found
}

/// Nothing of these servers runs, and nothing is left in shared memory or of iceoryx2's files.
/// Nobody cleans up here: the servers did.
fn assert_gone(sandbox: &Sandbox, ports: &[u16]) {
    for port in ports {
        eventually("all processes of a server have ended", || {
            processes_of(*port).is_empty().then_some(())
        });
    }
    assert_eq!(sandbox.leftovers(), Vec::<String>::new());
    let left = files_below(&sandbox.iceoryx_root());
    assert!(left.is_empty(), "{left:?}");
}

fn files_below(folder: &Path) -> Vec<PathBuf> {
    let Ok(entries) = folder.read_dir() else {
        return Vec::new();
    };
    let below = |entry: std::fs::DirEntry| {
        let path = entry.path();
        if path.is_dir() {
            files_below(&path)
        } else {
            vec![path]
        }
    };
    entries.flatten().flat_map(below).collect()
}

#[test]
fn two_servers_are_driven_and_killed_by_process_group() {
    let sandbox = Sandbox::new("carlaroot");
    let root = make(&sandbox);
    let (a, b) = (two_ports(), two_ports());
    let first = start(
        &sandbox,
        &root,
        a,
        "-quality-level=Low /Game/Carla/Maps/Town02",
    );
    let second = start(&sandbox, &root, b, "-benchmark -fps=10 Town01");
    let ports = [a.to_string(), b.to_string()];
    let themes = ["two worlds", "driving apart"];
    run_script(
        &sandbox,
        "carla_two_servers.py",
        &[&ports[0], &ports[1]],
        &themes,
    );

    kill_group(&first);
    // The other server does not notice, and the port can be had again at once.
    let again = start(&sandbox, &root, a, "Town02");
    run_script(
        &sandbox,
        "carla_two_servers.py",
        &[&ports[0], &ports[1]],
        &themes,
    );
    kill_group(&again);
    kill_group(&second);
    assert_gone(&sandbox, &[a, b]);
}

/// `killall -9 -r CarlaUE4-Linux`, as clean-up scripts have it, reaches the front alone.
#[test]
fn a_server_whose_front_is_killed_ends_and_leaves_nothing() {
    let sandbox = Sandbox::new("carlafront");
    let root = make(&sandbox);
    let port = two_ports();
    let caller = start(&sandbox, &root, port, "Town02");
    let front = front_of(port);
    let name = std::fs::read_to_string(format!("/proc/{front}/comm")).unwrap();
    assert_eq!(name.trim(), "CarlaUE4-Linux-");
    kill(Pid::from_raw(front), Signal::SIGKILL).unwrap();
    assert_gone(&sandbox, &[port]);
    drop(caller);
}

/// A signal that can be caught ends the server in order, and the caller learns how it ended.
#[test]
fn a_server_that_is_asked_to_end_does_and_says_so() {
    let sandbox = Sandbox::new("carlaterm");
    let root = make(&sandbox);
    let port = two_ports();
    let caller = start(&sandbox, &root, port, "Town02");
    kill(Pid::from_raw(front_of(port)), Signal::SIGTERM).unwrap();
    caller.wait().expect_code(0);
    assert_gone(&sandbox, &[port]);
}

/// The process that was given CARLA's arguments and is no shell.
fn front_of(port: u16) -> i32 {
    let is_front = |pid: &i32| {
        std::fs::read_to_string(format!("/proc/{pid}/comm"))
            .is_ok_and(|name| name.starts_with("Carla"))
    };
    let found = processes_of(port).into_iter().find(is_front);
    found.expect("a front runs")
}

#[test]
fn arguments_that_cannot_be_end_the_script_with_a_sentence() {
    let sandbox = Sandbox::new("carlaargs");
    let root = make(&sandbox);
    let run = |args: &[&str]| {
        let mut command = Command::new(root.join("CarlaUE4.sh"));
        command.args(args).current_dir(sandbox.dir());
        let output = output_within(&mut command, PATIENCE);
        let text = String::from_utf8_lossy(&output.stderr).into_owned();
        (output.status.code(), text)
    };
    let (code, text) = run(&["-carla-rpc-port=99999"]);
    assert_eq!(code, Some(2), "{text}");
    assert!(
        text.contains("error: -carla-rpc-port=99999 cannot be"),
        "{text}"
    );
    let port = two_ports();
    let (code, text) = run(&[&format!("-carla-rpc-port={port}"), "-dx12", "Atlantis"]);
    assert_eq!(code, Some(2), "{text}");
    assert!(text.contains("warning: -dx12 has no effect"), "{text}");
    assert!(text.contains("Atlantis"), "{text}");
    assert_gone(&sandbox, &[port]);

    // Without the program that it leads to.
    let moved = root.join("CarlaUE4/Binaries/Linux/CarlaUE4-Linux-Shipping");
    assert_eq!(
        moved.canonicalize().unwrap(),
        binary_path("gantry").canonicalize().unwrap()
    );
    std::fs::remove_file(moved).unwrap();
    let (code, text) = run(&[]);
    assert_eq!(code, Some(1), "{text}");
    assert!(text.contains("run `gantry carla-root"), "{text}");
}
