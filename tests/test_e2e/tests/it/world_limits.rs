//! How much a world takes: too many actors, texts without end, maps with too many signs, a map that
//! fails half-way, daemons that start at once, and readers that die. Each is a sentence for who
//! asked, and the world goes on for everybody else.

use std::collections::BTreeMap;

use schema_bus::{CommandClient, names};
use schema_frames::command::StoredMap;
use schema_frames::document::PoseText;
use schema_frames::limits::{MAX_ACTORS, MAX_SENTENCE_BYTES};
use schema_frames::{ActorList, Command, CommandReply, WorldInfo};
use test_e2e::{
    SMALL_RIG, Stage, ask, assert_nothing_left, counter, document, join_bus, reader, step,
};
use test_kit::{Process, Sandbox, eventually};

const LAUNCH: &str = "version = 1\n[scenario]\nmap = \"Town01\"\nseed = 7\ntick_hz = 20\nmode = \"stepped\"\n[ego]\ntype_id = \"none\"\n";

fn begin(name: &str, launch: &str) -> Stage {
    Stage::new(name, launch, &[])
}

/// Actors of the newest snapshot after one more tick, and of the list that it names.
fn actors(stage: &mut Stage) -> (usize, usize) {
    let tick = step(&mut stage.client, 1);
    let mut snapshots = stage.bus.snapshot_reader().unwrap();
    let (n_actors, revision) = eventually("the snapshot of the tick", || {
        let snapshot = snapshots.latest().unwrap()?;
        let header = snapshot.header();
        (header.tick >= tick).then(|| (snapshot.records().len(), header.actors_revision))
    });
    let listed = eventually("the list of the snapshot", || {
        let list = document(&stage.bus, names::WORLD_ACTORS);
        let is_newest = list.header.revision >= revision;
        is_newest.then(|| list.json::<ActorList>().unwrap().actors.len())
    });
    (n_actors, listed)
}

fn spawn(type_id: &str, x_m: f64, y_m: f64) -> Command {
    Command::Spawn {
        type_id: type_id.into(),
        pose: PoseText {
            translation_m: [x_m, y_m, 0.5],
            rotation_xyzw: [0.0, 0.0, 0.0, 1.0],
        },
        parent_id: None,
        role: String::new(),
        attributes: BTreeMap::new(),
    }
}

fn with_texts(role: &str, attributes: &[(String, String)]) -> Command {
    let Command::Spawn { type_id, pose, .. } = spawn("controller.ai.walker", 0.0, 0.0) else {
        unreachable!("spawn makes a spawn")
    };
    Command::Spawn {
        type_id,
        pose,
        parent_id: None,
        role: role.into(),
        attributes: attributes.iter().cloned().collect(),
    }
}

/// As many cones as a world takes, and one more.
#[test]
fn actors_beyond_the_limit_are_refused_and_the_world_goes_on() {
    let mut stage = begin("actors", LAUNCH);
    let (n_before, _) = actors(&mut stage);
    let mut cones = Vec::new();
    let mut refused = Vec::new();
    for batch in 0..5 {
        let wanted = (0..4000).map(|n| {
            let (x, y) = (f64::from(n % 100), f64::from(n / 100 + 40 * batch));
            spawn("static.prop.trafficcone01", x, y)
        });
        for reply in stage.ask_all(wanted.collect()) {
            match reply {
                CommandReply::Spawned { actor_id, .. } => cones.push(actor_id),
                CommandReply::Refused { error } => refused.push(error),
                other => panic!("{other:?}"),
            }
        }
    }
    assert_eq!(n_before + cones.len(), MAX_ACTORS);
    assert_eq!(refused.len(), 20_000 - cones.len());
    assert!(
        refused[0].contains("at most 16384 actors"),
        "{}",
        refused[0]
    );
    assert_eq!(actors(&mut stage), (MAX_ACTORS, MAX_ACTORS));
    // One place is free again, and one only.
    let one = Command::Destroy { actor_id: cones[7] };
    assert_eq!(ask(&mut stage.client, one), CommandReply::Done);
    let cone = || spawn("static.prop.trafficcone01", 0.0, 0.0);
    let again = ask(&mut stage.client, cone());
    assert!(matches!(again, CommandReply::Spawned { .. }), "{again:?}");
    assert!(stage.refusal(cone()).contains("destroy some first"));
    assert_eq!(actors(&mut stage), (MAX_ACTORS, MAX_ACTORS));
    assert_eq!(counter(&mut stage.client, "unsent"), 0);
    stage.end();
}

#[test]
fn texts_of_actors_are_bounded_one_by_one_and_together() {
    let mut stage = begin("texts", LAUNCH);
    let (n_before, _) = actors(&mut stage);
    let long = "x".repeat(15 << 20);
    let error = stage.refusal(with_texts(&long, &[]));
    assert!(
        error.contains("the role has 15728640 bytes, at most 256"),
        "{error}"
    );
    let error = stage.refusal(with_texts("", &[("role_name".into(), long.clone())]));
    assert!(error.contains("role"), "{error}");
    let error = stage.refusal(with_texts("", &[("note".into(), long.clone())]));
    assert!(error.contains("\"note\" has 15728640 bytes"), "{error}");
    // What is sent back of an unknown name is short, too.
    let error = stage.refusal(spawn(&long, 0.0, 0.0));
    assert!(error.len() <= MAX_SENTENCE_BYTES && error.contains("unknown type"));
    // Texts of a thousand characters that JSON writes with six each: only so many actors have room.
    let attributes: Vec<(String, String)> = (0..200)
        .map(|n| (format!("note_{n}"), "\u{1}".repeat(1000)))
        .collect();
    let replies: Vec<CommandReply> = (0..20)
        .map(|_| ask(&mut stage.client, with_texts("much", &attributes)))
        .collect();
    let is_refused = |reply: &&CommandReply| match reply {
        CommandReply::Refused { error } => error.contains("16 MiB"),
        _ => false,
    };
    let n_refused = replies.iter().filter(is_refused).count();
    // 200 × 6 KB are 1.2 MB an actor, of which 13 fit into 16 MiB.
    assert_eq!(n_refused, 7, "{replies:?}");
    assert_eq!(actors(&mut stage), (n_before + 13, n_before + 13));
    stage.end();
}

/// One straight road with so many signs.
fn road_with_signs(n_signs: usize) -> String {
    let signs: String = (0..n_signs)
        .map(|n| {
            let s_m = 1.0 + 1990.0 * n as f64 / n_signs as f64;
            format!(
                r#"<signal id="{n}" s="{s_m:.3}" t="-5" zOffset="2" name="" dynamic="no" orientation="+" type="206" subtype="-1" country="DEU" height="0.8" width="0.8" value="-1"/>"#
            )
        })
        .collect();
    format!(
        r#"<?xml version="1.0"?><OpenDRIVE><header revMajor="1" revMinor="6" name="signs"/><road id="1" length="2000" junction="-1">
        <planView><geometry s="0" x="0" y="0" hdg="0" length="2000"><line/></geometry></planView>
        <lanes><laneSection s="0"><center><lane id="0" type="none"/></center><right><lane id="-1" type="driving"><width sOffset="0" a="3.5" b="0" c="0" d="0"/></lane></right></laneSection></lanes>
        <signals>{signs}</signals></road></OpenDRIVE>"#
    )
}

fn store(stage: &mut Stage, name: &str, open_drive: String) {
    let map = StoredMap {
        name: name.into(),
        open_drive,
        roadside: false,
        ..StoredMap::default()
    };
    assert_eq!(
        ask(&mut stage.client, Command::StoreMap(map)),
        CommandReply::Done
    );
}

fn info(stage: &Stage) -> WorldInfo {
    document(&stage.bus, names::WORLD_INFO).json().unwrap()
}

#[test]
fn a_map_with_too_many_signs_is_refused_and_one_with_five_thousand_is_not() {
    let mut stage = begin("signs", LAUNCH);
    let before = (actors(&mut stage), info(&stage));
    store(&mut stage, "too_many", road_with_signs(MAX_ACTORS));
    let error = stage.refusal(Command::LoadMap {
        map: "too_many".into(),
    });
    assert!(
        error.contains("16384 traffic lights and signs") && error.contains("at most 16384"),
        "{error}"
    );
    assert_eq!(
        (actors(&mut stage), info(&stage)),
        before,
        "the old world is whole"
    );
    store(&mut stage, "many", road_with_signs(5000));
    let loaded = ask(&mut stage.client, Command::LoadMap { map: "many".into() });
    assert_eq!(loaded, CommandReply::Done);
    assert_eq!(actors(&mut stage), (5001, 5001));
    stage.end();
}

/// The rig rides on the fourth other vehicle, for which a map of one short road has no place: the
/// load fails when the new world already has its roads and its first vehicles.
#[test]
fn a_map_that_fails_half_way_leaves_the_old_world_as_it_is() {
    let launch = "version = 1\n[scenario]\nmap = \"Town01\"\nseed = 7\ntick_hz = 20\nmode = \"stepped\"\nvehicles = 8\n\
                  [rig.far]\nvehicle = 7\n[sensor.imu]\nkind = \"imu\"\nrig = \"far\"\n";
    let mut stage = begin("half-way", launch);
    let mut imu = reader(&stage.bus, "far/imu/imu");
    let before = (actors(&mut stage), info(&stage));
    let first = eventually("a frame", || imu.latest().unwrap());
    let list = || document(&stage.bus, names::WORLD_ACTORS).text;
    let listed = list();
    let short = road_with_signs(3).replace("2000", "60");
    let short = short
        .replace("s=\"664", "s=\"10")
        .replace("s=\"1327", "s=\"20");
    store(&mut stage, "short", short);
    let error = stage.refusal(Command::LoadMap {
        map: "short".into(),
    });
    assert!(error.contains("could not be placed"), "{error}");
    assert_eq!((actors(&mut stage), info(&stage)), before);
    assert_eq!(document(&stage.bus, names::WORLD_ACTORS).text, listed);
    let frame = eventually("a further frame of the same sensor", || {
        imu.latest().unwrap()
    });
    let (then, now) = (first.header(), frame.header());
    assert_eq!((then.sensor_id, then.episode), (now.sensor_id, now.episode));
    assert!(now.tick > then.tick);
    // Another map can still be loaded.
    let loaded = ask(
        &mut stage.client,
        Command::LoadMap {
            map: "Town02".into(),
        },
    );
    assert_eq!(loaded, CommandReply::Done);
    drop((first, frame, imu));
    stage.end();
}

/// Of several daemons that start at the same moment one runs, and the others say why they do not.
/// In every other round they find what a killed one left.
#[test]
fn of_daemons_that_start_at_once_exactly_one_stays() {
    for round in 0..6 {
        let sandbox = Sandbox::new(&format!("at-once-{round}"));
        let file = sandbox.write("launch.toml", LAUNCH);
        let file = file.to_str().expect("sandbox paths are text");
        let args = ["--launch", file, "--domain", sandbox.domain()];
        if round % 2 == 1 {
            let mut before = sandbox.spawn("simd", &args);
            before.wait_line("ready");
            before.kill9();
        }
        let mut daemons: Vec<Process> = (0..4).map(|_| sandbox.spawn("simd", &args)).collect();
        let mut ended = Vec::new();
        eventually("all but one have ended", || {
            let is_running: Vec<bool> = daemons.iter_mut().map(Process::is_running).collect();
            for idx in (0..daemons.len()).rev().filter(|idx| !is_running[*idx]) {
                ended.push(daemons.remove(idx).wait());
            }
            (daemons.len() <= 1).then_some(())
        });
        assert_eq!(daemons.len(), 1, "{ended:#?}");
        for other in ended {
            assert!(other.says("already has a daemon"), "{:#?}", other.lines);
            other.expect_code(2);
        }
        let mut daemon = daemons.remove(0);
        daemon.wait_line("ready");
        let bus = join_bus(&sandbox, "test");
        let mut client = bus.command_client("test").unwrap();
        step(&mut client, 3);
        drop((client, bus));
        daemon.stop().expect_code(0);
        assert_nothing_left(&sandbox);
    }
}

/// A world of 200 ticks a second has no five milliseconds to spare, and still notices within a
/// second that a reader was killed: what is counted are frames that were made for the dead one.
#[test]
fn frames_for_a_killed_reader_end_within_a_second() {
    const TICK_HZ: u64 = 200;
    let launch = SMALL_RIG.replace("tick_hz = 20", &format!("tick_hz = {TICK_HZ}"));
    assert!(launch.contains("tick_hz = 200"), "{launch}");
    let launch = launch.replace("rate_hz = 20\n", "rate_hz = 200\n");
    let mut stage = begin("dead-reader", &launch);
    let args = [
        "topic",
        "hz",
        "ego/imu/imu",
        "--domain",
        stage.sandbox.domain(),
    ];
    let watcher = stage.sandbox.spawn("gantry", &args);
    let sent = |client: &mut CommandClient| counter(client, "sent ego/imu/imu");
    eventually("frames for the reader", || {
        (sent(&mut stage.client) > 20).then_some(())
    });
    watcher.kill9();
    let (at_death, first_tick) = (sent(&mut stage.client), counter(&mut stage.client, "ticks"));
    let at_end = eventually("the frames end", || {
        let before = sent(&mut stage.client);
        let tick = counter(&mut stage.client, "ticks");
        eventually("a hundred more ticks", || {
            (counter(&mut stage.client, "ticks") > tick + 100).then_some(())
        });
        (sent(&mut stage.client) == before).then_some(before)
    });
    let n_for_nobody = at_end - at_death;
    assert!(
        n_for_nobody <= TICK_HZ,
        "{n_for_nobody} frames were made for a dead reader, from tick {first_tick} on"
    );
    stage.end();
}
