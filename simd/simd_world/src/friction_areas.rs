//! Areas in which tyres have another friction: `static.trigger.friction`.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Point3};
use schema_frames::document::Catalogue;
use schema_types::Pose;
use serde::{Deserialize, Serialize};

use crate::actors::Actors;
use crate::errors::BadAttribute;

/// Catalogue id.
pub(crate) const TYPE_ID: &str = "static.trigger.friction";
/// Attributes with their default values: friction, then half extents in **centimetres**, as in
/// CARLA.
pub(crate) const ATTRIBUTES: [(&str, &str); 4] = [
    ("friction", "3.5"),
    ("extent_x", "700.0"),
    ("extent_y", "700.0"),
    ("extent_z", "700.0"),
];

/// All areas by rising actor id.
#[derive(Clone, Default, Serialize, Deserialize)]
pub(crate) struct FrictionAreas {
    pub boxes: Vec<FrictionBox>,
}

impl FrictionAreas {
    /// Reads the areas from the actors, after one came, went or moved.
    pub fn refresh(&mut self, actors: &Actors, catalogue: &Catalogue) {
        let kind_idx = catalogue
            .entries
            .iter()
            .position(|entry| entry.type_id == TYPE_ID);
        let areas = actors
            .by_id
            .values()
            .filter(|actor| kind_idx == Some(actor.catalogue_idx as usize));
        self.boxes = areas
            .filter_map(|actor| FrictionBox::new(&actor.pose, &actor.attributes).ok())
            .collect();
    }
}

/// A box about a pose, with the friction of tyres in it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct FrictionBox {
    #[serde(with = "crate::serde_forms::isometry")]
    pub box_from_world: Isometry3<f64>,
    pub half_m: [f64; 3],
    pub friction: f32,
}

impl FrictionBox {
    /// The box of an actor, from its attributes.
    ///
    /// # Errors
    /// Names the attribute whose value cannot be used, and what is allowed.
    pub fn new(
        pose: &Pose,
        attributes: &BTreeMap<String, String>,
    ) -> Result<FrictionBox, BadAttribute> {
        let mut values = [0.0; 4];
        for ((name, usual), value) in ATTRIBUTES.iter().zip(&mut values) {
            let text = attributes.get(*name).map_or(*usual, String::as_str);
            let most = if *name == "friction" { 100.0 } else { 1e6 };
            *value = text
                .trim()
                .parse()
                .ok()
                .filter(|number: &f64| (0.0..=most).contains(number))
                .ok_or_else(|| BadAttribute {
                    name: (*name).to_owned(),
                    value: text.to_owned(),
                    allowed: format!("it must be a number from 0 to {most}"),
                })?;
        }
        let [friction, x, y, z] = values;
        Ok(FrictionBox {
            box_from_world: pose.isometry().inverse(),
            half_m: [x, y, z].map(|cm| cm / 100.0),
            friction: friction as f32,
        })
    }

    /// Whether a point of the world lies inside.
    pub fn contains(&self, point_in_world_m: &Point3<f64>) -> bool {
        let at = self.box_from_world * point_in_world_m;
        (0..3).all(|axis| at[axis].abs() <= self.half_m[axis])
    }
}

/// How much grip the ground gives to tyres.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GroundGrip<'w> {
    /// Areas of other friction, by rising actor id.
    pub friction: &'w [FrictionBox],
    /// Share of the friction outside such areas that the weather leaves.
    pub grip_ratio: f32,
}
