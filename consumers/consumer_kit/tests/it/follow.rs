//! Tests consumer_kit against a small stand-in for the daemon, on real shared memory in a private
//! place.

use std::time::{Duration, Instant};

use consumer_kit::{FollowedDocument, Follower, Lockstep, LockstepError, MAX_WAIT, Steps, Take};
use schema_bus::{Bus, FramePublisher, FrameTopic, Notifier, SnapshotPublisher, names};
use schema_frames::command::CommandReply;
use schema_frames::{ActorRecord, Modality, ReplyBatch, SnapshotHeader};

use crate::place::Place;

/// Publishes one IMU and snapshots as the daemon would.
struct Daemon {
    imu: FramePublisher,
    snapshots: SnapshotPublisher,
    event: Notifier,
    epoch: u64,
    bus: Bus,
}

impl Daemon {
    fn start(place: &Place, epoch: u64) -> Daemon {
        let bus = place.bus("simd");
        let imu = bus
            .frame_publisher("ego/imu/imu", FrameTopic::new(Modality::Imu, 72))
            .unwrap();
        let snapshots = bus.snapshot_publisher(4).unwrap();
        Daemon {
            imu,
            snapshots,
            event: bus.notifier("ego/imu/imu").unwrap(),
            epoch,
            bus,
        }
    }

    fn tick(&self, tick: u64) {
        let header = SnapshotHeader {
            tick,
            epoch: self.epoch,
            ..bytemuck::Zeroable::zeroed()
        };
        self.snapshots
            .send(
                header,
                &[ActorRecord {
                    id: 7,
                    ..bytemuck::Zeroable::zeroed()
                }],
            )
            .unwrap();
        let mut loan = self.imu.loan(72).unwrap();
        let header = loan.header_mut();
        header.set_list(1);
        (header.tick, header.seq, header.epoch) = (tick, tick, self.epoch);
        loan.send().unwrap();
        self.event.notify();
    }
}

/// Waits until the follower has its topic.
fn find(follower: &mut Follower, daemon: &Daemon) {
    let deadline = Instant::now() + Duration::from_secs(20);
    while daemon.imu.n_readers() == 0 {
        assert!(Instant::now() < deadline, "the topic was not found");
        follower.wait(MAX_WAIT).unwrap();
    }
}

#[test]
fn a_follower_waits_for_its_topic_and_survives_a_restart() {
    let place = Place::new("restart");
    let mut follower = Follower::on(place.bus("consumer"));
    let imu = follower.follow("ego/imu/imu", Take::All);
    assert!(!follower.wait(Duration::ZERO).unwrap());
    assert!(!follower.topic(imu).found());
    assert_eq!(
        follower.reports()[0].to_string(),
        "ego/imu/imu: never appeared"
    );

    let first = Daemon::start(&place, 1);
    find(&mut follower, &first);
    first.tick(1);
    assert!(follower.wait(MAX_WAIT).unwrap(), "woken by the frame");
    assert_eq!(follower.take(imu).unwrap().unwrap().header().tick, 1);
    drop(first);

    let second = Daemon::start(&place, 2);
    (1..=3).for_each(|tick| second.tick(tick));
    follower.wait(MAX_WAIT).unwrap();
    let ticks: Vec<u64> = std::iter::from_fn(|| follower.take(imu).unwrap())
        .map(|frame| frame.header().tick)
        .collect();
    assert_eq!(ticks, [1, 2, 3]);
    assert_eq!(follower.topic(imu).epoch(), Some(2));
    assert_eq!(
        follower.reports()[0].to_string(),
        "ego/imu/imu: 4 frames, 0 lost, 1 restarts of the simulator"
    );
}

#[test]
fn the_newest_is_taken_and_the_rest_is_counted() {
    let place = Place::new("newest");
    let daemon = Daemon::start(&place, 1);
    let mut follower = Follower::on(place.bus("consumer"));
    let new = follower.follow_all(Take::Newest).unwrap();
    assert_eq!(new.len(), 1);
    assert!(
        follower.follow_all(Take::Newest).unwrap().is_empty(),
        "known by now"
    );
    find(&mut follower, &daemon);
    (1..=40).for_each(|tick| daemon.tick(tick));
    assert_eq!(follower.take(new[0]).unwrap().unwrap().header().tick, 40);
    let counts = follower.topic(new[0]).counts();
    assert_eq!(
        (counts.taken, counts.skipped),
        (1, 15),
        "16 wait, the first of which has no predecessor"
    );
}

#[test]
fn a_frame_is_paired_with_the_world_of_its_tick() {
    let place = Place::new("pair");
    let daemon = Daemon::start(&place, 1);
    let mut follower = Follower::on(place.bus("consumer"));
    let imu = follower.follow("ego/imu/imu", Take::All);
    find(&mut follower, &daemon);
    assert!(follower.newest_world().unwrap().is_none());
    for tick in 1..=8 {
        daemon.tick(tick);
    }
    let frames: Vec<_> =
        std::iter::from_fn(|| follower.take(imu).unwrap().map(|frame| frame.header().tick))
            .collect();
    assert_eq!(frames.len(), 8);
    for tick in frames {
        let world = follower
            .world_at(tick)
            .unwrap()
            .expect("sent before the frame");
        assert_eq!(
            (world.header.tick, world.actor(7).map(|actor| actor.id)),
            (tick, Some(7))
        );
    }
    assert!(follower.world_at(99).unwrap().is_none());
}

#[test]
fn a_document_is_followed_from_before_it_exists() {
    let place = Place::new("doc");
    let bus = place.bus("consumer");
    let mut info = FollowedDocument::new(names::WORLD_INFO);
    assert!(info.changed(&bus).unwrap().is_none());
    let daemon = place.bus("simd");
    let mut publisher = daemon.document_publisher(names::WORLD_INFO).unwrap();
    publisher.send("hello", 1, 1).unwrap();
    let deadline = Instant::now() + Duration::from_secs(20);
    while info.changed(&bus).unwrap().is_none() {
        assert!(Instant::now() < deadline);
        publisher.greet();
    }
    assert_eq!(info.newest().unwrap().text, "hello");
    assert!(info.changed(&bus).unwrap().is_none(), "only news");
}

#[test]
fn lockstep_joins_acknowledges_and_leaves() {
    let place = Place::new("lock");
    let daemon = place.bus("simd");
    let mut server = daemon.command_server().unwrap();
    let mut acks = daemon.ack_reader().unwrap();
    let wake = daemon.listener(names::CONTROL_WAKE).unwrap();
    let bus = place.bus("recorder");
    let thread = std::thread::spawn(move || {
        let refused = Lockstep::join(&bus, "recorder", Duration::from_secs(10)).unwrap_err();
        let lockstep = Lockstep::join(&bus, "recorder", Duration::from_secs(10)).unwrap();
        lockstep.ack(4).unwrap();
        lockstep.ack(5).unwrap();
        refused
    });
    let replies = [
        CommandReply::Refused {
            error: "full".into(),
        },
        CommandReply::Joined {
            participant: 3,
            first_tick: 5,
        },
        CommandReply::Done,
    ];
    let (mut asked, mut acked) = (Vec::new(), Vec::new());
    for reply in replies {
        let deadline = Instant::now() + Duration::from_secs(10);
        let request = loop {
            assert!(Instant::now() < deadline);
            wake.wait(Duration::from_millis(50)).unwrap();
            // Before the request to leave, as the daemon does: what a writer sent that came and
            // went unseen is lost.
            acked.extend(acks.drain().unwrap());
            if let Some(request) = server.take().unwrap() {
                break request;
            }
        };
        // They may have come between the two looks, and go with their writer once it has left.
        acked.extend(acks.drain().unwrap());
        asked.push(asked_for(&request));
        server
            .reply(
                request,
                &ReplyBatch {
                    v: 1,
                    epoch: "9".into(),
                    tick: 4,
                    replies: vec![reply],
                },
            )
            .unwrap();
    }
    assert!(
        matches!(thread.join().unwrap(), LockstepError::Refused { reason, .. } if reason == "full")
    );
    assert_eq!(asked, ["join", "join", "leave"]);
    let acked: Vec<_> = acked
        .iter()
        .map(|ack| (ack.participant, ack.epoch, ack.tick))
        .collect();
    assert_eq!(
        acked,
        [(3, 9, 5)],
        "ticks before the first are not acknowledged"
    );
}

/// Every question is answered with tick 4, so tick 5 is complete by what was told alone.
#[test]
fn a_participant_hears_that_a_tick_is_complete() {
    let place = Place::new("complete");
    let daemon = Daemon::start(&place, 9);
    let complete = daemon.bus.complete_writer().unwrap();
    let snapshot_wake = daemon.bus.notifier(names::WORLD_SNAPSHOT).unwrap();
    let mut server = daemon.bus.command_server().unwrap();
    let mut acks = daemon.bus.ack_reader().unwrap();
    let wake = daemon.bus.listener(names::CONTROL_WAKE).unwrap();
    let (given, mut taken) = (std::sync::mpsc::channel(), None);
    let bus = place.bus("planner");
    let thread = std::thread::spawn(move || {
        let patience = Duration::from_secs(20);
        let mut steps = Steps::join_on(&bus, "planner", patience).unwrap();
        let world = steps.next(&bus, patience).unwrap().unwrap();
        given.0.send(world.header.tick).unwrap();
        steps.acknowledge().unwrap();
    });
    let mut acked = Vec::new();
    let mut is_joined = false;
    let deadline = Instant::now() + Duration::from_secs(20);
    while !thread.is_finished() {
        assert!(Instant::now() < deadline, "{acked:?}");
        wake.wait(Duration::from_millis(20)).unwrap();
        acked.extend(acks.drain().unwrap());
        while let Some(request) = server.take().unwrap() {
            let reply = match asked_for(&request) {
                "join" => CommandReply::Joined {
                    participant: 3,
                    first_tick: 5,
                },
                _ => CommandReply::Done,
            };
            let has_joined = matches!(reply, CommandReply::Joined { .. });
            let answer = ReplyBatch {
                v: 1,
                epoch: "9".into(),
                tick: 4,
                replies: vec![reply],
            };
            server.reply(request, &answer).unwrap();
            if has_joined {
                daemon.tick(5);
                snapshot_wake.notify();
                // Of a simulator that has ended, and of an earlier tick.
                complete.send(8, 5).unwrap();
                complete.send(9, 4).unwrap();
                is_joined = true;
            }
        }
        if is_joined && taken.is_none() {
            assert_eq!(given.1.try_recv().ok(), None, "tick 5 is not complete yet");
            complete.send(9, 5).unwrap();
            taken = Some(5);
        }
    }
    thread.join().unwrap();
    assert_eq!(given.1.try_recv().ok(), taken);
    let acked: Vec<_> = acked
        .iter()
        .map(|ack| (ack.participant, ack.tick))
        .collect();
    assert_eq!(acked, [(3, 5)]);
}

fn asked_for(request: &schema_bus::Request) -> &'static str {
    match request
        .batch
        .as_ref()
        .map(|batch| batch.commands.as_slice())
    {
        Ok([schema_frames::Command::JoinLockstep { .. }]) => "join",
        Ok([schema_frames::Command::LeaveLockstep { participant: 3 }]) => "leave",
        _ => "other",
    }
}
