//! Turns a camera's lens and exposure attributes into the simulator's `optics`.
//!
//! Clients send every attribute of a blueprint, most with their defaults. An attribute at its
//! default leaves Gantry's own image as it is: exposure follows the weather, the lens is a sharp
//! pinhole, and lamps have neither bloom nor ghosts. Attributes of one effect act together as soon
//! as one of them differs.

use serde_json::{Map, Value, json};

use crate::wire::description::Attributes;

/// CARLA's light is not photometric: its default shutter, aperture and film (EV100 8.6) expose a
/// street at noon well. In Gantry's photometric light that street needs EV100 15.
const MANUAL_OFFSET_EV: f64 = 6.4;

/// Difference between CARLA's default bounds of automatic exposure (10 and 12) and the EV100 of
/// streets by day (13.5 to 15.5).
const HISTOGRAM_OFFSET_EV: f64 = 3.5;

/// The frame time that CARLA's motion blur is a share of, seconds.
const BLURRED_SECS: f64 = 1.0 / 30.0;

type Keys = Map<String, Value>;

/// The optics that differ from a plain image; `None` if nothing does. The lens bends the images of
/// every camera, so that they fit each other; all else acts on colour.
pub fn optics(given: &Attributes<'_>, has_colour: bool) -> Option<Value> {
    let mut keys = Map::new();
    lens(given, &mut keys);
    if has_colour {
        colour(given, &mut keys);
        film(given, &mut keys);
        blur(given, &mut keys);
        if let Some(exposure) = exposure(given) {
            keys.insert("exposure".into(), exposure);
        }
    }
    (!keys.is_empty()).then_some(Value::Object(keys))
}

/// The attributes' values; `None` if all are the defaults.
fn unless_default<const N: usize>(
    given: &Attributes<'_>,
    attributes: [(&str, f64); N],
) -> Option<[f64; N]> {
    let values = attributes.map(|(name, default)| given.float(name, default));
    let defaults = attributes.map(|(_, default)| default);
    (values != defaults).then_some(values)
}

fn lens(given: &Attributes<'_>, keys: &mut Keys) {
    let lens = [
        ("lens_k", -1.0),
        ("lens_kcube", 0.0),
        ("lens_x_size", 0.08),
        ("lens_y_size", 0.08),
    ];
    if let Some([k, k_cubed, x, y]) = unless_default(given, lens) {
        keys.insert("distortion_k".into(), k.into());
        keys.insert("distortion_k_cubed".into(), k_cubed.into());
        keys.insert("distortion_size".into(), json!([x, y]));
    }
}

fn colour(given: &Attributes<'_>, keys: &mut Keys) {
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
    put("flare_intensity", "lens_flare_intensity", 0.1);
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
    if !given.flag("enable_postprocess_effects", true) {
        keys.insert("postprocess".into(), false.into());
    }
}

fn film(given: &Attributes<'_>, keys: &mut Keys) {
    let film = [
        ("slope", 0.88),
        ("toe", 0.55),
        ("shoulder", 0.26),
        ("black_clip", 0.0),
        ("white_clip", 0.04),
    ];
    if let Some([slope, toe, shoulder, black_clip, white_clip]) = unless_default(given, film) {
        // CARLA's renderer cuts these off in the same way.
        keys.insert(
            "film".into(),
            json!({
                "curve": "shaped",
                "slope": slope.clamp(0.01, 10.0),
                "toe": toe.clamp(0.0, 1.0),
                "shoulder": shoulder.clamp(0.0, 1.0),
                "black_clip": black_clip.clamp(0.0, 1.0),
                "white_clip": white_clip.clamp(0.0, 1.0),
            }),
        );
    }
}

fn blur(given: &Attributes<'_>, keys: &mut Keys) {
    let motion = [
        ("motion_blur_intensity", 0.45),
        ("motion_blur_max_distortion", 0.35),
    ];
    if let Some([intensity, longest_percent]) = unless_default(given, motion) {
        keys.insert(
            "motion_blur".into(),
            json!({
                "shutter_secs": (intensity * BLURRED_SECS).clamp(0.0, 1.0),
                "longest_ratio": (longest_percent / 100.0).clamp(0.0, 0.2),
            }),
        );
    }
    let focus = [
        ("focal_distance", 1000.0),
        ("min_fstop", 1.2),
        ("blade_count", 5.0),
        ("blur_amount", 1.0),
        ("blur_radius", 0.0),
    ];
    if let Some([distance_cm, min_fstop, blades, half_km, haze_px]) = unless_default(given, focus) {
        keys.insert(
            "focus".into(),
            json!({
                "distance_m": (distance_cm / 100.0).clamp(0.0, 1e5),
                "fstop": given.float("fstop", 1.4).clamp(0.1, 100.0),
                "min_fstop": min_fstop.clamp(0.0, 100.0),
                "blades": blades.clamp(4.0, 16.0) as u32,
                "haze_px": haze_px.clamp(0.0, 100.0),
                "haze_half_m": (1000.0 * half_km).clamp(1e-3, 1e6),
            }),
        );
    }
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
        optics(&Attributes::of(&description), true)
    }

    #[test]
    fn defaults_ask_for_nothing() {
        assert_eq!(
            given(&[
                ("gamma", "2.2"),
                ("lens_k", "-1.0"),
                ("exposure_mode", "histogram"),
                ("bloom_intensity", "0.675"),
                ("motion_blur_intensity", "0.45"),
                ("focal_distance", "1000.0"),
                ("blade_count", "5"),
                ("slope", "0.88"),
            ]),
            None
        );
    }

    /// Goal: one attribute of an effect switches it on with all its others, in the simulator's
    /// units.
    #[test]
    fn blur_focus_and_film_are_passed_on_in_metres_and_seconds() {
        let keys = given(&[
            ("motion_blur_intensity", "0.9"),
            ("motion_blur_max_distortion", "2.0"),
            ("focal_distance", "450"),
            ("fstop", "2.0"),
            ("blur_radius", "3"),
            ("toe", "0.4"),
            ("lens_flare_intensity", "0.5"),
        ])
        .unwrap();
        let about = |value: &Value, expected: f64| {
            assert!((value.as_f64().unwrap() - expected).abs() < 1e-9, "{value}");
        };
        about(&keys["motion_blur"]["shutter_secs"], 0.03);
        about(&keys["motion_blur"]["longest_ratio"], 0.02);
        about(&keys["flare_intensity"], 0.5);
        assert_eq!(
            keys["focus"],
            json!({
                "distance_m": 4.5, "fstop": 2.0, "min_fstop": 1.2, "blades": 5,
                "haze_px": 3.0, "haze_half_m": 1000.0,
            })
        );
        assert_eq!(
            keys["film"],
            json!({
                "curve": "shaped", "slope": 0.88, "toe": 0.4, "shoulder": 0.26,
                "black_clip": 0.0, "white_clip": 0.04,
            })
        );
    }

    #[test]
    fn cameras_without_colour_have_the_lens_alone() {
        let description = Description {
            type_id: "sensor.camera.depth".into(),
            attributes: [("lens_k", "-2.0"), ("lens_circle_multiplier", "3.0")]
                .map(|(name, value)| Attribute {
                    name: name.into(),
                    kind: 4,
                    value: value.into(),
                })
                .into(),
        };
        let keys = optics(&Attributes::of(&description), false).unwrap();
        assert_eq!(
            keys,
            json!({"distortion_k": -2.0, "distortion_k_cubed": 0.0, "distortion_size": [0.08, 0.08]})
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
