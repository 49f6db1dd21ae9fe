//! Recordings survive the disk; broken, foreign and cut-off ones are sentences or end early.

use std::collections::BTreeMap;

use consumer_carla::list;
use consumer_carla::recorder::changes::{Changes, StreetLight};
use consumer_carla::recorder::extra::Extra;
use consumer_carla::recorder::file::Reader;
use consumer_carla::recorder::frame::{Born, Collision, Frame, Head, Light, Origin, Pedals};
use consumer_carla::recorder::own_file::{MAGIC, VERSION};
use consumer_carla::recorder::read_error::ReadError;
use consumer_carla::recorder::report;
use consumer_carla::wire::axes::Transform;
use consumer_carla::wire::description::{Attribute, Description};
use consumer_carla::wire::msgpack::{self, Limits, Value};
use schema_frames::document::Weather;
use schema_frames::{GearPhysics, VehiclePhysics, WheelPhysics};

fn who(type_id: &str, role: &str) -> Description {
    let attributes = vec![Attribute {
        name: "role_name".into(),
        kind: 4,
        value: role.into(),
    }];
    Description {
        type_id: type_id.into(),
        attributes,
    }
}

/// Of everything one; numbers that binary fractions have exactly.
fn changes() -> Changes {
    let wheel = WheelPhysics {
        friction: 1.5,
        damping_nms: 0.25,
        max_steer_rad: 0.0,
        radius_m: 0.5,
        max_brake_nm: 1500.0,
        max_hand_brake_nm: 3000.0,
        lat_load_limit: 2.0,
        lat_stiffness_per_rad: 17.0,
        long_stiffness_kg: 1000.0,
        position_m: [1.5, 0.75, 0.5],
    };
    let physics = VehiclePhysics {
        torque_curve: vec![[0.0, 400.0], [6000.0, 300.0]],
        max_rpm: 6500.0,
        engine_inertia_kgm2: 1.0,
        damping_full_throttle_nms: 0.125,
        damping_closed_engaged_nms: 2.0,
        damping_closed_open_nms: 0.25,
        automatic_gearbox: true,
        gear_switch_secs: 0.5,
        clutch_strength_nms: 10.0,
        final_ratio: 4.0,
        forward_gears: vec![GearPhysics {
            ratio: 2.5,
            down_ratio: 0.5,
            up_ratio: 0.75,
        }],
        mass_kg: 1750.0,
        drag_coefficient: 0.25,
        center_of_mass_m: [0.5, -0.25, 0.125],
        steering_curve: vec![[0.0, 1.0]],
        wheels: vec![wheel],
        sweep_wheels: false,
    };
    let bone = Transform {
        location_m: [0.0, 0.25, 1.0],
        rotation_deg: [10.0, 20.0, 30.0],
    };
    Changes {
        weather: Some(Weather {
            cloudiness: 80.0,
            sun_azimuth_deg: 90.0,
            sun_altitude_deg: -5.0,
            ..Weather::default()
        }),
        doors: BTreeMap::from([(7, 0b0101), (8, 0)]),
        street_lights: BTreeMap::from([(
            21,
            StreetLight {
                on: true,
                intensity_lm: 4000.0,
                rgb: [255, 128, 0],
            },
        )]),
        physics: BTreeMap::from([(7, physics)]),
        bones: BTreeMap::from([(9, vec![("crl_hips__C".to_owned(), bone)])]),
    }
}

/// What a file of ours holds.
#[derive(Debug, PartialEq)]
struct Recording {
    head: Head,
    frames: Vec<Frame>,
}

fn read(bytes: &[u8]) -> Result<Recording, ReadError> {
    let mut reader = Reader::new(bytes)?;
    let mut frames = Vec::new();
    while let Some(frame) = reader.next_frame()? {
        frames.push(frame);
    }
    let head = reader.head().clone();
    Ok(Recording { head, frames })
}

/// A hero that drives 1 m a tick and hits a parked van at the third of four ticks.
fn drive() -> Recording {
    let at = |x: f64| Transform {
        location_m: [x, -2.0, 0.5],
        rotation_deg: [0.0, 90.0, 0.0],
    };
    let frames = (0..4u32).map(|idx| Frame {
        number: 1 + u64::from(idx),
        tick: 100 + u64::from(idx),
        elapsed_secs: 0.5 * f64::from(idx),
        delta_secs: 0.5,
        born: if idx == 0 {
            vec![
                Born {
                    id: 7,
                    parent: 0,
                    family: 1,
                    description: who("vehicle.tesla.model3", "hero"),
                    at: at(0.0),
                    on_parent: false,
                },
                Born {
                    id: 8,
                    parent: 0,
                    family: 1,
                    description: who("vehicle.volkswagen.t2", ""),
                    at: at(9.0),
                    on_parent: false,
                },
            ]
        } else {
            Vec::new()
        },
        gone: if idx == 3 { vec![8] } else { Vec::new() },
        attached: Vec::new(),
        poses: BTreeMap::from([(7, at(f64::from(idx))), (8, at(9.0))]),
        pedals: BTreeMap::from([(
            7,
            Pedals {
                steer: -0.25,
                throttle: 0.5,
                brake: 0.0,
                hand_brake: false,
                gear: 2,
            },
        )]),
        lights: BTreeMap::from([(
            3,
            Light {
                state: 1,
                frozen: true,
                elapsed_secs: 2.5,
            },
        )]),
        collisions: if idx == 2 {
            [(0, (7, 8)), (1, (7, 0))]
                .map(|(number, actors)| Collision { number, actors })
                .to_vec()
        } else {
            Vec::new()
        },
        gaits: BTreeMap::from([(9, 1.25)]),
        lamps: BTreeMap::from([(7, 0b10), (8, 0)]),
        motions: BTreeMap::from([(7, [[2.0, 0.0, 0.0], [0.0, 0.0, -1.0]])]),
        extra: Extra {
            boxes: BTreeMap::from([(7, [[0.0, 0.0, 0.75], [2.4, 1.0, 0.75]])]),
            triggers: BTreeMap::from([(3, [[-1.0, 2.0, 0.5], [1.5, 1.0, 0.5]])]),
            light_times: BTreeMap::from([(3, [10.0, 3.0, 2.5])]),
            platform_secs: Some(0.25 * f64::from(idx)),
        },
        changes: if idx == 0 {
            changes()
        } else {
            Changes::default()
        },
    });
    Recording {
        head: Head {
            origin: Origin::Gantry,
            version: VERSION,
            map: "Town10HD".into(),
            date: "2026-01-31 12:00:00".into(),
        },
        frames: frames.collect(),
    }
}

fn bytes(recording: &Recording) -> Vec<u8> {
    let mut bytes = Vec::new();
    recording.head.write(&mut bytes);
    recording
        .frames
        .iter()
        .for_each(|frame| frame.write(&mut bytes));
    bytes
}

#[test]
fn recordings_read_as_they_were_written() {
    let recording = drive();
    assert_eq!(read(&bytes(&recording)).unwrap(), recording);
}

/// Version 2 had nothing behind the velocities, version 3 nothing behind the platform time; texts
/// say which it is.
#[test]
fn recordings_of_the_versions_before_are_read() {
    for (version, n_fields) in [(2, 12), (3, 16)] {
        let mut recording = drive();
        let mut old = Vec::new();
        recording.head.version = version;
        recording.head.write(&mut old);
        for frame in &mut recording.frames {
            let mut bytes = Vec::new();
            frame.write(&mut bytes);
            let Ok(Value::Array(fields)) = msgpack::read(&mut bytes.as_slice(), Limits::default())
            else {
                panic!("a frame is a list")
            };
            msgpack::write(&mut old, &Value::Array(fields[..n_fields].to_vec()));
            frame.changes = Changes::default();
            if version == 2 {
                frame.extra = Extra::default();
            }
        }
        assert_eq!(read(&old).unwrap(), recording);
        let text = report::info(&mut Reader::new(&old[..]).unwrap(), false).unwrap();
        assert!(text.starts_with(&format!("Version: {version}\n")));
    }
    let mut newer = Vec::new();
    msgpack::write(
        &mut newer,
        &list![MAGIC, VERSION + 1, "Town10HD", "2026-01-31 12:00:00"],
    );
    assert!(
        read(&newer)
            .unwrap_err()
            .to_string()
            .contains("reads versions 2 to 4")
    );
}

#[test]
fn cut_off_recordings_end_with_their_last_whole_frame() {
    let recording = drive();
    let whole = bytes(&recording);
    let without_last = Recording {
        frames: recording.frames[..3].to_vec(),
        ..recording
    };
    for cut in [1, 20] {
        let cut = &whole[..whole.len() - cut];
        assert_eq!(read(cut).unwrap(), without_last);
        let text = report::info(&mut Reader::new(cut).unwrap(), false).unwrap();
        assert!(text.ends_with("The file ends within a frame, which is left out.\n"));
    }
}

#[test]
fn foreign_and_broken_recordings_are_sentences() {
    let error = |bytes: &[u8]| read(bytes).unwrap_err().to_string();
    assert!(error(b"").contains("not a recording"));
    assert!(error(b"\x93\x01\x02\x03").contains("not a recording"));
    let whole = bytes(&drive());
    assert!(
        error(&whole[..50]).contains("no frame") || error(&whole[..50]).contains("not a recording")
    );
    let mut backwards = drive();
    backwards.frames.swap(1, 2);
    assert!(error(&bytes(&backwards)).contains("order of time"));
    // Seeded damage: a recording or a sentence, never a panic.
    let mut rng = fastrand::Rng::with_seed(3);
    for _ in 0..20_000 {
        let mut broken = whole.clone();
        for _ in 0..rng.usize(1..5) {
            let at = rng.usize(0..broken.len());
            broken[at] = rng.u8(..);
        }
        let is_whole = read(&broken).is_ok();
        let reader = || Reader::new(&broken[..]);
        for text in [
            reader().and_then(|mut reader| report::info(&mut reader, true)),
            reader().and_then(|mut reader| report::collisions(&mut reader, 'a', 'a')),
            reader().and_then(|mut reader| report::blocked(&mut reader, 0.1, 10.0)),
        ] {
            assert_eq!(text.is_ok(), is_whole);
            assert!(text.is_err() || text.is_ok_and(|text| text.starts_with("Version: ")));
        }
    }
}

#[test]
fn texts_read_like_carlas() {
    let bytes = bytes(&drive());
    let recording = || Reader::new(&bytes[..]).unwrap();
    let info = report::info(&mut recording(), false).unwrap();
    assert!(
        info.starts_with(
            "Version: 4\nMap: Town10HD\nDate: 2026-01-31 12:00:00\n\nFrame 1 at 0 seconds\n"
        ),
        "{info}"
    );
    assert!(
        info.contains(" Create 7: vehicle.tesla.model3 (1) at (0, -200, 50)\n  role_name = hero\n")
    );
    assert!(info.contains("Frame 3 at 1 seconds\n Collision id 0 between 7 (hero)  with 8\n Collision id 1 between 7 (hero)  with 0\n"));
    assert!(info.contains("Frame 4 at 1.5 seconds\n Destroy 8\n") && !info.contains("Frame 2 "));
    assert!(info.ends_with("\nFrames: 4\nDuration: 1.5 seconds\n"));
    let all = report::info(&mut recording(), true).unwrap();
    for line in [
        "  Id: 7 Location: (300, -200, 50) Rotation: (0, 0, 90)",
        "  Id: 3 state: 1 frozen: 1 elapsedTime: 2.5",
        "  Id: 7 Steering: -0.25 Throttle: 0.5 Brake: 0 Handbrake: 0 Gear: 2",
        "  Id: 9 speed: 125",
        "  Id: 7 LowBeam",
        "  Id: 8 None",
        "  Id: 7 linear_velocity: (2, 0, 0) angular_velocity: (0, 0, -1)",
        " Actor bounding boxes: 1",
        "  Id: 7 origin: (0, 0, 75) extension: (240, 100, 75)",
        " Actor trigger volumes: 1",
        "  Id: 3 origin: (-100, 200, 50) extension: (150, 100, 50)",
        " Current platform time: 0.75",
        " Traffic Light time events: 1",
        "  Id: 3 green_time: 10 yellow_time: 3 red_time: 2.5",
        " Weathers: 1",
        " Vehicle door animations: 2",
        "  Doors opened:  Front Left  Rear Left ",
        "  Doors opened: ",
        " Scene light changes: 1",
        "  Id: 21 enabled: True intensity: 4000 RGB_color: (1, 0.501961, 0)",
        " Physics Control events: 1",
        "   mass = 1750",
        "   center_of_mass = (0.5, 0.25, 0.125)",
        "   torque_curve = (0, 400) (6000, 300)",
        "    gear 0: ratio 2.5 down_ratio 0.5 up_ratio 0.75",
        "    wheel 0: tire_friction 1.5 damping_rate 0.25 max_steer_angle 0 radius 50 max_brake_torque 1500 max_handbrake_torque 3000 position (75, -50, 100)",
        " Walkers Bones: 1",
        "     Bone: \"crl_hips__C\" relative: Loc(0, 25, 100) Rot(30, 10, 20)",
    ] {
        assert!(all.lines().any(|found| found == line), "{line}\n{all}");
    }
    // CARLA counts azimuths clockwise.
    assert!(
        all.contains("  Cloudiness: 80 Precipitation: 0 ")
            && all.contains(" SunAzimuthAngle: 270 SunAltitudeAngle: -5 "),
        "{all}"
    );
    let row = |text: String, id: u32| {
        text.lines()
            .find(|line| line.split_whitespace().any(|word| word == id.to_string()))
            .map(str::to_owned)
    };
    let hit = report::collisions(&mut recording(), 'v', 'h').unwrap();
    let words: Vec<String> = row(hit, 8)
        .unwrap()
        .split_whitespace()
        .map(str::to_owned)
        .collect();
    assert_eq!(
        words,
        [
            "1",
            "v",
            "v",
            "8",
            "vehicle.volkswagen.t2",
            "7",
            "vehicle.tesla.model3"
        ]
    );
    let none = report::collisions(&mut recording(), 'w', 'a').unwrap();
    assert_eq!(row(none, 7), None);
    // The van stood for the whole 1.5 s, the hero never for half a second.
    let blocked = report::blocked(&mut recording(), 1.0, 10.0).unwrap();
    assert!(
        row(blocked.clone(), 8).unwrap().trim_end().ends_with(" 2") && row(blocked, 7).is_none()
    );
}
