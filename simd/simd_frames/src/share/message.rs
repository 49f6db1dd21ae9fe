//! Scenes on their way to those who render a share of them.

use std::sync::Arc;

use anyhow::{Context as _, ensure};
use nalgebra::Vector3;
use schema_frames::document::Weather;
use schema_frames::{SceneFiring, SceneHeader, SceneInstance, SceneStroke};
use schema_types::{ActorId, Pose, SimTime, Tick};
use sensor_core::scene::{
    DebugStroke, DebugText, DynamicInstance, MeshId, Overlay, Past, Scene, SceneAssets,
};

use super::bytes::{Reader, Writer};

/// A scene as it was sent, to be sent again if a worker ends before it is done.
pub struct SentScene {
    /// Counts and numbers of the scene; who sends it sets numbers of message and versions.
    pub header: SceneHeader,
    /// What follows the firings.
    pub rest: Vec<u8>,
}

impl SentScene {
    /// A scene in bytes.
    pub fn of(scene: &Scene) -> SentScene {
        let instances: Vec<SceneInstance> = scene.dynamics.iter().map(instance).collect();
        let strokes: Vec<SceneStroke> = scene.debug.iter().map(stroke).collect();
        let overlay = overlay_bytes(&scene.overlay);
        let past = past_bytes(&scene.past);
        let rest = [
            bytemuck::cast_slice(&instances),
            bytemuck::cast_slice(&strokes),
            &overlay[..],
            &past[..],
        ]
        .concat();
        let header = SceneHeader {
            tick: scene.tick.0,
            sim_nanos: scene.sim_time.0,
            period_nanos: scene.period_nanos,
            lidar_extinction_per_m: scene.lidar_extinction_per_m,
            episode: scene.assets.episode,
            n_instances: instances.len() as u32,
            n_strokes: strokes.len() as u32,
            overlay_bytes: overlay.len() as u32,
            past_bytes: past.len() as u32,
            weather: numbers_of(&scene.weather),
            ..bytemuck::Zeroable::zeroed()
        };
        SentScene { header, rest }
    }
}

/// A scene from its bytes, before this still scenery, and its firings.
///
/// # Errors
/// A sentence about what does not fit together.
pub fn scene_of(
    header: &SceneHeader,
    payload: &[u8],
    assets: &Arc<SceneAssets>,
) -> anyhow::Result<(Scene, Vec<SceneFiring>)> {
    let read = || -> anyhow::Result<_> {
        let mut from = Reader(payload);
        let firings: Vec<SceneFiring> = from.get_n(header.n_firings as usize)?;
        let instances: Vec<SceneInstance> = from.get_n(header.n_instances as usize)?;
        let strokes: Vec<SceneStroke> = from.get_n(header.n_strokes as usize)?;
        let overlay = overlay_of(from.take(header.overlay_bytes as usize)?)?;
        let past = past_of(from.take(header.past_bytes as usize)?, instances.len())?;
        from.end()?;
        let n_meshes = assets.meshes.len();
        let mut dynamics = Vec::with_capacity(instances.len());
        for it in &instances {
            ensure!(
                (it.mesh as usize) < n_meshes,
                "mesh {} is shown, but the scenery has {n_meshes}",
                it.mesh
            );
            dynamics.push(dynamic(it));
        }
        let scene = Scene {
            tick: Tick(header.tick),
            sim_time: SimTime(header.sim_nanos),
            period_nanos: header.period_nanos,
            assets: assets.clone(),
            dynamics,
            past,
            weather: weather_of(&header.weather),
            lidar_extinction_per_m: header.lidar_extinction_per_m,
            debug: strokes.iter().map(drawn).collect(),
            overlay,
        };
        Ok((scene, firings))
    };
    read().context("a scene cannot be read")
}

fn instance(it: &DynamicInstance) -> SceneInstance {
    SceneInstance {
        world_from_mesh: Pose::from(it.world_from_mesh),
        velocity_in_world_mps: it.velocity_in_world_mps.into(),
        actor_id: it.actor.0,
        mesh: it.mesh.0,
        lamps: it.lamps,
        part: it.part,
        tint_rgb: it.tint_rgb,
        reserved: [0; 7],
    }
}

fn dynamic(it: &SceneInstance) -> DynamicInstance {
    DynamicInstance {
        actor: ActorId(it.actor_id),
        part: it.part,
        mesh: MeshId(it.mesh),
        world_from_mesh: it.world_from_mesh.isometry(),
        tint_rgb: it.tint_rgb,
        lamps: it.lamps,
        velocity_in_world_mps: Vector3::from(it.velocity_in_world_mps),
    }
}

fn stroke(it: &DebugStroke) -> SceneStroke {
    SceneStroke {
        from_m: it.from_m,
        to_m: it.to_m,
        width_m: it.width_m,
        color_rgb: it.color_rgb,
        reserved: 0,
    }
}

fn drawn(it: &SceneStroke) -> DebugStroke {
    DebugStroke {
        from_m: it.from_m,
        to_m: it.to_m,
        width_m: it.width_m,
        color_rgb: it.color_rgb,
    }
}

fn overlay_bytes(overlay: &Overlay) -> Vec<u8> {
    if overlay.is_empty() {
        return Vec::new();
    }
    let mut to = Writer::default();
    let strokes: Vec<SceneStroke> = overlay.strokes.iter().map(stroke).collect();
    to.put_all(&strokes);
    to.put_len(overlay.texts.len());
    for text in &overlay.texts {
        to.put(text.at_m);
        to.put(text.color_rgb);
        to.put(u8::from(text.shadow));
        to.put_text(&text.text);
    }
    to.put_len(overlay.panel.len());
    overlay.panel.iter().for_each(|line| to.put_text(line));
    to.0
}

fn overlay_of(bytes: &[u8]) -> anyhow::Result<Overlay> {
    let mut overlay = Overlay::default();
    if bytes.is_empty() {
        return Ok(overlay);
    }
    let mut from = Reader(bytes);
    let strokes: Vec<SceneStroke> = from.get_all()?;
    overlay.strokes = strokes.iter().map(drawn).collect();
    for _ in 0..from.get_len()? {
        overlay.texts.push(DebugText {
            at_m: from.get()?,
            color_rgb: from.get()?,
            shadow: from.get::<u8>()? != 0,
            text: from.get_text()?,
        });
    }
    for _ in 0..from.get_len()? {
        overlay.panel.push(from.get_text()?);
    }
    from.end()?;
    Ok(overlay)
}

fn past_bytes(past: &Past) -> Vec<u8> {
    if past.moved.is_empty() {
        return Vec::new();
    }
    let mut to = Writer::default();
    to.put_all(&past.ages_nanos);
    to.put_all(&past.moved);
    let poses: Vec<Pose> = past.poses.iter().map(|pose| Pose::from(*pose)).collect();
    to.put_all(&poses);
    to.0
}

/// Where so many parts were at the ticks before.
fn past_of(bytes: &[u8], n_parts: usize) -> anyhow::Result<Past> {
    if bytes.is_empty() {
        return Ok(Past::default());
    }
    let mut from = Reader(bytes);
    let ages_nanos: Vec<u64> = from.get_all()?;
    let moved: Vec<u32> = from.get_all()?;
    let poses: Vec<Pose> = from.get_all()?;
    from.end()?;
    ensure!(
        ages_nanos.is_sorted_by(|a, b| a < b)
            && moved.is_sorted_by(|a, b| a < b)
            && moved.last().is_some_and(|last| (*last as usize) < n_parts)
            && Some(poses.len()) == ages_nanos.len().checked_mul(moved.len()),
        "{} poses of {} parts at {} ticks do not fit {n_parts} parts",
        poses.len(),
        moved.len(),
        ages_nanos.len()
    );
    Ok(Past {
        ages_nanos,
        moved,
        poses: poses.iter().map(Pose::isometry).collect(),
    })
}

fn numbers_of(weather: &Weather) -> [f32; 14] {
    let Weather {
        cloudiness,
        precipitation,
        precipitation_deposits,
        wind_intensity,
        sun_azimuth_deg,
        sun_altitude_deg,
        fog_density,
        fog_distance_m,
        fog_falloff,
        wetness,
        scattering_intensity,
        mie_scattering_scale,
        rayleigh_scattering_scale,
        dust_storm,
    } = *weather;
    [
        cloudiness,
        precipitation,
        precipitation_deposits,
        wind_intensity,
        sun_azimuth_deg,
        sun_altitude_deg,
        fog_density,
        fog_distance_m,
        fog_falloff,
        wetness,
        scattering_intensity,
        mie_scattering_scale,
        rayleigh_scattering_scale,
        dust_storm,
    ]
}

fn weather_of(numbers: &[f32; 14]) -> Weather {
    let [
        cloudiness,
        precipitation,
        precipitation_deposits,
        wind_intensity,
        sun_azimuth_deg,
        sun_altitude_deg,
        fog_density,
        fog_distance_m,
        fog_falloff,
        wetness,
        scattering_intensity,
        mie_scattering_scale,
        rayleigh_scattering_scale,
        dust_storm,
    ] = *numbers;
    Weather {
        cloudiness,
        precipitation,
        precipitation_deposits,
        wind_intensity,
        sun_azimuth_deg,
        sun_altitude_deg,
        fog_density,
        fog_distance_m,
        fog_falloff,
        wetness,
        scattering_intensity,
        mie_scattering_scale,
        rayleigh_scattering_scale,
        dust_storm,
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Isometry3, UnitQuaternion};
    use sensor_core::mesh::Mesh;

    use super::*;

    #[test]
    fn a_scene_arrives_as_it_was() {
        let mut assets = SceneAssets {
            episode: 3,
            ..SceneAssets::default()
        };
        assets.add_mesh(Mesh::default());
        let assets = Arc::new(assets);
        let turned = UnitQuaternion::from_euler_angles(0.1, -0.2, 2.9);
        let scene = Scene {
            tick: Tick(9),
            sim_time: SimTime(450_000_001),
            period_nanos: 50_000_000,
            assets: assets.clone(),
            dynamics: vec![DynamicInstance {
                actor: ActorId(5),
                part: 7,
                mesh: MeshId(0),
                world_from_mesh: Isometry3::from_parts([1e6 + 0.1, -3.3, 0.7].into(), turned),
                tint_rgb: [1, 2, 3],
                lamps: 0x8000_0001,
                velocity_in_world_mps: Vector3::new(0.1, 0.2, 0.3),
            }],
            past: Past {
                ages_nanos: vec![50_000_000, 100_000_001],
                moved: vec![0],
                poses: vec![
                    Isometry3::from_parts([1e6, -3.4, 0.7].into(), turned),
                    Isometry3::translation(1e6 - 0.1, -3.5, 0.7),
                ],
            },
            weather: Weather {
                fog_density: 33.3,
                dust_storm: 1.5,
                ..Weather::default()
            },
            lidar_extinction_per_m: 0.01,
            debug: vec![DebugStroke {
                from_m: [0.1; 3],
                to_m: [0.3; 3],
                width_m: 0.5,
                color_rgb: [9, 8, 7],
            }],
            overlay: Overlay {
                strokes: Vec::new(),
                texts: vec![DebugText {
                    at_m: [1.0, 2.0, 0.1],
                    text: "näher".into(),
                    color_rgb: [4; 3],
                    shadow: true,
                }],
                panel: vec!["speed".into()],
            },
        };
        let sent = SentScene::of(&scene);
        let (read, firings) = scene_of(&sent.header, &sent.rest, &assets).unwrap();
        assert!(firings.is_empty());
        assert_eq!(format!("{read:?}"), format!("{scene:?}"));
        let bits = |scene: &Scene| {
            bytemuck::bytes_of(&Pose::from(scene.dynamics[0].world_from_mesh)).to_vec()
        };
        assert_eq!(bits(&read), bits(&scene));
        // Whatever is cut off or claimed is refused.
        for n_bytes in 0..sent.rest.len() {
            assert!(scene_of(&sent.header, &sent.rest[..n_bytes], &assets).is_err());
        }
        let many = SceneHeader {
            n_instances: u32::MAX,
            ..sent.header
        };
        assert!(scene_of(&many, &sent.rest, &assets).is_err());
        let mut later = scene.clone();
        later.past.moved = vec![1];
        let sent_later = SentScene::of(&later);
        assert!(scene_of(&sent_later.header, &sent_later.rest, &assets).is_err());
        let bare = Arc::new(SceneAssets::default());
        assert!(scene_of(&sent.header, &sent.rest, &bare).is_err());
    }
}
