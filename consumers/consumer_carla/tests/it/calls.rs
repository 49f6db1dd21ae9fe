//! Every call with arguments of every wrong kind: an answer or a sentence, never a panic, and
//! nothing wrong is stored.

use std::sync::Arc;

use consumer_carla::feeds::Feeds;
use consumer_carla::gateway::Gateway;
use consumer_carla::list;
use consumer_carla::rpc;
use consumer_carla::state::commander::commander;
use consumer_carla::state::known_world::World;
use consumer_carla::state::traffic_managers::MAX_TRAFFIC_MANAGERS;
use consumer_carla::wire::msgpack::Value;
use consumer_carla::wire::requests::{Answer, Failure, Request, response};
use consumer_rpc::budget::Account;
use schema_frames::WorldInfo;
use schema_frames::document::{StepMode, Weather};

/// A world in which a simulator has been seen.
pub fn world() -> World {
    let world = World::default();
    let info = WorldInfo {
        source: "live".into(),
        version: "0".into(),
        epoch: "5".into(),
        episode: 1,
        map: "Town10HD".into(),
        seed: 1,
        mode: StepMode::Stepped,
        period_nanos: 50_000_000,
        episode_start_nanos: 0,
        lockstep: Vec::new(),
        weather: Weather::default(),
        adapter: String::new(),
        cpu_copies: 0,
        batches: Vec::new(),
        cameras: Vec::new(),
    };
    world.change(|known| known.info = Some(info));
    world
}

/// A gateway that knows a world and has nobody to command.
fn gateway() -> Gateway {
    let world = Arc::new(world());
    Gateway::new(
        world.clone(),
        commander().0,
        Arc::new(Feeds::new(world)),
        2001,
    )
}

fn call(gateway: &Gateway, method: &str, args: Vec<Value>) -> Result<Answer, Failure> {
    call_of(gateway, &Account::of(1), method, args)
}

fn call_of(
    gateway: &Gateway,
    account: &Account,
    method: &str,
    args: Vec<Value>,
) -> Result<Answer, Failure> {
    let request = Request {
        id: 1,
        method: method.into(),
        is_async: false,
        args,
    };
    rpc::serve(gateway, account, &request)
}

fn odd(rng: &mut fastrand::Rng, depth: u32) -> Value {
    match rng.u8(0..if depth == 0 { 9 } else { 12 }) {
        0 => Value::Nil,
        1 => Value::Bool(rng.bool()),
        2 => Value::Int(-1 - i64::from(rng.u32(..))),
        3 => Value::UInt(rng.u64(..) >> rng.u32(0..64)),
        4 => Value::UInt(rng.u64(0..22)),
        5 => Value::F64([f64::NAN, f64::INFINITY, 1e300, -0.0, 0.05][rng.usize(0..5)]),
        6 => Value::F32(rng.f32() * 100.0 - 50.0),
        7 => Value::from(
            [
                "",
                "vehicle.tesla.model3",
                "sensor.camera.rgb",
                "color",
                "Town10HD",
            ][rng.usize(0..5)],
        ),
        8 => Value::Bin(vec![0; rng.usize(0..30)]),
        _ => Value::Array((0..rng.usize(0..6)).map(|_| odd(rng, depth - 1)).collect()),
    }
}

#[test]
fn odd_arguments_are_answered() {
    let (gateway, mut rng) = (gateway(), fastrand::Rng::with_seed(1));
    for _ in 0..2000 {
        for method in rpc::methods() {
            let args = (0..rng.usize(0..4)).map(|_| odd(&mut rng, 4)).collect();
            let outcome = call(&gateway, method, args);
            assert!(
                !matches!(outcome, Err(Failure::Unknown(_))),
                "{method} is unknown"
            );
            assert!(!response(1, false, outcome).is_empty());
        }
    }
}

/// What one client stored wrongly would end every later one, which decodes it.
#[test]
fn wrong_weather_and_settings_are_not_stored() {
    let gateway = gateway();
    let before = (
        call(&gateway, "get_weather_parameters", vec![]),
        call(&gateway, "get_episode_settings", vec![]),
    );
    let mut weather = vec![Value::F32(1.0); 14];
    weather[12] = Value::F32(f32::NAN);
    assert!(
        call(
            &gateway,
            "set_weather_parameters",
            vec![Value::Array(weather)]
        )
        .is_err()
    );
    let settings = list![
        true,
        false,
        list![true, f64::NAN],
        true,
        0.01,
        10,
        0.0,
        true,
        3000.0,
        2000.0,
        true
    ];
    assert!(call(&gateway, "set_episode_settings", vec![settings]).is_err());
    let after = (
        call(&gateway, "get_weather_parameters", vec![]),
        call(&gateway, "get_episode_settings", vec![]),
    );
    assert_eq!(before, after);
}

#[test]
fn a_traffic_manager_is_forgotten_with_its_connection() {
    let gateway = gateway();
    let place = || vec![list!["192.0.2.1", 8000u16]];
    assert_eq!(
        call(&gateway, "add_traffic_manager_running", place()),
        Ok(Answer::Value(true.into()))
    );
    assert_eq!(
        call(&gateway, "add_traffic_manager_running", place()),
        Ok(Answer::Value(false.into()))
    );
    let running = || call(&gateway, "is_traffic_manager_running", vec![8000u16.into()]);
    assert_eq!(running(), Ok(Answer::Value(true.into())));
    gateway.closed(1);
    assert_eq!(running(), Ok(Answer::Value(false.into())));
    assert_eq!(
        call(
            &gateway,
            "get_traffic_manager_running",
            vec![8000u16.into()]
        ),
        Ok(Answer::Value(list!["", 0u16]))
    );
}

/// Names of hosts are names, there are only so many managers, and nobody removes another's.
#[test]
fn traffic_managers_are_bounded_and_belong_to_who_registered_them() {
    let gateway = gateway();
    let (one, other) = (Account::of(1), Account::of(2));
    let add = |account: &Account, host: &str, port: u16| {
        let place = vec![list![host, port]];
        call_of(&gateway, account, "add_traffic_manager_running", place)
    };
    let long = "a".repeat(254);
    let refused = add(&one, &long, 8000).unwrap_err();
    assert!(
        matches!(&refused, Failure::Refused(error) if error.contains("254 bytes") && error.contains("253")),
        "{refused:?}"
    );
    assert_eq!(add(&one, &long[1..], 8000), Ok(Answer::Value(true.into())));
    let remove = |account: &Account| {
        call_of(
            &gateway,
            account,
            "destroy_traffic_manager",
            vec![8000u16.into()],
        )
    };
    assert_eq!(remove(&other), Ok(Answer::Value(false.into())));
    let running = || call(&gateway, "is_traffic_manager_running", vec![8000u16.into()]);
    assert_eq!(running(), Ok(Answer::Value(true.into())), "it stays");
    assert_eq!(remove(&one), Ok(Answer::Value(true.into())));
    assert_eq!(running(), Ok(Answer::Value(false.into())));
    assert_eq!(add(&one, "h", 8000), Ok(Answer::Value(true.into())));
    gateway.closed(1);
    assert_eq!(
        add(&other, "h", 8000),
        Ok(Answer::Value(true.into())),
        "gone"
    );
    // One connection cannot take all ports.
    let n_taken = (1..=u16::MAX)
        .take_while(|port| add(&other, "h", *port).is_ok())
        .count();
    assert!(n_taken < MAX_TRAFFIC_MANAGERS, "{n_taken}");
    assert!(other.is_over(), "its connection is closed");
    // Nor can many.
    for account in (3..40).map(Account::of) {
        let mut ports = 9000..u16::MAX;
        while ports
            .next()
            .is_some_and(|port| add(&account, "h", port).is_ok())
        {}
    }
    let full = add(&Account::of(40), "h", 65_000).unwrap_err();
    assert!(
        matches!(&full, Failure::Refused(error) if error.contains("1024")),
        "{full:?}"
    );
}

#[test]
fn sensors_and_unknown_calls_are_sentences() {
    let gateway = gateway();
    let transform = list![list![0.0, 0.0, 0.0], list![0.0, 0.0, 0.0]];
    let Err(Failure::Refused(error)) = call(
        &gateway,
        "spawn_actor",
        vec![list![1u32, "sensor.other.sonar", list![]], transform],
    ) else {
        panic!()
    };
    assert!(error.contains("sensor.other.sonar"), "{error}");
    let Err(Failure::Unknown(error)) = call(&gateway, "nothing", vec![]) else {
        panic!()
    };
    assert!(error.contains("'nothing' with argument count 1"), "{error}");
    // Names of methods are echoed, and logged, only so far.
    let Err(Failure::Unknown(error)) = call(&gateway, &"x".repeat(8 << 20), vec![]) else {
        panic!()
    };
    assert!(
        error.len() < 1000 && error.contains("8388608 bytes"),
        "{error}"
    );
}
