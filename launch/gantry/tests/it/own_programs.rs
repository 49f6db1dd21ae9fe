//! `gantry up` with programs of a user: where and as what they start, what they are told, topics
//! that the launch file announces, and every mistake before anything starts.

use std::path::Path;

use schema_bus::{Bus, BusOptions, ResultTopic};
use schema_frames::ResultType;
use test_kit::{Process, Sandbox, eventually};

fn up_in(sandbox: &Sandbox, files: &[&Path], more: &[&str]) -> Process {
    let data = sandbox.path("data");
    let mut words = vec!["up"];
    words.extend(files.iter().map(|file| file.to_str().unwrap()));
    words.extend(["--data", data.to_str().unwrap()]);
    words.extend(["--domain", sandbox.domain()]);
    sandbox.spawn("gantry", &[&words[..], more].concat())
}

fn up(sandbox: &Sandbox, launch: &str, more: &[&str]) -> Process {
    let file = sandbox.write("test.toml", &format!("version = 1\n{launch}"));
    up_in(sandbox, &[&file], more)
}

/// A file that may be run.
fn executable(sandbox: &Sandbox, name: &str, text: &str) {
    use std::os::unix::fs::PermissionsExt as _;
    let path = sandbox.write(name, text);
    std::fs::set_permissions(path, std::fs::Permissions::from_mode(0o755)).unwrap();
}

fn folder(sandbox: &Sandbox, name: &str) {
    std::fs::create_dir_all(sandbox.path(name)).unwrap();
}

fn bus(sandbox: &Sandbox) -> Bus {
    let options = BusOptions {
        iceoryx_root: Some(sandbox.iceoryx_root()),
        prefix: Some(sandbox.prefix().to_owned()),
    };
    Bus::open_with(sandbox.domain(), "test", &options).unwrap()
}

/// Python that can make virtual environments.
fn venv(sandbox: &Sandbox, name: &str) {
    let python = std::path::PathBuf::from("python3");
    let path = sandbox.path(name);
    let words = ["-m", "venv", "--without-pip", path.to_str().unwrap()];
    sandbox
        .spawn_program("python3", &python, &words, &[])
        .wait()
        .expect_code(0);
}

#[test]
fn python_runs_in_its_environment_its_folder_and_with_its_settings() {
    let sandbox = Sandbox::new("venv");
    folder(&sandbox, "project");
    venv(&sandbox, "project/env");
    sandbox.write(
        "project/detector.py",
        "import json, os, sys\n\
         print('prefix', os.path.realpath(sys.prefix))\n\
         print('venv', os.environ['VIRTUAL_ENV'] + '/bin' == os.environ['PATH'].split(':')[0])\n\
         print('home', os.environ.get('PYTHONHOME'))\n\
         print('here', os.path.realpath(os.getcwd()))\n\
         print('domain', os.environ['GANTRY_DOMAIN'])\n\
         print('settings', json.loads(sys.argv[-1])['threshold'])\n\
         print('up')\n\
         import time\n\
         time.sleep(100000)\n",
    );
    let file = sandbox.write(
        "project/pipeline.toml",
        "version = 1\n[process.detector]\ncmd = ['python', 'detector.py']\ncwd = '.'\nvenv = 'env'\n\
         ready = { line = '^up$' }\nstop = { signal = 'TERM' }\n[process.detector.params]\nthreshold = 0.25\n",
    );
    let mut gantry = up_in(&sandbox, &[&file], &[]);
    // Python's output is not kept back although it is no terminal's.
    gantry.wait_line("all 1 processes are up");
    let ended = gantry.stop().expect_code(0);
    let real = |name: &str| sandbox.path(name).canonicalize().unwrap();
    for line in [
        format!("detector │ prefix {}", real("project/env").display()),
        "detector │ venv True".into(),
        "detector │ home None".into(),
        format!("detector │ here {}", real("project").display()),
        format!("detector │ domain {}", sandbox.domain()),
        "detector │ settings 0.25".into(),
    ] {
        assert!(ended.lines.contains(&line), "{line:?}: {:#?}", ended.lines);
    }
    let kept = sandbox.path("data/runs/latest/detector.params.json");
    let kept = std::fs::read_to_string(kept).unwrap();
    assert!(kept.contains("\"threshold\": 0.25"), "{kept}");
}

#[test]
fn settings_go_where_the_command_has_them() {
    let sandbox = Sandbox::new("params");
    let launch = "[process.a]\ncmd = ['sh', '-c', 'echo text $0; cat $1', '${params}', '${params_file}']\n\
         params = { n = 3, name = '${name}' }\n";
    let ended = up(&sandbox, launch, &[]).wait().expect_code(0);
    assert!(
        ended.says("text {\"n\":3,\"name\":\"a\"}") && ended.says("  \"n\": 3,"),
        "{:#?}",
        ended.lines
    );
}

#[test]
fn the_domain_reaches_every_program_and_what_the_file_says_of_it_wins() {
    let sandbox = Sandbox::new("domain");
    let launch = "[process.a]\ncmd = ['sh', '-c', 'echo a is on $GANTRY_DOMAIN']\n\
         [process.b]\ncmd = ['sh', '-c', 'echo b is on $GANTRY_DOMAIN']\nenv = { GANTRY_DOMAIN = 'elsewhere' }\n";
    let ended = up(&sandbox, launch, &[]).wait().expect_code(0);
    assert!(
        ended.says(&format!("a is on {}", sandbox.domain())) && ended.says("b is on elsewhere"),
        "{:#?}",
        ended.lines
    );
    // Without a flag the launcher itself is on the domain of its environment.
    let file = sandbox.path("test.toml");
    let words = ["up", file.to_str().unwrap(), "--data", "data"];
    let gantry = test_kit::sandbox::binary_path("gantry");
    let env = [("GANTRY_DOMAIN", "lab")];
    let ended = sandbox
        .spawn_program("gantry", &gantry, &words, &env)
        .wait()
        .expect_code(0);
    assert!(ended.says("a is on lab"), "{:#?}", ended.lines);
    let ended = sandbox
        .spawn_program("gantry", &gantry, &words, &[("GANTRY_DOMAIN", "a/b")])
        .wait()
        .expect_code(2);
    assert!(
        ended.says("the environment's GANTRY_DOMAIN is \"a/b\", but a domain is"),
        "{:#?}",
        ended.lines
    );
    // So is a program that another word names.
    executable(
        &sandbox,
        "gantry-probe",
        "#!/bin/sh\necho probe on $GANTRY_DOMAIN: \"$@\"\n",
    );
    let path = format!("{}:/usr/bin:/bin", sandbox.dir().display());
    let words = ["--domain", "other", "probe", "--flag"];
    let ended = sandbox
        .spawn_program("gantry", &gantry, &words, &[("PATH", &path)])
        .wait()
        .expect_code(0);
    assert!(ended.says("probe on other: --flag"), "{:#?}", ended.lines);
}

#[test]
fn cores_and_priority_are_set() {
    let sandbox = Sandbox::new("cores");
    let launch = "[process.a]\ncmd = ['sh', '-c', 'echo on $(nproc) core, nice $(nice)']\ncores = [0]\nnice = 11\n";
    let ended = up(&sandbox, launch, &[]).wait().expect_code(0);
    assert!(ended.says("on 1 core, nice 11"), "{:#?}", ended.lines);
}

#[test]
fn a_priority_that_is_not_allowed_is_refused_with_the_lowest_that_is() {
    let sandbox = Sandbox::new("nice");
    let launch = "[process.a]\ncmd = ['touch', 'started']\nnice = -5\n";
    let file = sandbox.write("test.toml", &format!("version = 1\n{launch}"));
    let gantry = test_kit::sandbox::binary_path("gantry");
    // Takes the right away from a superuser, too.
    let words = [
        "--bounding-set=-sys_nice",
        "--inh-caps=-sys_nice",
        "sh",
        "-c",
        "ulimit -e 0; exec \"$0\" \"$@\"",
        gantry.to_str().unwrap(),
        "up",
        file.to_str().unwrap(),
        "--data",
        "data",
        "--domain",
        sandbox.domain(),
    ];
    let setpriv = Path::new("setpriv");
    let ended = sandbox
        .spawn_program("setpriv", setpriv, &words, &[])
        .wait()
        .expect_code(2);
    assert!(
        ended.says(
            "error: process a: nice is -5, but this user may only go down to 0; give 0 to 19"
        ),
        "{:#?}",
        ended.lines
    );
    assert!(!sandbox.path("started").exists());
}

#[test]
fn what_is_not_there_is_said_before_anything_starts() {
    let sandbox = Sandbox::new("missing");
    folder(&sandbox, "tools");
    sandbox.write("tools/plain.sh", "echo no program");
    let cases = [
        (
            "cwd = 'nowhere'",
            "process a: cwd is ",
            "/nowhere, but there is no such folder",
        ),
        (
            "venv = 'tools'",
            "process a: venv is ",
            "/tools/bin/python; make it with `python3 -m venv ",
        ),
        (
            "cores = [1023]",
            "process a: cores has 1023, but the cores of this machine are ",
            "",
        ),
        (
            "cwd = 'tools'\ncmd = ['./plain.sh']",
            "process a: there is no program \"./plain.sh\": the file is not executable",
            "",
        ),
        (
            "cmd = ['./other.sh']",
            "process a: there is no program \"./other.sh\"",
            "",
        ),
    ];
    for (lines, start, end) in cases {
        let cmd = if lines.contains("cmd") {
            ""
        } else {
            "cmd = ['touch', 'started']\n"
        };
        let launch =
            format!("[process.b]\ncmd = ['touch', 'started']\n[process.a]\n{cmd}{lines}\n");
        let ended = up(&sandbox, &launch, &[]).wait().expect_code(2);
        let found = |line: &String| line.contains(start) && line.contains(end);
        assert!(ended.lines.iter().any(found), "{lines}: {:#?}", ended.lines);
        assert!(!sandbox.path("started").exists());
    }
}

#[test]
fn a_program_beside_its_file_starts_from_anywhere() {
    let sandbox = Sandbox::new("beside");
    folder(&sandbox, "tools");
    executable(
        &sandbox,
        "tools/own.sh",
        "#!/bin/sh\necho in $(basename $PWD)\n",
    );
    let file = sandbox.write(
        "tools/own.toml",
        "version = 1\n[process.a]\ncmd = ['./own.sh']\ncwd = '.'\n",
    );
    let ended = up_in(&sandbox, &[&file], &[]).wait().expect_code(0);
    assert!(ended.says("in tools"), "{:#?}", ended.lines);
}

#[test]
fn several_files_are_one() {
    let sandbox = Sandbox::new("several");
    folder(&sandbox, "base");
    sandbox.write("base/base.toml", "version = 1\n[process.a]\ncmd = ['sh', '-c', 'echo $X in $(basename $PWD)']\ncwd = '.'\nenv = { X = 'first' }\n");
    let first = sandbox.write("first.toml", "version = 1\ninclude = ['base/base.toml']\n");
    let second = sandbox.write(
        "second.toml",
        "version = 1\n[scenario]\nseed = 5\n[process.a]\nenv = { X = 'second' }\n",
    );
    let ended = up_in(&sandbox, &[&first, &second], &[])
        .wait()
        .expect_code(0);
    assert!(ended.says("a      │ second in base"), "{:#?}", ended.lines);
    let dry = up_in(&sandbox, &[&first, &second], &["--dry-run"])
        .wait()
        .expect_code(0);
    let launch = launch_spec::Launch::parse(&dry.lines.join("\n"), "printed").unwrap();
    assert_eq!(launch.scenario.seed, 5);
    assert_eq!(launch.process("a").unwrap().env["X"], "second");
    let third = sandbox.write("third.toml", "version = 1\nprocess.a = 'x'\n");
    let ended = up_in(&sandbox, &[&first, &third], &[])
        .wait()
        .expect_code(2);
    assert!(
        ended.says("process.a is \"x\", but a table at ")
            && ended.says("base.toml:2:1; one of them must go at ")
            && ended.says("third.toml:2:13"),
        "{:#?}",
        ended.lines
    );
    let round = sandbox.write("round.toml", "version = 1\ninclude = ['round.toml']\n");
    let ended = up_in(&sandbox, &[&round], &[]).wait().expect_code(2);
    assert!(
        ended.says("include goes in a circle: "),
        "{:#?}",
        ended.lines
    );
    let ended = up_in(&sandbox, &[&sandbox.path("gone.toml")], &[])
        .wait()
        .expect_code(2);
    assert!(
        ended.says("cannot read the launch file ") && ended.says("gone.toml"),
        "{:#?}",
        ended.lines
    );
}

/// The daemon reads a resolved file elsewhere, so it is told the whole path of the map.
#[test]
fn a_map_beside_its_launch_file_is_found_from_anywhere() {
    let sandbox = Sandbox::new("map");
    folder(&sandbox, "project");
    sandbox.write("project/crossing.xodr", "<OpenDRIVE/>");
    let file = sandbox.write(
        "project/town.toml",
        "version = 1\n[scenario]\nmap = 'crossing.xodr'\n",
    );
    let ended = up_in(&sandbox, &[&file], &["--dry-run"])
        .wait()
        .expect_code(0);
    let whole = sandbox.path("project/crossing.xodr");
    assert!(
        ended.says(&format!("map = {:?}", whole.display().to_string())),
        "{:#?}",
        ended.lines
    );
}

#[test]
fn announced_topics_are_there_before_their_writers_and_with_their_limits() {
    let sandbox = Sandbox::new("topics");
    let launch = "[topic.'detector/boxes']\ntype = 'boxes2d'\nreaders = 3\nbuffer = 7\n\
         [topic.'detector/raw']\ntype = 'bytes'\n\
         [process.detector]\ncmd = ['sleep', '100000']\nready = { service = 'detector/boxes' }\n\
         [process.planner]\ncmd = ['sleep', '100000']\nafter = ['detector']\n";
    let mut gantry = up(&sandbox, launch, &[]);
    gantry.wait_line("started detector");
    let bus = bus(&sandbox);
    let topics = bus.topics().unwrap();
    let boxes = topics
        .iter()
        .find(|topic| topic.name == "detector/boxes")
        .unwrap();
    assert_eq!(
        (boxes.result, boxes.max_subscribers, boxes.publishers),
        (Some(ResultType::Boxes2d), 3, 0)
    );
    assert!(topics.iter().any(|topic| topic.name == "detector/raw"));
    let _reader = bus.result_reader("detector/boxes").unwrap();
    assert!(
        !gantry
            .lines()
            .iter()
            .any(|line| line.contains("detector is ready"))
    );
    // A topic without a writer is no sign of readiness, whoever reads it.
    let writer = bus
        .result_publisher("detector/boxes", &ResultTopic::new(ResultType::Boxes2d))
        .unwrap();
    gantry.wait_line("detector is ready after");
    gantry.wait_line("started planner");
    // The writer joined the topic as it is: a fourth reader finds no place.
    let _second = bus.result_reader("detector/boxes").unwrap();
    let _third = bus.result_reader("detector/boxes").unwrap();
    let error = bus.result_reader("detector/boxes").unwrap_err().to_string();
    assert!(error.contains('3'), "{error}");
    // Who publishes something else under the name is told.
    let other = bus.result_publisher("detector/boxes", &ResultTopic::new(ResultType::Json));
    assert!(other.is_err());
    drop((writer, _reader, _second, _third));
    gantry.stop().expect_code(0);
    drop(bus);
    eventually("nothing is left", || {
        sandbox.leftovers().is_empty().then_some(())
    });
}

#[test]
fn topics_of_a_launcher_that_was_killed_are_made_anew() {
    let sandbox = Sandbox::new("topics-kill");
    let launch = |readers: u32| {
        format!(
            "[topic.'a/b']\ntype = 'tensor'\nreaders = {readers}\n[process.p]\ncmd = ['sleep', '100000']\n"
        )
    };
    let mut gantry = up(&sandbox, &launch(2), &[]);
    gantry.wait_line("all 1 processes are up");
    gantry.kill9();
    let mut gantry = up(&sandbox, &launch(6), &[]);
    gantry.wait_line("all 1 processes are up");
    let bus = bus(&sandbox);
    let topics = bus.topics().unwrap();
    let found = topics.iter().find(|topic| topic.name == "a/b").unwrap();
    assert_eq!(found.max_subscribers, 6);
    drop(bus);
    gantry.stop().expect_code(0);
    assert_eq!(sandbox.leftovers(), Vec::<String>::new());
}

#[test]
fn a_topic_of_another_type_ends_the_start_with_a_sentence() {
    let sandbox = Sandbox::new("taken");
    let bus = bus(&sandbox);
    let _kept = bus
        .result_service("a/b", &ResultTopic::new(ResultType::Json))
        .unwrap();
    let sleeper = "[process.p]\ncmd = ['touch', 'started']\n";
    let launch = format!("[topic.'a/b']\ntype = 'boxes2d'\n{sleeper}");
    let ended = up(&sandbox, &launch, &[]).wait().expect_code(1);
    assert!(
        ended.says("json") && ended.says("boxes2d"),
        "{:#?}",
        ended.lines
    );
    assert!(!sandbox.path("started").exists());
    let launch = format!("[topic.'a/b']\ntype = 'json'\nreaders = 2\n{sleeper}");
    let ended = up(&sandbox, &launch, &[]).wait().expect_code(0);
    assert!(
        ended.says(
            "another process keeps a/b open, so the limits of the launch file do not act on it"
        ),
        "{:#?}",
        ended.lines
    );
}

#[test]
fn topics_that_do_not_fit_are_refused_before_anything_starts() {
    let sandbox = Sandbox::new("budget");
    let launch = "[topic.'a/b']\ntype = 'bytes'\nmax_bytes = 1000000000000\n[process.p]\ncmd = ['touch', 'started']\n";
    let ended = up(&sandbox, launch, &[]).wait().expect_code(2);
    assert!(
        ended.says("MiB of shared memory, but /dev/shm has"),
        "{:#?}",
        ended.lines
    );
    assert!(!sandbox.path("started").exists());
}

#[test]
fn the_schema_is_printed_for_editors() {
    let sandbox = Sandbox::new("schema");
    let ended = sandbox
        .spawn("gantry", &["up", "--schema"])
        .wait()
        .expect_code(0);
    let text = ended.lines.join("\n");
    let schema: serde_json::Value = text.parse().unwrap();
    assert_eq!(schema["title"], "Gantry launch file");
}
