//! Reads the mesh of a scene on which another renderer was measured: binary PLY, triangles only.

use std::sync::Arc;

use anyhow::Context as _;
use nalgebra::Isometry3;
use schema_frames::document::Weather;
use schema_types::{Class, ObjectId, SimTime, Tick};
use sensor_core::mesh::Surface;
use sensor_core::{Material, MeshBuilder, Scene, SceneAssets, StaticInstance};

/// Side of the ground squares into which the mesh is cut, so that squares out of sight are culled.
const CHUNK_M: f32 = 20.0;

/// A scene of the triangles in a PLY file (little-endian, `float x y z`, `list uchar int`), all of
/// one class, in chunks of 20 m.
///
/// # Errors
/// The file cannot be read or is no such PLY.
pub fn scene(path: &std::path::Path) -> anyhow::Result<Arc<Scene>> {
    let bytes = std::fs::read(path).with_context(|| format!("cannot read {}", path.display()))?;
    let (vertices, triangles) = parse(&bytes)
        .with_context(|| format!("{} is not a binary PLY of triangles", path.display()))?;
    let mut chunks: std::collections::BTreeMap<(i32, i32), MeshBuilder> = Default::default();
    let wall = Surface::new(Class::BUILDINGS, Material::Matte, [170, 160, 140]);
    for corners in triangles {
        let corners = corners.map(|i| vertices[i as usize]);
        let cell = |axis: usize| {
            ((corners[0][axis] + corners[1][axis] + corners[2][axis]) / (3.0 * CHUNK_M)).floor()
                as i32
        };
        chunks
            .entry((cell(0), cell(1)))
            .or_insert_with(|| MeshBuilder::new("chunk"))
            .triangle(wall, corners);
    }
    let mut assets = SceneAssets {
        episode: 1,
        ..Default::default()
    };
    for (i, builder) in chunks.into_values().enumerate() {
        let mesh = assets.add_mesh(builder.finish());
        assets.statics.push(StaticInstance {
            mesh,
            world_from_mesh: Isometry3::identity(),
            object: ObjectId::scenery(i as u32),
        });
    }
    Ok(Arc::new(Scene {
        tick: Tick(1),
        sim_time: SimTime(50_000_000),
        period_nanos: 50_000_000,
        assets: Arc::new(assets),
        dynamics: Vec::new(),
        past: Default::default(),
        weather: Weather::default(),
        lidar_extinction_per_m: 0.0,
        debug: Vec::new(),
        overlay: Default::default(),
    }))
}

type Triangles = (Vec<[f32; 3]>, Vec<[u32; 3]>);

fn parse(bytes: &[u8]) -> Option<Triangles> {
    const END: &[u8] = b"end_header\n";
    let body = bytes.windows(END.len()).position(|window| window == END)? + END.len();
    let header = std::str::from_utf8(&bytes[..body]).ok()?;
    let count = |what: &str| {
        header
            .lines()
            .find_map(|line| line.strip_prefix(what)?.trim().parse::<usize>().ok())
    };
    let (n_vertices, n_faces) = (count("element vertex")?, count("element face")?);
    let (vertices, faces) = bytes[body..].split_at_checked(12 * n_vertices)?;
    let float = |b: &[u8]| f32::from_le_bytes([b[0], b[1], b[2], b[3]]);
    let vertices = vertices
        .chunks_exact(12)
        .map(|v| [float(&v[..4]), float(&v[4..8]), float(&v[8..])])
        .collect();
    let index = |b: &[u8]| u32::from_le_bytes([b[0], b[1], b[2], b[3]]);
    let face = |f: &[u8]| (f[0] == 3).then(|| [index(&f[1..5]), index(&f[5..9]), index(&f[9..])]);
    let triangles: Option<Vec<[u32; 3]>> = faces.chunks_exact(13).take(n_faces).map(face).collect();
    let triangles = triangles
        .filter(|t| t.len() == n_faces && t.iter().flatten().all(|i| (*i as usize) < n_vertices))?;
    Some((vertices, triangles))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_triangle_comes_back_and_a_broken_file_does_not() {
        let mut file = b"ply\nformat binary_little_endian 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n".to_vec();
        let corners = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 2.0, 0.0]];
        corners
            .iter()
            .flatten()
            .for_each(|x| file.extend(x.to_le_bytes()));
        file.push(3);
        [0u32, 1, 2]
            .iter()
            .for_each(|i| file.extend(i.to_le_bytes()));
        assert_eq!(parse(&file), Some((corners.to_vec(), vec![[0, 1, 2]])));
        assert_eq!(parse(&file[..file.len() - 1]), None);
        let n = file.len();
        file[n - 4] = 9;
        assert_eq!(parse(&file), None);
    }
}
