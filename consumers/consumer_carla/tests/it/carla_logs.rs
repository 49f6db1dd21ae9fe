//! CARLA's own recordings: files made here byte by byte, as CARLA's documentation has them, and
//! everything that can be wrong with them.

use consumer_carla::recorder::file::Reader;
use consumer_carla::recorder::frame::{Frame, Head, Origin};
use consumer_carla::recorder::read_error::ReadError;
use consumer_carla::recorder::report;
use consumer_carla::wire::axes::Transform;

/// A file in the making.
#[derive(Clone, Default)]
struct Log(Vec<u8>);

impl Log {
    fn u8(mut self, value: u8) -> Log {
        self.0.push(value);
        self
    }

    fn u16(mut self, value: u16) -> Log {
        self.0.extend(value.to_le_bytes());
        self
    }

    fn u32(mut self, value: u32) -> Log {
        self.0.extend(value.to_le_bytes());
        self
    }

    fn u64(mut self, value: u64) -> Log {
        self.0.extend(value.to_le_bytes());
        self
    }

    fn f64(mut self, value: f64) -> Log {
        self.0.extend(value.to_le_bytes());
        self
    }

    fn floats(mut self, values: &[f32]) -> Log {
        values
            .iter()
            .for_each(|value| self.0.extend(value.to_le_bytes()));
        self
    }

    fn text(mut self, text: &str) -> Log {
        self = self.u16(text.len() as u16);
        self.0.extend(text.as_bytes());
        self
    }

    fn packet(mut self, number: u8, contents: Log) -> Log {
        self = self.u8(number).u32(contents.0.len() as u32);
        self.0.extend(contents.0);
        self
    }

    fn start(self, number: u64, elapsed_secs: f64) -> Log {
        let contents = log().u64(number).f64(0.5).f64(elapsed_secs);
        self.packet(0, contents)
    }

    fn end(self) -> Log {
        self.packet(1, log())
    }

    /// An actor of a type with a role, at a place in centimetres, turned by `yaw`.
    fn actor(self, id: u32, family: u8, type_id: &str, role: &str, at: [f32; 3], yaw: f32) -> Log {
        let me = self
            .u32(id)
            .u8(family)
            .floats(&at)
            .floats(&[0.0, 0.0, yaw])
            .u32(40)
            .text(type_id);
        me.u16(1).u8(4).text("role_name").text(role)
    }

    fn frames(&self) -> Result<(Head, Vec<Frame>), ReadError> {
        let mut reader = Reader::new(&self.0[..])?;
        let mut frames = Vec::new();
        while let Some(frame) = reader.next_frame()? {
            frames.push(frame);
        }
        Ok((reader.head().clone(), frames))
    }
}

fn log() -> Log {
    Log::default()
}

/// 17:02:49 on 8 February 2021.
fn head() -> Log {
    log()
        .u16(1)
        .text("CARLA_RECORDER")
        .u64(1_612_803_769)
        .text("Carla/Maps/Town04_Opt")
}

fn wheel(angle: f32, at: [f32; 3]) -> Log {
    log()
        .floats(&[3.5, 0.25, angle, 35.0, 1500.0, 3000.0])
        .floats(&[2.0, 17.0, 1000.0])
        .floats(&at)
}

fn physics() -> Log {
    let mut wheels = log().u32(2);
    for one in [
        wheel(70.0, [1110.0, 2120.0, 65.0]),
        wheel(0.0, [1090.0, 2120.0, 65.0]),
    ] {
        wheels.0.extend(one.0);
    }
    let mut control = log()
        .u16(1)
        .u32(7)
        .floats(&[6500.0, 1.0, 0.125, 2.0, 0.25])
        .u8(1)
        .floats(&[10.0, 4.0, 1750.0, 0.25])
        .floats(&[0.5, 0.25, 0.125]);
    control = control.u32(1).floats(&[0.0, 400.0]);
    control = control.u32(1).floats(&[2.5, 0.5, 0.75]);
    control = control.u32(2).floats(&[0.0, 1.0, 120.0, 0.5]);
    control.0.extend(wheels.0);
    control
}

/// A hero with a camera, a van and a walker; three ticks with every packet of CARLA 0.9.16.
fn drive() -> Log {
    let born = log()
        .u16(4)
        .actor(
            7,
            1,
            "vehicle.tesla.model3",
            "hero",
            [1000.0, 2000.0, 50.0],
            90.0,
        )
        .actor(
            8,
            1,
            "vehicle.volkswagen.t2",
            "",
            [1500.0, 2000.0, 50.0],
            0.0,
        )
        .actor(9, 2, "walker.pedestrian.0001", "", [0.0, 300.0, 100.0], 0.0)
        .actor(3, 3, "traffic.traffic_light", "", [-10.0, 20.0, 0.0], 0.0);
    let camera = log().u16(1).actor(
        12,
        5,
        "sensor.camera.rgb",
        "front",
        [150.0, 0.0, 240.0],
        0.0,
    );
    let poses = |x: f32| {
        log()
            .u16(2)
            .u32(7)
            .floats(&[x, 2000.0, 50.0, 1.5, -2.5, 90.0])
            .u32(9)
            .floats(&[0.0, 300.0, 100.0, 0.0, 0.0, 0.0])
    };
    let weather = [
        80.0, 0.0, 10.0, 20.0, 270.0, -5.0, 3.0, 0.75, 0.5, 60.0, 1.0, 0.5, 0.25, 0.0,
    ];
    let box_of = |id: u32| {
        log()
            .u16(1)
            .u32(id)
            .floats(&[0.0, 0.0, 75.0, 240.0, 100.0, 75.0])
    };
    head()
        .start(1, 0.0)
        .packet(20, log().f64(1.25))
        .packet(2, born)
        .packet(3, log().u16(0))
        .packet(4, log().u16(0))
        .packet(5, log().u16(0))
        .packet(6, poses(1000.0))
        .packet(7, log().u16(1).u32(3).u8(1).floats(&[2.5]).u8(2))
        .packet(
            8,
            log()
                .u16(1)
                .u32(7)
                .floats(&[-0.25, 0.5, 0.0])
                .u8(1)
                .u32(-1i32 as u32),
        )
        .packet(9, log().u16(1).u32(9).floats(&[125.0]))
        .packet(10, log().u16(2).u32(7).u32(0b10).u32(8).u32(0))
        .packet(
            11,
            log()
                .u16(1)
                .u32(21)
                .floats(&[4000.0, 1.0, 0.5, 0.0, 1.0])
                .u8(1)
                .u8(2),
        )
        .packet(22, log().u16(1).u32(7).u32(1).u8(0).floats(&[10.0, 20.0]))
        .packet(23, log().u16(1).u32(7).floats(&[5.0, 0.5]))
        .packet(24, log().u16(1).floats(&weather))
        .packet(
            12,
            log().u16(1).u32(7).floats(&[2.0, 0.0, 0.0, 0.0, 0.0, -1.0]),
        )
        .packet(13, box_of(7))
        .packet(17, box_of(3))
        .packet(14, log().f64(0.125))
        .packet(15, physics())
        .packet(16, log().u16(1).u32(3).floats(&[10.0, 3.0, 2.5]))
        .packet(
            19,
            log()
                .u16(1)
                .u32(9)
                .u16(1)
                .text("crl_hips__C")
                .floats(&[0.0, 25.0, 100.0, 30.0, 10.0, 20.0]),
        )
        .end()
        .start(2, 0.5)
        .packet(2, camera)
        .packet(4, log().u16(2).u32(12).u32(7).u32(9).u32(8))
        .packet(5, log().u16(1).u32(0).u32(7).u32(8).u8(1).u8(0))
        .packet(6, poses(1100.0))
        .packet(21, log().u16(2).u32(7).u8(0).u8(1).u32(7).u8(3).u8(1))
        .packet(18, log().u64(4711))
        .packet(139, log().text("somebody else's packet"))
        .end()
        .start(3, 1.0)
        .packet(3, log().u16(1).u32(8))
        .packet(
            5,
            log()
                .u16(2)
                .u32(1)
                .u32(7)
                .u32(8)
                .u8(1)
                .u8(0)
                .u32(2)
                .u32(7)
                .u32(u32::MAX)
                .u8(1)
                .u8(0),
        )
        .packet(6, poses(1200.0))
        .packet(21, log().u16(1).u32(7).u8(0).u8(0))
        .end()
}

#[test]
fn every_packet_is_read() {
    let (head, frames) = drive().frames().unwrap();
    assert_eq!(
        (
            head.origin,
            head.version,
            head.map.as_str(),
            head.date.as_str()
        ),
        (
            Origin::Carla,
            1,
            "Carla/Maps/Town04_Opt",
            "02/08/21 17:02:49"
        )
    );
    let [first, second, third] = &frames[..] else {
        panic!("three frames: {frames:?}")
    };
    let hero = &first.born[0];
    assert_eq!(
        (hero.id, hero.family, hero.description.type_id.as_str()),
        (7, 1, "vehicle.tesla.model3")
    );
    assert_eq!(hero.description.attribute("role_name"), Some("hero"));
    assert_eq!(
        hero.at,
        Transform {
            location_m: [10.0, 20.0, 0.5],
            rotation_deg: [0.0, 90.0, 0.0],
        }
    );
    assert_eq!(
        first.poses[&7],
        Transform {
            location_m: [10.0, 20.0, 0.5],
            rotation_deg: [-2.5, 90.0, 1.5],
        }
    );
    let light = first.lights[&3];
    assert_eq!(
        (light.state, light.frozen, light.elapsed_secs),
        (2, true, 2.5)
    );
    let pedals = first.pedals[&7];
    assert_eq!(
        (
            pedals.steer,
            pedals.throttle,
            pedals.hand_brake,
            pedals.gear
        ),
        (-0.25, 0.5, true, -1)
    );
    assert_eq!((first.gaits[&9], first.lamps[&7]), (1.25, 0b10));
    let lamp = first.changes.street_lights[&21];
    assert_eq!(
        (lamp.on, lamp.intensity_lm, lamp.rgb),
        (true, 4000.0, [255, 128, 0])
    );
    let weather = first.changes.weather.unwrap();
    // CARLA counts azimuths clockwise.
    assert_eq!((weather.cloudiness, weather.sun_azimuth_deg), (80.0, 90.0));
    assert_eq!(first.motions[&7], [[2.0, 0.0, 0.0], [0.0, 0.0, -1.0]]);
    assert_eq!(first.extra.boxes[&7], [[0.0, 0.0, 0.75], [2.4, 1.0, 0.75]]);
    assert_eq!(first.extra.triggers[&3], first.extra.boxes[&7]);
    assert_eq!(first.extra.platform_secs, Some(0.125));
    assert_eq!(first.extra.light_times[&3], [10.0, 3.0, 2.5]);
    let (name, bone) = &first.changes.bones[&9][0];
    assert_eq!(
        (name.as_str(), bone.location_m, bone.rotation_deg),
        ("crl_hips__C", [0.0, 0.25, 1.0], [10.0, 20.0, 30.0])
    );
    // The vehicle looks along the world's y: its first wheel is 1.2 m ahead and, as the world's x is
    // at its left, 1.1 m to the left. It rolls and pitches slightly.
    let physics = &first.changes.physics[&7];
    let [x, y, _] = physics.wheels[0].position_m;
    assert!(
        (x - 1.2).abs() < 0.02 && (y - 1.1).abs() < 0.02,
        "{physics:?}"
    );
    assert_eq!(
        (
            physics.mass_kg,
            physics.gear_switch_secs,
            physics.wheels.len()
        ),
        (1750.0, 0.5, 2)
    );
    // A pose on a parent is in the parent's axes.
    let camera = &second.born[0];
    assert_eq!((camera.parent, camera.on_parent), (7, true));
    assert_eq!(camera.at.location_m, [1.5, 0.0, 2.4]);
    assert_eq!(second.attached, [(9, 8)]);
    assert_eq!(second.collisions[0].actors, (7, 8));
    assert_eq!(second.changes.doors[&7], 0b1001);
    assert_eq!(third.changes.doors[&7], 0b1000);
    assert_eq!(third.gone, [8]);
}

#[test]
fn texts_are_those_of_carla() {
    let bytes = drive().0;
    let reader = || Reader::new(&bytes[..]).unwrap();
    let all = report::info(&mut reader(), true).unwrap();
    assert!(
        all.starts_with(
            "Version: 1\nMap: Carla/Maps/Town04_Opt\nDate: 02/08/21 17:02:49\n\nFrame 1 at 0 seconds\n Create 7: vehicle.tesla.model3 (1) at (1000, 2000, 50)\n  role_name = hero\n"
        ),
        "{all}"
    );
    assert!(all.ends_with("\nFrames: 3\nDuration: 1 seconds\n"), "{all}");
    for line in [
        " Create 12: sensor.camera.rgb (5) at (150, 0, 240)",
        " Parenting 12 with 7 (parent)",
        " Parenting 9 with 8 (parent)",
        " Collision id 0 between 7 (hero)  with 8",
        " Collision id 2 between 7 (hero)  with 4294967295",
        " Destroy 8",
        "  Id: 7 Location: (1100, 2000, 50) Rotation: (1.5, -2.5, 90)",
        "  Id: 3 state: 2 frozen: 1 elapsedTime: 2.5",
        "  Id: 7 Steering: -0.25 Throttle: 0.5 Brake: 0 Handbrake: 1 Gear: -1",
        "  Id: 9 speed: 125",
        "  Id: 7 LowBeam",
        "  Id: 21 enabled: True intensity: 4000 RGB_color: (1, 0.501961, 0)",
        "  Id: 7 linear_velocity: (2, 0, 0) angular_velocity: (0, 0, -1)",
        "  Id: 7 origin: (0, 0, 75) extension: (240, 100, 75)",
        " Current platform time: 0.125",
        "    wheel 0: tire_friction 3.5 damping_rate 0.25 max_steer_angle 70 radius 35 max_brake_torque 1500 max_handbrake_torque 3000 position (1110, 2120, 65)",
        "   steering_curve = (0, 1) (120, 0.5)",
        "  Id: 3 green_time: 10 yellow_time: 3 red_time: 2.5",
        "     Bone: \"crl_hips__C\" relative: Loc(0, 25, 100) Rot(30, 10, 20)",
    ] {
        assert!(all.lines().any(|found| found == line), "{line}\n{all}");
    }
    // The order that scenario_runner's reader of these texts needs.
    let titles = [
        " Create",
        " Positions:",
        " State traffic",
        " Vehicle animations",
        " Walker animations",
        " Vehicle light",
        " Scene light",
        " Dynamic actors",
        " Actor bounding",
        " Actor trigger",
        " Current platform",
        " Physics Control",
        " Traffic Light time",
    ];
    let places: Vec<usize> = titles
        .iter()
        .map(|title| all.find(&format!("\n{title}")).expect(title))
        .collect();
    assert!(places.is_sorted(), "{places:?}");
    // The two still touch in the third frame; the first of two is the one that noticed it.
    let crashes = |a, b| {
        let text = report::collisions(&mut reader(), a, b).unwrap();
        let rows = text.lines().filter(|line| line.contains("vehicle.tesla"));
        rows.map(|row| row.split_whitespace().collect::<Vec<_>>().join(" "))
            .collect::<Vec<_>>()
    };
    assert_eq!(
        crashes('h', 'v'),
        ["0 v v 7 vehicle.tesla.model3 8 vehicle.volkswagen.t2"]
    );
    assert_eq!(
        crashes('v', 'o'),
        ["1 v o 7 vehicle.tesla.model3 4294967295"]
    );
    assert!(crashes('o', 'v').is_empty());
    let blocked = report::blocked(&mut reader(), 0.75, 10.0).unwrap();
    assert!(
        blocked.contains("walker.pedestrian.0001") && !blocked.contains("vehicle.tesla"),
        "{blocked}"
    );
}

#[test]
fn numberings_and_widths_of_other_versions_are_told_apart() {
    let weather = log().u16(1).floats(&[25.0; 14]);
    let doors = log().u16(1).u32(7).u8(6).u8(1);
    // 40 bytes: without the stiffness of tyres, as before CARLA 0.9.11.
    let mut plain = physics();
    let wheels_at = plain.0.len() - 2 * 48;
    let wheels: Vec<u8> = plain.0[wheels_at..]
        .chunks(48)
        .flat_map(|wheel| [&wheel[..24], &wheel[36..]].concat())
        .collect();
    plain.0.truncate(wheels_at);
    plain.0.extend(wheels);
    let wide = log().u16(1).u32(7).f64(1000.0).f64(2.0).f64(3.0);
    let wide = wide.f64(0.0).f64(0.0).f64(90.0);
    let file = head()
        .start(1, 0.0)
        .packet(6, wide)
        .packet(18, weather)
        .packet(23, doors)
        .packet(15, plain)
        .end();
    let (_, frames) = file.frames().unwrap();
    let frame = &frames[0];
    assert_eq!(frame.poses[&7].location_m, [10.0, 0.02, 0.03]);
    assert_eq!(frame.changes.weather.unwrap().precipitation, 25.0);
    assert_eq!(frame.changes.doors[&7], 0b1111);
    assert_eq!(frame.changes.physics[&7].wheels[0].radius_m, 0.35);
    // What has another form is left out, unless it is needed.
    let odd = |number| head().start(1, 0.0).packet(number, log().u16(1)).end();
    assert_eq!(odd(15).frames().unwrap().1.len(), 1);
    let error = odd(6).frames().unwrap_err().to_string();
    assert!(error.contains("packet 6 of frame 1 is damaged"), "{error}");
}

#[test]
fn numbers_that_are_none_do_no_harm() {
    let poses = log().u16(1).u32(7).floats(&[f32::NAN; 6]);
    let boxes = log()
        .u16(1)
        .u32(7)
        .floats(&[-f32::NAN; 3])
        .floats(&[f32::NEG_INFINITY; 3]);
    let file = head()
        .start(1, 0.0)
        .packet(6, poses)
        .packet(13, boxes)
        .packet(9, log().u16(1).u32(7).floats(&[f32::NAN]))
        .packet(14, log().f64(f64::NAN))
        .end();
    let text = report::info(&mut Reader::new(&file.0[..]).unwrap(), true).unwrap();
    // As C++ writes them.
    assert!(
        text.contains("origin: (-nan, -nan, -nan) extension: (-inf, -inf, -inf)"),
        "{text}"
    );
    assert!(file.frames().unwrap().1[0].gaits.is_empty());
    let error = |file: Log| file.frames().unwrap_err().to_string();
    for secs in [f64::NAN, -1.0, f64::INFINITY] {
        assert!(error(head().start(1, secs).end()).contains("order of time"));
    }
}

#[test]
fn damaged_files_are_sentences_or_end_early() {
    let error = |file: &[u8]| Log(file.to_vec()).frames().unwrap_err().to_string();
    let whole = drive().0;
    assert!(error(&head().0).contains("no frame"));
    assert!(error(&head().0[..20]).contains("no frame"));
    assert!(error(&head().0[..9]).contains("not a recording"));
    let newer = log().u16(2).text("CARLA_RECORDER").u64(0).text("Town01");
    assert!(error(&newer.0).contains("version 2 of CARLA's, but this program reads version 1"));
    let twice = head().start(1, 0.0).start(2, 0.5).end();
    assert!(error(&twice.0).contains("frame 1 does not end"));
    let backwards = head().start(1, 1.0).end().start(2, 0.5).end();
    assert!(error(&backwards.0).contains("order of time"));
    // A size that is not there reserves no memory, and one that is there has a limit.
    let mut claims = head().start(1, 0.0).end().start(2, 0.5).u8(2).u32(u32::MAX);
    claims.0.extend([0; 100]);
    assert!(error(&claims.0).contains("frame 2 has more than 16777216 bytes"));
    let skipped = head().start(1, 0.0).end().u8(99).u32(u32::MAX);
    assert_eq!(skipped.frames().unwrap().1.len(), 1);
    // Cut anywhere: whole frames, or a sentence before the first.
    let mut n_frames = 0;
    for length in 0..whole.len() {
        let mut reader = Reader::new(&whole[..length]);
        let mut n_read = 0;
        if let Ok(reader) = &mut reader {
            while let Ok(Some(_)) = reader.next_frame() {
                n_read += 1;
            }
        }
        assert!(
            (n_frames..=n_frames + 1).contains(&n_read),
            "{length}: {n_read}"
        );
        n_frames = n_read;
    }
    assert_eq!(n_frames, 2);
}

/// Seeded damage: a recording or a sentence, never a panic; the three texts agree on which.
#[test]
fn flipped_bytes_are_survived() {
    let whole = drive().0;
    let mut rng = fastrand::Rng::with_seed(3);
    let mut n_sentences = 0;
    for _ in 0..20_000 {
        let mut broken = whole.clone();
        for _ in 0..rng.usize(1..5) {
            let at = rng.usize(0..broken.len());
            broken[at] = rng.u8(..);
        }
        let is_whole = Log(broken.clone()).frames().is_ok();
        n_sentences += usize::from(!is_whole);
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
    assert!((1000..19_000).contains(&n_sentences), "{n_sentences}");
}

/// Actors without end cost bounded memory.
#[test]
fn too_many_actors_are_a_sentence() {
    let mut file = head();
    for number in 0..3u32 {
        let mut born = log().u16(30_000);
        for id in 0..30_000 {
            born = born.actor(number * 30_000 + id, 1, "v", "", [0.0; 3], 0.0);
        }
        file = file.start(u64::from(number), 0.0).packet(2, born).end();
    }
    let error = report::info(&mut Reader::new(&file.0[..]).unwrap(), false).unwrap_err();
    assert!(error.to_string().contains("more than 65536 actors"));
}
