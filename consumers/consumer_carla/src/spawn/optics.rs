//! Turns a colour camera's lens and exposure attributes into the simulator's `optics`.
//!
//! Clients send every attribute of a blueprint, most with their defaults. An attribute at its
//! default leaves Gantry's own image as it is: exposure follows the weather, the lens is a pinhole,
//! and lamps have no bloom.

use serde_json::{Map, Value, json};

use crate::wire::description::Attributes;

/// CARLA's light is not photometric: its default shutter, aperture and film (EV100 8.6) expose a
/// street at noon well. In Gantry's photometric light that street needs EV100 15.
const MANUAL_OFFSET_EV: f64 = 6.4;

/// Difference between CARLA's default bounds of automatic exposure (10 and 12) and the EV100 of
/// streets by day (13.5 to 15.5).
const HISTOGRAM_OFFSET_EV: f64 = 3.5;

/// The optics that differ from a plain image; `None` if nothing does.
pub fn optics(given: &Attributes<'_>) -> Option<Value> {
    let mut keys = Map::new();
    let mut put = |key: &str, name: &str, default: f64| {
        let value = given.float(name, default);
        if value != default {
            keys.insert(key.to_owned(), value.into());
        }
    };
    put("gamma", "gamma", 2.2);
    put("white_kelvin", "temp", 6500.0);
    put("tint", "tint", 0.0);
    put("bloom_intensity", "bloom_intensity", 0.675);
    put(
        "chromatic_aberration",
        "chromatic_aberration_intensity",
        0.0,
    );
    put(
        "chromatic_aberration_start",
        "chromatic_aberration_offset",
        0.0,
    );
    if given.float("lens_circle_multiplier", 0.0) != 0.0 {
        keys.insert(
            "vignette_multiplier".into(),
            given.float("lens_circle_multiplier", 0.0).into(),
        );
        keys.insert(
            "vignette_falloff".into(),
            given.float("lens_circle_falloff", 5.0).into(),
        );
    }
    let lens = [
        ("lens_k", -1.0),
        ("lens_kcube", 0.0),
        ("lens_x_size", 0.08),
        ("lens_y_size", 0.08),
    ];
    let [k, k_cubed, x, y] = lens.map(|(name, default)| given.float(name, default));
    if lens
        .iter()
        .any(|(name, default)| given.float(name, *default) != *default)
    {
        keys.insert("distortion_k".into(), k.into());
        keys.insert("distortion_k_cubed".into(), k_cubed.into());
        keys.insert("distortion_size".into(), json!([x, y]));
    }
    if !given.flag("enable_postprocess_effects", true) {
        keys.insert("postprocess".into(), false.into());
    }
    if let Some(exposure) = exposure(given) {
        keys.insert("exposure".into(), exposure);
    }
    (!keys.is_empty()).then_some(Value::Object(keys))
}

fn exposure(given: &Attributes<'_>) -> Option<Value> {
    let compensation_ev = given.float("exposure_compensation", 0.0);
    if given.text("exposure_mode") == Some("manual") {
        return Some(json!({
            "mode": "manual",
            "compensation_ev": compensation_ev - MANUAL_OFFSET_EV,
            "shutter_per_s": given.float("shutter_speed", 200.0),
            "iso": given.float("iso", 100.0),
            "fstop": given.float("fstop", 1.4),
        }));
    }
    let meter = [
        ("exposure_min_bright", 10.0),
        ("exposure_max_bright", 12.0),
        ("exposure_speed_up", 3.0),
        ("exposure_speed_down", 1.0),
        ("calibration_constant", 16.0),
    ];
    if meter
        .iter()
        .any(|(name, default)| given.float(name, *default) != *default)
    {
        let [low, high, up, down, calibration] =
            meter.map(|(name, default)| given.float(name, default));
        return Some(json!({
            "mode": "histogram",
            "compensation_ev": compensation_ev,
            "min_ev100": low + HISTOGRAM_OFFSET_EV,
            "max_ev100": high + HISTOGRAM_OFFSET_EV,
            "speed_up_per_s": up,
            "speed_down_per_s": down,
            "calibration": calibration,
        }));
    }
    (compensation_ev != 0.0).then(|| json!({ "compensation_ev": compensation_ev }))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::description::{Attribute, Description};

    fn given(attributes: &[(&str, &str)]) -> Option<Value> {
        let attribute = |(name, value): &(&str, &str)| Attribute {
            name: (*name).into(),
            kind: 4,
            value: (*value).into(),
        };
        let description = Description {
            type_id: "sensor.camera.rgb".into(),
            attributes: attributes.iter().map(attribute).collect(),
        };
        optics(&Attributes::of(&description))
    }

    #[test]
    fn defaults_ask_for_nothing() {
        assert_eq!(
            given(&[
                ("gamma", "2.2"),
                ("lens_k", "-1.0"),
                ("exposure_mode", "histogram"),
                ("bloom_intensity", "0.675")
            ]),
            None
        );
    }

    #[test]
    fn what_differs_is_passed_on_and_accepted_by_the_specification() {
        let keys = given(&[
            ("lens_k", "-2.0"),
            ("exposure_mode", "manual"),
            ("fstop", "2.8"),
            ("enable_postprocess_effects", "false"),
        ])
        .unwrap();
        assert_eq!(
            (
                &keys["distortion_k"],
                &keys["postprocess"],
                &keys["exposure"]["mode"]
            ),
            (&json!(-2.0), &json!(false), &json!("manual"))
        );
        // CARLA's EV100 at these settings is log2(2.8² · 200) = 10.6; the simulator's is 17.0:
        // compensation carries the difference.
        assert!((keys["exposure"]["compensation_ev"].as_f64().unwrap() + 6.4).abs() < 1e-9);
        let metered = given(&[("exposure_max_bright", "14")]).unwrap();
        assert_eq!(
            (
                &metered["exposure"]["mode"],
                &metered["exposure"]["max_ev100"]
            ),
            (&json!("histogram"), &json!(17.5))
        );
    }
}
