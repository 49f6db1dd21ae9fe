//! Weathers and times of day that recipes and suites may name without describing them.

use std::collections::BTreeMap;

use toml::Table;

/// Keys of `scenario.weather`, percent.
type Preset = (&'static str, &'static [(&'static str, f64)]);

/// Weathers by name, in the words of CARLA's presets.
const WEATHERS: &[Preset] = &[
    ("clear", &[("cloudiness", 15.0), ("wind_intensity", 10.0)]),
    ("cloudy", &[("cloudiness", 80.0), ("wind_intensity", 30.0)]),
    (
        "wet",
        &[
            ("cloudiness", 20.0),
            ("precipitation_deposits", 50.0),
            ("wetness", 60.0),
        ],
    ),
    (
        "drizzle",
        &[
            ("cloudiness", 60.0),
            ("precipitation", 20.0),
            ("precipitation_deposits", 30.0),
            ("wetness", 50.0),
        ],
    ),
    (
        "rain",
        &[
            ("cloudiness", 80.0),
            ("precipitation", 55.0),
            ("precipitation_deposits", 60.0),
            ("wetness", 80.0),
            ("fog_density", 5.0),
            ("wind_intensity", 40.0),
        ],
    ),
    (
        "storm",
        &[
            ("cloudiness", 100.0),
            ("precipitation", 100.0),
            ("precipitation_deposits", 90.0),
            ("wetness", 100.0),
            ("fog_density", 10.0),
            ("wind_intensity", 100.0),
        ],
    ),
    (
        "fog",
        &[
            ("cloudiness", 60.0),
            ("fog_density", 60.0),
            ("fog_distance_m", 5.0),
            ("wetness", 20.0),
        ],
    ),
];

/// Times of day by name: where the sun is.
const TIMES: &[Preset] = &[
    (
        "dawn",
        &[("sun_altitude_deg", 3.0), ("sun_azimuth_deg", 10.0)],
    ),
    (
        "morning",
        &[("sun_altitude_deg", 25.0), ("sun_azimuth_deg", -30.0)],
    ),
    (
        "noon",
        &[("sun_altitude_deg", 65.0), ("sun_azimuth_deg", -90.0)],
    ),
    (
        "afternoon",
        &[("sun_altitude_deg", 42.0), ("sun_azimuth_deg", 130.0)],
    ),
    (
        "sunset",
        &[("sun_altitude_deg", 8.0), ("sun_azimuth_deg", 170.0)],
    ),
    (
        "night",
        &[("sun_altitude_deg", -30.0), ("sun_azimuth_deg", 0.0)],
    ),
];

/// Why a name stands for nothing.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PresetError {
    /// Nobody has described it.
    #[error("there is no {what} {name:?}; there is {known}, and [{what}.NAME] makes another")]
    Unknown {
        /// `weather` or `time`.
        what: &'static str,
        /// The name.
        name: String,
        /// Names that there are.
        known: String,
    },
    /// A time of day says more than where the sun is.
    #[error("[time.{name}] has the key {key:?}; a time of day has {allowed}")]
    NotOfTime {
        /// Its name.
        name: String,
        /// What it says.
        key: String,
        /// What it may say.
        allowed: String,
    },
}

/// Lays `over` on `base`: tables merge key by key, everything else is replaced.
pub fn merge(base: &mut Table, over: &Table) {
    for (key, value) in over {
        match (base.get_mut(key), value) {
            (Some(toml::Value::Table(base)), toml::Value::Table(over)) => merge(base, over),
            _ => drop(base.insert(key.clone(), value.clone())),
        }
    }
}

/// A weather by name: one of `own`, or a preset.
///
/// # Errors
/// [`PresetError::Unknown`].
pub fn weather(name: &str, own: &BTreeMap<String, Table>) -> Result<Table, PresetError> {
    find("weather", name, own, WEATHERS)
}

/// A time of day by name: one of `own`, or a preset.
///
/// # Errors
/// [`PresetError`].
pub fn time(name: &str, own: &BTreeMap<String, Table>) -> Result<Table, PresetError> {
    let keys = ["sun_altitude_deg", "sun_azimuth_deg"];
    let found = find("time", name, own, TIMES)?;
    match found.keys().find(|key| !keys.contains(&key.as_str())) {
        Some(key) => Err(PresetError::NotOfTime {
            name: name.to_owned(),
            key: key.clone(),
            allowed: keys.join(" and "),
        }),
        None => Ok(found),
    }
}

fn find(
    what: &'static str,
    name: &str,
    own: &BTreeMap<String, Table>,
    presets: &[Preset],
) -> Result<Table, PresetError> {
    if let Some(found) = own.get(name) {
        return Ok(found.clone());
    }
    let preset = presets.iter().find(|(other, _)| *other == name);
    let (_, values) = preset.ok_or_else(|| {
        let known = presets.iter().map(|(name, _)| *name);
        let own = own.keys().map(String::as_str);
        let names: Vec<&str> = known.chain(own).collect();
        PresetError::Unknown {
            what,
            name: name.to_owned(),
            known: names.join(", "),
        }
    })?;
    Ok(values
        .iter()
        .map(|(key, value)| ((*key).to_owned(), (*value).into()))
        .collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_preset_is_a_weather_of_a_launch_file() {
        for (name, _) in WEATHERS {
            for (time_name, _) in TIMES {
                let mut table = weather(name, &BTreeMap::new()).unwrap();
                table.extend(time(time_name, &BTreeMap::new()).unwrap());
                let text = format!(
                    "version = 1\n[scenario.weather]\n{}",
                    toml::to_string(&table).unwrap()
                );
                crate::Launch::parse(&text, name).unwrap();
            }
        }
    }

    #[test]
    fn own_ones_come_first_and_unknown_ones_are_listed() {
        let own = BTreeMap::from([("clear".to_owned(), Table::new())]);
        assert!(weather("clear", &own).unwrap().is_empty());
        let error = time("tea", &BTreeMap::new()).unwrap_err().to_string();
        assert!(
            error.contains("noon") && error.contains("[time.NAME]"),
            "{error}"
        );
        let wrong = BTreeMap::from([("x".to_owned(), "fog_density = 1".parse().unwrap())]);
        assert!(
            time("x", &wrong)
                .unwrap_err()
                .to_string()
                .contains("fog_density")
        );
    }
}
