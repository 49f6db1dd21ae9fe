//! `[spectator]`.

use sensor_spec::SIDE_PX;

use super::scenario::TICK_HZ;
use super::sections::nearest_place;
use crate::error::Errors;
use crate::fill::fill_entry;
use crate::model::Spectator;
use crate::tree::Table;

/// Field of view, degrees.
const FOV_DEG: (f64, f64) = (1.0, 170.0);

pub(super) fn read(file: &Table, errors: &mut Errors) -> Spectator {
    let usual = Spectator::default();
    let spectator = fill_entry(&usual, file.get("spectator"), "spectator", &[], errors);
    let side_px = (f64::from(SIDE_PX.0), f64::from(SIDE_PX.1));
    for (key, value, (low, high)) in [
        ("width_px", f64::from(spectator.width_px), side_px),
        ("height_px", f64::from(spectator.height_px), side_px),
        ("fov_deg", spectator.fov_deg, FOV_DEG),
        ("rate_hz", spectator.rate_hz, TICK_HZ),
    ] {
        if !(low..=high).contains(&value) {
            let path = format!("spectator.{key}");
            errors.push(
                nearest_place(file, &path),
                format!("{path} is {value}, but must be {low} to {high}"),
            );
        }
    }
    spectator
}
