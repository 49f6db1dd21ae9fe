//! How the simulator is started for a new run: as the recorded one was, with what the user changes
//! and adds.

use std::path::Path;

use launch_cli::files::{MAX_SETTINGS_BYTES, read_text};
use launch_cli::wrong_usage;

use crate::children::adapters;
use crate::cli::{Args, Then};
use crate::report::Report;
use crate::script::Script;

/// Arguments of the simulator, without those about lockstep and the journal's end.
pub fn simulator_args(
    args: &Args,
    script: &Script,
    sensors: &[(String, String)],
    folder: &Path,
    report: &mut Report,
) -> anyhow::Result<Vec<String>> {
    let head = &script.head;
    let path = |path: &Path| path.display().to_string();
    let mut all = vec![
        "--launch".into(),
        path(&script.launch),
        "--journal".into(),
        path(&script.journal),
        "--data".into(),
        path(folder),
        "--quality".into(),
        head.quality.clone(),
        "--lidars-on".into(),
        head.lidars_on.clone(),
    ];
    let there = adapters()?;
    if there.contains(&head.adapter) {
        all.extend(["--adapter".into(), head.adapter.clone()]);
    } else {
        report.note(format!(
            "the recorded run rendered on {:?}, which is not here ({}), so images may differ",
            head.adapter,
            there.join(", ")
        ));
        // What another GPU cannot do is left to it.
        all.truncate(all.len() - 2);
    }
    let mode = match args.then {
        Then::Stepped => "stepped",
        Then::Stop | Then::Live => "free_running",
    };
    let mut set = vec![format!("scenario.mode=\"{mode}\"")];
    // Those of the recorded run come first, so that they keep their ids.
    for name in &head.added_sensors {
        all.extend(["--added-sensor".into(), name.clone()]);
    }
    for (name, spec) in sensors {
        set.push(format!("sensor.{name}={spec}"));
        all.extend(["--added-sensor".into(), name.clone()]);
    }
    set.extend(args.set.iter().cloned());
    for word in set {
        all.extend(["--set".into(), word]);
    }
    Ok(all)
}

/// Sensors to add: name and specification as TOML.
pub fn added_sensors(words: &[String]) -> anyhow::Result<Vec<(String, String)>> {
    let mut sensors = Vec::new();
    for word in words {
        match word.split_once('=') {
            Some((name, spec)) => sensors.push((name.trim().to_owned(), spec.trim().to_owned())),
            None => {
                let text = read_text(word.as_ref(), MAX_SETTINGS_BYTES).map_err(|error| {
                    wrong_usage(format!(
                        "--sensor {word}: neither NAME=SPEC nor a file that can be read ({error})"
                    ))
                })?;
                let table: toml::Table = text
                    .parse()
                    .map_err(|error| wrong_usage(format!("--sensor {word}: {error}")))?;
                let found = table.get("sensor").and_then(toml::Value::as_table);
                let found = found.filter(|found| !found.is_empty()).ok_or_else(|| {
                    wrong_usage(format!("--sensor {word}: the file has no [sensor.NAME]"))
                })?;
                sensors.extend(
                    found
                        .iter()
                        .map(|(name, spec)| (name.clone(), spec.to_string())),
                );
            }
        }
    }
    for (name, _) in &sensors {
        let is_plain = |c: char| c.is_ascii_alphanumeric() || c == '_' || c == '-';
        if name.is_empty() || !name.chars().all(is_plain) {
            return Err(wrong_usage(format!(
                "--sensor: {name:?} is no name of a sensor; write for example roof='{{kind=\"lidar\"}}'"
            )));
        }
    }
    Ok(sensors)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sensors_come_from_the_command_line_or_from_a_file() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("more.toml");
        std::fs::write(
            &file,
            "version = 1\n[sensor.roof]\nkind = \"lidar\"\nmount.position_m = [0, 0, 2]\n[sensor.nose]\nkind = \"radar\"\n",
        )
        .unwrap();
        let words = ["imu2={kind=\"imu\"}".to_owned(), file.display().to_string()];
        let found = added_sensors(&words).unwrap();
        let names: Vec<&str> = found.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(names, ["imu2", "nose", "roof"]);
        assert!(
            !found[2].1.contains('\n') && found[2].1.starts_with('{'),
            "{}",
            found[2].1
        );
        let error = |word: &str| added_sensors(&[word.to_owned()]).unwrap_err().to_string();
        assert!(error("nowhere.toml").contains("neither NAME=SPEC nor a file"));
        assert!(error("a b={}").contains("no name of a sensor"));
    }
}
