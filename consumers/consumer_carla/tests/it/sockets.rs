//! Seeded, bounded fuzzing through real sockets: broken requests and handshakes end their own
//! connection, and who is well is served meanwhile.

use std::io::{Read as _, Write as _};
use std::net::{Shutdown, TcpListener, TcpStream};
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;

use consumer_carla::feeds::Feeds;
use consumer_carla::gateway::Gateway;
use consumer_carla::recorder::Recorder;
use consumer_carla::state::commander::commander;
use consumer_carla::state::known_world::World;
use consumer_carla::wire::msgpack::{self, Limits, Value};
use consumer_carla::wire::streams::{StreamMessage, WORLD_STREAM};
use consumer_carla::{list, rpc, rpc_server, stream_server};
use consumer_rpc::door::{Admits, Door};

use crate::calls::world;

const CASES: usize = 10_000;
const PATIENCE: Duration = Duration::from_secs(60);

fn door(admits: Admits) -> (Door, u16) {
    let listener = TcpListener::bind("127.0.0.1:0").unwrap();
    let port = listener.local_addr().unwrap().port();
    let door = Door::new(listener, "test connections", 512, admits);
    (door.unwrap(), port)
}

fn connect(port: u16) -> TcpStream {
    let connection = TcpStream::connect(("127.0.0.1", port)).unwrap();
    connection.set_read_timeout(Some(PATIENCE)).unwrap();
    connection
}

/// Streams without a simulator.
fn feeds() -> Arc<Feeds> {
    Arc::new(Feeds::new(Arc::new(World::default())))
}

/// A call as clients write it, for a method that needs no simulator.
fn version(connection: &mut TcpStream) {
    let mut bytes = Vec::new();
    msgpack::write(
        &mut bytes,
        &list![0u32, 7u32, "version", list![list![false]]],
    );
    connection.write_all(&bytes).unwrap();
    let answer = msgpack::read(connection, Limits::default()).unwrap();
    assert_eq!(
        answer,
        list![1u32, 7u32, Value::Nil, list![list![1u32, "0.9.16"]]]
    );
}

fn send(connection: &mut TcpStream, id: u32, method: &str, is_async: bool) {
    let mut bytes = Vec::new();
    msgpack::write(&mut bytes, &list![0u32, id, method, list![list![is_async]]]);
    connection.write_all(&bytes).unwrap();
}

/// The number of the next answer; `None` if none comes for a while.
fn answered(connection: &mut TcpStream, patience: Duration) -> Option<u64> {
    connection.set_read_timeout(Some(patience)).unwrap();
    let answer = msgpack::read(connection, Limits::default()).ok()?;
    match answer {
        Value::Array(parts) => match parts[1] {
            Value::UInt(number) => Some(number),
            _ => panic!("{parts:?}"),
        },
        other => panic!("{other:?}"),
    }
}

/// The gateway knows the weather by itself, but who has cleared something before asks for it to know
/// that all is cleared.
#[test]
fn an_answer_comes_when_all_that_its_connection_told_before_has_been_done() {
    const A_WHILE: Duration = Duration::from_millis(300);
    let ((door, port), (commander, work)) = (door(Admits::AnyUser), commander());
    let world = Arc::new(world());
    let feeds = Arc::new(Feeds::new(world.clone()));
    let gateway = Arc::new(Gateway::new(world, commander, feeds, 1));
    std::thread::spawn(move || rpc_server::serve(door, &gateway));
    let (mut teller, mut other) = (connect(port), connect(port));
    send(&mut teller, 1, "clear_debug_string", true);
    assert_eq!(answered(&mut teller, PATIENCE), Some(1));
    send(&mut teller, 2, "is_traffic_manager_running", false);
    assert_eq!(answered(&mut teller, PATIENCE), Some(2), "not of the world");
    send(&mut teller, 3, "get_weather_parameters", false);
    assert_eq!(
        answered(&mut teller, A_WHILE),
        None,
        "nobody has cleared it"
    );
    send(&mut other, 4, "get_weather_parameters", false);
    assert_eq!(answered(&mut other, PATIENCE), Some(4), "it told nothing");
    drop(work);
    assert_eq!(answered(&mut teller, PATIENCE), Some(3));
}

/// A whole request, with something broken in it more often than not.
fn request(rng: &mut fastrand::Rng, methods: &[&str]) -> Vec<u8> {
    let argument = |rng: &mut fastrand::Rng| match rng.u8(0..6) {
        0 => Value::UInt(rng.u64(..) >> rng.u32(0..64)),
        1 => {
            Value::from(["", "../../etc/passwd", "/dev/full", "a\0b", "Town10HD"][rng.usize(0..5)])
        }
        2 => Value::F64(f64::from_bits(rng.u64(..))),
        3 => Value::Bin(vec![rng.u8(..); rng.usize(0..40)]),
        4 => list![1u32, list![-1.0, "x", list![]]],
        _ => Value::Nil,
    };
    let method = methods[rng.usize(0..methods.len())];
    let mut args = vec![list![rng.bool()]];
    if rng.u8(0..4) == 0 {
        args.extend([
            ["drive", "/tmp/drive.log", "../../drive", "..", ""][rng.usize(0..5)].into(),
            rng.bool().into(),
        ]);
    } else {
        args.extend((0..rng.usize(0..5)).map(|_| argument(rng)));
    }
    let mut bytes = Vec::new();
    msgpack::write(
        &mut bytes,
        &list![0u32, rng.u32(..), method, Value::Array(args)],
    );
    for _ in 0..rng.usize(0..3) {
        let at = rng.usize(0..bytes.len());
        bytes[at] = rng.u8(..);
    }
    bytes.truncate(rng.usize(1..=bytes.len()));
    bytes
}

#[test]
fn broken_requests_end_their_connection_and_nothing_else() {
    // What has closed already belongs to nobody; its request is served all the same here.
    let ((door, port), feeds) = (door(Admits::AnyUser), feeds());
    let data = Path::new(env!("CARGO_TARGET_TMPDIR")).join("sockets");
    let gateway = Arc::new(Gateway::new(
        Arc::new(World::default()),
        commander().0,
        feeds,
        1,
    ));
    gateway.recorder.keep_in(data.clone());
    std::thread::spawn(move || rpc_server::serve(door, &gateway));
    // Those that ask a simulator would only take time.
    let quick = ["show_recorder_file_info", "start_recorder"];
    let methods: Vec<&str> = rpc::methods()
        .filter(|method| method.starts_with("set_replayer") || quick.contains(method))
        .chain(["version", "x"])
        .collect();
    let mut well = connect(port);
    let mut rng = fastrand::Rng::with_seed(11);
    for n in 0..CASES {
        let mut connection = connect(port);
        let bytes = request(&mut rng, &methods);
        // The server may have closed by now, and then that is its answer.
        let _ = connection.write_all(&bytes);
        if n % 3 == 0 {
            let _ = connection.shutdown(Shutdown::Write);
            let mut answer = Vec::new();
            let _ = connection.read_to_end(&mut answer);
        }
        if n % 500 == 0 {
            version(&mut well);
        }
    }
    version(&mut well);
    version(&mut connect(port));
    // Whatever names there were, files are recordings in their folder.
    let recordings: Vec<_> = std::fs::read_dir(data.join("recordings/carla"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    assert!(
        !recordings.is_empty()
            && recordings
                .iter()
                .all(|path| path.extension().is_some_and(|kind| kind == "log")),
        "{recordings:?}"
    );
    for folder in [data.clone(), data.join("recordings")] {
        assert_eq!(
            std::fs::read_dir(folder).unwrap().count(),
            1,
            "nothing beside them"
        );
    }
    // The last requests may still be carried out, and make a file meanwhile.
    let _ = std::fs::remove_dir_all(data);
}

#[test]
fn no_name_of_a_recording_leads_out_of_the_folder() {
    let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("names");
    let recorder = Recorder::default();
    recorder.keep_in(folder.clone());
    let within = folder.join("recordings/carla");
    for (name, file) in [
        ("drive", "drive.log"),
        ("/etc/passwd", "passwd.log"),
        ("../../x.log", "x.log"),
        ("C:\\a\\b.log", "b.log"),
    ] {
        assert_eq!(recorder.path(name), Ok(within.join(file)), "{name:?}");
    }
    for name in ["", "..", "a/..", "a\0b", ".bashrc", "x/", &"y".repeat(300)] {
        assert!(recorder.path(name).is_err(), "{name:?}");
    }
    std::fs::create_dir_all(&within).unwrap();
    let link = within.join("link.log");
    let _ = std::fs::remove_file(&link);
    std::os::unix::fs::symlink("/etc/hostname", &link).unwrap();
    assert!(
        recorder
            .path("link")
            .unwrap_err()
            .to_string()
            .contains("is a link")
    );
    std::fs::remove_dir_all(folder).unwrap();
}

#[test]
fn odd_handshakes_cost_a_listener_nothing() {
    let ((door, port), feeds) = (door(Admits::SameUser), feeds());
    let serving = feeds.clone();
    std::thread::spawn(move || stream_server::serve(door, &serving));
    let streams = feeds.world_stream();
    let message = |tick: u64| StreamMessage {
        tick,
        bytes: vec![tick as u8; 9].into(),
    };
    streams.send(message(1));
    let mut well = connect(port);
    well.write_all(&WORLD_STREAM.to_le_bytes()).unwrap();
    let next = |well: &mut TcpStream| {
        let mut bytes = [0; 13];
        well.read_exact(&mut bytes).unwrap();
        assert_eq!(bytes[..4], 9u32.to_le_bytes());
        bytes[4]
    };
    assert_eq!(next(&mut well), 1);
    let mut rng = fastrand::Rng::with_seed(12);
    let mut half_open = Vec::new();
    for n in 0..CASES {
        let mut connection = connect(port);
        // Half of all numbers are clients' own world streams; sensors' are small.
        let id = match rng.u8(0..8) {
            0 => WORLD_STREAM,
            1 => 0x8000_0000 | rng.u32(..),
            2 => [0, u32::MAX, 0x7fff_ffff, 0x8000_0000][rng.usize(0..4)],
            3 => rng.u32(0x1_0000..0x8000_0000),
            _ => rng.u32(2..0x1_0000),
        };
        let n_bytes = rng.usize(0..=4);
        let _ = connection.write_all(&id.to_le_bytes()[..n_bytes]);
        if rng.u8(..) < 40 {
            let _ = connection.write_all(&vec![rng.u8(..); rng.usize(0..64)]);
        }
        // Some stay half open, one instead of another.
        if rng.u8(..) < 20 {
            half_open.push(connection);
            if half_open.len() > 100 {
                half_open.swap_remove(rng.usize(0..half_open.len()));
            }
        }
        if n % 250 == 249 {
            let tick = (n / 250 + 2) as u64;
            streams.send(message(tick));
            assert_eq!(u64::from(next(&mut well)), tick & 0xff);
        }
    }
}

/// A client that loads a world hears nothing of the old one until then; other clients do.
#[test]
fn a_load_silences_one_clients_world_stream() {
    let ((door, port), feeds) = (door(Admits::SameUser), feeds());
    let serving = feeds.clone();
    std::thread::spawn(move || stream_server::serve(door, &serving));
    let streams = feeds.world_stream();
    let message = |tick: u64| StreamMessage {
        tick,
        bytes: vec![tick as u8; 9].into(),
    };
    streams.send(message(1));
    let next = |connection: &mut TcpStream| {
        let mut bytes = [0; 13];
        connection.read_exact(&mut bytes).unwrap();
        bytes[4]
    };
    let [mut loader, mut other] = [1, 2].map(|client| {
        let mut connection = connect(port);
        connection
            .write_all(&streams.stream_of(client).to_le_bytes())
            .unwrap();
        connection
    });
    assert_eq!((next(&mut loader), next(&mut other)), (1, 1));
    let left = streams.stream_of(1);
    assert!(streams.retire(1).is_some());
    streams.send(message(2));
    assert_eq!(next(&mut other), 2);
    loader.shutdown(Shutdown::Write).unwrap();
    let mut rest = Vec::new();
    loader.read_to_end(&mut rest).unwrap();
    assert!(rest.is_empty(), "{rest:?}");
    // Nor does one that connects to it only now.
    let mut late = connect(port);
    late.write_all(&left.to_le_bytes()).unwrap();
    late.set_read_timeout(Some(Duration::from_millis(300)))
        .unwrap();
    let heard = late.read(&mut [0; 13]);
    assert!(
        heard
            .as_ref()
            .is_err_and(|error| error.kind() == std::io::ErrorKind::WouldBlock),
        "{heard:?}"
    );
}
