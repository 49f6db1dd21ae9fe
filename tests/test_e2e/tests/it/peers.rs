//! Peers that are idle, silent, stalled, greedy or somebody else's: the gateway and the Traffic
//! Manager serve everybody else meanwhile.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::os::unix::process::ExitStatusExt as _;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use consumer_rpc::budget::MAX_MESSAGE_BYTES;
use consumer_rpc::list;
use consumer_rpc::msgpack::{self, Limits, Value};
use consumer_rpc::seats::STALLED;
use consumer_rpc::server::MAX_RPC_CONNECTIONS;
use nix::sys::signal::Signal;
use schema_frames::Command;
use test_e2e::carla::{Stage, empty_town, start_gateway, start_script};
use test_e2e::{ask, join_bus, not_tested, spawn_consumer, start_daemon};
use test_kit::sandbox::binary_path;
use test_kit::{Process, Sandbox, eventually};

use crate::listener::{self, Listener, connect};

/// Streaming connections that a gateway takes.
const MAX_STREAMS: usize = 1024;
/// A user who is not us.
const NOBODY: &str = "65534";
const WORLD_STREAM: u32 = 1;
/// More than anybody is told.
const ALL: usize = 1 << 16;
const ROOT_ALONE: &str = "only root can become somebody else; run this test as root";

fn request(method: &str, args: &[Value]) -> Vec<u8> {
    listener::request(7, method, args)
}

/// The text of an answer, whatever its form.
fn call(connection: &mut TcpStream, method: &str, args: &[Value]) -> Option<String> {
    connection.write_all(&request(method, args)).ok()?;
    let answer = msgpack::read(connection, Limits::default()).ok()?;
    Some(format!("{answer:?}"))
}

fn is_served(port: u16) -> bool {
    call(&mut connect(port), "version", &[]).is_some_and(|answer| answer.contains("0.9.16"))
}

fn n_files(process: &Process) -> usize {
    let folder = format!("/proc/{}/fd", process.pid());
    std::fs::read_dir(folder).unwrap().count()
}

/// Seconds of processor time so far.
fn worked_secs(process: &Process) -> f64 {
    let stat = std::fs::read_to_string(format!("/proc/{}/stat", process.pid())).unwrap();
    let after_name = stat.rsplit(')').next().unwrap();
    let words: Vec<&str> = after_name.split_ascii_whitespace().collect();
    let ticks = |word: &str| word.parse::<f64>().unwrap();
    (ticks(words[11]) + ticks(words[12])) / 100.0
}

/// Lets a stock client listen and stop so often. That client's own library sometimes decodes a
/// message of which it has received only the length when it is told to stop, and ends in a
/// segmentation fault or an abort; then another client does it.
fn listen(stage: &Stage, n_calls: u32) {
    let (port, n_calls) = (stage.port.to_string(), n_calls.to_string());
    for _ in 0..5 {
        let client = start_script(&stage.sandbox, "carla_peers.py", &[&port, &n_calls]);
        let ended = client.wait_longer(test_kit::PATIENCE * 3);
        let is_its_own_fault = ended.status.signal() == Some(Signal::SIGSEGV as i32)
            || ended.status.signal() == Some(Signal::SIGABRT as i32) && ended.says("bad_cast");
        if !is_its_own_fault {
            assert!(ended.expect_code(0).says("listens passed"));
            return;
        }
        eprintln!("the stock client ended by a message that it had not received");
    }
    panic!("no client listened {n_calls} times");
}

#[test]
fn a_thousand_listens_leave_no_descriptor() {
    let stage = Stage::new("carlalistens", &empty_town("Town02"));
    listen(&stage, 60);
    let mut listener = Listener::new(stage.port);
    listener.listen(1);
    let gateway = stage.gateway();
    let before = n_files(gateway);
    let limits = std::fs::read_to_string(format!("/proc/{}/limits", gateway.pid())).unwrap();
    let line = limits
        .lines()
        .find(|line| line.starts_with("Max open files"));
    let words: Vec<&str> = line.unwrap().split_ascii_whitespace().collect();
    assert_eq!(words[3], words[4], "the soft limit is the hard one");
    for call in 0..1100 {
        listener.listen(if call % 50 == 0 { 2 } else { 0 });
    }
    listener.listen(1);
    // Threads that served the last ones may still end.
    eventually("the descriptors of 1100 calls are closed", || {
        (n_files(stage.gateway()) <= before + 8).then_some(())
    });
    stage.end();
}

/// Starts a gateway that may have so few files open.
fn starved_gateway(sandbox: &Sandbox, files: u32) -> (Process, u16) {
    let gateway = binary_path("gantry-carla");
    let text = format!("ulimit -n {files}; exec {} \"$@\"", gateway.display());
    let domain = sandbox.domain();
    let args = ["-c", &text, "sh", "--port", "0", "--domain", domain];
    let shell = PathBuf::from("/bin/sh");
    let mut process = sandbox.spawn_program("gantry-carla", &shell, &args, &[]);
    let line = process.wait_line("listening on");
    let port = line.split([':', ',']).nth(1).unwrap().parse().unwrap();
    (process, port)
}

/// Connections take no more than their share of the descriptors, so the rest goes on.
#[test]
fn with_few_descriptors_the_gateway_serves_fewer_and_does_not_spin() {
    let sandbox = Sandbox::new("carlastarved");
    let (gateway, port) = starved_gateway(&sandbox, 128);
    let mut held: Vec<TcpStream> = Vec::new();
    for n in 0..200 {
        let mut connection = connect(port);
        let answer = call(&mut connection, "version", &[]);
        assert!(answer.is_some(), "client {n} gets no answer");
        held.push(connection);
    }
    let files = n_files(&gateway);
    assert!(files < 128, "{files} of 128 are open");
    let before = worked_secs(&gateway);
    std::thread::sleep(Duration::from_secs(3));
    let worked = worked_secs(&gateway) - before;
    assert!(worked < 1.0, "it worked for {worked} s of 3");
    // Those who never ask make room, too.
    let silent: Vec<TcpStream> = (0..200).map(|_| connect(port)).collect();
    eventually("a client is served beside silent ones", || {
        is_served(port).then_some(())
    });
    drop((held, silent));
    let said = gateway.stop().expect_code(0);
    assert!(
        said.says("the one that did nothing for longest"),
        "{:?}",
        said.lines
    );
}

#[test]
fn idle_and_stalled_clients_keep_nobody_out() {
    let sandbox = Sandbox::new("carlaidle");
    let daemon = start_daemon(&sandbox, &empty_town("Town02"), &[]);
    let (gateway, port, stream_port) = start_gateway(&sandbox);
    eventually("the world is known", || {
        let answer = call(&mut connect(port), "get_map_data", &[]);
        answer.filter(|answer| answer.len() > 100_000)
    });
    // Idle ones: they asked once. The oldest make room.
    let mut idle: Vec<TcpStream> = Vec::new();
    for _ in 0..MAX_RPC_CONNECTIONS + 20 {
        let mut connection = connect(port);
        call(&mut connection, "version", &[]).expect("an answer");
        idle.push(connection);
    }
    assert!(is_served(port));
    drop(idle);
    // Stalled ones: they never read answers that do not fit the kernel's memory.
    let mut stalled = Vec::new();
    for _ in 0..MAX_RPC_CONNECTIONS {
        let mut connection = connect(port);
        let one = request("get_map_data", &[]);
        let _ = connection.write(&one.repeat(60));
        stalled.push(connection);
    }
    std::thread::sleep(STALLED);
    eventually("a client is served beside stalled ones", || {
        is_served(port).then_some(())
    });
    drop(stalled);
    // Clients of streams that do not exist.
    let unknown: Vec<TcpStream> = (0..MAX_STREAMS + 20)
        .map(|n| {
            let mut connection = connect(stream_port);
            let stream = 1_000_000 + n as u32;
            let _ = connection.write_all(&stream.to_le_bytes());
            connection
        })
        .collect();
    let mut world = connect(stream_port);
    world.write_all(&WORLD_STREAM.to_le_bytes()).unwrap();
    world.read_exact(&mut [0; 64]).expect("a snapshot");
    // One client that listens to the same stream very often.
    drop(unknown);
    let many: Vec<TcpStream> = (0..MAX_STREAMS + 20)
        .map(|_| {
            let mut connection = connect(stream_port);
            let _ = connection.write_all(&77_777u32.to_le_bytes());
            connection
        })
        .collect();
    world.read_exact(&mut [0; 64]).expect("the next snapshot");
    let mut second = connect(stream_port);
    second.write_all(&WORLD_STREAM.to_le_bytes()).unwrap();
    second.read_exact(&mut [0; 64]).expect("a snapshot");
    drop(many);
    gateway.stop().expect_code(0);
    daemon.stop().expect_code(0);
}

#[test]
fn requests_of_all_clients_together_take_only_so_much_memory() {
    let sandbox = Sandbox::new("carlagreedy");
    let (gateway, port, _) = start_gateway(&sandbox);
    assert!(is_served(port));
    let before = gateway.resident_bytes();
    // Requests that are never whole, of just below what one may have.
    let text = vec![b'x'; (16 << 20) - 4096];
    let n_needed = 2 * MAX_MESSAGE_BYTES / text.len();
    let mut head = vec![0x94, 0, 1, 0xdb];
    head.extend(((text.len() + 2048) as u32).to_be_bytes());
    let greedy: Vec<TcpStream> = (0..n_needed)
        .map(|_| {
            let mut connection = connect(port);
            let _ = connection
                .write_all(&head)
                .and_then(|()| connection.write_all(&text));
            connection
        })
        .collect();
    assert!(is_served(port), "small requests are free");
    let grown = gateway.resident_bytes().saturating_sub(before);
    let most = MAX_MESSAGE_BYTES as u64 * 3 / 2;
    assert!(grown < most, "{} MiB of {} MiB", grown >> 20, most >> 20);
    drop(greedy);
    let said = gateway.stop().expect_code(0);
    assert!(said.says("too much memory now"), "{:?}", said.lines);
}

#[test]
fn names_from_outside_fill_no_log() {
    let sandbox = Sandbox::new("carlalog");
    let (gateway, port, _) = start_gateway(&sandbox);
    let name = "x".repeat(8 << 20);
    let host = Value::from("h".repeat(8 << 20));
    for manager_port in 1..=60u16 {
        let mut connection = connect(port);
        assert!(call(&mut connection, &name, &[]).is_some());
        let place = Value::Array(vec![host.clone(), manager_port.into()]);
        assert!(call(&mut connection, "add_traffic_manager_running", &[place]).is_some());
    }
    let said = gateway.stop().expect_code(0);
    assert!(
        said.says("8388608 bytes"),
        "{:.1000}",
        said.lines.join("\n")
    );
    let n_bytes: usize = said.lines.iter().map(String::len).sum();
    assert!(n_bytes < 64 << 10, "{n_bytes} bytes of log");
}

/// The kernel asks peers that are silent whether they are there.
#[test]
fn connections_are_kept_alive_or_ended() {
    let sandbox = Sandbox::new("carlakeepalive");
    let (gateway, port, stream_port) = start_gateway(&sandbox);
    for port in [port, stream_port] {
        let connection = connect(port);
        let client = connection.local_addr().unwrap().port();
        eventually("the server's end has a keepalive timer", || {
            let list = std::fs::read_to_string("/proc/net/tcp").unwrap();
            let (here, there) = (format!(":{port:04X}"), format!(":{client:04X}"));
            let mut lines = list.lines().map(|line| {
                let words: Vec<String> = line.split_ascii_whitespace().map(Into::into).collect();
                words
            });
            let line =
                lines.find(|words| words[1].ends_with(&here) && words[2].ends_with(&there))?;
            // Timer 2 is that of keepalive.
            line[5].starts_with("02:").then_some(())
        });
    }
    gateway.stop().expect_code(0);
}

/// The first `n_most` bytes that a program of another user gets for a request, or all until the
/// connection ends; `None` if this test is not run by root, who alone can become somebody else.
fn as_nobody(sandbox: &Sandbox, port: u16, bytes: &[u8], n_most: usize) -> Option<String> {
    if !nix::unistd::geteuid().is_root() {
        return None;
    }
    let octal: String = bytes.iter().map(|byte| format!("\\{byte:03o}")).collect();
    let text = format!(
        "exec 3<>/dev/tcp/127.0.0.1/{port}; printf '{octal}' >&3; timeout 60 head -c {n_most} <&3 2>/dev/null | tr -cd '[:print:]'; echo"
    );
    let args = [
        "--reuid",
        NOBODY,
        "--regid",
        NOBODY,
        "--clear-groups",
        "bash",
        "-c",
        &text,
    ];
    let ended = sandbox
        .spawn_program("setpriv", &PathBuf::from("/usr/bin/setpriv"), &args, &[])
        .wait();
    Some(ended.lines.join("\n"))
}

#[test]
fn other_users_are_refused_unless_they_are_let_in() {
    let sandbox = Sandbox::new("carlastrangers");
    let (gateway, port, stream_port) = start_gateway(&sandbox);
    assert!(is_served(port));
    let Some(said) = as_nobody(&sandbox, port, &request("version", &[]), ALL) else {
        let what = "whether other users' programs are refused";
        return not_tested(what, ROOT_ALONE);
    };
    assert!(
        said.contains("answers only that user's programs") && said.contains("--any-user"),
        "{said}"
    );
    let said = as_nobody(&sandbox, stream_port, &WORLD_STREAM.to_le_bytes(), ALL).unwrap();
    assert!(said.trim().is_empty(), "{said}");
    assert!(is_served(port));
    let said = gateway.stop().expect_code(0);
    assert!(said.says("this one is user 65534's"), "{:?}", said.lines);
    let args = ["--port", "0", "--any-user"];
    let mut open = spawn_consumer(&sandbox, "gantry-carla", &args);
    let line = open.wait_line("listening on");
    let port = line.split([':', ',']).nth(1).unwrap().parse().unwrap();
    // The whole answer, after which the connection stays open.
    let said = as_nobody(&sandbox, port, &request("version", &[]), 14).unwrap();
    assert!(said.contains("0.9.16"), "{said}");
    open.stop().expect_code(0);
    // The Traffic Manager's port is a door of the same kind.
    let daemon = start_daemon(&sandbox, &empty_town("Town02"), &[]);
    let free = test_e2e::carla::free_port().to_string();
    let mut drive = spawn_consumer(&sandbox, "gantry-drive", &["--serve", &free]);
    let line = drive.wait_line("listening on");
    let port = line.rsplit(':').next().unwrap().trim().parse().unwrap();
    let mut bytes = Vec::new();
    msgpack::write(
        &mut bytes,
        &list![0u32, 7u32, "health_check_remote_TM", list![]],
    );
    let said = as_nobody(&sandbox, port, &bytes, ALL).unwrap();
    assert!(said.contains("answers only that user's programs"), "{said}");
    drive.stop().expect_code(0);
    daemon.stop().expect_code(0);
}

/// Two users on one machine, and two containers that share `/dev/shm`: each has a simulator, although
/// the first user also took the name of the second one's folder.
#[test]
fn another_users_folder_of_iceoryx2_is_no_obstacle() {
    if !nix::unistd::geteuid().is_root() {
        let what = "whether two users may each have a simulator";
        return not_tested(what, ROOT_ALONE);
    }
    let sandbox = Sandbox::new("twousers");
    let simd = binary_path("simd");
    // In folders for temporary files and shared memory of its own, where nothing is configured.
    let script = format!(
        r#"set -e
mount -t tmpfs none /tmp; mount -t tmpfs none /dev/shm; chmod 1777 /tmp /dev/shm
mount -t tmpfs none /run; mkdir /run/one /run/two; chown {NOBODY} /run/two
printf '%s' "$TEXT" > /run/launch.toml
export HOME=/run/one
cd /run/one
{simd} --launch /run/launch.toml --domain two > /run/one/log 2>&1 & first=$!
until grep -q ready /run/one/log; do sleep 0.1; kill -0 $first; done
mkdir -m 0700 /tmp/iceoryx2-{NOBODY}
cd /run/two
HOME=/run/two setpriv --reuid {NOBODY} --regid {NOBODY} --clear-groups {simd} --launch /run/launch.toml --domain two > /run/two/log 2>&1 & second=$!
for n in $(seq 600); do grep -q ready /run/two/log && break; kill -0 $second 2>/dev/null || break; sleep 0.1; done
echo "the second user's simulator says:"; cat /run/two/log
ls -d /tmp/iceoryx2*
# Another container: its own /tmp, the same /dev/shm, the same user.
unshare -m sh -c 'mount -t tmpfs none /tmp; cd /run/one; {simd} --launch /run/launch.toml --domain two > /run/one/third 2>&1 & third=$!
for n in $(seq 600); do grep -q ready /run/one/third && break; kill -0 $third 2>/dev/null || break; sleep 0.1; done
echo "the other container says:"; cat /run/one/third; kill -INT $third; wait $third || true'
kill -INT $first $second; wait $first; wait $second; echo "both ended well"
"#,
        simd = simd.display(),
    );
    let text = empty_town("Town02");
    let args = ["-m", "bash", "-c", &script];
    let unshare = PathBuf::from("/usr/bin/unshare");
    let ended = sandbox
        .spawn_program("unshare", &unshare, &args, &[("TEXT", &text)])
        .wait();
    let said = ended.lines.join("\n");
    for expected in [
        "belongs to user 0, so the shared-memory bus of user 65534 is in /tmp/iceoryx2-65534-1",
        "/tmp/iceoryx2-65534-1",
        "both ended well",
    ] {
        assert!(said.contains(expected), "{expected:?} is missing:\n{said}");
    }
    assert_eq!(said.matches("ready").count(), 2, "{said}");
}

#[test]
fn clients_and_foreign_files_name_nothing_outside_the_data_folder() {
    let sandbox = Sandbox::new("carlapaths");
    let data = sandbox.path("data");
    let recordings = data.join("recordings/carla");
    std::fs::create_dir_all(&recordings).unwrap();
    std::fs::create_dir_all(data.join("checkpoints")).unwrap();
    let pipe = |path: PathBuf| nix::unistd::mkfifo(&path, nix::sys::stat::Mode::S_IRWXU).unwrap();
    pipe(recordings.join("pipe.log"));
    pipe(data.join("checkpoints/pipe.gckp"));
    // Recordings of CARLA whose map is elsewhere.
    for (name, map) in [("kmsg", "/proc/kmsg"), ("opt", "../../secret.xodr_Opt")] {
        let text = |text: &str| {
            let mut bytes = (text.len() as u16).to_le_bytes().to_vec();
            bytes.extend(text.as_bytes());
            bytes
        };
        let mut bytes = 1u16.to_le_bytes().to_vec();
        bytes.extend(text("CARLA_RECORDER"));
        bytes.extend(1_600_000_000i64.to_le_bytes());
        bytes.extend(text(map));
        // One frame: number 1, at 0 s, 0.05 s long, and its end.
        bytes.extend([0]);
        bytes.extend(24u32.to_le_bytes());
        bytes.extend(1u64.to_le_bytes());
        bytes.extend(0f64.to_le_bytes());
        bytes.extend(0.05f64.to_le_bytes());
        bytes.extend([1, 0, 0, 0, 0]);
        std::fs::write(recordings.join(format!("{name}.log")), bytes).unwrap();
    }
    std::fs::write(sandbox.path("secret.xodr"), "<secret/>").unwrap();
    let folder = data.to_str().unwrap();
    let daemon = start_daemon(&sandbox, &empty_town("Town02"), &["--data", folder]);
    let (gateway, port, _) = start_gateway(&sandbox);
    let mut client = connect(port);
    eventually("the world is known", || {
        let answer = call(&mut connect(port), "get_map_info", &[])?;
        answer.contains("Town02").then_some(())
    });
    let began = Instant::now();
    let info = |client: &mut TcpStream, name: &str| {
        call(
            client,
            "show_recorder_file_info",
            &[name.into(), true.into()],
        )
        .unwrap()
    };
    assert!(info(&mut client, "pipe").contains("it is a named pipe, not a file"));
    let replay = |client: &mut TcpStream, name: &str| {
        let args = [
            name.into(),
            0.0.into(),
            0.0.into(),
            0u32.into(),
            false.into(),
        ];
        call(client, "replay_file", &args).unwrap()
    };
    for (name, map) in [("kmsg", "kmsg"), ("opt", "secret")] {
        let answer = replay(&mut client, name);
        let sentence = format!("Could not load mapfile {map}");
        assert!(
            answer.contains(&sentence) && answer.contains("not found"),
            "{answer}"
        );
    }
    for map in ["/proc/kmsg", "x/../../../secret", "../secret.xodr_Opt"] {
        let answer = call(
            &mut client,
            "load_new_episode",
            &[map.into(), true.into(), 0u32.into()],
        );
        let answer = answer.unwrap();
        assert!(answer.contains("not found"), "{map}: {answer}");
    }
    let bus = join_bus(&sandbox, "witness");
    let mut commands = bus.command_client("witness").unwrap();
    for map in [
        "/proc/kmsg",
        "/proc/self/environ",
        "/nowhere/x.xodr",
        "/etc/../etc/passwd",
    ] {
        let said = format!(
            "{:?}",
            ask(&mut commands, Command::LoadMap { map: map.into() })
        );
        assert!(
            said.contains("clients load no other paths"),
            "{map}: {said}"
        );
    }
    let restore = Command::RestoreCheckpoint {
        from: schema_frames::command::CheckpointPlace::File("pipe".into()),
    };
    let said = format!("{:?}", ask(&mut commands, restore));
    assert!(said.contains("it is a named pipe, not a file"), "{said}");
    assert!(began.elapsed() < Duration::from_secs(300));
    drop((commands, bus));
    gateway.stop().expect_code(0);
    daemon.stop().expect_code(0);
}
