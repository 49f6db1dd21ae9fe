//! Traffic lights and signs of the network, on their poles.

use nalgebra::{Isometry3, Vector3};
use schema_types::Class;

use crate::meshes::SharedMeshes;
use crate::meshes::signals::HEADS_M;
use crate::network::{KERB_HEIGHT_M, Signal, SignalKind, facing};
use crate::scenery::{Builder, LightSite};

/// Puts up one signal.
pub fn signal(builder: &mut Builder<'_>, meshes: &SharedMeshes, signal: &Signal) {
    let road = &builder.network.roads[signal.road];
    let foot = road.path.beside(signal.pole_s_m, signal.t_m);
    let yaw = facing(road.path.at(signal.pole_s_m).1, signal.against);
    let z = KERB_HEIGHT_M + road.elevation.at(signal.pole_s_m);
    if signal.kind != SignalKind::Light {
        let mesh = meshes
            .signs
            .iter()
            .find(|(kind, _)| *kind == signal.kind)
            .expect("the shared meshes have every sign that networks place")
            .1;
        let object = builder.object(Class::TRAFFIC_SIGNS, "traffic_sign");
        builder.stand_as(object, mesh, foot, z, yaw);
        builder.pole_at(object, foot, z, 0.09, 2.6);
        return;
    }
    let wide = road.profile.main;
    let object = builder.object(Class::POLES, "traffic_light_pole");
    builder.stand_as(object, meshes.poles[usize::from(wide)], foot, z, yaw);
    builder.pole_at(object, foot, z, 0.09, 2.6);
    let pole = Isometry3::new(Vector3::new(foot.x, foot.y, z), Vector3::z() * yaw);
    let head = |y: f64, z: f64| pole * Isometry3::translation(0.2, y, z);
    let mut heads = vec![head(0.0, HEADS_M.0)];
    if wide {
        heads.push(head(-4.6, HEADS_M.1 - 0.45));
    }
    builder.lights.push(LightSite {
        signal_id: signal.id.to_string(),
        pole: pole.into(),
        heads,
    });
}
