//! A scenario's launch file.

use std::path::Path;

use anyhow::Context as _;
use launch_cli::wrong_usage;
use launch_spec::presets::{self, merge};
use launch_spec::{FileText, Launch};
use toml::{Table, Value};

use crate::matrix::Scenario;
use crate::recipe::Recipe;

/// The text of a scenario's launch file; relative paths of the recipe begin in `folder`.
///
/// # Errors
/// If a weather or a time of day is unknown.
pub fn text(recipe: &Recipe, scenario: &Scenario, folder: &Path) -> anyhow::Result<String> {
    let rig = recipe
        .rig
        .get(&scenario.rig)
        .context("the rig was checked")?;
    let mut launch = Table::new();
    launch.insert("version".into(), Value::Integer(1));
    if let Some(file) = &rig.launch {
        let file = std::path::absolute(folder.join(file))?;
        let file = file.display().to_string();
        launch.insert("include".into(), Value::Array(vec![file.into()]));
    }
    let sentence = |error: presets::PresetError| wrong_usage(error);
    let mut weather = presets::weather(&scenario.weather, &recipe.weather).map_err(sentence)?;
    weather.extend(presets::time(&scenario.time, &recipe.time).map_err(sentence)?);
    let mut world = Table::new();
    let map = if scenario.map.contains('/') {
        let path = std::path::absolute(folder.join(&scenario.map))?;
        path.display().to_string()
    } else {
        scenario.map.clone()
    };
    world.insert("map".into(), map.into());
    world.insert("seed".into(), Value::Integer(scenario.seed as i64));
    world.insert("tick_hz".into(), scenario.tick_hz.into());
    world.insert("mode".into(), "stepped".into());
    world.insert("vehicles".into(), i64::from(scenario.vehicles).into());
    world.insert("walkers".into(), i64::from(scenario.walkers).into());
    world.insert("weather".into(), Value::Table(weather));
    launch.insert("scenario".into(), Value::Table(world));
    let mut ego = rig.ego.clone();
    let place = i64::from(scenario.spawn_point);
    ego.entry("spawn_point").or_insert(Value::Integer(place));
    launch.insert("ego".into(), Value::Table(ego));
    for (key, table) in [("rig", &rig.rig), ("sensor", &rig.sensor)] {
        if !table.is_empty() {
            launch.insert(key.into(), Value::Table(table.clone()));
        }
    }
    merge(&mut launch, &scenario.launch);
    Ok(toml::to_string(&launch)?)
}

/// Reads the text as the simulator will.
///
/// # Errors
/// [`wrong_usage`] with everything that is wrong, under the name of the scenario.
pub fn check(text: &str, scenario: &Scenario) -> anyhow::Result<Launch> {
    let own = std::path::PathBuf::from(format!("[scenario {}]", scenario.name));
    let mut read = |path: &Path| {
        if path == own {
            return Ok(FileText {
                identity: own.clone(),
                folder: std::path::PathBuf::new(),
                text: text.to_owned(),
            });
        }
        FileText::read(path)
    };
    let launch = Launch::load(std::slice::from_ref(&own), &[], &mut read)
        .map_err(|error| wrong_usage(format!("scenario {}: {error}", scenario.name)))?;
    if launch.memory_budget().is_empty() {
        return Err(wrong_usage(format!(
            "scenario {}: the rig {:?} has no sensors; give it [rig.{}.sensor.NAME] or a launch file with some",
            scenario.name, scenario.rig, scenario.rig
        )));
    }
    Ok(launch)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::matrix::scenarios;
    use crate::recipe::tests::SMALL;

    fn first(text: &str) -> (Recipe, Scenario) {
        let recipe: Recipe = toml::from_str(text).unwrap();
        let scenario = scenarios(&recipe).unwrap().remove(0);
        (recipe, scenario)
    }

    #[test]
    fn the_text_is_a_launch_file_with_the_scenario_in_it() {
        let (recipe, mut scenario) = first(&SMALL.replace("\"clear\", ", ""));
        scenario.launch = "[sensor.front]\nwidth_px = 64\n".parse().unwrap();
        let text = text(&recipe, &scenario, Path::new("/recipes")).unwrap();
        let launch = check(&text, &scenario).unwrap();
        assert_eq!(
            (launch.scenario.map.as_str(), launch.scenario.seed),
            ("Town01", 5)
        );
        assert_eq!(launch.scenario.weather.precipitation, 55.0);
        assert_eq!(launch.scenario.weather.sun_altitude_deg, 65.0);
        assert_eq!(launch.memory_budget().len(), 2);
    }

    #[test]
    fn mistakes_name_the_scenario() {
        let (recipe, scenario) = first(&SMALL.replace("kind = \"camera\"", "kind = \"camra\""));
        let wrong = text(&recipe, &scenario, Path::new("")).unwrap();
        let error = check(&wrong, &scenario).unwrap_err().to_string();
        assert!(
            error.contains("Town01_clear_noon_s5") && error.contains("camra"),
            "{error}"
        );
        let (recipe, scenario) = first(&SMALL.replace(
            "[rig.front.sensor.front]\nkind = \"camera\"\nmodalities = [\"rgb\", \"depth\"]",
            "[rig.front]",
        ));
        let empty = text(&recipe, &scenario, Path::new("")).unwrap();
        assert!(
            check(&empty, &scenario)
                .unwrap_err()
                .to_string()
                .contains("no sensors")
        );
    }
}
