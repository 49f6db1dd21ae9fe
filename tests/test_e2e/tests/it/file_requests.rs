//! Commands that name files: while the simulator's thread for files stands still, as one that waits
//! for a slow disk does, ticks and everybody else's commands go on. Each client's commands keep
//! their order, and what does not fit is refused with a sentence.

use std::collections::BTreeMap;
use std::thread::JoinHandle;
use std::time::Duration;

use schema_bus::{Bus, CommandClient, CommandError};
use schema_frames::command::{CheckpointPlace, StoredMap};
use schema_frames::document::PoseText;
use schema_frames::{Command, CommandBatch, CommandReply, JournalAct, JournalEntry, JournalHead};
use test_e2e::laboratory::strike::{HeldThread, hold};
use test_e2e::{Stage, ask, counter, not_tested, step};
use test_kit::{Sandbox, eventually};

const FREE: &str = "version = 1\n[scenario]\nmap = \"Town02\"\nseed = 7\ntick_hz = 20\n[ego]\ntype_id = \"none\"\n";
const STEPPED: &str = "version = 1\n[scenario]\nmap = \"Town02\"\nseed = 7\ntick_hz = 20\nmode = \"stepped\"\n[ego]\ntype_id = \"none\"\n";

/// Longer than anything takes.
const LONG: Duration = Duration::from_secs(600);
/// Long enough to send a request, whose answer is not waited for.
const SENT: Duration = Duration::from_millis(1);

fn save(file: &str) -> Command {
    Command::SaveCheckpoint {
        to: CheckpointPlace::File(file.into()),
    }
}

fn restore(file: &str) -> Command {
    Command::RestoreCheckpoint {
        from: CheckpointPlace::File(file.into()),
    }
}

fn restore_name(name: &str) -> Command {
    Command::RestoreCheckpoint {
        from: CheckpointPlace::Name(name.into()),
    }
}

fn load(map: &str) -> Command {
    Command::LoadMap { map: map.into() }
}

fn refusal(reply: &CommandReply) -> &str {
    match reply {
        CommandReply::Refused { error } => error,
        other => panic!("it was not refused: {other:?}"),
    }
}

fn restored() -> CommandReply {
    CommandReply::Restored { gone: Vec::new() }
}

/// The simulator's thread for files, stopped; `None` where tracing is forbidden.
fn held(stage: &Stage) -> Option<HeldThread> {
    let held = hold(stage.daemon.pid(), "simd-files");
    if held.is_none() {
        not_tested(
            "the world beside a file that takes long",
            "the kernel forbids to stop a thread of another process",
        );
    }
    held
}

/// Asks on a thread of its own, as a client of its own.
fn ask_aside(bus: &Bus, name: &str, commands: Vec<Command>) -> JoinHandle<Vec<CommandReply>> {
    let mut client = bus.command_client(name).unwrap();
    std::thread::spawn(move || {
        let answer = client.request(&CommandBatch::new(commands), LONG);
        answer.unwrap_or_else(|error| panic!("{error}")).replies
    })
}

/// Sends a request and waits for no answer.
fn send(client: &mut CommandClient, command: Command) {
    let sent = client.request(&CommandBatch::new(vec![command]), SENT);
    assert!(
        matches!(sent, Err(CommandError::Timeout { .. })),
        "{sent:?}"
    );
}

fn wait_for_requests(stage: &mut Stage, n: u64) {
    eventually(&format!("{n} requests wait for files"), || {
        (counter(&mut stage.client, "file_requests") == n).then_some(())
    });
}

#[test]
fn ticks_and_other_clients_go_on_while_a_file_waits() {
    let mut stage = Stage::new("filesaside", FREE, &[]);
    let Some(thread) = held(&stage) else { return };
    let path = stage.sandbox.path("data/gantry/checkpoints/there.gckp");
    let saving = ask_aside(&stage.bus, "slow", vec![save("there"), Command::Ping]);
    wait_for_requests(&mut stage, 1);
    stage.ticks_go_on(20);
    assert_eq!(
        ask(&mut stage.client, Command::SetLampCycle { on: false }),
        CommandReply::Done
    );
    assert!(!path.exists() && !saving.is_finished());
    drop(thread);
    let replies = saving.join().unwrap();
    let path_of = |path: &std::path::Path| path.display().to_string();
    assert_eq!(
        replies[0],
        CommandReply::Saved {
            path: path_of(&path)
        }
    );
    assert!(matches!(replies[1], CommandReply::Pong { .. }));
    assert!(path.exists(), "it is there when the request is answered");

    // Reading a checkpoint, parsing a text, building a map.
    let text = std::fs::read_to_string("/proc/self/cmdline").unwrap();
    let bad = StoredMap {
        name: "bad".into(),
        open_drive: text,
        ..StoredMap::default()
    };
    for command in [
        restore("there"),
        Command::StoreMap(bad),
        Command::ListMaps,
        load("Town01"),
    ] {
        let thread = held(&stage).expect("it was allowed before");
        let asked = ask_aside(&stage.bus, "slow", vec![command.clone()]);
        wait_for_requests(&mut stage, 1);
        stage.ticks_go_on(5);
        assert!(!asked.is_finished(), "{command:?}");
        drop(thread);
        let replies = asked.join().unwrap();
        match &command {
            Command::RestoreCheckpoint { .. } => assert_eq!(replies, [restored()]),
            Command::StoreMap(_) => assert!(refusal(&replies[0]).contains("map \"bad\"")),
            Command::ListMaps => assert!(
                matches!(&replies[0], CommandReply::Maps { names } if names.contains(&"Town05".into()))
            ),
            _ => assert_eq!(replies, [CommandReply::Done]),
        }
    }
    stage.end();
}

#[test]
fn the_commands_of_a_client_keep_their_order() {
    let mut stage = Stage::new("filesorder", STEPPED, &[]);
    let Some(thread) = held(&stage) else { return };
    let mut slow = stage.bus.command_client("slow").unwrap();
    send(&mut slow, save("first"));
    send(
        &mut slow,
        Command::SaveCheckpoint {
            to: CheckpointPlace::Name("second".into()),
        },
    );
    send(&mut slow, Command::Step { n: 3 });
    wait_for_requests(&mut stage, 1);
    // Others step the world meanwhile, and find that nothing else of it was done.
    step(&mut stage.client, 2);
    let error = stage.refusal(restore_name("second"));
    assert!(error.contains("no checkpoint \"second\""), "{error}");
    assert_eq!(counter(&mut stage.client, "ticks"), 2);
    drop(thread);
    assert_eq!(ask(&mut slow, restore_name("second")), restored());
    eventually("the steps that were asked for", || {
        (counter(&mut stage.client, "ticks") == 5).then_some(())
    });
    drop(slow);
    stage.end();
}

#[test]
fn the_seventeenth_request_is_refused_and_its_other_commands_run() {
    let mut stage = Stage::new("filesfull", STEPPED, &[]);
    let Some(thread) = held(&stage) else { return };
    let asked: Vec<_> = (0..16)
        .map(|n| {
            let name = format!("client{n:02}");
            let command = match n % 2 {
                0 => save(&name),
                _ => load("Town02"),
            };
            ask_aside(&stage.bus, &name, vec![command])
        })
        .collect();
    wait_for_requests(&mut stage, 16);
    let replies = stage.ask_all(vec![
        save("more"),
        Command::Ping,
        load("Town01"),
        Command::ListMaps,
        restore("other"),
    ]);
    for reply in [0, 2, 3, 4].map(|idx| &replies[idx]) {
        let error = refusal(reply);
        assert!(error.starts_with("16 requests wait for files"), "{error}");
    }
    assert!(matches!(replies[1], CommandReply::Pong { .. }));
    drop(thread);
    for (n, asked) in asked.into_iter().enumerate() {
        let replies = asked.join().unwrap();
        match n % 2 {
            0 => {
                assert!(matches!(&replies[..], [CommandReply::Saved { .. }]), "{n}");
                let file = format!("data/gantry/checkpoints/client{n:02}.gckp");
                assert!(stage.sandbox.path(&file).exists(), "{file}");
            }
            _ => assert_eq!(replies, [CommandReply::Done], "{n}"),
        }
    }
    assert_eq!(counter(&mut stage.client, "file_requests"), 0);
    stage.end();
}

#[test]
fn a_request_names_at_most_64_checkpoint_files() {
    let mut stage = Stage::new("files64", STEPPED, &[]);
    let commands = (0..66).map(|n| save(&format!("file{}", n % 3)));
    let replies = stage.ask_all(commands.collect());
    for (n, reply) in replies.iter().enumerate() {
        match n < 64 {
            true => assert!(
                matches!(reply, CommandReply::Saved { .. }),
                "{n}: {reply:?}"
            ),
            false => assert!(refusal(reply).contains("more than 64 checkpoint files")),
        }
    }
    let folder = stage.sandbox.path("data/gantry/checkpoints");
    assert_eq!(std::fs::read_dir(folder).unwrap().count(), 3);
    stage.end();
}

#[test]
fn the_commands_of_one_request_see_each_others_files() {
    let mut stage = Stage::new("filesinone", STEPPED, &[]);
    step(&mut stage.client, 2);
    let spawn = Command::Spawn {
        type_id: "vehicle.audi.tt".into(),
        pose: PoseText {
            translation_m: [0.0, 0.0, 40.0],
            rotation_xyzw: [0.0, 0.0, 0.0, 1.0],
        },
        parent_id: None,
        role: String::new(),
        attributes: BTreeMap::new(),
    };
    // What is saved and restored at once, while an older file has the same name.
    assert!(matches!(
        stage.ask_all(vec![save("here")])[0],
        CommandReply::Saved { .. }
    ));
    let replies = stage.ask_all(vec![spawn, save("here"), Command::Reset, restore("here")]);
    let [
        CommandReply::Spawned { actor_id, .. },
        CommandReply::Saved { .. },
        _,
        last,
    ] = &replies[..]
    else {
        panic!("{replies:?}")
    };
    assert_eq!(*last, restored());
    let destroy = Command::Destroy {
        actor_id: *actor_id,
    };
    assert_eq!(ask(&mut stage.client, destroy), CommandReply::Done);

    // A checkpoint of the map that the same request loads, and of one that was loaded before it.
    assert_eq!(ask(&mut stage.client, load("Town01")), CommandReply::Done);
    let error = stage.refusal(restore("here"));
    assert!(
        error.contains("Town02") && error.contains("Town01"),
        "{error}"
    );
    let replies = stage.ask_all(vec![load("Town02"), restore("here")]);
    assert_eq!(replies, [CommandReply::Done, restored()]);
    let destroy = Command::Destroy {
        actor_id: *actor_id,
    };
    assert_eq!(ask(&mut stage.client, destroy), CommandReply::Done);
    stage.end();
}

#[test]
fn a_checkpoint_that_cannot_be_written_is_refused_in_its_place() {
    let mut stage = Stage::new("filesbad", STEPPED, &[]);
    let folder = stage.sandbox.path("data/gantry/checkpoints");
    std::fs::create_dir_all(folder.parent().unwrap()).unwrap();
    std::fs::write(&folder, "not a folder").unwrap();
    let replies = stage.ask_all(vec![Command::Ping, save("x"), Command::Ping]);
    assert!(refusal(&replies[1]).contains("cannot make the folder"));
    for reply in [&replies[0], &replies[2]] {
        assert!(matches!(reply, CommandReply::Pong { .. }));
    }
    std::fs::remove_file(&folder).unwrap();
    assert!(matches!(
        ask(&mut stage.client, save("x")),
        CommandReply::Saved { .. }
    ));
    stage.end();
}

/// A simulator that reaches its last tick answers what it has carried out.
#[test]
fn a_checkpoint_is_written_and_answered_before_the_simulator_ends() {
    let stage = Stage::new("filesend", FREE, &[]);
    let Some(thread) = held(&stage) else { return };
    let path = stage.sandbox.path("data/gantry/checkpoints/last.gckp");
    let asked = ask_aside(&stage.bus, "slow", vec![save("last")]);
    let Stage {
        mut client,
        bus,
        daemon,
        sandbox,
    } = stage;
    eventually("the request waits", || {
        (counter(&mut client, "file_requests") == 1).then_some(())
    });
    daemon.signal(nix::sys::signal::Signal::SIGTERM);
    eventually("no request is served any more", || {
        let ping = CommandBatch::new(vec![Command::Ping]);
        client.request(&ping, Duration::from_millis(500)).err()
    });
    assert!(!asked.is_finished());
    drop(thread);
    assert!(matches!(
        asked.join().unwrap()[..],
        [CommandReply::Saved { .. }]
    ));
    assert!(path.exists());
    drop((client, bus));
    daemon.wait().expect_code(0);
    test_e2e::assert_nothing_left(&sandbox);
}

/// A journal that is longer than what is read of it in one go, with a command that loads a map.
fn journal() -> String {
    let load = JournalAct::Commands {
        client: "then".into(),
        seq: 1,
        text: serde_json::to_string(&CommandBatch::new(vec![load("Town01")])).unwrap(),
        outcomes: Vec::new(),
        is_last_of_round: true,
    };
    let later = (0..6000).map(|n| JournalAct::Audience {
        topic: "ego/none/dvs".into(),
        is_made: n % 2 == 0,
    });
    let acts = std::iter::once((3, load)).chain(later.map(|act| (5, act)));
    let entries = (1..).zip(acts).map(|(n, (edge, act))| {
        serde_json::to_string(&JournalEntry { n, edge, act }).unwrap() + "\n"
    });
    let head = serde_json::to_string(&JournalHead::default()).unwrap() + "\n";
    std::iter::once(head).chain(entries).collect()
}

#[test]
fn everybody_is_answered_while_a_journal_waits_for_its_files() {
    let notes = Sandbox::new("filesnotes");
    let journal = notes.write("journal", &journal());
    let extra = [
        "--journal",
        journal.to_str().unwrap(),
        "--await-lockstep",
        "1",
    ];
    let mut stage = Stage::new("filesjournal", FREE, &extra);
    let Some(thread) = held(&stage) else { return };
    // The first tick waits for it.
    let mut participant = stage
        .sandbox
        .spawn("examples/misbehave", &[stage.sandbox.domain(), "lockstep"]);
    participant.wait_line("at work");
    eventually("the world stands where the map is needed", || {
        (counter(&mut stage.client, "ticks") == 3).then_some(())
    });
    for _ in 0..5 {
        let answer = ask(&mut stage.client, Command::Ping);
        assert!(matches!(answer, CommandReply::Pong { .. }), "{answer:?}");
    }
    assert_eq!(counter(&mut stage.client, "ticks"), 3);
    drop(thread);
    stage.daemon.wait_line("map loaded");
    stage.daemon.wait_line("the journal ends");
    stage.ticks_go_on(5);
    participant.kill9();
    stage.end();
}
