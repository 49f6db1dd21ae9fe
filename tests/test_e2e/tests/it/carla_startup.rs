//! Clients that connect while the gateway is still reading the world: they wait until it has read
//! everything.

use std::io::{Read as _, Write as _};
use std::net::TcpStream;
use std::time::Duration;

use schema_bus::names;
use schema_frames::ActorList;
use test_e2e::carla::{empty_town, start_gateway};
use test_e2e::{document, join_bus, start_daemon};
use test_kit::{Sandbox, eventually};

const OTHERS: [&str; 4] = [
    names::WORLD_MAP,
    names::WORLD_ACTORS,
    names::WORLD_CATALOGUE,
    names::WORLD_SPAWN_POINTS,
];

/// `get_required_files("Nav")` as a client asks for its navigation mesh: once per process, for
/// good.
const REQUIRED_FILES: &[u8] = b"\x94\x00\x01\xb2get_required_files\x92\x91\xc2\xa3Nav";

#[test]
fn no_call_is_answered_from_a_world_that_is_half_known() {
    // The texts of a real world, sent once more by the test itself.
    let source = Sandbox::new("carlatexts");
    let daemon = start_daemon(&source, &empty_town("Town02"), &[]);
    let bus = join_bus(&source, "test");
    let info = document(&bus, names::WORLD_INFO);
    let others = OTHERS.map(|name| document(&bus, name));
    drop(bus);
    daemon.stop().expect_code(0);

    let sandbox = Sandbox::new("carlastartup");
    let bus = join_bus(&sandbox, "test");
    let mut publishers = OTHERS.map(|name| bus.document_publisher(name).unwrap());
    let mut first = bus.document_publisher(names::WORLD_INFO).unwrap();
    first.send(&info.text, info.header.epoch, 0).unwrap();
    let (gateway, port, _) = start_gateway(&sandbox);
    let mut client = TcpStream::connect(("127.0.0.1", port)).unwrap();
    client.write_all(REQUIRED_FILES).unwrap();
    client
        .set_read_timeout(Some(Duration::from_millis(100)))
        .unwrap();
    let mut answer = [0; 256];
    for _ in 0..10 {
        first.greet();
        client
            .read(&mut answer)
            .expect_err("an answer before the map is known");
    }
    for (publisher, text) in publishers.iter_mut().zip(&others) {
        publisher.send(&text.text, text.header.epoch, 0).unwrap();
    }
    let mut n = 0;
    eventually("the answer", || {
        // The gateway may open a document only now.
        publishers.iter().for_each(|publisher| publisher.greet());
        match client.read(&mut answer[n..]) {
            Ok(0) => panic!("closed after {:?}", String::from_utf8_lossy(&answer[..n])),
            Ok(more) => n += more,
            Err(error) => assert_eq!(error.kind(), std::io::ErrorKind::WouldBlock, "{error}"),
        }
        answer[..n].ends_with(b".bin").then_some(())
    });
    let text = String::from_utf8_lossy(&answer[..n]).into_owned();
    assert!(
        text.contains("/Nav/") && text.ends_with("Town02.bin"),
        "{text}"
    );
    gateway.stop().expect_code(0);
}

/// Nobody takes a spawn point or stands in the way where the launch file asks for no ego vehicle.
#[test]
fn a_town_without_an_ego_vehicle_is_empty() {
    let sandbox = Sandbox::new("carlaempty");
    let daemon = start_daemon(
        &sandbox,
        &(empty_town("Town02") + "[ego]\ntype_id = \"none\"\n"),
        &[],
    );
    let bus = join_bus(&sandbox, "test");
    let actors: ActorList = document(&bus, names::WORLD_ACTORS).json().unwrap();
    assert!(!actors.actors.is_empty(), "lights and signs");
    assert!(
        actors
            .actors
            .iter()
            .all(|actor| !actor.type_id.starts_with("vehicle.")),
        "{actors:?}"
    );
    drop(bus);
    daemon.stop().expect_code(0);
}
