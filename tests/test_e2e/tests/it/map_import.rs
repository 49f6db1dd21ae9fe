//! `gantry map import` on folders laid out as a CARLA installation, and what a simulator then loads.

use std::path::Path;

use schema_bus::names;
use schema_frames::Command;
use test_e2e::{ask, document, join_bus, start_daemon};
use test_kit::Sandbox;

const LAUNCH: &str = "version = 1\n[scenario]\nmap = \"Town02\"\nseed = 7\ntick_hz = 20\nmode = \"stepped\"\n[ego]\ntype_id = \"none\"\n";

/// A folder as CARLA's, with a town whose text is another town's, so that the two can be told apart.
fn installation(sandbox: &Sandbox) -> std::path::PathBuf {
    let root = sandbox.path("CARLA_0.9.16");
    let maps = root.join("CarlaUE4/Content/Carla/Maps");
    for folder in ["OpenDrive", "Town12/OpenDrive", "Nav"] {
        std::fs::create_dir_all(maps.join(folder)).unwrap();
    }
    let export = |town: &str, file: &Path| {
        let words = ["map", "export", town, file.to_str().unwrap()];
        sandbox.spawn("gantry", &words).wait().expect_code(0);
    };
    export("Town07", &maps.join("OpenDrive/Town02.xodr"));
    std::fs::copy(
        maps.join("OpenDrive/Town02.xodr"),
        maps.join("OpenDrive/Town02_Opt.xodr"),
    )
    .unwrap();
    export("Town01", &maps.join("Town12/OpenDrive/Town12.xodr"));
    std::fs::write(maps.join("OpenDrive/Broken.xodr"), "<OpenDRIVE><road").unwrap();
    std::fs::write(maps.join("Nav/Town02.bin"), "no map").unwrap();
    root
}

#[test]
fn a_carla_installation_becomes_maps_that_are_loaded_by_their_names() {
    let sandbox = Sandbox::new("mapimport");
    let root = installation(&sandbox);
    let data = sandbox.path("data");
    let import = |more: &[&str], code| {
        let mut words = vec!["map", "import", root.to_str().unwrap()];
        words.extend(["--data", data.to_str().unwrap()]);
        words.extend(more);
        sandbox.spawn("gantry", &words).wait().expect_code(code)
    };
    let dry = import(&["--dry-run"], 1);
    assert!(!data.exists(), "--dry-run writes nothing");
    assert!(dry.says("2 maps would be in"), "{:#?}", dry.lines);
    let first = import(&[], 1);
    assert!(
        first.says("imported  Town02: ") && first.says("imported  Town12: "),
        "{:#?}",
        first.lines
    );
    assert!(first.says("loads as Town02_Opt"), "{:#?}", first.lines);
    assert!(
        first.says("refused   Broken: ") && first.says("line 1"),
        "{:#?}",
        first.lines
    );
    let mut files: Vec<_> = std::fs::read_dir(data.join("maps"))
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    files.sort();
    assert_eq!(files, ["Town02.xodr", "Town12.xodr"]);
    assert!(import(&[], 1).says("unchanged Town02: "));
    // Another text under the name is not lost by accident.
    std::fs::write(data.join("maps/Town02.xodr"), "mine").unwrap();
    assert!(import(&[], 1).says("--replace"));
    assert_eq!(
        std::fs::read_to_string(data.join("maps/Town02.xodr")).unwrap(),
        "mine"
    );
    assert!(import(&["--replace"], 1).says("replaced  Town02: "));
    let text =
        std::fs::read_to_string(root.join("CarlaUE4/Content/Carla/Maps/OpenDrive/Town02.xodr"))
            .unwrap();
    let daemon = start_daemon(&sandbox, LAUNCH, &["--data", data.to_str().unwrap()]);
    let bus = join_bus(&sandbox, "test");
    assert!(document(&bus, names::WORLD_MAP).text == text);
    let mut client = bus.command_client("test").unwrap();
    for name in ["Town12", "/Game/Carla/Maps/Town02_Opt"] {
        ask(&mut client, Command::LoadMap { map: name.into() });
    }
    drop(daemon);
}

#[test]
fn what_cannot_be_imported_is_said_in_a_sentence() {
    let sandbox = Sandbox::new("mapnot");
    let root = installation(&sandbox);
    let data = sandbox.path("data");
    let empty = sandbox.path("empty");
    std::fs::create_dir_all(&empty).unwrap();
    let lane = sandbox.write(
        "narrow.xodr",
        r#"<OpenDRIVE><road id="1" length="50" junction="-1"><planView><geometry s="0" x="0" y="0" hdg="0" length="50"><line/></geometry></planView><lanes><laneSection s="0"><center><lane id="0"/></center><right><lane id="-1" type="sidewalk"><width sOffset="0" a="2" b="0" c="0" d="0"/></lane></right></laneSection></lanes></road></OpenDRIVE>"#,
    );
    for (what, more, code, sentence) in [
        ("/nowhere/x.xodr", "", 2, "there is no file or folder"),
        (
            empty.to_str().unwrap(),
            "",
            2,
            "no .xodr file in the folder",
        ),
        (root.to_str().unwrap(), "--name=Mine", 2, "3 were found"),
        (lane.to_str().unwrap(), "--name=../x", 2, "cannot be called"),
        (
            lane.to_str().unwrap(),
            "",
            1,
            "no driving lane is long and wide enough",
        ),
    ] {
        let mut words = vec!["map", "import", what, "--data", data.to_str().unwrap()];
        words.extend((!more.is_empty()).then_some(more));
        let ended = sandbox.spawn("gantry", &words).wait().expect_code(code);
        assert!(ended.says(sentence), "{what}: {:#?}", ended.lines);
    }
}
