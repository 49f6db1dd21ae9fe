//! `[batch.NAME]`: what it finds, what it needs, and the sentences of what cannot be one.

use launch_spec::{Launch, LaunchErrors};
use schema_frames::Modality;

/// Two rigs with two cameras and a lidar each.
const FILE: &str = r#"version = 1
[scenario]
vehicles = 11
[rig.car2]
vehicle = 2
[rig.car10]
vehicle = 10
[sensor.left]
kind = "camera"
rig = ["car2", "ego", "car10"]
modalities = ["rgb", "depth", "dvs", "semantic"]
[sensor.right]
kind = "camera"
modalities = ["rgb", "depth"]
[sensor.roof]
kind = "lidar"
"#;

fn parsed(batch: &str) -> Result<Launch, LaunchErrors> {
    Launch::parse(&format!("{FILE}[batch.fleet]\n{batch}\n"), "x.toml")
}

fn launch(batch: &str) -> Launch {
    parsed(batch).unwrap_or_else(|errors| panic!("{errors}"))
}

fn refused(batch: &str) -> String {
    parsed(batch).expect_err(batch).to_string()
}

#[test]
fn cameras_come_in_the_order_of_the_list_and_of_what_patterns_find() {
    let cameras = |list: &str| {
        launch(&format!("cameras = {list}")).batches["fleet"]
            .cameras
            .clone()
    };
    assert_eq!(
        cameras(r#"["ego/right", "ego/left"]"#),
        ["ego/right", "ego/left"]
    );
    // By rig, the ego's first, then by name; then by sensor. A lidar is no camera.
    assert_eq!(
        cameras(r#"["*/*"]"#),
        ["ego/left", "ego/right", "car10/left", "car2/left"]
    );
    assert_eq!(
        cameras(r#"["car*/left", "*/*"]"#),
        ["car10/left", "car2/left", "ego/left", "ego/right"]
    );
    assert_eq!(cameras(r#"["e*o/*i*"]"#), ["ego/right"]);
}

#[test]
fn a_batch_has_topics_with_places_for_two_readers_and_is_written_out() {
    let more = "cameras = [\"ego/*\"]\nmodalities = [\"depth\", \"rgb\"]\n[topic.\"batch/fleet/rgb\"]\nreaders = 5\ngpu = true\n";
    let launch = launch(more);
    let budget = launch.batch_budget();
    let topics: Vec<(&str, Modality, Option<u32>, usize)> = budget
        .iter()
        .map(|it| {
            (
                &*it.topic,
                it.modality,
                it.limits.readers,
                it.max_payload_bytes,
            )
        })
        .collect();
    let bytes = 2 * 800 * 600 * 4;
    assert_eq!(
        topics,
        [
            ("batch/fleet/depth", Modality::Depth, Some(2), bytes),
            ("batch/fleet/rgb", Modality::Rgb, Some(5), bytes),
        ]
    );
    assert!(launch.memory_budget().ends_with(&budget) && budget[1].limits.gpu);
    let text = launch.to_toml_with_defaults();
    assert!(
        text.contains("cameras = [\"ego/left\", \"ego/right\"]"),
        "{text}"
    );
    assert_eq!(Launch::parse(&text, "full.toml"), Ok(launch));
    let set = ["batch.fleet.cameras=[\"ego/left\"]".to_owned()];
    let text = format!("{FILE}[batch.fleet]\ncameras = [\"ego/right\"]\n");
    let launch = Launch::parse_with(&text, "x.toml", &set).unwrap();
    assert_eq!(launch.batches["fleet"].cameras, ["ego/left"]);
}

#[test]
fn what_cannot_be_a_batch_is_refused_with_a_sentence() {
    for (batch, sentence) in [
        ("", "[batch.fleet] has no cameras; give a list such as"),
        (
            "cameras = []",
            "batch.fleet.cameras is [], but must be a list of one or more cameras",
        ),
        (
            "cameras = \"ego/left\"",
            "must be a list of one or more cameras",
        ),
        ("cameras = [3]", "must be a list of one or more cameras"),
        (
            "cameras = [\"ego/left\"]\nmodality = [\"rgb\"]",
            "unknown key \"modality\" in [batch.fleet], did you mean \"modalities\"?",
        ),
        (
            "cameras = [\"ego/lft\"]",
            "batch.fleet.cameras has \"ego/lft\", but no camera of this launch is called so, did you mean \"ego/left\"?",
        ),
        (
            "cameras = [\"left\"]",
            "no camera of this launch is called so",
        ),
        (
            "cameras = [\"*/rear\"]",
            "batch.fleet.cameras has \"*/rear\", but no camera of this launch is called so",
        ),
        (
            "cameras = [\"ego/roof\"]",
            "\"ego/roof\", which is no camera; a batch holds images only",
        ),
        (
            "cameras = [\"ego/left\", \"ego/left\"]",
            "batch.fleet.cameras has \"ego/left\" twice",
        ),
        (
            "cameras = [\"ego/*\"]\nmodalities = [\"semantic\"]",
            "batch.fleet.modalities has \"semantic\", but camera \"ego/right\" does not; add it to sensor.right.modalities or remove it here",
        ),
        (
            "cameras = [\"ego/left\"]\nmodalities = [\"dvs\"]",
            "must be a list of kinds of images, each once: rgb, depth, semantic, instance, flow, normals",
        ),
        (
            "cameras = [\"ego/left\"]\nmodalities = []",
            "must be a list of kinds of images",
        ),
        (
            "cameras = [\"ego/left\"]\nmodalities = [\"rgb\", \"rgb\"]",
            "each once",
        ),
        (
            "cameras = [\"ego/left\"]\n[rig.batch]\nvehicle = 1",
            "[rig.batch] has a name that the simulator uses itself",
        ),
        (
            "cameras = [\"ego/left\"]\n[batch.Fleet]\ncameras = [\"ego/left\"]",
            "[batch.Fleet] has a name that is not",
        ),
        (
            "cameras = [\"ego/*\"]\n[sensor.right]\nwidth_px = 640",
            "batch.fleet has images of 800 × 600 px (ego/left) and of 640 × 600 px (ego/right); a batch needs one size",
        ),
        (
            "cameras = [\"ego/*\"]\n[sensor.right]\nrate_hz = 10",
            "batch.fleet has cameras of 20 Hz (ego/left) and of 10 Hz (ego/right); a batch needs one rate_hz",
        ),
    ] {
        // Keys of a sensor that the file has already are laid over it.
        let errors = match batch.split_once("[sensor.right]\n") {
            Some((batch, key)) => {
                let set = [format!("sensor.right.{}", key.replace(" = ", "="))];
                let text = format!("{FILE}[batch.fleet]\n{batch}\n");
                Launch::parse_with(&text, "x.toml", &set)
                    .unwrap_err()
                    .to_string()
            }
            None => refused(batch),
        };
        assert!(errors.contains(sentence), "{batch}: {errors}");
        assert_eq!(errors.lines().count(), 1, "{errors}");
    }
}

#[test]
fn frames_of_a_batch_are_not_too_long_and_their_images_begin_at_multiples_of_four() {
    let sized = |width: u32, height: u32, modality: &str, n: u32| {
        let sensors: String = (0..n)
            .map(|i| {
                format!("[sensor.c{i}]\nkind = \"camera\"\nmodalities = [\"{modality}\"]\nwidth_px = {width}\nheight_px = {height}\n")
            })
            .collect();
        let text = format!(
            "version = 1\n{sensors}[batch.all]\ncameras = [\"*/*\"]\nmodalities = [\"{modality}\"]\n"
        );
        Launch::parse(&text, "x.toml").map_err(|errors| errors.to_string())
    };
    assert!(sized(257, 259, "depth", 3).is_ok() && sized(257, 259, "semantic", 1).is_ok());
    let odd = sized(257, 259, "semantic", 2).unwrap_err();
    assert!(
        odd.contains("make the width or the height of the cameras a multiple of 4"),
        "{odd}"
    );
    assert!(sized(4096, 4096, "rgb", 16).is_ok());
    let large = sized(4096, 4096, "rgb", 17).unwrap_err();
    assert!(
        large.contains("frames of 1088 MiB (rgb), but they may have at most 1024 MiB"),
        "{large}"
    );
    let many = sized(16, 16, "rgb", 1025).unwrap_err();
    assert!(
        many.contains("has 1025 cameras, but may have at most 1024"),
        "{many}"
    );
}
