//! The episode's meshes on the GPU: one vertex buffer, one index buffer.

use std::sync::Arc;

use sensor_core::{SceneAssets, StaticInstance, Vertex};
use sensor_gpu::Gpu;

use super::mesh_draw::{matrix_rows, quaternion};
use super::meshes::Meshes;
use super::switched;
use crate::uniform::StillData;

/// Uploaded meshes of one episode.
#[derive(Debug)]
pub(crate) struct GpuAssets {
    pub meshes: Meshes,
    pub vertices: wgpu::Buffer,
    pub indices: wgpu::Buffer,
    /// How lamps are switched, for shaders.
    pub switched: wgpu::Buffer,
    /// Poses of static instances, where shaders have `f64` and there are some.
    pub stills: Option<wgpu::Buffer>,
}

impl GpuAssets {
    pub fn upload(gpu: &Gpu, scene_assets: &Arc<SceneAssets>) -> Self {
        let (meshes, (vertices, indices)) = Meshes::of(scene_assets);
        GpuAssets {
            meshes,
            vertices: gpu.buffer_with(
                "vertices",
                bytemuck::cast_slice(&vertices),
                wgpu::BufferUsages::VERTEX | wgpu::BufferUsages::STORAGE,
            ),
            indices: gpu.buffer_with(
                "indices",
                bytemuck::cast_slice(&indices),
                wgpu::BufferUsages::INDEX | wgpu::BufferUsages::STORAGE,
            ),
            switched: switched::upload(gpu, scene_assets),
            stills: stills(gpu, scene_assets),
        }
    }

    /// Takes over assets of the same episode that show more or fewer triangles of the same meshes.
    /// Returns the uploaded bytes, which are the indices of the meshes that changed. Returns
    /// `None`, and takes over nothing, if the meshes are others or need more room.
    pub fn take_over(&mut self, gpu: &Gpu, other: &Arc<SceneAssets>) -> Option<u64> {
        let known = &self.meshes.scene_assets;
        if known.episode != other.episode || known.meshes.len() != other.meshes.len() {
            return None;
        }
        let pairs = known.meshes.iter().zip(&other.meshes);
        let changed: Vec<usize> = pairs
            .enumerate()
            .filter(|(_, (a, b))| !Arc::ptr_eq(a, b))
            .map(|(i, _)| i)
            .collect();
        let fits = |i: &usize| {
            let (old, new) = (&known.meshes[*i], &other.meshes[*i]);
            new.indices.len() <= self.meshes.ranges[*i].n_places as usize
                && old.vertices == new.vertices
        };
        let mut n_bytes = 0;
        if !changed.iter().all(fits) {
            n_bytes = self.exchange(gpu, other, &changed)?;
            return Some(self.shows(gpu, other, n_bytes));
        }
        for i in changed {
            let mesh = &other.meshes[i];
            let bytes: &[u8] = bytemuck::cast_slice(&mesh.indices);
            gpu.queue().write_buffer(
                &self.indices,
                4 * self.meshes.ranges[i].first_idx as u64,
                bytes,
            );
            n_bytes += bytes.len() as u64;
            self.meshes.replace(i, mesh);
        }
        Some(self.shows(gpu, other, n_bytes))
    }

    /// Takes over where the instances of `other`, whose meshes are uploaded, stand.
    fn shows(&mut self, gpu: &Gpu, other: &Arc<SceneAssets>, n_bytes: u64) -> u64 {
        self.meshes.shows(other);
        self.switched = switched::upload(gpu, other);
        self.stills = stills(gpu, other);
        n_bytes
    }

    /// Puts streamed meshes in the place of others and returns the uploaded bytes; `None`, with
    /// nothing usable left, if there is no room for them.
    fn exchange(&mut self, gpu: &Gpu, other: &SceneAssets, changed: &[usize]) -> Option<u64> {
        if !other.streamed {
            return None;
        }
        for i in changed {
            self.meshes.give_back(*i);
        }
        let mut n_bytes = 0;
        for i in changed {
            let mesh = &other.meshes[*i];
            let place = self.meshes.place(*i, mesh)?;
            let vertices: &[u8] = bytemuck::cast_slice(&mesh.vertices);
            let indices: &[u8] = bytemuck::cast_slice(&mesh.indices);
            let at = place.base_vertex as u64 * size_of::<Vertex>() as u64;
            gpu.queue().write_buffer(&self.vertices, at, vertices);
            gpu.queue()
                .write_buffer(&self.indices, 4 * u64::from(place.first_idx), indices);
            n_bytes += (vertices.len() + indices.len()) as u64;
        }
        Some(n_bytes)
    }

    /// Bytes of meshes on the GPU.
    pub fn n_bytes(&self) -> u64 {
        self.vertices.size() + self.indices.size()
    }

    /// Takes over how the lamps of `other`, which shows the same meshes, are switched.
    pub fn switch_lamps(&mut self, gpu: &Gpu, other: &Arc<SceneAssets>) {
        self.meshes.switch_lamps(other);
        self.switched = switched::upload(gpu, other);
    }
}

/// Poses of static instances for shaders; `None` if there are none, or shaders have no `f64`.
fn stills(gpu: &Gpu, assets: &SceneAssets) -> Option<wgpu::Buffer> {
    if !gpu.has_wide_numbers() || assets.statics.is_empty() {
        return None;
    }
    let of = |instance: &StaticInstance| StillData {
        world_from_mesh: matrix_rows(&instance.world_from_mesh),
        world_from_mesh_xyzw: quaternion(&instance.world_from_mesh),
        object_id: instance.object.0,
        rest: [0; 3],
    };
    let all: Vec<StillData> = assets.statics.iter().map(of).collect();
    let bytes = bytemuck::cast_slice(&all);
    Some(gpu.buffer_with("stills", bytes, wgpu::BufferUsages::STORAGE))
}
