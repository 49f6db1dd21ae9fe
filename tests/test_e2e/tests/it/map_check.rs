//! `gantry map` on our towns, on maps made by PyPI scenariogeneration, and on broken ones; CARLA's
//! client is the oracle.

use test_e2e::venv_program;
use test_kit::Sandbox;
use test_kit::sandbox::repository;

fn made_maps(sandbox: &Sandbox) -> std::path::PathBuf {
    let folder = sandbox.path("made");
    let script = repository().join("tests/test_e2e/python/make_maps.py");
    let args = [script.to_str().unwrap(), folder.to_str().unwrap()];
    sandbox
        .spawn_program(
            "make_maps",
            &venv_program("python"),
            &args,
            &[("PYTHONDONTWRITEBYTECODE", "1")],
        )
        .wait()
        .expect_code(0);
    folder
}

/// Random road networks as SUMO's netgenerate writes them: U-turns tighter than a lane is wide,
/// several lanes, pavements, lights.
#[test]
fn networks_of_sumo_are_read_as_by_the_stock_client() {
    let sandbox = Sandbox::new("mapsumo");
    let folder = sandbox.path("sumo");
    std::fs::create_dir_all(&folder).unwrap();
    let networks = [
        (
            "rand",
            "--rand --rand.iterations 12 --seed 7 --tls.guess --default.lanenumber 2 --sidewalks.guess --crossings.guess",
        ),
        (
            "grid",
            "--grid --grid.number 3 --default.lanenumber 3 --rand.random-lanenumber --turn-lanes 2 -j traffic_light --seed 5 --perturb-x 20",
        ),
        (
            "spider",
            "--spider --spider.arm-number 5 --spider.circle-number 2 --spider.omit-center",
        ),
    ];
    for (name, words) in networks {
        let file = folder.join(format!("{name}.xodr"));
        let args: Vec<&str> = words
            .split(' ')
            .chain(["--opendrive-output", file.to_str().unwrap()])
            .collect();
        sandbox
            .spawn_program("netgenerate", &venv_program("netgenerate"), &args, &[])
            .wait()
            .expect_code(0);
    }
    let python = venv_program("python");
    let words = [
        "map",
        "check",
        folder.to_str().unwrap(),
        "--carla",
        "always",
        "--python",
        python.to_str().unwrap(),
    ];
    let ended = sandbox.spawn("gantry", &words).wait().expect_code(0);
    assert!(
        ended.says("3 maps: 3 sound, 0 broken, 0 read otherwise"),
        "{:#?}",
        ended.lines
    );
    assert!(
        ended
            .lines
            .iter()
            .filter(|line| line.contains("landmarks agree"))
            .count()
            == 3,
        "{:#?}",
        ended.lines
    );
}

/// Roads, lane links, places, widths, types, landmarks: all as the client has them, or the check
/// fails.
#[test]
fn towns_and_made_maps_are_read_as_by_the_stock_client() {
    let sandbox = Sandbox::new("mapcheck");
    let folder = made_maps(&sandbox);
    let python = venv_program("python");
    let words = [
        "map",
        "check",
        folder.to_str().unwrap(),
        "Town02",
        "Town03",
        "--carla",
        "always",
        "--python",
        python.to_str().unwrap(),
    ];
    let ended = sandbox.spawn("gantry", &words).wait().expect_code(0);
    for map in [
        "chain.xodr",
        "crossing.xodr",
        "direct.xodr",
        "signals.xodr",
        "Town02",
        "Town03",
    ] {
        assert!(
            ended
                .lines
                .iter()
                .any(|line| line.starts_with("ok") && line.contains(map)),
            "{map}: {:#?}",
            ended.lines
        );
    }
    // The comparison was not empty: every town has hundreds of waypoints and lane links.
    let n_waypoints = |line: &String| {
        line.trim()
            .strip_prefix("carla: ")?
            .split_once(" waypoints")?
            .0
            .parse::<u32>()
            .ok()
    };
    let counts: Vec<u32> = ended.lines.iter().filter_map(n_waypoints).collect();
    assert!(
        counts.len() >= 4 && counts.iter().all(|n| *n > 50) && counts.iter().any(|n| *n > 1000),
        "{counts:?}"
    );
    assert!(
        ended.says("0 broken, 0 read otherwise"),
        "{:#?}",
        ended.lines
    );
}

/// What the check finds when the map in the file is not the map that the client reads: the oracle
/// is not blind.
#[test]
fn a_map_that_the_client_reads_otherwise_is_found() {
    let sandbox = Sandbox::new("mapdiffer");
    let folder = made_maps(&sandbox);
    let text = std::fs::read_to_string(folder.join("chain.xodr")).unwrap();
    // A Python whose carla moves everything by 5 cm.
    let python = venv_program("python");
    let shim = sandbox.write(
        "python_shim",
        &format!(
            "#!/bin/sh\n[ \"$1\" = -c ] || exit 2\nexec {} -c 'import sys; source = sys.argv[1].replace(\"[location.x,\", \"[location.x + 0.05,\"); sys.argv[1:] = []; exec(compile(source, \"shim\", \"exec\"))' \"$2\"\n",
            python.display()
        ),
    );
    use std::os::unix::fs::PermissionsExt as _;
    std::fs::set_permissions(&shim, std::fs::Permissions::from_mode(0o755)).unwrap();
    let file = sandbox.write("moved.xodr", &text);
    let words = [
        "map",
        "check",
        file.to_str().unwrap(),
        "--carla",
        "always",
        "--python",
        shim.to_str().unwrap(),
    ];
    let ended = sandbox.spawn("gantry", &words).wait().expect_code(1);
    assert!(
        ended
            .lines
            .iter()
            .any(|line| line.contains("differs: places differ by 50.0")),
        "{:#?}",
        ended.lines
    );
}

#[test]
fn broken_maps_are_named_with_line_and_fail_the_check() {
    let sandbox = Sandbox::new("mapbroken");
    let folder = made_maps(&sandbox);
    let text = std::fs::read_to_string(folder.join("chain.xodr")).unwrap();
    let cases = [
        ("half", text[..text.len() / 2].to_owned(), "line"),
        ("other", "<svg/>".to_owned(), "root element is <svg>"),
        ("nan", text.replacen("curvature=\"0.02\"", "curvature=\"nan\"", 1), "not a number within"),
        (
            "dangling",
            text.replacen("<link/>", "<link><successor elementType=\"road\" elementId=\"99\" contactPoint=\"start\"/></link>", 1),
            "\"99\", which the file does not have",
        ),
        (
            "unknown",
            text.replacen("<lanes>", "<lanes><hovercraft eels=\"1\"/><hovercraft/>", 1),
            "unknown element <hovercraft> in <lanes>, 2 times",
        ),
    ];
    for (name, text, sentence) in cases {
        let file = sandbox.write(&format!("{name}.xodr"), &text);
        let ended = sandbox
            .spawn(
                "gantry",
                &["map", "check", file.to_str().unwrap(), "--carla", "never"],
            )
            .wait();
        // Something unknown is odd, not broken.
        let ended = ended.expect_code(i32::from(name != "unknown"));
        assert!(ended.says(sentence), "{name}: {:#?}", ended.lines);
    }
    let ended = sandbox
        .spawn("gantry", &["map", "check", "nowhere.xodr"])
        .wait()
        .expect_code(2);
    assert!(ended.says("no file or folder"), "{:?}", ended.lines);
}

#[test]
fn a_town_is_exported_and_read_back() {
    let sandbox = Sandbox::new("mapexport");
    let file = sandbox.path("town.xodr");
    sandbox
        .spawn(
            "gantry",
            &[
                "map",
                "export",
                "Town02",
                file.to_str().unwrap(),
                "--seed",
                "3",
            ],
        )
        .wait()
        .expect_code(0);
    let text = std::fs::read_to_string(&file).unwrap();
    assert!(schema_roads::RoadMap::parse(&text).unwrap().lanes().len() > 100);
    let ended = sandbox
        .spawn(
            "gantry",
            &["map", "export", "Town99", file.to_str().unwrap()],
        )
        .wait()
        .expect_code(2);
    assert!(ended.says("Town10HD"), "{:?}", ended.lines);
}
