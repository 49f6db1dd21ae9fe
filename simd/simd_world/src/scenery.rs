//! What of the scenery is shown, and which of its lamps shine: switched at run time, for all
//! sensors and for collisions.
//!
//! A checkpoint does not carry it: going back keeps what is hidden hidden, as it keeps the map.

use std::collections::{BTreeMap, BTreeSet};

use schema_frames::CommandReply;
use schema_frames::scenery::{LampChange, SceneryLampInfo, SceneryObjectInfo};
use schema_types::ObjectId;
use sensor_core::LampSetting;
use simd_town::{LampGroup, SceneryLamp};

use crate::map::MapData;
use crate::world::World;

/// Below this height of the sun, degrees, lamps that nobody switched shine.
const DUSK_DEG: f32 = 5.0;

/// A lamp as clients set it.
#[derive(Clone, Debug)]
struct Lamp {
    rgb: [u8; 3],
    intensity_lm: f32,
    group: u8,
    /// Switched by hand.
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

/// What is hidden and switched.
#[derive(Clone, Debug, Default)]
pub(crate) struct SceneryState {
    pub hidden: BTreeSet<ObjectId>,
    lamps: Vec<Lamp>,
    /// Lamps that nobody switched stay dark.
    no_cycle: bool,
    /// Changes of what is shown, and of lamps.
    revisions: (u64, u64),
}

impl SceneryState {
    pub fn of(map: &MapData) -> SceneryState {
        SceneryState {
            lamps: map.lamps.iter().map(Lamp::of).collect(),
            ..SceneryState::default()
        }
    }
}

impl World {
    /// Objects of the scenery that are hidden.
    pub fn hidden_objects(&self) -> &BTreeSet<ObjectId> {
        &self.scenery.hidden
    }

    /// Objects whose lamps are not as built.
    pub fn switched_lamps(&self) -> BTreeMap<ObjectId, LampSetting> {
        let lamps = self.map.lamps.iter().zip(&self.scenery.lamps);
        let setting = |(site, lamp): (&SceneryLamp, &Lamp)| {
            let on = lamp.on.or(self.scenery.no_cycle.then_some(false));
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

    /// Counts of changes in this episode: of what is shown, and of lamps.
    pub fn scenery_revisions(&self) -> (u64, u64) {
        self.scenery.revisions
    }

    pub(crate) fn scenery_reply(&self) -> CommandReply {
        let objects = self.map.objects.iter().map(|object| SceneryObjectInfo {
            id: object.id.0,
            name: object.name.clone(),
            class: object.class.0,
            layer: object.layer.map_or(0, |layer| layer as u16),
            pose: object.pose.into(),
            box_pose: object.box_pose.into(),
            box_half_m: object.box_half_m,
            shown: !self.scenery.hidden.contains(&object.id),
        });
        let dark = self.weather.sun_altitude_deg < DUSK_DEG && !self.scenery.no_cycle;
        let lamps = self
            .map
            .lamps
            .iter()
            .zip(&self.scenery.lamps)
            .enumerate()
            .map(|(number, (site, lamp))| SceneryLampInfo {
                lamp: number as u32,
                object_id: site.object.0,
                position_m: site.position_m,
                rgb: lamp.rgb,
                intensity_lm: lamp.intensity_lm,
                group: lamp.group,
                on: lamp.on.unwrap_or(dark),
            });
        CommandReply::Scenery {
            objects: objects.collect(),
            lamps: lamps.collect(),
        }
    }

    pub(crate) fn show_objects(&mut self, ids: &[u32], shown: bool) -> Result<(), String> {
        let known: BTreeSet<u32> = self.map.objects.iter().map(|object| object.id.0).collect();
        if let Some(id) = ids.iter().find(|id| !known.contains(id)) {
            return Err(format!(
                "object {id} is not in map {:?}; the command scenery lists those that are",
                self.map.name
            ));
        }
        self.show(ids.iter().map(|&id| ObjectId(id)).collect(), shown);
        Ok(())
    }

    pub(crate) fn show_layers(&mut self, layers: u16, shown: bool) {
        let members = self
            .map
            .objects
            .iter()
            .filter(|object| object.layer.is_some_and(|layer| layers & layer as u16 != 0));
        self.show(members.map(|object| object.id).collect(), shown);
    }

    fn show(&mut self, objects: Vec<ObjectId>, shown: bool) {
        let before = self.scenery.hidden.len();
        for object in objects {
            if shown {
                self.scenery.hidden.remove(&object);
            } else {
                self.scenery.hidden.insert(object);
            }
        }
        if self.scenery.hidden.len() != before {
            self.scenery.revisions.0 += 1;
            let map = self.map.clone();
            self.physics.show_only(&map, &self.scenery.hidden);
        }
    }

    pub(crate) fn set_scenery_lamps(&mut self, changes: &[LampChange]) -> Result<(), String> {
        let n = self.scenery.lamps.len();
        for change in changes {
            if change.lamp as usize >= n {
                return Err(format!(
                    "lamp {} is not in map {:?}, which has {n}",
                    change.lamp, self.map.name
                ));
            }
            if let Some(lumen) = change
                .intensity_lm
                .filter(|lumen| !(0.0..=1e9).contains(lumen))
            {
                return Err(format!(
                    "intensity_lm of lamp {} is {lumen}, but must be 0 to 1e9",
                    change.lamp
                ));
            }
            if let Some(group) = change.group.filter(|&group| group > 4) {
                return Err(format!(
                    "group of lamp {} is {group}, but must be 0 to 4",
                    change.lamp
                ));
            }
        }
        for change in changes {
            let lamp = &mut self.scenery.lamps[change.lamp as usize];
            lamp.on = change.on.or(lamp.on);
            lamp.rgb = change.rgb.unwrap_or(lamp.rgb);
            lamp.intensity_lm = change.intensity_lm.unwrap_or(lamp.intensity_lm);
            lamp.group = change.group.unwrap_or(lamp.group);
        }
        self.scenery.revisions.1 += u64::from(!changes.is_empty());
        Ok(())
    }

    /// Whether lamps that nobody switched shine in the dark. Switched ones go back to doing so when
    /// it is turned on.
    pub(crate) fn set_lamp_cycle(&mut self, on: bool) {
        self.scenery.no_cycle = !on;
        if on {
            self.scenery
                .lamps
                .iter_mut()
                .for_each(|lamp| lamp.on = None);
        }
        self.scenery.revisions.1 += 1;
    }
}
