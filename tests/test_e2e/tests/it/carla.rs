//! The stock CARLA client, from the repository's own environment, through `gantry-carla` against a
//! real daemon.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::time::Duration;

use test_e2e::carla::{Stage, empty_town, free_port, start_gateway, start_script};
use test_e2e::start_daemon;
use test_kit::Sandbox;

#[test]
fn the_stock_client_looks_round_steps_and_drives() {
    let stage = Stage::new("carla", &empty_town("Town10HD"));
    let themes = [
        "session",
        "settings",
        "ticks",
        "spectator",
        "weather",
        "vehicle",
        "batch",
        "lights",
        "autopilot",
        "sentences",
        "restore",
    ];
    stage.run("carla_client.py", &[&free_port().to_string()], &themes);
    stage.run("carla_client.py", &[], &["loading"]);
    stage.end();
}

/// Sends bytes and returns everything that the server sent before it closed the connection.
fn exchange(port: u16, bytes: &[u8]) -> Vec<u8> {
    let mut connection = TcpStream::connect(("127.0.0.1", port)).unwrap();
    connection
        .set_read_timeout(Some(Duration::from_secs(20)))
        .unwrap();
    connection.write_all(bytes).unwrap();
    let mut answer = Vec::new();
    // A reset ends the connection as well as a close does.
    let _ = connection.read_to_end(&mut answer);
    answer
}

#[test]
fn broken_messages_close_their_connection_and_nothing_else() {
    let sandbox = Sandbox::new("carlabad");
    let (mut gateway, port, stream_port) = start_gateway(&sandbox);
    let broken: [(&[u8], &str); 4] = [
        (&[0xdd, 0xff, 0xff, 0xff, 0xff], "more than 2000000 values"),
        (&[0x91; 100], "lists within lists"),
        (&[0x94, 0x00, 0x01, 0x81, 0x01, 0x01], "a map"),
        (b"GET / HTTP/1.1\r\n\r\n", "a request is an integer"),
    ];
    for (bytes, sentence) in broken {
        assert_eq!(exchange(port, bytes), b"");
        gateway.wait_line(sentence);
    }
    // An unknown call is an answer, and the connection goes on: a second call is answered too.
    let mut connection = TcpStream::connect(("127.0.0.1", port)).unwrap();
    connection
        .set_read_timeout(Some(Duration::from_secs(20)))
        .unwrap();
    for _ in 0..2 {
        connection
            .write_all(b"\x94\x00\x01\xa7nothing\x91\x91\xc2")
            .unwrap();
        let mut answer = vec![0; 4];
        connection.read_exact(&mut answer).unwrap();
        assert_eq!(answer[..3], [0x94, 0x01, 0x01]);
        let mut text = vec![0; 256];
        let n = connection.read(&mut text).unwrap();
        assert!(
            String::from_utf8_lossy(&text[..n]).contains("'nothing'"),
            "{:?}",
            String::from_utf8_lossy(&text[..n])
        );
    }
    // Seeded handshakes on the streaming port: unknown stream numbers, half numbers, hang-ups.
    let mut state = 9u32;
    for n in 0..200 {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        let mut connection = TcpStream::connect(("127.0.0.1", stream_port)).unwrap();
        connection.write_all(&state.to_le_bytes()[..n % 5]).unwrap();
    }
    assert!(gateway.is_running());
    gateway.stop().expect_code(0);
}

#[test]
fn the_world_goes_on_when_the_client_that_stepped_it_is_killed() {
    let sandbox = Sandbox::new("carlalost");
    let mut daemon = start_daemon(&sandbox, &empty_town("Town10HD"), &[]);
    let (gateway, port, _) = start_gateway(&sandbox);
    let mut client = start_script(&sandbox, "carla_stepper.py", &[&port.to_string()]);
    client.wait_line("stepping");
    client.kill9();
    daemon.wait_line("no client for 10 s in stepped mode");
    gateway.stop().expect_code(0);
    daemon.stop().expect_code(0);
}

/// Opens far more connections than the gateway serves: those beyond the limit are refused with a
/// sentence, memory stays bounded, and the connected clients go on.
#[test]
fn thousands_of_silent_connections_make_room_and_nothing_else_happens() {
    let sandbox = Sandbox::new("carlaflood");
    let (mut gateway, port, stream_port) = start_gateway(&sandbox);
    let version = |connection: &mut TcpStream| {
        connection
            .write_all(b"\x94\x00\x01\xa7version\x91\x91\xc2")
            .unwrap();
        let mut answer = [0; 14];
        connection.read_exact(&mut answer).unwrap();
        assert!(answer.ends_with(b"0.9.16"), "{answer:?}");
    };
    let mut first = TcpStream::connect(("127.0.0.1", port)).unwrap();
    first
        .set_read_timeout(Some(Duration::from_secs(20)))
        .unwrap();
    version(&mut first);
    let before_bytes = gateway.resident_bytes();
    for port in [port, stream_port] {
        // Half-open: they say nothing, or half a word, and stay.
        let mut held = Vec::new();
        for n in 0..3000 {
            let Ok(mut connection) = TcpStream::connect(("127.0.0.1", port)) else {
                continue;
            };
            let _ = connection.write_all(&[0x94, 0x00, 0x01][..n % 4]);
            if held.len() < 600 {
                held.push(connection);
            }
        }
    }
    gateway.wait_line("closed one of 512 RPC connections, the one that did nothing for longest");
    // 1024 streams have room, beyond what this process may hold open; `peers.rs` fills them.
    version(&mut first);
    let grown_bytes = gateway.resident_bytes().saturating_sub(before_bytes);
    assert!(grown_bytes < 64 << 20, "{grown_bytes} bytes more");
    gateway.stop().expect_code(0);
}
