//! What a view draws, as lists that processors rasterise: made from a scene by matrices alone, with
//! nothing left out.

use nalgebra::Isometry3;
use schema_types::space::sensor_from_camera;
use sensor_camera::{InstanceData, RasterDraw, TileImages, TileInput, ViewData, exact_images};
use sensor_core::{MeshId, Scene, Vertex};
use sensor_spec::Intrinsics;

pub struct Lists {
    pub view: ViewData,
    pub vertices: Vec<Vertex>,
    pub indices: Vec<u32>,
    pub instances: Vec<InstanceData>,
    pub draws: Vec<RasterDraw>,
}

fn rows(transform: &Isometry3<f64>) -> [[f32; 4]; 3] {
    let m = transform.to_homogeneous();
    std::array::from_fn(|row| std::array::from_fn(|column| m[(row, column)] as f32))
}

/// What an instance has beside its mesh and its pose.
struct Marks {
    object_id: u32,
    tint: [u8; 4],
    lamps: u32,
}

impl Lists {
    /// Of the second of two firings; of each the scene and the sensor's pose.
    pub fn of([before, now]: [&Scene; 2], poses: &[Isometry3<f64>; 2], lens: &Intrinsics) -> Lists {
        let [camera_before, camera] = poses.map(|pose| pose * sensor_from_camera());
        let turn = camera_before.rotation.inverse() * camera.rotation;
        let view = ViewData {
            lens_px: lens.as_array().map(|x| x as f32),
            size_px: [lens.width_px as f32, lens.height_px as f32],
            near_m: 0.1,
            sky_depth_m: f32::INFINITY,
            world_from_camera: rows(&camera),
            previous_from_camera: rows(&Isometry3::from_parts(Default::default(), turn)),
            turned: 1.0,
            ..bytemuck::Zeroable::zeroed()
        };
        let mut lists = Lists {
            view,
            vertices: Vec::new(),
            indices: Vec::new(),
            instances: Vec::new(),
            draws: Vec::new(),
        };
        let mut add = |mesh: MeshId, pose: &Isometry3<f64>, then: &Isometry3<f64>, marks: Marks| {
            let mesh = now.assets.mesh(mesh);
            let n_before = lists.draws.last();
            let first_triangle = n_before.map_or(0, |draw| draw.first_triangle + draw.n_triangles);
            let first_idx = lists.indices.len() as u32;
            // Meshes may hold coarser levels behind the finest.
            let finest = mesh.lods.first().map(|lod| {
                let first = lod.first_idx as usize;
                first..first + lod.n_indices as usize
            });
            let indices = &mesh.indices[finest.unwrap_or(0..mesh.indices.len())];
            lists.draws.push(RasterDraw {
                first_triangle,
                n_triangles: indices.len() as u32 / 3,
                first_idx,
                base_vertex: lists.vertices.len() as u32,
                instance: lists.instances.len() as u32,
                view: 0,
                first_chunk: 0,
                rest: 0,
            });
            lists.indices.extend(indices);
            lists.vertices.extend(&mesh.vertices);
            let q = pose.rotation.coords;
            lists.instances.push(InstanceData {
                camera_from_mesh: rows(&(camera.inverse() * pose)),
                previous_from_camera: rows(
                    &(camera_before.inverse() * then * pose.inverse() * camera),
                ),
                world_from_mesh_xyzw: [q.x, q.y, q.z, q.w].map(|x| x as f32),
                object_id: marks.object_id,
                tint: marks.tint,
                lamps: marks.lamps,
                moved: 1,
            });
        };
        for instance in &now.assets.statics {
            let pose = &instance.world_from_mesh;
            let marks = Marks {
                object_id: instance.object.0,
                tint: [0; 4],
                lamps: 0,
            };
            add(instance.mesh, pose, pose, marks);
        }
        for (instance, then) in now.dynamics.iter().zip(&before.dynamics) {
            let [r, g, b] = instance.tint_rgb;
            let marks = Marks {
                object_id: instance.actor.0,
                tint: [r, g, b, 255],
                lamps: instance.lamps,
            };
            add(
                instance.mesh,
                &instance.world_from_mesh,
                &then.world_from_mesh,
                marks,
            );
        }
        lists
    }

    pub fn input(&self) -> TileInput<'_> {
        TileInput {
            vertices: &self.vertices,
            indices: &self.indices,
            instances: &self.instances,
            draws: &self.draws,
        }
    }

    pub fn exact_images(&self) -> TileImages {
        exact_images(&self.view, &self.input())
    }
}
