//! Vertex and instance attributes of the geometry shader.

use bytemuck::{Pod, Zeroable};

use crate::uniform::{InstanceData, ViewData};
use crate::vertex::{attribute, with_albedo};
use crate::visible::Drawn;

/// The same with the albedo's bytes in one word, and those of [`InstanceAttributes`].
pub(super) const ATTACHED_ATTRIBUTES: [&[wgpu::VertexAttribute]; 2] = [
    &with_albedo(wgpu::VertexFormat::Uint32),
    &[
        attribute(6, 0, wgpu::VertexFormat::Float32x4),
        attribute(7, 16, wgpu::VertexFormat::Float32x4),
        attribute(8, 32, wgpu::VertexFormat::Float32x4),
        attribute(9, 48, wgpu::VertexFormat::Float32x4),
        attribute(10, 64, wgpu::VertexFormat::Float32x4),
        attribute(11, 80, wgpu::VertexFormat::Float32x4),
        attribute(12, 96, wgpu::VertexFormat::Float32x4),
        attribute(13, 112, wgpu::VertexFormat::Uint32x4),
    ],
];

/// Mirror of the instance attributes of `Vertex` in `shader/geometry_attached.wgsl`.
#[repr(C)]
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
pub(super) struct InstanceAttributes {
    /// Mesh space to clip space, metres: rows of x, y, w.
    clip_from_mesh: [[f32; 4]; 3],
    /// (x · depth, y · depth, depth, 1) of a pixel to the same at the previous firing: rows of x,
    /// y, depth. If nothing moved, it gives a depth of -1, which no pixel has.
    before_from_pixel: [[f32; 4]; 3],
    /// Rotation of mesh space to world.
    world_from_mesh_xyzw: [f32; 4],
    object_id: u32,
    tint: [u8; 4],
    lamps: u32,
    focal_px: f32,
}

pub(super) const ATTACHED_BYTES: u64 = size_of::<InstanceAttributes>() as u64;

impl InstanceAttributes {
    fn of(instance: &InstanceData, view: &ViewData) -> InstanceAttributes {
        let InstanceData {
            camera_from_mesh,
            previous_from_camera,
            world_from_mesh_xyzw,
            object_id,
            tint,
            lamps,
            moved,
        } = *instance;
        let [fx, fy, cx, cy] = view.lens_px.map(f64::from);
        let [width, height] = view.size_px.map(f64::from);
        let [x, y, z] = camera_from_mesh.map(|row| row.map(f64::from));
        // Clip space spans -1 to 1 over the image, y upwards.
        let clip_from_mesh = [
            sum([2.0 * fx / width, 2.0 * cx / width - 1.0], [x, z]),
            sum([-2.0 * fy / height, 1.0 - 2.0 * cy / height], [y, z]),
            z,
        ];
        let before_from_pixel = if moved == 0 {
            [[0.0; 4], [0.0; 4], [0.0, 0.0, 0.0, -1.0]]
        } else {
            let [x, y, z] = previous_from_camera.map(|row| row.map(f64::from));
            let taking_pixels =
                |[x, y, z, w]: [f64; 4]| [x / fx, y / fy, z - x * cx / fx - y * cy / fy, w];
            [sum([fx, cx], [x, z]), sum([fy, cy], [y, z]), z].map(taking_pixels)
        };
        let single = |rows: [[f64; 4]; 3]| rows.map(|row| row.map(|x| x as f32));
        InstanceAttributes {
            clip_from_mesh: single(clip_from_mesh),
            before_from_pixel: single(before_from_pixel),
            world_from_mesh_xyzw,
            object_id,
            tint,
            lamps,
            focal_px: view.lens_px[0],
        }
    }

    /// The attributes of all views in the order of `Drawn::first_instance`.
    pub fn of_all(views: &[ViewData], drawn: &[&Drawn]) -> Vec<InstanceAttributes> {
        let views = views.iter().zip(drawn);
        views
            .flat_map(|(view, drawn)| {
                drawn
                    .instances
                    .iter()
                    .map(move |instance| InstanceAttributes::of(instance, view))
            })
            .collect()
    }
}

fn sum(factors: [f64; 2], rows: [[f64; 4]; 2]) -> [f64; 4] {
    std::array::from_fn(|i| factors[0] * rows[0][i] + factors[1] * rows[1][i])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn apply(rows: &[[f32; 4]; 3], p: [f64; 4]) -> [f64; 3] {
        rows.map(|row| row.iter().zip(p).map(|(a, b)| f64::from(*a) * b).sum())
    }

    /// Oracle: the pinhole camera, forwards to pixels and back.
    #[test]
    fn attributes_are_the_instance_behind_the_lens() {
        let [fx, fy, cx, cy] = [410.0f32, 395.0, 402.5, 297.25];
        let mut view: ViewData = Zeroable::zeroed();
        (view.lens_px, view.size_px) = ([fx, fy, cx, cy], [800.0, 600.0]);
        let mut rng = fastrand::Rng::with_seed(5);
        let mut row = || std::array::from_fn::<f32, 4, _>(|_| rng.f32() * 2.0 - 1.0);
        let mut instance: InstanceData = Zeroable::zeroed();
        instance.camera_from_mesh = [row(), row(), row()];
        instance.previous_from_camera = [
            [1.0, 0.02, -0.01, 0.3],
            [-0.02, 1.0, 0.03, -0.2],
            [0.01, -0.03, 1.0, 0.5],
        ];
        instance.moved = 1;
        let attributes = InstanceAttributes::of(&instance, &view);
        let [fx, fy, cx, cy] = [fx, fy, cx, cy].map(f64::from);
        let pixel = |[x, y, z]: [f64; 3]| [cx + fx * x / z, cy + fy * y / z];
        for p in [[0.3, -0.2, 4.0], [2.0, 1.0, 0.5], [-7.0, 3.0, 11.0]] {
            let [x, y, z] = apply(&instance.camera_from_mesh, [p[0], p[1], p[2], 1.0]);
            let clip = apply(&attributes.clip_from_mesh, [p[0], p[1], p[2], 1.0]);
            assert!((clip[2] - z).abs() < 1e-5);
            let [u, v] = pixel([x, y, z]);
            let seen = [
                (clip[0] / clip[2] + 1.0) * 400.0,
                (1.0 - clip[1] / clip[2]) * 300.0,
            ];
            assert!(
                (seen[0] - u).abs() < 1e-3 * u.abs().max(1.0)
                    && (seen[1] - v).abs() < 1e-3 * v.abs().max(1.0),
                "{seen:?}: {u}, {v}"
            );
            // The same numbers as a point in camera space, at the previous tick.
            let [u, v] = pixel(p);
            let before = apply(&instance.previous_from_camera, [p[0], p[1], p[2], 1.0]);
            let [x, y, depth] = apply(
                &attributes.before_from_pixel,
                [u * p[2], v * p[2], p[2], 1.0],
            );
            let expected = pixel(before);
            assert!((depth - before[2]).abs() < 1e-5);
            assert!(
                (x / depth - expected[0]).abs() < 2e-3 && (y / depth - expected[1]).abs() < 2e-3,
                "{expected:?}"
            );
        }
        instance.moved = 0;
        let still = InstanceAttributes::of(&instance, &view);
        assert!(
            apply(
                &still.before_from_pixel,
                [800.0 * 1e6, 600.0 * 1e6, 1e6, 1.0]
            )[2] < 0.0
        );
    }
}
