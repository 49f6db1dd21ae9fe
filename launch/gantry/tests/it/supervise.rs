//! `gantry up` with small shell commands as processes: start, readiness, restart, exit codes,
//! ordered stop, nothing left behind.
//!
//! The tests wait for conditions, never for times. A process is gone when `/proc` does not have its
//! pid, or has it as a zombie.

use std::path::Path;

use nix::sys::signal::{Signal, kill};
use nix::unistd::Pid;
use test_kit::{Process, Sandbox, eventually};

/// A script that writes its pid into the file `NAME.pid` and sleeps for ever.
const SLEEPER: &str = "echo $$ > NAME.pid; exec sleep 100000";
/// A script that ignores INT and TERM.
const MULE: &str = "trap \"\" INT TERM; echo $$ > NAME.pid; while :; do sleep 0.01; done";

fn up(sandbox: &Sandbox, launch: &str, more: &[&str]) -> Process {
    sandbox.up(&format!("version = 1\n{launch}"), more)
}

/// A process of the launch file that runs a shell script.
fn process(name: &str, script: &str, more: &str) -> String {
    let script = script.replace("NAME", name);
    format!("[process.{name}]\ncmd = ['sh', '-c', '''{script}''']\n{more}\n")
}

fn text(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap_or_default()
}

fn pid_in(sandbox: &Sandbox, file: &str) -> i32 {
    eventually(&format!("a pid in {file}"), || {
        text(&sandbox.path(file)).trim().parse().ok()
    })
}

fn is_gone(pid: i32) -> bool {
    let stat = text(Path::new(&format!("/proc/{pid}/stat")));
    stat.is_empty()
        || stat
            .rsplit(')')
            .next()
            .is_some_and(|rest| rest.trim_start().starts_with('Z'))
}

fn wait_gone(pid: i32) {
    eventually(&format!("pid {pid} is gone"), || is_gone(pid).then_some(()));
}

#[test]
fn the_exit_code_of_a_required_process_ends_everything_and_is_passed_on() {
    let sandbox = Sandbox::new("required");
    let launch = process(
        "other",
        SLEEPER,
        "ready = { line = 'never', within = '1h' }",
    ) + &process(
        "main",
        "while [ ! -s other.pid ]; do sleep 0.01; done; exit 7",
        "required = true",
    );
    let ended = up(&sandbox, &launch, &[]).wait().expect_code(7);
    assert!(
        ended.says("main is required; stopping"),
        "{:?}",
        ended.lines
    );
    assert!(is_gone(pid_in(&sandbox, "other.pid")));
}

#[test]
fn a_failing_process_is_restarted_up_to_its_limit() {
    let sandbox = Sandbox::new("restart");
    let restart = "restart = { policy = 'on-failure', delay = '1ms', max_delay = '3ms', max = 3, window = '1h' }";
    let ended = up(
        &sandbox,
        &process("flaky", "echo start >> starts; exit 1", restart),
        &[],
    )
    .wait()
    .expect_code(1);
    assert_eq!(
        text(&sandbox.path("starts")).lines().count(),
        4,
        "one start and three restarts"
    );
    assert!(
        ended.says("restarting flaky in 1 ms (1 of 3)")
            && ended.says("restarting flaky in 3 ms (3 of 3)"),
        "{:?}",
        ended.lines
    );
    assert!(
        ended.says("flaky was restarted 3 times within 3600s; giving up, its log is"),
        "{:?}",
        ended.lines
    );
}

#[test]
fn a_process_that_ends_well_is_not_restarted_on_failure() {
    let sandbox = Sandbox::new("once");
    let launch = process(
        "once",
        "echo start >> starts",
        "restart = { policy = 'on-failure', delay = '1ms' }",
    );
    up(&sandbox, &launch, &[]).wait().expect_code(0);
    assert_eq!(text(&sandbox.path("starts")).lines().count(), 1);
}

#[test]
fn a_killed_child_is_restarted_and_the_others_go_on() {
    let sandbox = Sandbox::new("kill9");
    let launch = process(
        "a",
        SLEEPER,
        "restart = { policy = 'on-failure', delay = '1ms' }",
    ) + &process("b", SLEEPER, "");
    let mut gantry = up(&sandbox, &launch, &[]);
    let (a, b) = (pid_in(&sandbox, "a.pid"), pid_in(&sandbox, "b.pid"));
    kill(Pid::from_raw(a), Signal::SIGKILL).unwrap();
    gantry.wait_line("a ended with signal SIGKILL");
    let again = eventually("a second pid", || {
        Some(pid_in(&sandbox, "a.pid")).filter(|pid| *pid != a)
    });
    assert!(!is_gone(b));
    gantry.stop().expect_code(0);
    wait_gone(again);
    wait_gone(b);
}

#[test]
fn ctrl_c_stops_readers_before_what_they_read() {
    let sandbox = Sandbox::new("order");
    let script = "trap \"echo NAME >> order; exit 0\" INT; echo up; while :; do sleep 0.01; done";
    let launch = process("source", script, "ready = { line = '^up$' }")
        + &process(
            "reader",
            script,
            "after = ['source']\nready = { line = '^up$' }",
        )
        + &process(
            "last",
            script,
            "after = ['reader']\nready = { line = '^up$' }",
        );
    let mut gantry = up(&sandbox, &launch, &[]);
    gantry.wait_line("all 3 processes are up");
    gantry.signal(Signal::SIGINT);
    gantry.wait().expect_code(0);
    assert_eq!(text(&sandbox.path("order")), "last\nreader\nsource\n");
}

#[test]
fn those_that_come_after_start_when_the_line_has_been_said() {
    let sandbox = Sandbox::new("after");
    let launch = process(
        "second",
        "test -e made || exit 9",
        "after = ['first']\nrequired = true",
    ) + &process(
        "first",
        "sleep 0.1; touch made; echo it is READY now; exec sleep 100000",
        "ready = { line = 'READY' }",
    );
    let ended = up(&sandbox, &launch, &[]).wait().expect_code(0);
    assert!(ended.says("first is ready after"), "{:?}", ended.lines);
}

#[test]
fn a_port_can_be_the_sign_of_readiness() {
    let sandbox = Sandbox::new("tcp");
    let listener = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let ready = format!("ready = {{ tcp = '{}' }}", listener.local_addr().unwrap());
    let launch = process("server", SLEEPER, &ready)
        + &process("client", "exit 0", "after = ['server']\nrequired = true");
    up(&sandbox, &launch, &[]).wait().expect_code(0);
}

#[test]
fn what_never_gets_ready_ends_the_pipeline_with_a_sentence() {
    let sandbox = Sandbox::new("unready");
    let launch = process(
        "slow",
        SLEEPER,
        "ready = { service = 'world/snapshot', within = '300ms' }",
    ) + &process("b", "exit 0", "after = ['slow']");
    let ended = up(&sandbox, &launch, &[]).wait().expect_code(1);
    assert!(ended.says("process slow was not ready within 0.3 s: there was no sign of a writer of world/snapshot"), "{:?}", ended.lines);
    assert!(!ended.says("started b"), "{:?}", ended.lines);
}

#[test]
fn a_process_that_fails_while_others_wait_for_it_ends_the_pipeline() {
    let sandbox = Sandbox::new("waited");
    let launch = process("first", "exit 4", "ready = { line = 'never' }")
        + &process("second", SLEEPER, "after = ['first']");
    let ended = up(&sandbox, &launch, &[]).wait().expect_code(1);
    assert!(
        ended.says("others wait for first; stopping"),
        "{:?}",
        ended.lines
    );
}

#[test]
fn one_that_ignores_signals_is_killed_after_its_grace_and_said_so() {
    let sandbox = Sandbox::new("stubborn");
    let gantry = up(
        &sandbox,
        &process("mule", MULE, "stop = { grace = '10ms' }"),
        &[],
    );
    let pid = pid_in(&sandbox, "mule.pid");
    let ended = gantry.stop().expect_code(1);
    assert!(
        ended.says("mule did not end after SIGINT; sending SIGTERM")
            && ended.says("sending SIGKILL"),
        "{:?}",
        ended.lines
    );
    wait_gone(pid);
}

#[test]
fn a_second_ctrl_c_kills_at_once() {
    let sandbox = Sandbox::new("twice");
    let mut gantry = up(
        &sandbox,
        &process("mule", MULE, "stop = { grace = '24h' }"),
        &[],
    );
    let pid = pid_in(&sandbox, "mule.pid");
    gantry.signal(Signal::SIGINT);
    gantry.wait_line("once more kills at once");
    gantry.signal(Signal::SIGINT);
    gantry.wait().expect_code(1);
    wait_gone(pid);
}

#[test]
fn children_of_children_go_with_their_group() {
    let sandbox = Sandbox::new("group");
    up(
        &sandbox,
        &process(
            "parent",
            "sleep 100000 & echo $! > grandchild.pid; exit 0",
            "",
        ),
        &[],
    )
    .wait()
    .expect_code(0);
    wait_gone(pid_in(&sandbox, "grandchild.pid"));
}

#[test]
fn a_killed_launcher_takes_its_children_with_it() {
    let sandbox = Sandbox::new("orphan");
    let gantry = up(&sandbox, &process("a", SLEEPER, ""), &[]);
    let pid = pid_in(&sandbox, "a.pid");
    gantry.kill9();
    wait_gone(pid);
}

#[test]
fn the_time_given_ends_the_run_well() {
    let sandbox = Sandbox::new("for");
    let ended = up(
        &sandbox,
        &process("a", SLEEPER, "ready = { line = 'up' }").replace("exec", "echo up; exec"),
        &["--for", "50ms"],
    )
    .wait()
    .expect_code(0);
    assert!(ended.says("0.05 s are over; stopping"), "{:?}", ended.lines);
    wait_gone(pid_in(&sandbox, "a.pid"));
}

#[test]
fn lost_data_is_exit_code_3() {
    let sandbox = Sandbox::new("lost");
    let launch = process(
        "recorder",
        "trap \"exit 3\" INT; echo up; while :; do sleep 0.01; done",
        "ready = { line = 'up' }",
    );
    let mut gantry = up(&sandbox, &launch, &[]);
    gantry.wait_line("all 1 processes are up");
    gantry.stop().expect_code(3);
}

#[test]
fn lines_are_prefixed_on_the_terminal_and_kept_in_a_file_each() {
    let sandbox = Sandbox::new("logs");
    let launch = process("talker", "echo hello from ${name}; echo oh >&2", "")
        + &process("quiet_one", "exit 0", "");
    let ended = up(&sandbox, &launch, &[]).wait().expect_code(0);
    assert!(
        ended
            .lines
            .contains(&"talker    │ hello from talker".to_owned()),
        "{:?}",
        ended.lines
    );
    let run = sandbox.path("data/runs/latest");
    let log = text(&run.join("talker.log"));
    assert!(
        log.contains(" hello from talker\n")
            && log.contains(" oh\n")
            && log.contains("ended with exit code 0"),
        "{log}"
    );
    assert!(text(&run.join("launch.toml")).contains("[process.talker]"));
}

#[test]
fn mistakes_are_found_before_anything_starts() {
    let sandbox = Sandbox::new("mistakes");
    let launch = "[process.a]\ncmd = ['gantry-nothing']\n[process.b]\ncmd = ['touch', 'started']\n";
    let ended = up(&sandbox, launch, &[]).wait().expect_code(2);
    assert!(
        ended.says("error: process a: there is no program \"gantry-nothing\" beside"),
        "{:?}",
        ended.lines
    );
    let ended = up(
        &sandbox,
        "[process.b]\ncmd = ['touch', 'started']\nrequird = true\n",
        &[],
    )
    .wait()
    .expect_code(2);
    assert!(
        ended.says("unknown key \"requird\" in [process.b], did you mean \"required\"?")
            && ended.says("test.toml:4:1"),
        "{:?}",
        ended.lines
    );
    assert!(!sandbox.path("started").exists());
    sandbox
        .spawn("gantry", &["up", "no/such.toml"])
        .wait()
        .expect_code(2);
    sandbox
        .spawn("gantry", &["up", "--for", "soon"])
        .wait()
        .expect_code(2);
}

#[test]
fn a_dry_run_prints_a_launch_file_and_starts_nothing() {
    let sandbox = Sandbox::new("dry");
    let ended = up(
        &sandbox,
        "[process.b]\ncmd = ['touch', 'started']\n",
        &["--dry-run", "--set", "scenario.seed=42"],
    )
    .wait()
    .expect_code(0);
    let printed = ended.lines.join("\n");
    let launch = launch_spec::Launch::parse(&printed, "printed")
        .unwrap_or_else(|errors| panic!("{errors}\n{printed}"));
    assert_eq!(launch.scenario.seed, 42);
    assert!(!sandbox.path("started").exists() && !sandbox.path("data").exists());
}

#[test]
fn nothing_of_the_launcher_stays_in_shared_memory() {
    let sandbox = Sandbox::new("clean");
    let ended = up(&sandbox, &process("a", "exit 0", ""), &[])
        .wait()
        .expect_code(0);
    assert_eq!(
        sandbox.leftovers(),
        Vec::<String>::new(),
        "{:?}",
        ended.lines
    );
}
