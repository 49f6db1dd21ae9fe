//! The lists of sensors that workers have, and which sensors are on them.

use schema_bus::Bus;
use schema_frames::SceneHeader;
use sensor_core::scene::SceneAssets;
use simd_frames::frames::Sensors;
use simd_frames::sensor::{Model, Role, Sensor};
use simd_frames::topic::Writer;

use crate::clock::Clock;
use crate::sensing::workers::{Listed, Parting};
use crate::world::LiveWorld;

/// What the places of cameras depend on besides sensors and workers.
#[derive(Clone, Copy)]
pub struct Surroundings<'a> {
    /// Has the actors and the scenery.
    pub world: &'a LiveWorld,
    /// Has the tick.
    pub clock: &'a Clock,
    /// Where topics are closed and opened.
    pub bus: &'a Bus,
    /// Whether cameras may leave processes that work.
    pub parting: Parting,
}

/// The cameras as the lists of workers have them.
pub fn listed(sensors: &Sensors) -> Vec<Listed> {
    let entry = |sensor: &Sensor| Listed {
        actor: sensor.actor,
        n_beginnings: sensor.n_beginnings,
        maker: sensor.maker,
        hidden: sensor.hidden.clone(),
    };
    shared(sensors).map(entry).collect()
}

/// The sensors whose frames are of a kind that workers can make: cameras and lidars.
pub fn shared(sensors: &Sensors) -> impl Iterator<Item = &Sensor> {
    let all = sensors.sensors.iter();
    all.filter(|sensor| sensor.model.is_costly())
}

/// Whether a sensor's frames are made here whatever workers there are. Those of cameras with a lens
/// are. Where there is a GPU for it, the spectator's are; and those of lidars that are not cast on the
/// processor with the scenery of cameras.
pub fn stays_here(sensors: &Sensors, assets: &SceneAssets, sensor: &Sensor) -> bool {
    match sensor.model {
        Model::Lens(_) => true,
        Model::Lidar { .. } => sensors.options().lidars_on == Writer::Gpu || assets.streamed,
        _ => sensor.role == Role::Spectator && sensors.gpu().is_some(),
    }
}

/// Header of a message without firings, which says that the lists are others.
pub fn header_of_lists(around: &Surroundings<'_>) -> SceneHeader {
    SceneHeader {
        tick: around.clock.tick().0,
        sim_nanos: around.clock.now().0,
        period_nanos: around.clock.period_nanos(),
        episode: around.world.episode().stamp().episode,
        ..bytemuck::Zeroable::zeroed()
    }
}
