//! The actors' part of the scene: bodies, wheels, limbs, lamp heads.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use schema_frames::LightState;
use schema_types::ActorId;
use sensor_core::{DynamicInstance, MeshId, SceneAssets};
use simd_body::person::{Posture, mesh_of};
use simd_body::prop::prop_mesh;
use simd_body::{Door, outfitted_door_meshes, outfitted_meshes, person_meshes};

use crate::map_data::MapData;
use crate::physics::Physics;
use crate::props::{Props, prop_models};
use crate::records::Records;
use crate::signals::TrafficLights;
use crate::vehicles::{Vehicle, Vehicles, WheelState, vehicle_models};
use crate::walkers::{Walker, Walkers, walker_models};

/// Part numbers: a vehicle's body is 0, its wheels count from 1 and its doors from here.
const BODY_PART: u16 = 0;
const FIRST_DOOR_PART: u16 = 16;

/// A body with an open interior, and its doors with their meshes.
type OpenBody = (MeshId, Vec<(MeshId, Door)>);

/// Meshes of this episode's actors.
#[derive(Clone, Default)]
pub(crate) struct ActorMeshes {
    /// Body and wheel per vehicle model, by its index.
    vehicles: Vec<(MeshId, MeshId)>,
    /// By the same index: bodies of models whose doors can open.
    open_bodies: BTreeMap<u32, Arc<OpenBody>>,
    /// Parts of the body and wheelchair per walker model, by its index.
    walkers: Vec<([MeshId; 7], MeshId)>,
    /// Mesh per prop model, by its index.
    props: Vec<MeshId>,
    light_head: Option<MeshId>,
    /// Lamp heads per light actor.
    heads: BTreeMap<ActorId, Vec<Isometry3<f64>>>,
}

/// What the poses of all parts follow from.
pub(crate) struct PosedActors<'w> {
    pub records: &'w Records,
    pub vehicles: &'w Vehicles,
    pub walkers: &'w Walkers,
    pub props: &'w Props,
    pub lights: &'w TrafficLights,
    pub physics: &'w Physics,
}

impl ActorMeshes {
    /// Adds the meshes of every actor that may appear; once per episode, after the map's own
    /// meshes.
    pub fn register(
        assets: &mut SceneAssets,
        map: &MapData,
        lights: &TrafficLights,
    ) -> ActorMeshes {
        let vehicles = vehicle_models().iter().map(|model| {
            let meshes = outfitted_meshes(&model.shape(), model.outfit());
            (assets.add_mesh(meshes.body), assets.add_mesh(meshes.wheel))
        });
        let vehicles = vehicles.collect();
        let mut open_bodies = BTreeMap::new();
        for (idx, model) in vehicle_models()
            .iter()
            .enumerate()
            .filter(|(_, model)| model.has_dynamic_doors())
        {
            let Some(meshes) = outfitted_door_meshes(&model.shape(), model.outfit()) else {
                continue;
            };
            let body = assets.add_mesh(meshes.body);
            let mut add = |mut door: Door| (assets.add_mesh(std::mem::take(&mut door.mesh)), door);
            open_bodies.insert(
                idx as u32,
                Arc::new((body, meshes.doors.into_iter().map(&mut add).collect())),
            );
        }
        let walkers = walker_models().iter().map(|model| {
            let meshes = person_meshes(&model.shape);
            (
                meshes.parts.map(|part| assets.add_mesh(part)),
                assets.add_mesh(meshes.wheelchair),
            )
        });
        let walkers = walkers.collect();
        let props = prop_models()
            .iter()
            .map(|model| assets.add_mesh(prop_mesh(&model.shape)))
            .collect();
        let light_head =
            (!map.light_head.lods.is_empty()).then(|| assets.add_mesh(map.light_head.clone()));
        let mut meshes = ActorMeshes {
            vehicles,
            open_bodies,
            walkers,
            props,
            light_head,
            heads: BTreeMap::new(),
        };
        meshes.find_light_heads(map, lights);
        meshes
    }

    /// Assigns lamp heads to light actors; must be called again when the lights' ids may have
    /// changed.
    pub fn find_light_heads(&mut self, map: &MapData, lights: &TrafficLights) {
        let heads_of = |signal_id: &str| {
            map.lights
                .iter()
                .find(|site| site.signal_id == signal_id)
                .map(|site| site.heads.clone())
        };
        self.heads = lights
            .lights
            .iter()
            .filter_map(|light| Some((light.actor, heads_of(&light.signal_id)?)))
            .collect();
    }

    /// Fills `out` with every part of every actor, by rising (actor, part).
    pub fn instances(&self, posed: &PosedActors<'_>, out: &mut Vec<DynamicInstance>) {
        out.clear();
        for record in posed.records.all() {
            let actor = ActorId(record.id);
            if let Some(vehicle) = posed.vehicles.get(actor) {
                if let Some((body, wheel)) = self.vehicles.get(record.catalogue_idx as usize) {
                    let world_from_vehicle = record.world_from_actor.isometry();
                    let open = self
                        .open_bodies
                        .get(&record.catalogue_idx)
                        .filter(|_| !vehicle.doors.are_shut());
                    let body = open.map_or(*body, |open| open.0);
                    add_vehicle(
                        posed.physics,
                        out,
                        actor,
                        vehicle,
                        &world_from_vehicle,
                        VehicleMeshes {
                            body,
                            wheel: *wheel,
                        },
                        open.map(Arc::as_ref),
                    );
                }
            } else if let Some(walker) = posed.walkers.get(actor) {
                self.add_walker(out, actor, walker);
            } else if let Some(prop) = posed.props.get(actor) {
                if let Some(mesh) = self.props.get(prop.model_idx as usize) {
                    let velocity_in_world_mps = Vector3::from(record.velocity_in_world_mps);
                    out.push(DynamicInstance {
                        velocity_in_world_mps,
                        ..still(actor, 0, *mesh, record.world_from_actor.isometry(), 0)
                    });
                }
            } else if let (Some(heads), Some(mesh)) = (self.heads.get(&actor), self.light_head) {
                let lamps = posed
                    .lights
                    .get(actor)
                    .map_or(0, |light| lamp_bits(light.state));
                out.extend(
                    heads
                        .iter()
                        .enumerate()
                        .map(|(part, head)| still(actor, part as u16, mesh, *head, lamps)),
                );
            }
        }
    }

    fn add_walker(&self, out: &mut Vec<DynamicInstance>, actor: ActorId, walker: &Walker) {
        let Some((parts, wheelchair)) = self.walkers.get(walker.model_idx as usize) else {
            return;
        };
        let posture = walker.posture();
        let world_from_ground = walker.world_from_ground();
        let velocity_in_world_mps = Vector3::from(walker.velocity_mps);
        let part = |part: usize, mesh: MeshId, ground_from_mesh: &Isometry3<f64>| DynamicInstance {
            actor,
            part: part as u16,
            mesh,
            world_from_mesh: world_from_ground * ground_from_mesh,
            tint_rgb: [255; 3],
            lamps: 0,
            velocity_in_world_mps,
        };
        let poses = walker.parts();
        out.extend(
            poses
                .iter()
                .enumerate()
                .map(|(idx, pose)| part(idx, parts[mesh_of(idx)], pose)),
        );
        if posture == Posture::Seated {
            out.push(part(poses.len(), *wheelchair, &Isometry3::identity()));
        }
    }
}

/// The meshes of a vehicle.
struct VehicleMeshes {
    body: MeshId,
    wheel: MeshId,
}

fn add_vehicle(
    physics: &Physics,
    out: &mut Vec<DynamicInstance>,
    actor: ActorId,
    vehicle: &Vehicle,
    world_from_vehicle: &Isometry3<f64>,
    meshes: VehicleMeshes,
    open: Option<&OpenBody>,
) {
    let VehicleMeshes {
        body,
        wheel: wheel_mesh,
    } = meshes;
    let (velocity, spin) = vehicle.velocity(physics);
    let lamps = vehicle.shining_lamps();
    let part = |part: u16, mesh: MeshId, world_from_mesh: Isometry3<f64>| {
        let lever = world_from_mesh.translation.vector - world_from_vehicle.translation.vector;
        let velocity_in_world_mps = velocity + spin.cross(&lever);
        DynamicInstance {
            actor,
            part,
            mesh,
            world_from_mesh,
            tint_rgb: vehicle.tint_rgb,
            lamps,
            velocity_in_world_mps,
        }
    };
    out.push(part(BODY_PART, body, *world_from_vehicle));
    for (i, wheel) in vehicle.visible_wheels().enumerate() {
        let radius_m = f64::from(vehicle.physics.wheels[i].radius_m);
        out.push(part(
            1 + i as u16,
            wheel_mesh,
            world_from_vehicle * vehicle_from_wheel(&wheel, radius_m),
        ));
    }
    for (i, (mesh, door)) in open.iter().flat_map(|open| &open.1).enumerate() {
        let vehicle_from_door = door.vehicle_from_mesh(vehicle.doors.visible(i));
        out.push(part(
            FIRST_DOOR_PART + i as u16,
            *mesh,
            world_from_vehicle * vehicle_from_door,
        ));
    }
}

/// Pose of a wheel: steering about z, then roll about the axle, then half a turn for wheels on the
/// left, whose outer side would otherwise face inwards.
fn vehicle_from_wheel(wheel: &WheelState, radius_m: f64) -> Isometry3<f64> {
    let place = Translation3::new(
        wheel.x_m as f64,
        wheel.y_m as f64,
        radius_m + wheel.travel_m as f64,
    );
    let about = |axis, angle: f64| UnitQuaternion::from_axis_angle(&axis, angle);
    let half_turn = if wheel.y_m > 0.0 {
        std::f64::consts::PI
    } else {
        0.0
    };
    let rotation = about(Vector3::z_axis(), wheel.steer_rad as f64)
        * about(Vector3::y_axis(), wheel.spin_rad as f64)
        * about(Vector3::z_axis(), half_turn);
    Isometry3::from_parts(place, rotation)
}

fn lamp_bits(state: LightState) -> u32 {
    match state {
        LightState::Red => 1,
        LightState::Yellow => 2,
        LightState::Green => 4,
        LightState::Off | LightState::Unknown => 0,
    }
}

fn still(
    actor: ActorId,
    part: u16,
    mesh: MeshId,
    world_from_mesh: Isometry3<f64>,
    lamps: u32,
) -> DynamicInstance {
    DynamicInstance {
        actor,
        part,
        mesh,
        world_from_mesh,
        tint_rgb: [255; 3],
        lamps,
        velocity_in_world_mps: Vector3::zeros(),
    }
}
