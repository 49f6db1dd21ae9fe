//! A watchdog over the tests of this program: one that never ends would take the others' results
//! with it. Tests run in the order of their names, so that this one comes first.

use std::fmt::Write as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use nix::sys::signal::{Signal, kill};
use nix::unistd::{Pid, SysconfVar, sysconf};
use test_kit::eventually;

/// Far longer than any test takes.
const LONGEST_TEST: Duration = Duration::from_secs(20 * 60);
const ROUND: Duration = Duration::from_secs(10);

/// A thread of this process, or another process.
#[derive(Debug)]
struct Task {
    id: i32,
    name: String,
    /// `R`, `S`, `D`, `T`, `t` or `Z`, as `ps` says them.
    state: String,
    parent: i32,
    age: Duration,
    place: PathBuf,
}

impl Task {
    /// Reads `/proc/…/stat`; `None` if it has ended.
    fn read(place: &Path) -> Option<Task> {
        let text = std::fs::read_to_string(place.join("stat")).ok()?;
        let (id, rest) = text.split_once(" (")?;
        let (name, rest) = rest.rsplit_once(") ")?;
        let fields: Vec<&str> = rest.split(' ').collect();
        let began: u64 = fields.get(19)?.parse().ok()?;
        let per_second = sysconf(SysconfVar::CLK_TCK).ok()??;
        let uptime = std::fs::read_to_string("/proc/uptime").ok()?;
        let uptime_s: f64 = uptime.split(' ').next()?.parse().ok()?;
        let age_s = uptime_s - began as f64 / per_second as f64;
        Some(Task {
            id: id.parse().ok()?,
            name: name.to_owned(),
            state: (*fields.first()?).to_owned(),
            parent: fields.get(1)?.parse().ok()?,
            age: Duration::from_secs_f64(age_s.max(0.0)),
            place: place.to_owned(),
        })
    }

    fn all_in(folder: &str) -> Vec<Task> {
        let entries = std::fs::read_dir(folder).expect("procfs");
        let entries = entries.flatten().map(|entry| entry.path());
        entries.filter_map(|place| Task::read(&place)).collect()
    }

    fn file(&self, name: &str) -> String {
        let text = std::fs::read_to_string(self.place.join(name)).unwrap_or_default();
        text.replace(['\0', '\n'], " ")
    }
}

/// Threads of tests, and those that they started, that are older than `limit`. They are called by
/// the beginning of the test's path.
fn late_threads(limit: Duration) -> Vec<Task> {
    let mut threads = Task::all_in("/proc/self/task");
    threads.retain(|thread| thread.name.contains("::") && thread.age > limit);
    threads
}

/// The processes that this one started, and those that they started.
fn descendants() -> Vec<Task> {
    let mut others = Task::all_in("/proc");
    let mut found: Vec<Task> = Vec::new();
    loop {
        let own = std::process::id() as i32;
        let is_ours =
            |task: &Task| task.parent == own || found.iter().any(|parent| parent.id == task.parent);
        let (more, rest): (Vec<Task>, Vec<Task>) = others.into_iter().partition(is_ours);
        if more.is_empty() {
            return found;
        }
        found.extend(more);
        others = rest;
    }
}

fn report(threads: &[Task], processes: &[Task]) -> String {
    let mut text = format!("tests have run for more than {LONGEST_TEST:?}:\n");
    for task in threads.iter().chain(processes) {
        let Task {
            id,
            name,
            state,
            parent,
            age,
            ..
        } = task;
        let [line, place, stack] = ["cmdline", "wchan", "stack"].map(|file| task.file(file));
        let age_s = age.as_secs();
        let _ = writeln!(
            text,
            "{id} of {parent}, {name}, state {state}, {age_s} s, in {place} ({stack}): {line}"
        );
    }
    text
}

fn watch() -> ! {
    loop {
        std::thread::sleep(ROUND);
        let late = late_threads(LONGEST_TEST);
        if late.is_empty() {
            continue;
        }
        let processes = descendants();
        eprintln!("{}", report(&late, &processes));
        for process in processes {
            let _ = kill(Pid::from_raw(process.id), Signal::SIGKILL);
        }
        std::process::exit(101);
    }
}

#[test]
fn a_test_that_never_ends_is_named_and_ended() {
    let (end, ended) = std::sync::mpsc::channel::<()>();
    let waiting = std::thread::Builder::new()
        .name("a_watchdog::it".into())
        .spawn(move || {
            let _ = ended.recv();
        })
        .expect("a thread");
    let mut child = std::process::Command::new("sleep")
        .arg("600")
        .spawn()
        .expect("sleep is there");
    eventually("the thread and the process are listed", || {
        let threads = late_threads(Duration::from_millis(200));
        let is_listed = threads.iter().any(|it| it.name == "a_watchdog::it");
        let processes = descendants();
        let is_child = processes.iter().any(|it| it.id == child.id() as i32);
        let text = report(&threads, &processes);
        (is_listed && is_child && text.contains("sleep 600")).then_some(())
    });
    assert!(late_threads(LONGEST_TEST).is_empty(), "it has just begun");
    child.kill().expect("it runs");
    child.wait().expect("it was started here");
    drop(end);
    waiting.join().expect("it does not panic");
    // A name of its own, or it would be taken for a thread of this test.
    std::thread::Builder::new()
        .name("watchdog".into())
        .spawn(|| watch())
        .expect("a thread");
}
