//! `[scenario]`.

use super::sections::nearest_place;
use crate::error::Errors;
use crate::fill::fill_entry;
use crate::model::Scenario;
use crate::tree::Table;

/// Ticks per second a scenario may ask for.
pub(super) const TICK_HZ: (f64, f64) = (0.1, 1000.0);
/// Wait for an idle lockstep participant, seconds; 0 is for ever.
const LOCKSTEP_TIMEOUT_S: (f64, f64) = (0.0, 86_400.0);
/// Most other vehicles.
const MAX_VEHICLES: u32 = 500;
/// Most people on foot.
const MAX_WALKERS: u32 = 1000;

pub(super) fn read(file: &Table, errors: &mut Errors) -> Scenario {
    let scenario = fill_entry(
        &Scenario::default(),
        file.get("scenario"),
        "scenario",
        &[],
        errors,
    );
    check(&scenario, file, errors);
    scenario
}

fn check(scenario: &Scenario, file: &Table, errors: &mut Errors) {
    let mut range = |key: &str, value: f64, (low, high): (f64, f64)| {
        if !(low..=high).contains(&value) {
            let path = format!("scenario.{key}");
            errors.push(
                nearest_place(file, &path),
                format!("{path} is {value}, but must be {low} to {high}"),
            );
        }
    };
    range("tick_hz", scenario.tick_hz, TICK_HZ);
    range(
        "lockstep_timeout_s",
        scenario.lockstep_timeout_s,
        LOCKSTEP_TIMEOUT_S,
    );
    range(
        "vehicles",
        scenario.vehicles.into(),
        (0.0, MAX_VEHICLES.into()),
    );
    range(
        "walkers",
        scenario.walkers.into(),
        (0.0, MAX_WALKERS.into()),
    );
    let weather = &scenario.weather;
    let percent = (0.0, 100.0);
    for (key, value, allowed) in [
        ("cloudiness", weather.cloudiness, percent),
        ("precipitation", weather.precipitation, percent),
        (
            "precipitation_deposits",
            weather.precipitation_deposits,
            percent,
        ),
        ("wind_intensity", weather.wind_intensity, percent),
        ("fog_density", weather.fog_density, percent),
        ("wetness", weather.wetness, percent),
        ("sun_azimuth_deg", weather.sun_azimuth_deg, (-360.0, 360.0)),
        ("sun_altitude_deg", weather.sun_altitude_deg, (-90.0, 90.0)),
        ("fog_distance_m", weather.fog_distance_m, (0.0, 10_000.0)),
        ("fog_falloff", weather.fog_falloff, (0.0, 10.0)),
        (
            "scattering_intensity",
            weather.scattering_intensity,
            (0.0, 1000.0),
        ),
        (
            "mie_scattering_scale",
            weather.mie_scattering_scale,
            (0.0, 5.0),
        ),
        (
            "rayleigh_scattering_scale",
            weather.rayleigh_scattering_scale,
            (0.0, 2.0),
        ),
        ("dust_storm", weather.dust_storm, percent),
    ] {
        range(&format!("weather.{key}"), value.into(), allowed);
    }
    if scenario.map.trim().is_empty() {
        errors.push(
            nearest_place(file, "scenario.map"),
            "scenario.map is empty; name a map such as \"Town10HD\", or an .xodr file",
        );
    }
}
