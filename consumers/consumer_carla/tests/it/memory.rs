//! What clients send, do not take, and have kept for them costs the gateway a bounded memory.

use std::io::Write as _;
use std::net::{TcpListener, TcpStream};
use std::sync::Arc;
use std::time::Duration;

use consumer_carla::feeds::Feeds;
use consumer_carla::gateway::Gateway;
use consumer_carla::state::commander::commander;
use consumer_carla::state::known_world::World;
use consumer_carla::wire::msgpack::{self, DecodeError, Limits, Value};
use consumer_carla::{list, rpc, rpc_server};
use consumer_rpc::budget::{MAX_CONNECTION_BYTES, MAX_MESSAGE_BYTES};
use consumer_rpc::door::{Admits, Door};
use consumer_rpc::server::MAX_RPC_CONNECTIONS;

use crate::calls::world;

const PATIENCE: Duration = Duration::from_secs(120);
/// Text of the map: with all connections it makes three times what a server may hold.
const MAP_BYTES: usize = 3 * MAX_MESSAGE_BYTES / MAX_RPC_CONNECTIONS;
/// What this process may need beside: buffers of connections, and the other tests of this program.
const BESIDE_BYTES: usize = 256 << 20;

/// Clients at a time that call all methods.
const CLIENTS: usize = 6;

/// A gateway that knows a world and a map, and its port.
fn gateway() -> u16 {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    let door = Door::new(listener, "test connections", 512, Admits::AnyUser).unwrap();
    let known: World = world();
    known.change(|known| known.map = "<!-- map -->".repeat(MAP_BYTES / 12).into());
    let known = Arc::new(known);
    let feeds = Arc::new(Feeds::new(known.clone()));
    let gateway = Arc::new(Gateway::new(known, commander().0, feeds, 1));
    gateway
        .recorder
        .keep_in(std::env::temp_dir().join(format!("gantry-memory-{}", std::process::id())));
    std::thread::spawn(move || rpc_server::serve(door, &gateway));
    port
}

fn connect(port: u16) -> TcpStream {
    let connection = TcpStream::connect(("127.0.0.1", port)).unwrap();
    connection.set_read_timeout(Some(PATIENCE)).unwrap();
    connection.set_write_timeout(Some(PATIENCE)).unwrap();
    connection
}

fn request(method: &str, args: &[Value]) -> Vec<u8> {
    let params: Vec<Value> = std::iter::once(list![false])
        .chain(args.iter().cloned())
        .collect();
    let mut bytes = Vec::new();
    msgpack::write(&mut bytes, &list![0u32, 7u32, method, Value::Array(params)]);
    bytes
}

/// The answer; `None` if the connection was closed in its place.
fn call(connection: &mut TcpStream, request: &[u8]) -> Option<Value> {
    connection.write_all(request).ok()?;
    match msgpack::read(connection, Limits::default()) {
        Ok(answer) => Some(answer),
        Err(DecodeError::Closed | DecodeError::Io(_)) => None,
        Err(error) => panic!("{error}"),
    }
}

fn is_served(port: u16) -> bool {
    call(&mut connect(port), &request("version", &[])).is_some()
}

/// Memory that this process has of the machine, without what was freed.
fn resident_bytes() -> usize {
    launch_cli::heap::give_back();
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"));
    let kib = line.unwrap().trim().trim_end_matches(" kB");
    kib.parse::<usize>().unwrap() << 10
}

/// Both in one test, because they measure the same process.
#[test]
fn memory_is_bounded_whatever_clients_send_and_do_not_take() {
    let port = gateway();
    assert!(is_served(port));
    let before = resident_bytes();
    let grown = || resident_bytes().saturating_sub(before);

    // Every method with large texts, with many values, with lists within lists, and one that does
    // not exist under a long name.
    let texts: Vec<Value> = (0..15).map(|_| "x".repeat(1 << 20).into()).collect();
    let many = vec![Value::Array(vec![Value::UInt(7); 500_000])];
    let nested = (0..16).fold(list![1u32], |inner, _| list![inner.clone(), inner]);
    let forms = [texts, many, vec![nested; 1]];
    let long: &str = "x".repeat(8 << 20).leak();
    let methods: Vec<&str> = rpc::methods().chain([long]).collect();
    // Some methods wait for a world that never answers, so several clients share the work.
    std::thread::scope(|scope| {
        for methods in methods.chunks(methods.len().div_ceil(CLIENTS)) {
            scope.spawn(|| {
                for (method, args) in methods
                    .iter()
                    .flat_map(|it| forms.iter().map(move |args| (it, args)))
                {
                    let _ = call(&mut connect(port), &request(method, args));
                }
            });
        }
    });
    assert!(is_served(port));
    let most = MAX_CONNECTION_BYTES + BESIDE_BYTES;
    assert!(grown() < most, "{} MiB after all methods", grown() >> 20);

    // What is kept for one connection: it is closed when that is too much.
    let host = "h".repeat(253);
    let mut client = connect(port);
    let n_kept = (1..=u16::MAX)
        .take_while(|port| {
            let place = [list![host.as_str(), *port]];
            call(&mut client, &request("add_traffic_manager_running", &place)).is_some()
        })
        .count();
    assert!(n_kept < 1024, "{n_kept} registrations of one connection");
    drop(client);
    assert!(is_served(port));
    assert!(grown() < most, "{} MiB with registrations", grown() >> 20);

    // Answers that nobody takes.
    let asking = request("get_map_data", &[]);
    let greedy: Vec<TcpStream> = (0..MAX_RPC_CONNECTIONS - 16)
        .map(|_| {
            let mut client = connect(port);
            client.write_all(&asking).unwrap();
            client
        })
        .collect();
    // One more is answered, or told to come later.
    let mut last = connect(port);
    assert!(call(&mut last, &asking).is_some());
    let most = MAX_MESSAGE_BYTES + BESIDE_BYTES;
    assert!(grown() < most, "{} MiB with answers", grown() >> 20);
    drop(greedy);
    assert!(is_served(port));
}
