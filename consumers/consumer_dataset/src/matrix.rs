//! The scenarios of a recipe: every combination of its matrix, with its settings.

use consumer_sets::options::hash;
use launch_run::matrix::{combinations, name, number_doubles};
use launch_spec::presets::merge;
use serde::{Deserialize, Serialize};
use toml::Table;

use crate::recipe::{Recipe, RecipeError, When};

/// Longest name of a scenario; exports take 64 characters, and a number may follow.
const MAX_NAME: usize = 56;

/// One scenario.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Scenario {
    /// Its name, unique in the set.
    pub name: String,
    /// Map, as the recipe names it.
    pub map: String,
    /// Name of the weather.
    pub weather: String,
    /// Name of the time of day.
    pub time: String,
    /// Name of the rig.
    pub rig: String,
    /// Where the ego begins.
    pub spawn_point: u32,
    /// Seed of everything random.
    pub seed: u64,
    /// Ticks that are recorded.
    pub frames: u64,
    /// Ticks before them.
    pub warm_up_ticks: u64,
    /// Ticks per simulated second.
    pub tick_hz: f64,
    /// Vehicles besides the ego.
    pub vehicles: u32,
    /// People on foot.
    pub walkers: u32,
    /// Whether gantry-drive drives.
    pub drive: bool,
    /// Keys of the launch file that overrides set.
    pub launch: Table,
}

/// All scenarios, in the order of the matrix; the last key varies fastest.
///
/// # Errors
/// [`RecipeError::AllExcluded`].
pub fn scenarios(recipe: &Recipe) -> Result<Vec<Scenario>, RecipeError> {
    let matrix = &recipe.matrix;
    let (rigs, seeds) = (recipe.rigs(), matrix.seeds.list());
    let lengths = [
        matrix.maps.len(),
        matrix.weathers.len(),
        matrix.times.len(),
        rigs.len(),
        matrix.spawn_points.len(),
        seeds.len(),
    ];
    let places = combinations(lengths).map(|[map, weather, time, rig, spawn_point, seed]| Place {
        map: &matrix.maps[map],
        weather: &matrix.weathers[weather],
        time: &matrix.times[time],
        rig: &rigs[rig],
        spawn_point: matrix.spawn_points[spawn_point],
        seed: seeds[seed],
    });
    let mut found: Vec<Scenario> = places
        .filter(|place| !recipe.exclude.iter().any(|rule| place.is_in(rule)))
        .map(|place| place.scenario(recipe))
        .collect();
    if found.is_empty() {
        return Err(RecipeError::AllExcluded);
    }
    number_doubles(found.iter_mut().map(|scenario| &mut scenario.name));
    Ok(found)
}

/// A cell of the matrix.
struct Place<'a> {
    map: &'a String,
    weather: &'a String,
    time: &'a String,
    rig: &'a String,
    spawn_point: u32,
    seed: u64,
}

impl Place<'_> {
    fn is_in(&self, rule: &When) -> bool {
        rule.map.holds(self.map)
            && rule.weather.holds(self.weather)
            && rule.time.holds(self.time)
            && rule.rig.holds(self.rig)
            && rule.spawn_point.holds(&self.spawn_point)
            && rule.seed.holds(&self.seed)
    }

    fn scenario(&self, recipe: &Recipe) -> Scenario {
        let mut warm_up_s = recipe.warm_up_s;
        let mut made = Scenario {
            name: self.name(recipe),
            map: self.map.clone(),
            weather: self.weather.clone(),
            time: self.time.clone(),
            rig: self.rig.clone(),
            spawn_point: self.spawn_point,
            seed: self.seed,
            frames: recipe.frames,
            warm_up_ticks: 0,
            tick_hz: recipe.tick_hz,
            vehicles: recipe.vehicles,
            walkers: recipe.walkers,
            drive: recipe.drive,
            launch: Table::new(),
        };
        for rule in recipe.overrides.iter().filter(|it| self.is_in(&it.when)) {
            let set = &rule.set;
            made.frames = set.frames.unwrap_or(made.frames);
            made.vehicles = set.vehicles.unwrap_or(made.vehicles);
            made.walkers = set.walkers.unwrap_or(made.walkers);
            made.drive = set.drive.unwrap_or(made.drive);
            warm_up_s = set.warm_up_s.unwrap_or(warm_up_s);
            merge(&mut made.launch, &set.launch);
        }
        made.warm_up_ticks = (warm_up_s * recipe.tick_hz).round() as u64;
        made
    }

    /// What is varied, in words that are safe in paths.
    fn name(&self, recipe: &Recipe) -> String {
        let point = format!("p{}", self.spawn_point);
        let seed = format!("s{}", self.seed);
        let mut words = vec![self.weather.as_str(), self.time];
        if recipe.rigs().len() > 1 {
            words.push(self.rig);
        }
        if recipe.matrix.spawn_points.len() > 1 {
            words.push(&point);
        }
        words.push(&seed);
        let name = name(self.map, &words);
        if name.len() <= MAX_NAME {
            return name;
        }
        // The end says most: the seed stands there.
        let end = &name[name.len() - MAX_NAME / 2..];
        format!("{:08x}_{end}", hash(0, &name) >> 32)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::recipe::tests::SMALL;

    fn all(more: &str) -> Result<Vec<Scenario>, RecipeError> {
        let recipe: Recipe = toml::from_str(&format!("{SMALL}{more}")).unwrap();
        recipe.check()?;
        scenarios(&recipe)
    }

    #[test]
    fn every_combination_is_a_scenario_with_a_name() {
        let found = all("").unwrap();
        let names: Vec<_> = found.iter().map(|it| it.name.as_str()).collect();
        assert_eq!(found.len(), 8);
        assert_eq!(names[0], "Town01_clear_noon_s5");
        assert_eq!(names[7], "Town02_rain_noon_s6");
        assert_eq!(found[0].warm_up_ticks, 40);
    }

    #[test]
    fn rules_leave_out_and_change() {
        let rules = "[[exclude]]\nmap = \"Town02\"\nseed = [6]\n\
                     [[override]]\nwhen.weather = \"rain\"\nset.frames = 3\nset.launch.scenario.weather.fog_density = 9.0\n\
                     [[override]]\nwhen.seed = 5\nset = { vehicles = 7, warm_up_s = 0.5 }\n";
        let found = all(rules).unwrap();
        assert_eq!(found.len(), 6);
        let rain = found
            .iter()
            .find(|it| it.name == "Town01_rain_noon_s5")
            .unwrap();
        assert_eq!((rain.frames, rain.vehicles, rain.warm_up_ticks), (3, 7, 10));
        assert_eq!(
            rain.launch["scenario"]["weather"]["fog_density"].as_float(),
            Some(9.0)
        );
        let error = all("[[exclude]]\n").unwrap_err();
        assert!(matches!(error, RecipeError::AllExcluded), "{error}");
    }

    #[test]
    fn long_names_are_cut_and_stay_different() {
        let (a, b) = ("a".repeat(90), "b".repeat(90));
        let text = SMALL.replace("\"Town01\", \"Town02\"", &format!("\"{a}\", \"{b}\""));
        let found = scenarios(&toml::from_str(&text).unwrap()).unwrap();
        assert!(found.iter().all(|it| it.name.len() <= MAX_NAME));
        assert!(found[0].name.ends_with("_clear_noon_s5") && found[0].name != found[4].name);
    }

    #[test]
    fn maps_of_one_name_are_told_apart() {
        let text = SMALL.replace("\"Town01\", \"Town02\"", "\"a/x.xodr\", \"b/x.xodr\"");
        let recipe: Recipe = toml::from_str(&text).unwrap();
        let found = scenarios(&recipe).unwrap();
        assert_eq!(found[0].name, "x_clear_noon_s5");
        assert_eq!(found[4].name, "x_clear_noon_s5_2");
    }
}
