//! One firing of one sensor: what its frame's header says, and where its noise comes from.

use nalgebra::Isometry3;
use schema_bus::{FrameLoan, mono_now};
use schema_frames::{CollisionEvent, FrameHeader, Modality};
use schema_roads::RoadMap;
use schema_types::ActorId;
use schema_types::noise::Noise;
use sensor_core::gnss::GeoReference;
use sensor_core::scene::Scene;
use sensor_core::schedule::Firing;

use crate::carrier::Carrier;
use crate::sensor::Sensor;
use crate::stages;
use crate::topic::Audience;

/// What is the same in every header of one episode.
#[derive(Clone, Copy, Debug)]
pub struct Stamp {
    /// Random number of the daemon's start.
    pub epoch: u64,
    /// Count of map loads.
    pub episode: u32,
    /// Seed of the run.
    pub seed: u64,
    /// Geographic place of the map's origin.
    pub geo_reference: GeoReference,
}

/// What sensors see of one tick.
#[derive(Clone, Copy)]
pub struct TickView<'a> {
    /// Actors, weather and map.
    pub scene: &'a Scene,
    /// What all headers have in common.
    pub stamp: &'a Stamp,
    /// Contacts of the tick by rising actor that was pushed.
    pub collisions: &'a [(ActorId, CollisionEvent)],
    /// Roads of the map.
    pub roads: Option<&'a RoadMap>,
}

/// A sensor that fires in this tick.
pub(super) struct Due {
    pub sensor_idx: usize,
    pub firing: Firing,
    pub carrier: Carrier,
}

/// One sensor in one tick.
pub(super) struct Shot<'a> {
    pub tick: TickView<'a>,
    pub due: &'a Due,
    pub world_from_sensor: Isometry3<f64>,
    pub noise: Noise,
    pub audience: Audience,
}

impl<'a> Shot<'a> {
    pub fn new(tick: &TickView<'a>, due: &'a Due, sensor: &Sensor, audience: Audience) -> Self {
        let n_ticks = tick.scene.tick.0 - sensor.made_at.0;
        Shot {
            tick: *tick,
            due,
            world_from_sensor: due.carrier.world_from_sensor.isometry(),
            noise: Noise::new(tick.stamp.seed, sensor.stream.number(), n_ticks),
            audience,
        }
    }

    /// Header of a topic, still without size and times.
    pub fn header(&self, actor: ActorId, modality: Modality) -> FrameHeader {
        let TickView { scene, stamp, .. } = self.tick;
        let Due {
            firing, carrier, ..
        } = self.due;
        FrameHeader {
            sensor_id: actor.0,
            tick: scene.tick.0,
            sim_nanos: scene.sim_time.0,
            seq: firing.seq,
            episode: stamp.episode,
            window_nanos: firing.window_nanos,
            world_from_sensor: carrier.world_from_sensor,
            parent_id: carrier.parent.0,
            epoch: stamp.epoch,
            ..FrameHeader::new(modality)
        }
    }

    /// Header of the sensor's only topic.
    pub fn only_header(&self, sensor: &Sensor) -> FrameHeader {
        self.header(sensor.actor, sensor.topics[0].modality)
    }

    /// Sends a filled loan of the sensor's only topic.
    pub fn send(&self, sensor: &mut Sensor, loan: FrameLoan, mut header: FrameHeader) {
        header.rendered_mono_nanos = mono_now().0;
        let _span = stages::PUBLISH.span();
        sensor.topics[0].send(loan, header, self.audience);
    }
}
