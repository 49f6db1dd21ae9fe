//! Which objects of the scenery are shown and which of its lamps shine. Both can be switched at run
//! time, for all sensors and for collisions.
//!
//! A checkpoint does not contain this state: like the map itself, it stays as it is when the world
//! goes back.

use std::collections::{BTreeMap, BTreeSet};

use schema_frames::CommandReply;
use schema_frames::document::Weather;
use schema_frames::scenery::{LampChange, SceneryLampInfo, SceneryObjectInfo};
use schema_types::ObjectId;
use sensor_core::LampSetting;
use simd_town::{LampGroup, SceneryLamp};

use crate::errors::SceneryError;
use crate::map_data::MapData;
use crate::physics::Physics;

/// Below this altitude of the sun, degrees, lamps that were not switched shine.
const DUSK_DEG: f32 = 5.0;

/// A lamp's settings.
#[derive(Clone, Debug)]
struct Lamp {
    rgb: [u8; 3],
    intensity_lm: f32,
    group: u8,
    /// Switched by a command; `None` follows the time of day.
    on: Option<bool>,
}

impl Lamp {
    fn of(lamp: &SceneryLamp) -> Lamp {
        let group = match lamp.group {
            LampGroup::Street => 2,
            LampGroup::Building => 3,
            LampGroup::Other => 4,
        };
        Lamp {
            rgb: lamp.rgb,
            intensity_lm: lamp.intensity_lm,
            group,
            on: None,
        }
    }
}

/// Tells one state of the scenery in an episode from another.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SceneryRevisions {
    /// Count of changes of what is shown.
    pub objects: u64,
    /// Count of commands that changed lamps.
    pub lamps: u64,
    /// Whether lamps that were not switched shine.
    pub is_dark: bool,
}

/// What is hidden and switched.
#[derive(Clone, Debug, Default)]
pub(crate) struct SceneryState {
    hidden: BTreeSet<ObjectId>,
    lamps: Vec<Lamp>,
    /// Whether lamps that were not switched stay dark.
    no_cycle: bool,
    /// Count of changes of what is hidden.
    object_changes: u64,
    /// Count of commands that changed lamps.
    lamp_changes: u64,
}

impl SceneryState {
    pub fn of(map: &MapData) -> SceneryState {
        SceneryState {
            lamps: map.lamps.iter().map(Lamp::of).collect(),
            ..SceneryState::default()
        }
    }

    /// Objects of the scenery that are hidden.
    pub fn hidden_objects(&self) -> &BTreeSet<ObjectId> {
        &self.hidden
    }

    /// Settings of lamps that differ from the map's.
    pub fn switched_lamps(&self, map: &MapData) -> BTreeMap<ObjectId, LampSetting> {
        let lamps = map.lamps.iter().zip(&self.lamps);
        let setting = |(site, lamp): (&SceneryLamp, &Lamp)| {
            let on = lamp.on.or(self.no_cycle.then_some(false));
            let rgb = (lamp.rgb != site.rgb).then_some(lamp.rgb);
            let strength_ratio = lamp.intensity_lm / site.intensity_lm;
            let set = on.is_some() || rgb.is_some() || strength_ratio != 1.0;
            set.then_some((
                site.object,
                LampSetting {
                    on,
                    rgb,
                    strength_ratio,
                },
            ))
        };
        lamps.filter_map(setting).collect()
    }

    pub fn revisions(&self, weather: &Weather) -> SceneryRevisions {
        SceneryRevisions {
            objects: self.object_changes,
            lamps: self.lamp_changes,
            is_dark: self.is_dark(weather),
        }
    }

    fn is_dark(&self, weather: &Weather) -> bool {
        weather.sun_altitude_deg < DUSK_DEG && !self.no_cycle
    }

    pub fn reply(&self, map: &MapData, weather: &Weather) -> CommandReply {
        let objects = map.objects.iter().map(|object| SceneryObjectInfo {
            id: object.id.0,
            name: object.name.clone(),
            class: object.class.0,
            layer: object.layer.map_or(0, |layer| layer as u16),
            pose: object.pose.into(),
            box_pose: object.box_pose.into(),
            box_half_m: object.box_half_m,
            shown: !self.hidden.contains(&object.id),
        });
        let is_dark = self.is_dark(weather);
        let lamps = map
            .lamps
            .iter()
            .zip(&self.lamps)
            .enumerate()
            .map(|(number, (site, lamp))| SceneryLampInfo {
                lamp: number as u32,
                object_id: site.object.0,
                position_m: site.position_m,
                rgb: lamp.rgb,
                intensity_lm: lamp.intensity_lm,
                group: lamp.group,
                on: lamp.on.unwrap_or(is_dark),
            });
        CommandReply::Scenery {
            objects: objects.collect(),
            lamps: lamps.collect(),
        }
    }

    pub fn show_objects(
        &mut self,
        ids: &[u32],
        shown: bool,
        map: &MapData,
        physics: &mut Physics,
    ) -> Result<(), SceneryError> {
        let known: BTreeSet<u32> = map.objects.iter().map(|object| object.id.0).collect();
        if let Some(id) = ids.iter().find(|id| !known.contains(id)) {
            return Err(SceneryError::UnknownObject {
                object: *id,
                map: map.name.clone(),
            });
        }
        self.show(
            ids.iter().map(|&id| ObjectId(id)).collect(),
            shown,
            map,
            physics,
        );
        Ok(())
    }

    pub fn show_layers(&mut self, layers: u16, shown: bool, map: &MapData, physics: &mut Physics) {
        let members = map
            .objects
            .iter()
            .filter(|object| object.layer.is_some_and(|layer| layers & layer as u16 != 0));
        self.show(
            members.map(|object| object.id).collect(),
            shown,
            map,
            physics,
        );
    }

    fn show(&mut self, objects: Vec<ObjectId>, shown: bool, map: &MapData, physics: &mut Physics) {
        let before = self.hidden.len();
        for object in objects {
            if shown {
                self.hidden.remove(&object);
            } else {
                self.hidden.insert(object);
            }
        }
        if self.hidden.len() != before {
            self.object_changes += 1;
            physics.show_only(map, &self.hidden);
        }
    }

    pub fn set_lamps(&mut self, changes: &[LampChange], map: &MapData) -> Result<(), SceneryError> {
        let n = self.lamps.len();
        for change in changes {
            if change.lamp as usize >= n {
                return Err(SceneryError::UnknownLamp {
                    lamp: change.lamp,
                    map: map.name.clone(),
                    n_lamps: n,
                });
            }
            if let Some(lumen) = change
                .intensity_lm
                .filter(|lumen| !(0.0..=1e9).contains(lumen))
            {
                return Err(SceneryError::Intensity {
                    lamp: change.lamp,
                    lumen,
                });
            }
            if let Some(group) = change.group.filter(|&group| group > 4) {
                return Err(SceneryError::Group {
                    lamp: change.lamp,
                    group,
                });
            }
        }
        for change in changes {
            let lamp = &mut self.lamps[change.lamp as usize];
            lamp.on = change.on.or(lamp.on);
            lamp.rgb = change.rgb.unwrap_or(lamp.rgb);
            lamp.intensity_lm = change.intensity_lm.unwrap_or(lamp.intensity_lm);
            lamp.group = change.group.unwrap_or(lamp.group);
        }
        self.lamp_changes += u64::from(!changes.is_empty());
        Ok(())
    }

    /// Sets whether lamps that were not switched shine in the dark. Turning it on also makes all
    /// switched lamps follow the time of day again.
    pub fn set_lamp_cycle(&mut self, on: bool) {
        self.no_cycle = !on;
        if on {
            self.lamps.iter_mut().for_each(|lamp| lamp.on = None);
        }
        self.lamp_changes += 1;
    }
}
