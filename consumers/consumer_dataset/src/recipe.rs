//! Recipes: what a data set is made of, as a TOML file says it.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use consumer_sets::formats::Format;
use consumer_sets::options::parse_split;
use launch_cli::files::MAX_SETTINGS_BYTES;
use launch_cli::wrong_usage;
use launch_run::matrix::Seeds;
use launch_spec::presets;
use serde::{Deserialize, Serialize};
use toml::Table;

mod error;

pub use error::RecipeError;

/// Most scenarios of a recipe.
pub const MAX_SCENARIOS: usize = 100_000;

/// A recipe.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// 1.
    pub version: u32,
    /// Name of the set, for its page; the file's name if it is empty.
    #[serde(default)]
    pub name: String,
    /// A sentence for people.
    #[serde(default)]
    pub description: String,
    /// Ticks that are recorded of each scenario.
    pub frames: u64,
    /// Simulated seconds before them that are not recorded, so that traffic is under way.
    #[serde(default = "two")]
    pub warm_up_s: f64,
    /// Ticks per simulated second.
    #[serde(default = "twenty")]
    pub tick_hz: f64,
    /// Vehicles besides the ego.
    #[serde(default)]
    pub vehicles: u32,
    /// People on foot.
    #[serde(default)]
    pub walkers: u32,
    /// Whether gantry-drive drives the ego and the other vehicles.
    #[serde(default = "yes")]
    pub drive: bool,
    /// Parts of the set and their shares, `train=0.8,val=0.2`.
    #[serde(default = "train_only")]
    pub split: String,
    /// Decides which scenario goes to which part.
    #[serde(default)]
    pub split_seed: u64,
    /// Whether recordings stay in the set when everything is exported.
    #[serde(default)]
    pub keep_recordings: bool,
    /// What is varied.
    pub matrix: Matrix,
    /// Rigs by name.
    pub rig: BTreeMap<String, Rig>,
    /// Weathers by name: keys of a launch file's `scenario.weather`.
    #[serde(default)]
    pub weather: BTreeMap<String, Table>,
    /// Times of day by name: `sun_altitude_deg`, `sun_azimuth_deg`.
    #[serde(default)]
    pub time: BTreeMap<String, Table>,
    /// Settings of single scenarios, later ones over earlier ones.
    #[serde(default, rename = "override")]
    pub overrides: Vec<Override>,
    /// Scenarios that are left out.
    #[serde(default)]
    pub exclude: Vec<When>,
    /// Formats to write.
    #[serde(default)]
    pub export: Vec<Export>,
}

/// The matrix: every combination is a scenario.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Matrix {
    /// Maps, as in a launch file; a path begins beside the recipe.
    pub maps: Vec<String>,
    /// Names of weathers.
    #[serde(default = "clear")]
    pub weathers: Vec<String>,
    /// Names of times of day.
    #[serde(default = "noon")]
    pub times: Vec<String>,
    /// Names of rigs; empty: all.
    #[serde(default)]
    pub rigs: Vec<String>,
    /// Places where the ego begins.
    #[serde(default = "first_place")]
    pub spawn_points: Vec<u32>,
    /// Seeds.
    #[serde(default = "one_seed")]
    pub seeds: Seeds,
}

/// Sensors and what carries them, in a launch file's words.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Rig {
    /// A launch file whose ego, rigs and sensors are taken; it begins beside the recipe.
    #[serde(default)]
    pub launch: Option<PathBuf>,
    /// `[ego]`.
    #[serde(default)]
    pub ego: Table,
    /// `[rig.NAME]`.
    #[serde(default)]
    pub rig: Table,
    /// `[sensor.NAME]`.
    #[serde(default)]
    pub sensor: Table,
}

/// Scenarios that a rule is about: those that have one of the values for every key that it names.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct When {
    /// Maps.
    pub map: OneOrMany<String>,
    /// Weathers.
    pub weather: OneOrMany<String>,
    /// Times of day.
    pub time: OneOrMany<String>,
    /// Rigs.
    pub rig: OneOrMany<String>,
    /// Spawn points.
    pub spawn_point: OneOrMany<u32>,
    /// Seeds.
    pub seed: OneOrMany<u64>,
}

/// A value or a list of them; nothing stands for every value.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum OneOrMany<T> {
    /// Every value.
    #[default]
    Any,
    /// This one.
    One(T),
    /// These.
    Many(Vec<T>),
}

impl<T: PartialEq> OneOrMany<T> {
    /// Whether it stands for `value`.
    pub fn holds(&self, value: &T) -> bool {
        match self {
            OneOrMany::Any => true,
            OneOrMany::One(one) => one == value,
            OneOrMany::Many(many) => many.contains(value),
        }
    }

    fn values(&self) -> &[T] {
        match self {
            OneOrMany::Any => &[],
            OneOrMany::One(one) => std::slice::from_ref(one),
            OneOrMany::Many(many) => many,
        }
    }
}

/// Settings of some scenarios.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Override {
    /// Which.
    pub when: When,
    /// What is different.
    pub set: Settings,
}

/// What an override can change.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Settings {
    /// Ticks that are recorded.
    pub frames: Option<u64>,
    /// Simulated seconds before them.
    pub warm_up_s: Option<f64>,
    /// Vehicles besides the ego.
    pub vehicles: Option<u32>,
    /// People on foot.
    pub walkers: Option<u32>,
    /// Whether gantry-drive drives.
    pub drive: Option<bool>,
    /// Keys of the scenario's launch file.
    pub launch: Table,
}

/// A format to write.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Export {
    /// Its name, as `gantry export --format` has it.
    pub format: String,
    /// Folder in the set; the format's name if it is empty.
    #[serde(default)]
    pub folder: String,
    /// Every how many keyframes one is exported.
    #[serde(default = "one")]
    pub every: u64,
    /// Cameras in their order; empty: all that the format can hold.
    #[serde(default)]
    pub cameras: Vec<String>,
    /// Rig of the launch file whose sensors are exported.
    #[serde(default)]
    pub rig: Option<String>,
    /// `png` or `jpg`.
    #[serde(default)]
    pub images: Option<String>,
    /// Quality of JPEG, 1 to 100.
    #[serde(default)]
    pub jpeg_quality: Option<u8>,
    /// Form of COCO's masks.
    #[serde(default)]
    pub masks: Option<String>,
    /// Objects that fewer pixels show get no label.
    #[serde(default)]
    pub min_pixels: Option<u64>,
}

impl Export {
    /// Its folder in the set.
    pub fn folder(&self) -> &str {
        if self.folder.is_empty() {
            &self.format
        } else {
            &self.folder
        }
    }
}

fn yes() -> bool {
    true
}
fn one() -> u64 {
    1
}
fn two() -> f64 {
    2.0
}
fn twenty() -> f64 {
    20.0
}
fn train_only() -> String {
    "train=1".into()
}
fn clear() -> Vec<String> {
    vec!["clear".into()]
}
fn noon() -> Vec<String> {
    vec!["noon".into()]
}
fn first_place() -> Vec<u32> {
    vec![0]
}
fn one_seed() -> Seeds {
    Seeds::List(vec![1])
}

/// Letters, digits, `-` and `_`: what names in paths and domains may consist of.
pub fn is_name(text: &str) -> bool {
    !text.is_empty()
        && text.len() <= 64
        && text
            .chars()
            .all(|c| c.is_ascii_alphanumeric() || c == '-' || c == '_')
}

impl Recipe {
    /// Reads and checks a recipe.
    ///
    /// # Errors
    /// [`wrong_usage`] with the file, what is wrong, and what is allowed.
    pub fn read(file: &Path) -> anyhow::Result<Recipe> {
        let shown = file.display();
        let text = launch_cli::files::read_text(file, MAX_SETTINGS_BYTES)
            .map_err(|error| wrong_usage(format!("cannot read the recipe {shown}: {error}")))?;
        let mut recipe: Recipe = toml::from_str(&text)
            .map_err(|error| wrong_usage(format!("{shown} is no recipe: {error}")))?;
        if recipe.name.is_empty() {
            let stem = file.file_stem().unwrap_or_default();
            recipe.name = stem.to_string_lossy().into_owned();
        }
        recipe
            .check()
            .map_err(|sentence| wrong_usage(format!("{shown}: {sentence}")))?;
        Ok(recipe)
    }

    /// Checks what the types do not.
    ///
    /// # Errors
    /// [`RecipeError`].
    pub fn check(&self) -> Result<(), RecipeError> {
        if self.version != 1 {
            return Err(RecipeError::Version(self.version));
        }
        check_range("tick_hz", self.tick_hz, 0.1, 1000.0)?;
        check_run(self.frames, self.warm_up_s)?;
        parse_split(&self.split).map_err(RecipeError::Split)?;
        self.check_matrix()?;
        for rule in &self.overrides {
            self.check_when(&rule.when)?;
            check_run(
                rule.set.frames.unwrap_or(self.frames),
                rule.set.warm_up_s.unwrap_or(self.warm_up_s),
            )?;
        }
        for rule in &self.exclude {
            self.check_when(rule)?;
        }
        self.check_exports()
    }

    fn check_matrix(&self) -> Result<(), RecipeError> {
        let matrix = &self.matrix;
        let seeds = match &matrix.seeds {
            Seeds::Range(range) => range.count as usize,
            Seeds::List(seeds) => seeds.len(),
        };
        if self.rig.is_empty() {
            return Err(RecipeError::NoRig);
        }
        for (what, n) in [
            ("maps", matrix.maps.len()),
            ("weathers", matrix.weathers.len()),
            ("times", matrix.times.len()),
            ("spawn_points", matrix.spawn_points.len()),
            ("seeds", seeds),
        ] {
            if n == 0 {
                return Err(RecipeError::Empty(what));
            }
        }
        for name in self.rig.keys() {
            if !is_name(name) {
                return Err(RecipeError::RigName(name.clone()));
            }
        }
        for name in &matrix.weathers {
            presets::weather(name, &self.weather)?;
        }
        for name in &matrix.times {
            presets::time(name, &self.time)?;
        }
        for name in &matrix.rigs {
            if !self.rig.contains_key(name) {
                return Err(RecipeError::UnknownRig {
                    name: name.clone(),
                    known: list(self.rig.keys()),
                });
            }
        }
        let rigs = self.rigs().len();
        let n = [
            matrix.maps.len(),
            matrix.weathers.len(),
            matrix.times.len(),
            matrix.spawn_points.len(),
            seeds,
            rigs,
        ]
        .iter()
        .try_fold(1usize, |n, next| n.checked_mul(*next));
        match n {
            Some(n) if n <= MAX_SCENARIOS => Ok(()),
            _ => Err(RecipeError::TooMany(MAX_SCENARIOS)),
        }
    }

    /// A rule that names something outside of the matrix would silently do nothing.
    fn check_when(&self, when: &When) -> Result<(), RecipeError> {
        let matrix = &self.matrix;
        let unknown = |key, value: String, known| Err(RecipeError::Rule { key, value, known });
        let texts = [
            ("map", &when.map, &matrix.maps),
            ("weather", &when.weather, &matrix.weathers),
            ("time", &when.time, &matrix.times),
            ("rig", &when.rig, &self.rigs()),
        ];
        for (key, wanted, known) in texts {
            if let Some(other) = wanted.values().iter().find(|it| !known.contains(it)) {
                return unknown(key, format!("{other:?}"), list(known.iter()));
            }
        }
        let seeds = matrix.seeds.list();
        if let Some(other) = when.seed.values().iter().find(|it| !seeds.contains(it)) {
            return unknown("seed", other.to_string(), list(seeds.iter()));
        }
        let points = &matrix.spawn_points;
        let other = |it: &&u32| !points.contains(it);
        if let Some(other) = when.spawn_point.values().iter().find(other) {
            return unknown("spawn_point", other.to_string(), list(points.iter()));
        }
        Ok(())
    }

    fn check_exports(&self) -> Result<(), RecipeError> {
        use clap::ValueEnum as _;
        let mut folders: Vec<&str> = Vec::new();
        for export in &self.export {
            if Format::from_str(&export.format, false).is_err() {
                let known = Format::value_variants().iter().map(|format| format.name());
                return Err(RecipeError::Format {
                    name: export.format.clone(),
                    known: list(known),
                });
            }
            if export.every == 0 {
                return Err(RecipeError::Every);
            }
            let folder = export.folder();
            if !is_name(folder) || RESERVED.contains(&folder) {
                return Err(RecipeError::Folder {
                    name: folder.into(),
                    taken: RESERVED.join(" or "),
                });
            }
            if folders.contains(&folder) {
                return Err(RecipeError::SameFolder(folder.into()));
            }
            folders.push(folder);
        }
        if self.export.is_empty() && !self.keep_recordings {
            return Err(RecipeError::Nothing);
        }
        Ok(())
    }

    /// The rigs that the matrix has.
    pub fn rigs(&self) -> Vec<String> {
        if self.matrix.rigs.is_empty() {
            self.rig.keys().cloned().collect()
        } else {
            self.matrix.rigs.clone()
        }
    }
}

/// Names in a set that are not an export's.
const RESERVED: [&str; 2] = ["recordings", "logs"];

fn check_run(frames: u64, warm_up_s: f64) -> Result<(), RecipeError> {
    if !(1..=1_000_000).contains(&frames) {
        return Err(RecipeError::Frames(frames));
    }
    check_range("warm_up_s", warm_up_s, 0.0, 3600.0)
}

fn check_range(key: &'static str, value: f64, least: f64, most: f64) -> Result<(), RecipeError> {
    if (least..=most).contains(&value) {
        Ok(())
    } else {
        Err(RecipeError::Range {
            key,
            value,
            least,
            most,
        })
    }
}

/// Values with commas between them.
fn list<T: ToString>(values: impl Iterator<Item = T>) -> String {
    let values: Vec<String> = values.map(|it| it.to_string()).collect();
    values.join(", ")
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    pub(crate) const SMALL: &str = r#"
version = 1
frames = 10
[matrix]
maps = ["Town01", "Town02"]
weathers = ["clear", "rain"]
seeds = { from = 5, count = 2 }
[rig.front.sensor.front]
kind = "camera"
modalities = ["rgb", "depth"]
[[export]]
format = "kitti"
"#;

    fn read(text: &str) -> anyhow::Result<Recipe> {
        let recipe: Recipe = toml::from_str(text)?;
        recipe.check()?;
        Ok(recipe)
    }

    #[test]
    fn a_small_recipe_has_defaults() {
        let recipe = read(SMALL).unwrap();
        assert_eq!(recipe.matrix.seeds.list(), [5, 6]);
        assert_eq!((recipe.warm_up_s, recipe.tick_hz), (2.0, 20.0));
        assert_eq!(recipe.rigs(), ["front"]);
        assert_eq!(recipe.export[0].folder(), "kitti");
        assert!(recipe.drive && !recipe.keep_recordings);
    }

    #[test]
    fn what_is_wrong_is_said_in_a_sentence() {
        for (from, to, word) in [
            ("frames = 10", "frames = 0", "1 to 1000000"),
            ("\"rain\"", "\"snow\"", "snow"),
            ("\"kitti\"", "\"kity\"", "semantickitti"),
            ("count = 2", "count = 0", "matrix.seeds is empty"),
            ("version = 1", "version = 2", "version = 1"),
            ("version = 1", "version = 1\ntick_hz = 0.0", "tick_hz"),
            ("version = 1", "version = 1\nsplit = \"a\"", "split"),
            ("[matrix]", "[matrix]\nrigs = [\"rear\"]", "there is front"),
            ("count = 2", "count = 2000000", "several sets"),
            ("frames = 10", "frmes = 10", "frmes"),
        ] {
            let error = read(&SMALL.replace(from, to)).expect_err(to).to_string();
            assert!(error.contains(word), "{to}: {error}");
        }
        let twice = format!("{SMALL}[[export]]\nformat = \"kitti\"\n");
        let refused = |text: &str| read(text).unwrap_err().to_string();
        assert!(refused(&twice).contains("two exports"));
        let rule = format!("{SMALL}[[exclude]]\nmap = \"Town03\"\n");
        assert!(refused(&rule).contains("Town01, Town02"));
    }
}
