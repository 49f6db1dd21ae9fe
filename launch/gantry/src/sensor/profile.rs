//! Reads profiles as launch files do, and prints them.

use std::io::IsTerminal as _;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use launch_cli::{Exit, wrong_usage};
use launch_spec::profiles::{self, Status};
use launch_spec::{FileText, Launch, Profile};
use sensor_spec::SensorSpec;

/// Name of the launch file and of the sensor with which a profile is read.
const READER: (&str, &str) = ("profile of the command line", "profile");

/// A profile, and the sensor that it describes.
///
/// # Errors
/// Everything that is wrong with it, each with file and line.
pub fn read(asked: &str) -> anyhow::Result<(Profile, SensorSpec)> {
    let value = toml::Value::String(asked.to_owned());
    let launch = format!("version = 1\n[sensor.{}]\nsensor = {value}\n", READER.1);
    let mut text = profiles::text(asked).map(str::to_owned);
    let mut read_file = |path: &Path| {
        if path == Path::new(READER.0) {
            return Ok(FileText {
                identity: path.to_owned(),
                folder: PathBuf::new(),
                text: launch.clone(),
            });
        }
        let found = FileText::read(path)?;
        text = Some(found.text.clone());
        Ok(found)
    };
    let launch = Launch::load(&[READER.0.into()], &[], &mut read_file)
        .map_err(|errors| wrong_usage(errors.to_string()))?;
    let text = text.context("a profile that was read has a text")?;
    let profile: Profile = toml::from_str(&text).context("the profile cannot be read")?;
    let sensor = launch.sensors.get(READER.1);
    let spec = sensor
        .context("the profile describes no sensor")?
        .spec
        .clone();
    Ok((profile, spec))
}

/// How many numbers of a profile have a status.
fn count(profile: &Profile, status: Status) -> usize {
    let of_it = profile.keys.values().filter(|it| it.status == status);
    of_it.count()
}

/// Runs `gantry sensor list`.
pub fn list() -> anyhow::Result<Exit> {
    println!(
        "{:<18} {:<18} {:<6} {:>9} {:>6} {:>8} {:>7}",
        "profile", "product", "kind", "datasheet", "driver", "measured", "assumed"
    );
    for name in profiles::names() {
        let (profile, _) = read(name)?;
        let n = |status| count(&profile, status);
        println!(
            "{name:<18} {:<18} {:<6} {:>9} {:>6} {:>8} {:>7}",
            profile.name,
            profile.kind,
            n(Status::Datasheet),
            n(Status::Driver),
            n(Status::Measured),
            n(Status::Assumed)
        );
    }
    Ok(Exit::Done)
}

/// Runs `gantry sensor show`; guesses are yellow on a terminal.
pub fn show(asked: &str) -> anyhow::Result<Exit> {
    let (profile, _) = read(asked)?;
    let [begin, end] = match std::io::stdout().is_terminal() {
        true => ["\x1b[33m", "\x1b[0m"],
        false => ["", ""],
    };
    println!("{} ({})", profile.name, profile.kind);
    for (key, number) in &profile.keys {
        let line = format!(
            "  {key} = {}  [{}, {}]",
            number.value,
            number.status.name(),
            number.source
        );
        match number.status {
            Status::Assumed => println!("{begin}{line}{end}"),
            _ => println!("{line}"),
        }
    }
    println!("sources");
    for (source, meaning) in &profile.sources {
        println!("  {source}: {meaning}");
    }
    Ok(Exit::Done)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_profile_is_a_sensor_and_sorted_by_name() {
        let names: Vec<_> = profiles::names().collect();
        assert!(names.is_sorted() && names.len() >= 11, "{names:?}");
        for name in names {
            let (profile, spec) = read(name).unwrap();
            let key = match spec {
                SensorSpec::Lidar(_) => "range_m",
                SensorSpec::Imu(_) => "density_gyro_radps_rthz",
                other => panic!("{name} is {other:?}"),
            };
            assert!(profile.keys.contains_key(key), "{name}");
        }
    }

    /// Noise densities in °/s/√Hz and µg/√Hz, in-run bias stabilities in °/h and µg, as data sheets
    /// write them; a stability is the floor of the Allan deviation, √(2 ln 2 / π) of the instability.
    #[test]
    fn imus_have_the_noise_of_their_data_sheets() {
        for (name, sheet) in [
            ("xsens/mti-1", [0.007, 120.0, 10.0, 30.0]),
            ("xsens/mti-300", [0.01, 60.0, 10.0, 15.0]),
            ("xsens/mti-630", [0.007, 60.0, 8.0, 10.0]),
            ("adi/adis16448", [0.0135, 230.0, 14.5, 250.0]),
        ] {
            let (_, spec) = read(name).unwrap();
            let SensorSpec::Imu(spec) = spec else {
                panic!("{name} is no IMU")
            };
            let floor = (2.0 * std::f64::consts::LN_2 / std::f64::consts::PI).sqrt();
            let found = [
                spec.density_gyro_radps_rthz[0].to_degrees(),
                spec.density_accel_mps2_rthz[0] / 9.806_65e-6,
                (spec.instability_gyro_radps[0] * floor).to_degrees() * 3600.0,
                spec.instability_accel_mps2[0] * floor / 9.806_65e-6,
            ];
            for (found, wanted) in found.into_iter().zip(sheet) {
                assert!(
                    (found / wanted - 1.0).abs() < 1e-5,
                    "{name}: {found} {wanted}"
                );
            }
        }
    }

    #[test]
    fn a_wrong_profile_is_refused_with_file_and_line() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("own.toml");
        let text = "name = \"Own\"\nkind = \"lidar\"\n[sources]\nme = \"mine\"\n[keys]\n\
            chanels = { value = 4, status = \"measured\", source = \"me\" }\n\
            range_m = { value = 1e9, status = \"guessed\", source = \"you\" }\n\
            columns = { value = 8 }\n";
        std::fs::write(&file, text).unwrap();
        let error = read(file.to_str().unwrap()).unwrap_err().to_string();
        for wanted in [
            "unknown key \"chanels\" in [sensor.profile], did you mean \"channels\"? at ",
            "own.toml:6:1",
            "keys.range_m.status is \"guessed\", but must be one of datasheet, driver, measured, assumed",
            "keys.range_m.source is \"you\", but must be a key of [sources], known: me",
            "sensor.profile.range_m is 1000000000, but must be 0.1 to 10000",
            "own.toml:7:21",
            "keys.columns has no status",
        ] {
            assert!(error.contains(wanted), "{wanted}\n{error}");
        }
        let error = read("ouster/os1-12").unwrap_err().to_string();
        assert!(
            error.contains("did you mean \"ouster/os1-128\"?"),
            "{error}"
        );
    }
}
