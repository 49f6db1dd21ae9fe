//! Flights in worlds of a few actors.

use bytemuck::Zeroable as _;
use schema_frames::SnapshotHeader;
use schema_types::Pose;

use super::*;

const SPECTATOR: u32 = 1;
const CAR: u32 = 7;
const WALKER: u32 = 9;

fn record(id: u32, kind: ActorKind, at: [f64; 3], yaw_rad: f64) -> ActorRecord {
    ActorRecord {
        id,
        kind: kind as u16,
        world_from_actor: Pose::from(Isometry3::from_parts(
            Translation3::from(at),
            rotation(yaw_rad, 0.0),
        )),
        ..ActorRecord::zeroed()
    }
}

/// A spectator 20 m up that looks north (y), a car that drives east, and a walker.
fn world() -> WorldAt {
    let mut car = record(CAR, ActorKind::Vehicle, [100.0, 0.0, 0.0], 0.0);
    car.velocity_in_world_mps = [20.0, 0.0, 0.0];
    WorldAt {
        header: SnapshotHeader {
            tick: 5,
            episode: 1,
            period_nanos: 50_000_000,
            ..SnapshotHeader::zeroed()
        },
        records: vec![
            record(SPECTATOR, ActorKind::Spectator, [0.0, 0.0, 20.0], FRAC_PI_2),
            record(WALKER, ActorKind::Walker, [0.0, 50.0, 1.0], 0.0),
            car,
        ],
    }
}

fn hold(pilot: &mut Pilot, keys: &[Held]) {
    pilot.take(Input::ReleaseAll);
    keys.iter()
        .for_each(|key| pilot.take(Input::Hold(*key, true)));
}

fn near(is: [f64; 3], want: [f64; 3]) -> bool {
    (Vector3::from(is) - Vector3::from(want)).norm() < 1e-6
}

#[test]
fn without_a_key_the_spectator_stays_with_others() {
    let mut pilot = Pilot::default();
    let mut world = world();
    assert_eq!(pilot.advance(0.1, &world), None);
    world.records[0].world_from_actor.translation_m = [5.0, 5.0, 5.0];
    world.header.tick += 2;
    assert_eq!(pilot.advance(0.1, &world), None, "a script moved it");
    hold(&mut pilot, &[Held::Up]);
    let pose = pilot.advance(0.1, &world).unwrap();
    assert!(
        near(pose.translation_m, [5.0, 5.0, 6.0]),
        "from there on: {pose:?}"
    );
}

#[test]
fn keys_fly_along_the_view_and_shift_is_four_times_as_fast() {
    let mut pilot = Pilot::default();
    let world = world();
    pilot.advance(0.1, &world);
    // 10 m/s for half a second, northwards.
    hold(&mut pilot, &[Held::Forward]);
    let pose = pilot.advance(0.5, &world).unwrap();
    assert!(near(pose.translation_m, [0.0, 5.0, 20.0]), "{pose:?}");
    // Left of north is west; the pose in the snapshot lags behind and must not pull it back.
    hold(&mut pilot, &[Held::Left, Held::Fast]);
    let pose = pilot.advance(0.5, &world).unwrap();
    assert!(near(pose.translation_m, [-20.0, 5.0, 20.0]), "{pose:?}");
    hold(&mut pilot, &[]);
    pilot.take(Input::Turn {
        yaw_rad: -FRAC_PI_2,
        pitch_rad: 0.3,
    });
    let pose = pilot.advance(0.1, &world).unwrap();
    let view = pose.isometry().rotation * Vector3::x();
    assert!(
        near(view.into(), [0.3f64.cos(), 0.0, -0.3f64.sin()]),
        "east and down: {view:?}"
    );
    // One notch is 1.2 times the speed.
    pilot.take(Input::Wheel(1.0));
    hold(&mut pilot, &[Held::Up]);
    let pose = pilot.advance(1.0, &world).unwrap();
    assert!((pose.translation_m[2] - 32.0).abs() < 1e-6, "{pose:?}");
}

#[test]
fn the_view_stays_behind_an_actor_where_it_will_be_at_the_next_tick() {
    let mut pilot = Pilot::default();
    let world = world();
    pilot.take(Input::Follow { next: true });
    let pose = pilot.advance(0.1, &world).unwrap();
    // 20 m/s for 50 ms: 1 m ahead; 8 m behind, looking 0.3 rad down at a point 1.2 m above it.
    let want = [101.0 - 8.0 * 0.3f64.cos(), 0.0, 1.2 + 8.0 * 0.3f64.sin()];
    assert!(near(pose.translation_m, want), "{pose:?}");
    pilot.take(Input::Follow { next: true });
    pilot.advance(0.1, &world);
    assert!(
        pilot.describe().contains(&format!("behind {WALKER}")),
        "{}",
        pilot.describe()
    );
    pilot.take(Input::Follow { next: true });
    pilot.advance(0.1, &world);
    assert!(pilot.describe().contains(&format!("behind {CAR}")), "round");
    let mut without = world;
    without.records.pop();
    pilot.advance(0.1, &without);
    assert!(pilot.describe().starts_with("free"), "its actor has gone");
}

#[test]
fn a_pose_that_is_on_its_way_is_not_taken_back() {
    let mut pilot = Pilot::default();
    let mut world = world();
    hold(&mut pilot, &[Held::Up]);
    pilot.advance(0.1, &world);
    hold(&mut pilot, &[]);
    for _ in 0..20 {
        assert_eq!(pilot.advance(0.1, &world), None);
    }
    assert!(
        near(pilot.position_m.into(), [0.0, 0.0, 21.0]),
        "the world stands still"
    );
    world.header.tick += 5;
    pilot.advance(0.1, &world);
    assert!(
        near(pilot.position_m.into(), [0.0, 0.0, 20.0]),
        "somebody else moved it"
    );
}

#[test]
fn egos_are_followed_first() {
    let mut pilot = Pilot::default();
    let mut world = world();
    let hero = record(30, ActorKind::Vehicle, [0.0; 3], 0.0);
    world.records.push(hero);
    pilot.egos = BTreeSet::from([30]);
    assert_eq!(pilot.order(&world), [30, CAR, WALKER]);
    pilot.take(Input::Follow { next: false });
    pilot.advance(0.1, &world);
    assert_eq!(
        pilot.followed,
        Some(WALKER),
        "backwards begins with the last"
    );
}

#[test]
fn the_view_from_above_looks_straight_down_and_follows() {
    let mut pilot = Pilot::default();
    let world = world();
    pilot.advance(0.1, &world);
    pilot.take(Input::Top);
    let pose = pilot.advance(0.1, &world).unwrap();
    let view = pose.isometry().rotation * Vector3::x();
    assert!(near(view.into(), [0.0, 0.0, -1.0]), "{view:?}");
    let up = pose.isometry().rotation * Vector3::z();
    assert!(near(up.into(), [0.0, 1.0, 0.0]), "north stays up: {up:?}");
    assert!(near(pose.translation_m, [0.0, 0.0, 50.0]), "{pose:?}");
    pilot.take(Input::Follow { next: true });
    let pose = pilot.advance(0.1, &world).unwrap();
    assert!(near(pose.translation_m, [101.0, 0.0, 50.0]), "{pose:?}");
    pilot.take(Input::Free);
    let free = pilot.advance(0.1, &world).unwrap();
    assert!(
        near(free.translation_m, pose.translation_m),
        "it stays there: {free:?}"
    );
}

#[test]
fn a_new_episode_begins_anew_where_its_spectator_is() {
    let mut pilot = Pilot::default();
    let mut world = world();
    pilot.take(Input::Follow { next: true });
    assert!(pilot.advance(0.1, &world).is_some());
    world.header.episode = 2;
    assert_eq!(pilot.advance(0.1, &world), None);
    assert!(near(pilot.position_m.into(), [0.0, 0.0, 20.0]));
}

/// Also one that was asked for before the first world was seen.
#[test]
fn an_actor_is_followed_by_its_id_until_it_is_let_go() {
    let mut pilot = Pilot::default();
    pilot.take(Input::FollowActor(WALKER));
    pilot.advance(0.1, &world());
    assert!(
        pilot.describe().starts_with("behind "),
        "{}",
        pilot.describe()
    );
    pilot.take(Input::FollowActor(4_000_000));
    pilot.advance(0.1, &world());
    assert!(pilot.describe().starts_with("free"), "nobody has this id");
    pilot.take(Input::FollowActor(CAR));
    pilot.take(Input::Free);
    pilot.advance(0.1, &world());
    assert!(pilot.describe().starts_with("free"), "{}", pilot.describe());
}
