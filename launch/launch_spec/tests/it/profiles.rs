//! Profiles of sensors beneath a sensor's own keys, and mistakes in them: each is told with the
//! profile's file and line.

use std::io;
use std::path::{Path, PathBuf};

use launch_spec::{FileText, Launch, LaunchErrors};
use sensor_spec::{LidarSpec, SensorSpec};

/// Loads a launch file of one sensor, `roof`, beside the profile `own.toml`.
fn load(sensor: &str, profile: &str, sets: &[&str]) -> Result<LidarSpec, LaunchErrors> {
    let launch = format!("version = 1\n[sensor.roof]\n{sensor}\n");
    let mut read = |path: &Path| {
        let text = match path.to_str() {
            Some("runs/town.toml") => launch.clone(),
            Some("runs/own.toml") => profile.to_owned(),
            _ => return Err(io::Error::from(io::ErrorKind::NotFound)),
        };
        Ok(FileText {
            identity: path.to_owned(),
            folder: "runs".into(),
            text,
        })
    };
    let sets: Vec<String> = sets.iter().map(|set| (*set).to_owned()).collect();
    let launch = Launch::load(&[PathBuf::from("runs/town.toml")], &sets, &mut read)?;
    match &launch.sensors["roof"].spec {
        SensorSpec::Lidar(spec) => Ok(spec.clone()),
        other => panic!("{other:?} is no lidar"),
    }
}

fn refused(sensor: &str, profile: &str, expected: &[&str]) {
    let errors = load(sensor, profile, &[]).expect_err("must be refused");
    let found: Vec<String> = errors.0.iter().map(ToString::to_string).collect();
    assert_eq!(found, expected, "for {sensor:?} with {profile:?}");
}

/// A profile whose first key is in line 6.
fn profile(keys: &str) -> String {
    format!("name = \"Own\"\nkind = \"lidar\"\n[sources]\nme = \"my bench\"\n[keys]\n{keys}")
}

const OWN: &str = "sensor = \"own.toml\"";

#[test]
fn own_keys_and_sets_stand_above_the_profile() {
    let own = profile(
        "channels = { value = 4, status = \"measured\", source = \"me\" }\n\
         columns = { value = 90, status = \"measured\", source = \"me\" }\n\
         elevations_deg = { value = [3, 1.5], status = \"measured\", source = \"me\" }\n",
    );
    let spec = load(&format!("{OWN}\ncolumns = 45"), &own, &[]).unwrap();
    assert_eq!((spec.channels, spec.columns), (4, 45));
    assert_eq!(spec.elevations_deg, [3.0, 1.5]);
    let sets = [
        "sensor.roof.channels=8",
        "sensor.roof.sensor=\"ouster/os1-32\"",
    ];
    let spec = load(OWN, &own, &sets).unwrap();
    assert_eq!((spec.channels, spec.columns), (8, 1024));
    assert!(spec.returns && spec.clockwise);
    assert_eq!(
        load("kind = \"lidar\"", "", &[]).unwrap(),
        LidarSpec::default(),
        "a lidar without a profile has none of its keys"
    );
}

#[test]
fn wrong_values_of_a_profile_are_told_with_its_line() {
    let wrong = profile(
        "channels = { value = 4, status = \"measured\", source = \"me\" }\n\
         elevations_deg = { value = [3, 1, 0], status = \"measured\", source = \"me\" }\n\
         rings = { value = [0, 256], status = \"measured\", source = \"me\" }\n\
         range_m = { value = \"far\", status = \"measured\", source = \"me\" }\n\
         chanels = { value = 4, status = \"measured\", source = \"me\" }\n\
         clockwise = true\n",
    );
    refused(
        OWN,
        &wrong,
        &[
            r#"sensor.roof.elevations_deg is a list of 3, but must have as many numbers as channels 4 or a divisor at runs/own.toml:7:28"#,
            r#"sensor.roof.rings is 256, but its numbers are 0 to 255 at runs/own.toml:8:19"#,
            r#"sensor.roof.range_m is "far", but must be a number at runs/own.toml:9:21"#,
            r#"unknown key "chanels" in [sensor.roof], did you mean "channels"? at runs/own.toml:10:1"#,
            r#"keys.clockwise is true, but must be a table at runs/own.toml:11:13"#,
        ],
    );
}

#[test]
fn profiles_that_are_not_there_or_cannot_be_read_are_told() {
    refused(
        "sensor = \"theirs.toml\"",
        "",
        &[
            r#"sensor.roof.sensor names "theirs.toml", but runs/theirs.toml cannot be read: entity not found; its path begins in the folder of the launch file at runs/town.toml:3:10"#,
        ],
    );
    refused(
        "sensor = \"ouster/os1-12\"",
        "",
        &[
            r#"sensor.roof.sensor is "ouster/os1-12", but must be the name of a profile or of a file that ends in .toml, did you mean "ouster/os1-128"? at runs/town.toml:3:10"#,
        ],
    );
    refused(
        "sensor = 16",
        "",
        &[
            r#"sensor.roof.sensor is 16, but must be the name of a profile, e.g. "velodyne/vlp-16", or of a file that ends in .toml at runs/town.toml:3:10"#,
        ],
    );
    refused(
        OWN,
        "name = \n",
        &[r#"string values must be quoted, expected literal string at runs/own.toml:1:8"#],
    );
    refused(
        OWN,
        "",
        &[
            r#"the profile has no keys at runs/own.toml:1:1"#,
            r#"the profile has no kind at runs/own.toml:1:1"#,
            r#"the profile has no name at runs/own.toml:1:1"#,
            r#"the profile has no sources at runs/own.toml:1:1"#,
        ],
    );
    refused(
        OWN,
        &profile("").replace("lidar", "sonar"),
        &[
            r#"sensor.roof.kind is "sonar", but must be a kind of sensor, known: camera, lidar, imu, gnss, radar, obstacle, collision, lane_invasion at runs/own.toml:2:8"#,
        ],
    );
    refused(
        &format!("{OWN}\nkind = \"radar\""),
        &profile(""),
        &[
            r#"sensor.roof.kind is "radar", but the profile "own.toml" is of kind "lidar"; leave kind out at runs/town.toml:4:8"#,
        ],
    );
}
