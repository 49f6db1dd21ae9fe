//! Attributes of vehicles in the catalogue, and which of them a spawn may set.

use std::collections::BTreeMap;

use schema_frames::document::CatalogueEntry;
use simd_body::BodyStyle;

use super::model::VehicleModel;
use crate::errors::{self, BadAttribute};

/// Attributes that describe a vehicle and cannot be set; the rest can.
const FIXED_ATTRIBUTES: &[&str] = &[
    "base_type",
    "special_type",
    "generation",
    "number_of_wheels",
    "has_lights",
    "has_dynamic_doors",
    "mass_kg",
    "wheelbase_m",
    "max_steer_rad",
    "wheel_radius_m",
];

/// What the catalogue says about a model.
pub(crate) fn catalogue_entry(model: &VehicleModel) -> CatalogueEntry {
    CatalogueEntry {
        type_id: model.type_id.to_owned(),
        kind: "vehicle".to_owned(),
        class: model.class.0,
        body_box: model.body_box(),
        attributes: attributes(model),
        recommended: BTreeMap::from([(
            "color".to_owned(),
            model
                .colors
                .iter()
                .map(|color| color_text(*color))
                .collect(),
        )]),
    }
}

fn attributes(model: &VehicleModel) -> BTreeMap<String, String> {
    let pairs = [
        ("base_type", model.base_type.to_owned()),
        ("special_type", model.special_type.to_owned()),
        ("generation", model.generation.to_string()),
        ("number_of_wheels", model.n_wheels().to_string()),
        (
            "has_lights",
            (model.style != BodyStyle::Bicycle).to_string(),
        ),
        ("has_dynamic_doors", model.has_dynamic_doors().to_string()),
        ("mass_kg", model.mass_kg.to_string()),
        ("wheelbase_m", model.wheelbase_m.to_string()),
        ("max_steer_rad", model.max_steer_rad().to_string()),
        ("wheel_radius_m", model.wheel_radius_m.to_string()),
        ("color", color_text(model.colors[0])),
        ("sticky_control", "true".to_owned()),
    ];
    let driver = model
        .is_two_wheeler()
        .then(|| ("driver_id", "0".to_owned()));
    pairs
        .into_iter()
        .chain(driver)
        .map(|(name, value)| (name.to_owned(), value))
        .collect()
}

/// A colour as the text `r,g,b`.
pub(crate) fn color_text([r, g, b]: [u8; 3]) -> String {
    format!("{r},{g},{b}")
}

/// Reads `r,g,b` with each 0..=255.
pub(crate) fn parse_color(text: &str) -> Option<[u8; 3]> {
    let parts: Vec<u8> = text
        .split(',')
        .map(|part| part.trim().parse().ok())
        .collect::<Option<_>>()?;
    parts.try_into().ok()
}

/// The model's attributes with the `given` ones in their place.
///
/// # Errors
/// A given attribute that the model does not have, or that may not differ.
pub(crate) fn checked_attributes(
    model: &VehicleModel,
    given: &BTreeMap<String, String>,
) -> Result<BTreeMap<String, String>, BadAttribute> {
    errors::checked_attributes(attributes(model), given, refusal)
}

/// What is allowed instead of a value.
fn refusal(name: &str, value: &str, known: &BTreeMap<String, String>) -> Option<String> {
    if FIXED_ATTRIBUTES.contains(&name) {
        let is_so = known.get(name).is_some_and(|is| is == value);
        return (!is_so).then(|| format!("it is fixed at {:?}", known[name]));
    }
    match name {
        "color" if parse_color(value).is_none() => {
            Some("it must be \"r,g,b\" with each 0 to 255".to_owned())
        }
        "sticky_control" if !["true", "false"].contains(&value) => {
            Some("it must be true or false".to_owned())
        }
        // Selects CARLA's rider; here all riders look alike.
        "driver_id" if known.contains_key(name) => match value.parse::<u32>() {
            Ok(_) => None,
            Err(_) => Some("it must be a whole number from 0".to_owned()),
        },
        "color" | "sticky_control" => None,
        _ => Some(format!(
            "a vehicle has only {}",
            known.keys().cloned().collect::<Vec<_>>().join(", ")
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colour_reads_back() {
        assert_eq!(parse_color(&color_text([1, 20, 255])), Some([1, 20, 255]));
        assert_eq!(parse_color("1,2"), None);
        assert_eq!(parse_color("1,2,256"), None);
    }
}
