//! Launch files as users write them, with and without mistakes.

use launch_spec::{FileText, Launch, LidarsOn, Rig};
use sensor_spec::SensorSpec;

/// The error messages for `body`, which begins in line 2 below the version.
fn errors(body: &str) -> Vec<String> {
    let text = format!("version = 1\n{body}");
    match Launch::parse(&text, "launch/town.toml") {
        Ok(_) => Vec::new(),
        Err(errors) => errors.0.iter().map(ToString::to_string).collect(),
    }
}

fn check(body: &str, expected: &[&str]) {
    assert_eq!(errors(body), expected, "for {body:?}");
}

#[test]
fn a_misspelt_key_is_named_with_its_place_and_the_right_word() {
    let body = "\n".repeat(10) + "[sensor.roof]\nkind = \"lidar\"\nchanels = 64\n";
    check(
        &body,
        &[
            "unknown key \"chanels\" in [sensor.roof], did you mean \"channels\"? at launch/town.toml:14:1",
        ],
    );
}

#[test]
fn all_errors_of_a_file_are_reported_together_in_its_order() {
    let body = r#"
[scenario]
tick_hz = 20
vehicels = 3
mode = "steped"
[sensor.roof]
kind = "lidar"
channels = 400
rate_hz = 15
mount.position = [0, 0, 2]
[sensor.front]
kind = "camera"
modalities = ["rgb", "dept"]
width_px = "wide"
height_px = -5
[process.drive]
cmd = "gantry-drive"
after = ["simd"]
"#;
    check(
        body,
        &[
            "unknown key \"vehicels\" in [scenario], did you mean \"vehicles\"? at launch/town.toml:5:1",
            "scenario.mode is \"steped\", but must be one of free_running, stepped, did you mean \"stepped\"? at launch/town.toml:6:8",
            "sensor.roof.channels is 400, but must be 1 to 256 at launch/town.toml:9:12",
            "sensor.roof.rate_hz is 15, but must divide the tick rate 20; try 20 or 10 at launch/town.toml:10:11",
            "unknown key \"position\" in [sensor.roof.mount], did you mean \"position_m\"? at launch/town.toml:11:7",
            "sensor.front.modalities is [\"rgb\", \"dept\"], but must name only rgb, depth, semantic, instance, flow, normals, dvs; \"dept\" is none of them at launch/town.toml:14:14",
            "sensor.front.width_px is \"wide\", but must be a whole number at launch/town.toml:15:12",
            "sensor.front.height_px is -5, but must be a whole number from 0 to 4294967295 at launch/town.toml:16:13",
            "process.drive.after is \"simd\", but there is no [process.simd] at launch/town.toml:17:10",
            "process.drive.cmd is \"gantry-drive\", but must be a list in brackets at launch/town.toml:18:7",
        ],
    );
}

#[test]
fn lidars_are_cast_where_the_file_says() {
    let lidars_on = |body: &str| {
        Launch::parse(&format!("version = 1\n[scenario]\n{body}"), "x.toml")
            .map(|launch| launch.scenario.lidars_on)
    };
    for (body, expected) in [
        ("", LidarsOn::Auto),
        ("lidars_on = \"cpu\"", LidarsOn::Cpu),
        ("lidars_on = \"gpu\"", LidarsOn::Gpu),
    ] {
        assert_eq!(lidars_on(body).unwrap(), expected, "{body:?}");
    }
    let error = "scenario.lidars_on is \"gqu\", but must be one of auto, cpu, gpu, did you mean \"gpu\"? at x.toml:3:13";
    assert_eq!(
        lidars_on("lidars_on = \"gqu\"").unwrap_err().to_string(),
        error
    );
}

#[test]
fn idle_lockstep_participants_are_waited_for_as_long_as_the_file_says() {
    let nanos = |body: &str| {
        Launch::parse(&format!("version = 1\n[scenario]\n{body}"), "x.toml")
            .map(|launch| launch.scenario.lockstep_timeout_nanos())
            .map_err(|error| error.to_string())
    };
    assert_eq!(nanos(""), Ok(None));
    assert_eq!(nanos("lockstep_timeout_s = 0"), Ok(None));
    assert_eq!(nanos("lockstep_timeout_s = 2.5"), Ok(Some(2_500_000_000)));
    let error = "scenario.lockstep_timeout_s is -1, but must be 0 to 86400 at x.toml:3:22";
    assert_eq!(nanos("lockstep_timeout_s = -1"), Err(error.to_owned()));
}

#[test]
fn syntax_errors_have_a_place() {
    let messages = errors("[scenario\nmap = \"Town\n");
    assert!(
        !messages.is_empty()
            && messages
                .iter()
                .all(|message| message.contains("launch/town.toml:")),
        "{messages:?}"
    );
    check(
        "[scenario]\nseed = 1\nseed = 2\n",
        &["duplicate key at launch/town.toml:4:1"],
    );
}

#[test]
fn the_version_is_asked_for() {
    let error = Launch::parse("", "x.toml").unwrap_err().to_string();
    assert_eq!(
        error,
        "version is missing; begin the file with version = 1 at x.toml:1:1"
    );
    let error = Launch::parse("version = 2", "x.toml")
        .unwrap_err()
        .to_string();
    assert_eq!(
        error,
        "version is 2, but this program reads 1 at x.toml:1:11"
    );
}

#[test]
fn sensors_need_a_known_kind_and_a_rig_that_exists() {
    check(
        "[sensor.a]\n",
        &[
            "[sensor.a] has no kind; give one of camera, lidar, imu, gnss, radar, obstacle, collision, lane_invasion, or a profile as sensor at launch/town.toml:2:9",
        ],
    );
    check(
        "[sensor.a]\nkind = \"lider\"\n",
        &[
            "sensor.a.kind is \"lider\", but must be a kind of sensor, did you mean \"lidar\"? at launch/town.toml:3:8",
        ],
    );
    check(
        "[sensor.a]\nkind = \"imu\"\nrig = \"eggo\"\n",
        &[
            "sensor.a.rig is \"eggo\", but there is no [rig.eggo], did you mean \"ego\"? at launch/town.toml:4:7",
        ],
    );
    check(
        "[sensor.Front]\nkind = \"imu\"\n",
        &[
            "[sensor.Front] has a name that is not 1 to 32 lower-case letters, digits or '_', a letter first at launch/town.toml:2:9",
        ],
    );
}

#[test]
fn rigs_ride_on_vehicles_that_exist() {
    check(
        "[scenario]\nvehicles = 2\n[rig.a]\nvehicle = 2\n[rig.world]\nvehicle = 0\n[rig.b]\n",
        &[
            "rig.a.vehicle is 2, but must be \"ego\" or 0 to 1 (scenario.vehicles is 2) at launch/town.toml:5:11",
            "[rig.world] has a name that the simulator uses itself; choose another at launch/town.toml:6:6",
            "[rig.b] says not where it is; give vehicle = \"ego\", vehicle = 0 (another vehicle) or pose at launch/town.toml:8:6",
        ],
    );
}

#[test]
fn processes_that_wait_for_one_another_are_refused() {
    check(
        "[process.a]\ncmd = [\"a\"]\nafter = [\"b\"]\n[process.b]\ncmd = [\"b\"]\nafter = [\"a\"]\n",
        &[
            "processes a, b wait for one another through \"after\"; break the circle at launch/town.toml:2:10",
        ],
    );
}

#[test]
fn process_details_are_checked() {
    check(
        "[process.a]\ncmd = [\"a\", \"${runs}\"]\nstop = { grace = \"5 parsecs\", signal = \"STOP\" }\nready = { line = \"(\", tcp = \"2000\" }\nrestart.policy = \"onfailure\"\n",
        &[
            "process.a.cmd has \"${runs}\", which is nothing the launcher replaces, known: run_dir, name, domain, launch, params, params_file at launch/town.toml:3:7",
            "process.a.stop.grace is \"5 parsecs\", but must be a time such as 500ms, 2.5s, 1m or 1h, at most a week at launch/town.toml:4:18",
            "process.a.stop.signal is \"STOP\", but must be one of INT, TERM, HUP, QUIT, KILL at launch/town.toml:4:40",
            "process.a.ready has 2 signs, but must have one of service, line, tcp at launch/town.toml:5:1",
            "process.a.ready.line is \"(\", which is no regular expression: unclosed group at launch/town.toml:5:9",
            "process.a.ready.tcp is \"2000\", but must be host:port, e.g. \"127.0.0.1:2000\" at launch/town.toml:5:9",
            "process.a.restart.policy is \"onfailure\", but must be one of never, on-failure, always, did you mean \"on-failure\"? at launch/town.toml:6:18",
        ],
    );
}

#[test]
fn what_a_process_starts_in_is_checked() {
    check(
        "[process.a]\ncmd = [\"a\", \"${params}\"]\ncpus = [1]\ncores = [1, 5000]\nnice = 30\ncwd = \"\"\nvenv = 3\n\
         [process.b]\ncmd = [\"b\"]\nnice = \"low\"\nparams = 3\n\
         [process.c]\ncmd = [\"c\"]\nlockstep = true\n\
         [process.d.params]\nx = nan\ny = { z = [\"${nam}\"] }\n",
        &[
            "process.a.cmd wants params, but there is no [process.a.params] at launch/town.toml:3:7",
            "unknown key \"cpus\" in [process.a], did you mean \"cores\"? at launch/town.toml:4:1",
            "process.a.cores has 5000, but cores are 0 to 1023 at launch/town.toml:5:9",
            "process.a.nice is 30, but must be a whole number from -20 to 19 at launch/town.toml:6:8",
            "process.a.cwd is \"\", but must be the path of a folder in quotes at launch/town.toml:7:7",
            "process.a.venv is 3, but must be the path of a folder in quotes at launch/town.toml:8:8",
            "process.b.nice is \"low\", but must be a whole number from -20 to 19 at launch/town.toml:11:8",
            "process.b.params is 3, but must be a table at launch/town.toml:12:10",
            "process.c.lockstep is true, but no process of the launch runs simd or gantry-replay, whose ticks could wait for it at launch/town.toml:15:12",
            "[process.d] has no cmd; give cmd = [\"program\", \"argument\"] at launch/town.toml:16:10",
            "process.d.params.x is nan, but JSON has no such number at launch/town.toml:17:5",
            "process.d.params.y.z has \"${nam}\", which is nothing the launcher replaces, did you mean \"name\"? at launch/town.toml:18:11",
        ],
    );
}

#[test]
fn who_takes_part_in_lockstep_comes_after_the_simulator() {
    let text = "version = 1\n[process.a]\ncmd = [\"a\"]\nlockstep = true\n[process.world]\ncmd = [\"/opt/simd\"]\n";
    let launch = Launch::parse(text, "x.toml").unwrap();
    assert_eq!(launch.process("a").unwrap().after, ["world"]);
    let within = text.replace(
        "lockstep = true\n",
        "lockstep = true\nready = { within = \"2s\" }\n",
    );
    let launch = Launch::parse(&within, "x.toml").unwrap();
    let ready = launch.process("a").unwrap().ready.clone().unwrap();
    assert_eq!(ready.when, launch_spec::ReadyWhen::Lockstep);
    assert_eq!(ready.within.to_string(), "2s");
    let written = launch.to_toml_with_defaults();
    assert_eq!(
        Launch::parse(&written, "x.toml").unwrap(),
        launch,
        "{written}"
    );
    check(
        "[process.world]\ncmd = [\"simd\"]\nafter = [\"a\"]\n[process.a]\ncmd = [\"a\"]\nlockstep = true\n",
        &[
            "processes world, a wait for one another through \"after\"; break the circle at launch/town.toml:2:10",
        ],
    );
    check(
        "[process.world]\ncmd = [\"simd\"]\nlockstep = true\n",
        &[
            "process.world.lockstep is true, but this process is the simulator, with which the others keep step at launch/town.toml:4:12",
        ],
    );
}

#[test]
fn topics_have_limits_and_those_of_ones_own_a_type() {
    let text = "version = 1\n[sensor.front]\nkind = \"camera\"\n[topic.\"ego/front/rgb\"]\nreaders = 4\nbuffer = 6\n\
        [topic.\"detector/boxes\"]\ntype = \"boxes2d\"\nborrowed = 2\nmax_bytes = 4096\n";
    let launch = Launch::parse(text, "x.toml").unwrap();
    let limits = launch.limits_of("ego/front/rgb");
    assert_eq!(
        (limits.readers, limits.buffer, limits.borrowed),
        (Some(4), Some(6), None)
    );
    assert_eq!(launch.memory_budget()[0].limits, limits);
    let own = &launch.topics["detector/boxes"];
    assert_eq!(
        (
            own.result.map(|kind| kind.name()),
            own.max_bytes,
            own.limits.borrowed
        ),
        (Some("boxes2d"), Some(4096), Some(2))
    );
    let written = launch.to_toml_with_defaults();
    assert_eq!(
        Launch::parse(&written, "written").unwrap(),
        launch,
        "{written}"
    );
    check(
        "[sensor.front]\nkind = \"camera\"\n\
         [topic.\"ego/front/rbg\"]\nreaders = 0\nbuffer = 257\nborrowed = 1.5\n\
         [topic.\"ego/front/rgb\"]\ntype = \"image\"\nmax_bytes = 0\n\
         [topic.\"a//b\"]\ntype = \"box2d\"\n\
         [topic.\"world/snapshot\"]\nreaders = 20\n\
         [topic.\"a/about\"]\ntype = \"json\"\nhistory = 1\n",
        &[
            "no sensor of this launch publishes \"ego/front/rbg\"; a topic of your own needs type, e.g. type = \"boxes2d\", did you mean \"ego/front/rgb\"? at launch/town.toml:4:8",
            "topic.\"ego/front/rbg\".readers is 0, but must be a whole number from 1 to 32 at launch/town.toml:5:11",
            "topic.\"ego/front/rbg\".buffer is 257, but must be a whole number from 1 to 256 at launch/town.toml:6:10",
            "topic.\"ego/front/rbg\".borrowed is 1.5, but must be a whole number from 1 to 256 at launch/town.toml:7:12",
            "topic.\"ego/front/rgb\".type is given, but a sensor of this launch publishes the topic and says that; remove the key at launch/town.toml:9:1",
            "topic.\"ego/front/rgb\".max_bytes is given, but a sensor of this launch publishes the topic and says that; remove the key at launch/town.toml:10:1",
            "topic.\"ego/front/rgb\".max_bytes is 0, but must be a whole number from 1 to 1099511627776 at launch/town.toml:10:13",
            "[topic.\"a//b\"] has a name that is not 1 to 200 letters, digits, '_', '-', '.', with '/' between parts at launch/town.toml:11:8",
            "topic.\"a//b\".type is \"box2d\", but must be a type of result, did you mean \"boxes2d\"? at launch/town.toml:12:8",
            "[topic.\"world/snapshot\"] is one of the simulator's own topics, whose limits are fixed; choose a name outside world/ and control/ that does not end in /about at launch/town.toml:13:8",
            "[topic.\"a/about\"] is one of the simulator's own topics, whose limits are fixed; choose a name outside world/ and control/ that does not end in /about at launch/town.toml:15:8",
            "unknown key \"history\" in [topic.\"a/about\"], known: readers, buffer, borrowed, gpu, gpu_readers, type, max_bytes at launch/town.toml:17:1",
        ],
    );
}

#[test]
fn frames_of_cameras_and_lidars_can_be_kept_on_the_gpu_and_no_others() {
    let text = "version = 1\n[sensor.front]\nkind = \"camera\"\n[sensor.imu]\nkind = \"imu\"\n\
        [topic.\"ego/front/rgb\"]\ngpu = true\ngpu_readers = 3\n";
    let launch = Launch::parse(text, "x.toml").unwrap();
    let limits = launch.limits_of("ego/front/rgb");
    assert_eq!((limits.gpu, limits.gpu_readers), (true, Some(3)));
    let written = launch.to_toml_with_defaults();
    assert_eq!(Launch::parse(&written, "written").unwrap(), launch);
    check(
        "[sensor.front]\nkind = \"camera\"\n[sensor.imu]\nkind = \"imu\"\n\
         [topic.\"ego/front/rgb\"]\ngpu = 1\ngpu_readers = 33\n\
         [topic.\"ego/imu/imu\"]\ngpu = true\n",
        &[
            "topic.\"ego/front/rgb\".gpu is 1, but must be true or false at launch/town.toml:7:7",
            "topic.\"ego/front/rgb\".gpu_readers is 33, but must be a whole number from 1 to 32 at launch/town.toml:8:15",
            "topic.\"ego/imu/imu\".gpu is given, but only frames of cameras and lidars (images, dvs and lidar points) can stay on the GPU; remove the key at launch/town.toml:10:1",
        ],
    );
}

#[test]
fn settings_are_typed_laid_over_and_blamed() {
    let text = "version = 1\n[scenario]\nseed = 1\n[sensor.front]\nkind = \"camera\"\n";
    let sets = [
        "scenario.seed=9",
        "scenario.map=Town02",
        "sensor.front.width_px = 640",
        "process.a.cmd=[\"a\"]",
    ]
    .map(String::from);
    let launch = Launch::parse_with(text, "x.toml", &sets).unwrap();
    assert_eq!(
        (launch.scenario.seed, launch.scenario.map.as_str()),
        (9, "Town02")
    );
    assert!(
        matches!(&launch.sensors["front"].spec, SensorSpec::Camera(camera) if camera.width_px == 640 && camera.height_px == 600)
    );
    assert_eq!(launch.processes[0].cmd, ["a"]);

    let sets = ["scenario.sead=9", "scenario.tick_hz=fast", "nonsense"].map(String::from);
    let messages: Vec<_> = Launch::parse_with(text, "x.toml", &sets)
        .unwrap_err()
        .0
        .iter()
        .map(ToString::to_string)
        .collect();
    assert_eq!(
        messages,
        [
            "unknown key \"sead\" in [scenario], did you mean \"seed\"? at --set scenario.sead=9",
            "scenario.tick_hz is \"fast\", but must be a number at --set scenario.tick_hz=fast",
            "--set \"nonsense\" has no \"=\"; write --set key=value, e.g. --set scenario.seed=7 at the command line",
        ]
    );
}

#[test]
fn a_sensor_on_two_rigs_has_topics_on_both() {
    let text = include_str!("../../../two_rigs.toml");
    let launch = Launch::parse(text, "launch/two_rigs.toml").unwrap();
    let topics: Vec<_> = launch
        .memory_budget()
        .into_iter()
        .map(|topic| topic.topic)
        .collect();
    assert!(
        topics.contains(&"ego/front/depth".into()) && topics.contains(&"chaser/front/depth".into()),
        "{topics:?}"
    );
    assert_eq!(launch.placed_sensors()[0].rig, "ego");
    assert_eq!(launch.rigs["chaser"], Rig::Other(0));
    let depth = launch
        .memory_budget()
        .into_iter()
        .find(|topic| topic.topic == "ego/front/depth")
        .unwrap();
    assert_eq!(depth.max_payload_bytes, 640 * 480 * 4);
}

#[test]
fn defaults_reach_processes_that_say_nothing_else() {
    let text = "version = 1\n[defaults]\nenv = { A = \"1\", B = \"1\" }\nrestart = { policy = \"always\", max = 2 }\n\
        [process.p]\ncmd = [\"p\"]\nenv = { B = \"2\" }\nrestart = { max = 3 }\n";
    let launch = Launch::parse(text, "x.toml").unwrap();
    let process = launch.process("p").unwrap();
    assert_eq!(
        process.env.clone().into_iter().collect::<Vec<_>>(),
        [("A".into(), "1".into()), ("B".into(), "2".into())]
    );
    assert_eq!(
        (process.restart.policy, process.restart.max),
        (launch_spec::RestartPolicy::Always, 3)
    );
}

#[test]
fn every_launch_file_we_ship_parses_and_survives_being_written_out() {
    let folder = concat!(env!("CARGO_MANIFEST_DIR"), "/..");
    let mut n_files = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|extension| extension != "toml") {
            continue;
        }
        let launch = Launch::load(&[path], &[], &mut FileText::read)
            .unwrap_or_else(|errors| panic!("{errors}"));
        let written = launch.to_toml_with_defaults();
        let again = Launch::parse(&written, "written")
            .unwrap_or_else(|errors| panic!("{errors}\n{written}"));
        assert_eq!(again, launch, "{written}");
        n_files += 1;
    }
    assert!(n_files >= 3, "{n_files} launch files in {folder}");
}

/// Goal: no text makes the reader panic. Method: a seeded mutator cuts, repeats and replaces pieces
/// of a good file.
#[test]
fn mutated_files_never_panic() {
    let pipeline = "version = 1
[sensor.front]
kind = \"camera\"
[topic.\"ego/front/rgb\"]
readers = 4
[topic.\"detector/boxes\"]
type = \"boxes2d\"
max_bytes = 4096
[process.simd]
cmd = [\"simd\"]
[process.detector]
cmd = [\"python\", \"detector.py\", \"${params}\"]
cwd = \".\"
venv = \"envs/torch\"
nice = 5
cores = [0, 1]
lockstep = true
ready = { within = \"20s\" }
params = { threshold = 0.5, classes = [\"car\", \"person\"], since = 1979-05-27 }
";
    let good = [
        include_str!("../../../quickstart.toml"),
        include_str!("../../../two_rigs.toml"),
        pipeline,
    ];
    let pieces = [
        "=",
        "[",
        "]]",
        "\"",
        "{ }",
        "nan",
        "-1",
        "1e999",
        "99999999999999999999",
        "true",
        "\u{0}",
        "ü",
        "${",
        ".",
        "1979-05-27",
        "[[process]]",
    ];
    let mut rng = fastrand::Rng::with_seed(2);
    let mut n_accepted = 0;
    for _ in 0..3_000 {
        let lines = good[rng.usize(0..good.len())].lines();
        let mut chosen: Vec<String> = lines
            .filter(|_| rng.u8(..) > 2)
            .map(str::to_owned)
            .collect();
        for _ in 0..rng.usize(0..4) {
            let line = rng.usize(0..chosen.len());
            let text = chosen[line].clone();
            let cut = text.floor_char_boundary(rng.usize(0..=text.len()));
            let piece = pieces[rng.usize(0..pieces.len())];
            chosen[line] = match rng.u8(0..4) {
                0 => format!("{}{piece}{}", &text[..cut], &text[cut..]),
                1 => text[..cut].to_owned(),
                2 => text.split('=').next().unwrap_or_default().to_owned() + "= " + piece,
                _ => chosen[rng.usize(0..chosen.len())].clone(),
            };
        }
        let text = chosen.join("\n");
        let sets: Vec<_> = (rng.u8(0..4) == 0)
            .then(|| format!("scenario.seed={}", pieces[rng.usize(0..pieces.len())]))
            .into_iter()
            .collect();
        match Launch::parse_with(&text, "fuzz.toml", &sets) {
            Err(errors) => assert!(!errors.to_string().is_empty()),
            Ok(launch) => {
                n_accepted += 1;
                Launch::parse(&launch.to_toml_with_defaults(), "written")
                    .unwrap_or_else(|errors| panic!("{errors}\n{text}"));
            }
        }
    }
    assert!(
        n_accepted > 0,
        "the mutator breaks every file; it tests nothing behind the syntax"
    );
}

#[test]
fn sensors_on_no_ego_vehicle_are_refused() {
    let town = "version = 1\n[ego]\ntype_id = \"none\"\n";
    assert!(Launch::parse(town, "town.toml").unwrap().ego.is_none());
    let pole = "[rig.pole]\npose.position_m = [0.0, 0.0, 6.0]\n[sensor.imu]\nkind = \"imu\"\n";
    Launch::parse(&format!("{town}{pole}rig = \"pole\"\n"), "town.toml").unwrap();
    let errors = Launch::parse(&format!("{town}{pole}"), "town.toml")
        .unwrap_err()
        .to_string();
    assert!(
        errors.contains("sensor.imu rides on the ego vehicle, but ego.type_id is \"none\""),
        "{errors}"
    );
}

#[test]
fn ticks_are_a_millisecond_to_ten_seconds_long() {
    for (tick_hz, period_nanos) in [("0.1", 10_000_000_000), ("1000", 1_000_000)] {
        let launch = Launch::parse(
            &format!("version = 1\n[scenario]\ntick_hz = {tick_hz}\n"),
            "a.toml",
        )
        .unwrap();
        assert_eq!(launch.scenario.period_nanos(), period_nanos);
    }
    for tick_hz in ["0.09", "1001", "0", "nan"] {
        let error = Launch::parse(
            &format!("version = 1\n[scenario]\ntick_hz = {tick_hz}\n"),
            "a.toml",
        )
        .unwrap_err()
        .to_string();
        assert!(
            error.contains("scenario.tick_hz is") && error.contains("but must be 0.1 to 1000"),
            "{error}"
        );
    }
}
