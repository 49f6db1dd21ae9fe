//! Maps by name, by path, from the map folder and handed over as a text; and that loading again and
//! again costs no memory.

use std::time::Instant;

use schema_bus::{Bus, CommandClient, names};
use schema_frames::command::StoredMap;
use schema_frames::{Command, CommandReply, SpawnPoints, WorldInfo};
use test_e2e::{ask, document, join_bus, start_daemon, step};
use test_kit::{Process, Sandbox, eventually};

/// A launch file without sensors, so that nothing is rendered.
const LAUNCH: &str = "version = 1\n[scenario]\nmap = \"Town02\"\nseed = 7\ntick_hz = 20\nmode = \"stepped\"\nvehicles = 3\n";

struct Bench {
    daemon: Process,
    bus: Bus,
    client: CommandClient,
    sandbox: Sandbox,
}

fn start(name: &str) -> Bench {
    let sandbox = Sandbox::new(name);
    let data = sandbox.path("data");
    std::fs::create_dir_all(data.join("maps")).unwrap();
    let daemon = start_daemon(&sandbox, LAUNCH, &["--data", data.to_str().unwrap()]);
    let bus = join_bus(&sandbox, "test");
    let client = bus.command_client("test").unwrap();
    Bench {
        daemon,
        bus,
        client,
        sandbox,
    }
}

impl Bench {
    fn load(&mut self, map: &str) -> CommandReply {
        ask(&mut self.client, Command::LoadMap { map: map.into() })
    }

    /// Asserts that the map is loaded: its name, its text, and the ego standing on it.
    fn expect(&mut self, name: &str, text: &str) {
        eventually(&format!("world/info names {name}"), || {
            (document(&self.bus, names::WORLD_INFO)
                .json::<WorldInfo>()
                .unwrap()
                .map
                == name)
                .then_some(())
        });
        assert!(
            document(&self.bus, names::WORLD_MAP).text == text,
            "world/map is the text of {name}"
        );
        let points: SpawnPoints = document(&self.bus, names::WORLD_SPAWN_POINTS)
            .json()
            .unwrap();
        assert!(
            points.points.len() > 20,
            "{} has {} spawn points",
            name,
            points.points.len()
        );
        step(&mut self.client, 20);
        let mut snapshots = self.bus.snapshot_reader().unwrap();
        let snapshot = eventually("the newest snapshot", || snapshots.latest().unwrap());
        let vehicles = snapshot
            .records()
            .iter()
            .filter(|actor| actor.vehicle().is_some());
        for actor in vehicles {
            // The vertical part of the body's own z axis: 1 − 2(x² + y²) of its quaternion.
            let [x, y, ..] = actor.world_from_actor.rotation_xyzw;
            assert!(
                1.0 - 2.0 * (x * x + y * y) > 0.99,
                "actor {} lies on its side on {name}",
                actor.id
            );
        }
    }
}

#[test]
fn maps_load_by_name_path_folder_and_text() {
    let mut bench = start("maps");
    let text = document(&bench.bus, names::WORLD_MAP).text.clone();
    let folder = bench.sandbox.path("data/maps");
    std::fs::write(folder.join("mine.xodr"), &text).unwrap();
    std::fs::create_dir_all(bench.sandbox.path("elsewhere")).unwrap();
    let road = bench.sandbox.path("elsewhere/road.xodr");
    std::fs::write(&road, text.replace("Town02", "road")).unwrap();

    let CommandReply::Maps { names: listed } = ask(&mut bench.client, Command::ListMaps) else {
        panic!("maps are listed")
    };
    assert!(
        ["Town01", "Town10HD", "mine"]
            .iter()
            .all(|name| listed.contains(&(*name).to_owned())),
        "{listed:?}"
    );
    assert_eq!(bench.load("mine"), CommandReply::Done);
    bench.expect("mine", &text);
    assert_eq!(bench.load(road.to_str().unwrap()), CommandReply::Done);
    bench.expect("road", &text.replace("Town02", "road"));
    for (map, sentence) in [
        ("nowhere", "not found"),
        ("../elsewhere/road", "clients load no other paths"),
        ("elsewhere/none.xodr", "clients load no other paths"),
        ("/proc/self/environ", "clients load no other paths"),
        ("", "1 to 4096"),
    ] {
        let CommandReply::Refused { error } = bench.load(map) else {
            panic!("{map:?} must be refused")
        };
        assert!(error.contains(sentence), "{error}");
    }
    std::fs::write(folder.join("broken.xodr"), &text[..text.len() / 2]).unwrap();
    let CommandReply::Refused { error } = bench.load("broken") else {
        panic!("half a file must be refused")
    };
    assert!(
        error.contains("broken.xodr") && error.contains("line"),
        "{error}"
    );
    bench.expect("road", &text.replace("Town02", "road"));

    let stored = StoredMap {
        name: "handed_over".into(),
        open_drive: text.clone(),
        wall_height_m: 1.0,
        roadside: false,
        ..StoredMap::default()
    };
    assert_eq!(
        ask(&mut bench.client, Command::StoreMap(stored.clone())),
        CommandReply::Done
    );
    assert_eq!(bench.load("handed_over"), CommandReply::Done);
    bench.expect("handed_over", &text);
    for bad in [
        StoredMap {
            name: "../out".into(),
            ..stored.clone()
        },
        StoredMap {
            open_drive: "<x/>".into(),
            ..stored
        },
    ] {
        assert!(matches!(
            ask(&mut bench.client, Command::StoreMap(bad)),
            CommandReply::Refused { .. }
        ));
    }
    drop(bench.client);
    drop(bench.bus);
    bench.daemon.stop().expect_code(0);
    test_e2e::assert_nothing_left(&bench.sandbox);
}

/// Loads maps in turn. After a first round, in which caches fill, resident memory must not grow
/// with the number of loads.
#[test]
fn loading_again_and_again_costs_no_memory() {
    let n_loads = if std::env::var_os("GANTRY_SOAK").is_some() {
        1000
    } else {
        40
    };
    let mut bench = start("reload");
    let text = document(&bench.bus, names::WORLD_MAP).text.clone();
    std::fs::write(bench.sandbox.path("data/maps/mine.xodr"), &text).unwrap();
    let maps = ["Town02", "mine", "Town01"];
    let mut times = Vec::new();
    let mut settled_bytes = 0;
    for i in 0..n_loads {
        let started = Instant::now();
        assert_eq!(bench.load(maps[i % maps.len()]), CommandReply::Done);
        times.push(started.elapsed());
        step(&mut bench.client, 1);
        if i == n_loads / 4 {
            settled_bytes = bench.daemon.resident_bytes();
        }
    }
    let end_bytes = bench.daemon.resident_bytes();
    times[maps.len()..].sort();
    println!(
        "first {:?}, again p50 {:?}, memory {} -> {} MiB",
        &times[..maps.len()],
        times[times.len() / 2],
        settled_bytes >> 20,
        end_bytes >> 20
    );
    // A town's meshes and solids are tens of MiB: a leak of one per load would be hundreds.
    assert!(
        end_bytes < settled_bytes + (48 << 20),
        "{settled_bytes} bytes grew to {end_bytes} over {n_loads} loads"
    );
    // Nine other towns push the first ones out of what is kept.
    for map in ["Town03", "Town05", "Town06", "Town07", "Town10HD"] {
        let started = Instant::now();
        assert_eq!(bench.load(map), CommandReply::Done);
        let first = started.elapsed();
        let started = Instant::now();
        assert_eq!(bench.load(map), CommandReply::Done);
        println!("{map}: {first:?}, again {:?}", started.elapsed());
    }
    bench.daemon.stop().expect_code(0);
}
