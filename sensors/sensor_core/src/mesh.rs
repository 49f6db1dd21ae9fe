//! Triangle meshes as sensors see them: cameras and rays read the same triangles.

use bytemuck::{Pod, Zeroable};
use schema_types::{Class, ObjectId};

/// How a surface reflects light. Colour only; labels, depth and flow do not depend on it.
#[repr(u8)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Material {
    /// Plain diffuse vertex colour.
    Matte = 0,
    /// Road surface: fine noise, wear, wet darkening.
    Asphalt = 1,
    /// Pavement slabs and kerbs.
    Concrete = 2,
    /// Road paint.
    Paint = 3,
    /// Wall with a procedural grid of windows; `Vertex::uv_m` runs along and up the facade in
    /// metres.
    Facade = 4,
    /// Shop front: large panes at street level; `uv_m` as for `Facade`.
    ShopFront = 5,
    /// Roof felt, tiles.
    Roof = 6,
    /// Leaves: two-sided, soft light, noise.
    Foliage = 7,
    /// Bark.
    Bark = 8,
    /// Grass, earth.
    Grass = 9,
    /// Car paint: glossy; takes the instance's tint.
    CarPaint = 10,
    /// Window glass of vehicles and houses: dark, mirrors the sky.
    Glass = 11,
    /// Bare metal, chrome, poles.
    Metal = 12,
    /// Rubber, dark plastic.
    Rubber = 13,
    /// A lamp: shines in its vertex colour if `DynamicInstance::lamps` has the bit `Vertex::lamp`,
    /// else it is dark.
    Lamp = 14,
    /// Skin and cloth.
    Cloth = 15,
    /// Water.
    Water = 16,
}

/// One corner of a triangle, 36 bytes. Triangles of different class or object share no vertices, so
/// that labels are flat.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct Vertex {
    /// Position in the mesh's space, metres.
    pub position_m: [f32; 3],
    /// Unit normal, signed normalised (127 is 1); w unused.
    pub normal: [i8; 4],
    /// Albedo R G B, sRGB; A unused (255).
    pub color: [u8; 4],
    /// Class number, [`Material`] number, lamp bit index (`Lamp` only), 0.
    pub class: u8,
    /// [`Material`] number.
    pub material: u8,
    /// Bit index into `DynamicInstance::lamps` (material `Lamp` only).
    pub lamp: u8,
    /// Zero.
    pub reserved: u8,
    /// Object shown; 0 stands for the object of the instance.
    pub object_id: u32,
    /// Surface coordinates, metres (facades: along, up; roads: along, across).
    pub uv_m: [f32; 2],
}
const _: () = assert!(size_of::<Vertex>() == 36);

/// One level of detail: a range of `Mesh::indices`, used while the mesh is nearer than `until_m`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Lod {
    /// First index.
    pub first_idx: u32,
    /// Number of indices, a multiple of 3.
    pub n_indices: u32,
    /// Distance from the eye to the mesh's bounding sphere up to which this level is drawn;
    /// `f32::INFINITY` for the last. Beyond the last level's distance nothing is drawn. Rays always
    /// use level 0.
    pub until_m: f32,
}

/// Triangles with levels of detail. Front faces are counter-clockwise seen from outside.
#[derive(Clone, Debug, Default)]
pub struct Mesh {
    /// Name for messages and labels.
    pub name: String,
    /// Corners.
    pub vertices: Vec<Vertex>,
    /// Three per triangle.
    pub indices: Vec<u32>,
    /// Finest first; never empty in a finished mesh.
    pub lods: Vec<Lod>,
    /// Centre of the bounding sphere, mesh space, metres.
    pub centre_m: [f32; 3],
    /// Radius of the bounding sphere, metres.
    pub radius_m: f32,
}

impl Mesh {
    /// Triangles of the finest level as corner positions with the first corner's vertex (labels are
    /// flat).
    pub fn triangles(&self) -> impl Iterator<Item = ([[f32; 3]; 3], &Vertex)> {
        let lod = self.lods.first().copied().unwrap_or(Lod {
            first_idx: 0,
            n_indices: 0,
            until_m: 0.0,
        });
        let range = lod.first_idx as usize..(lod.first_idx + lod.n_indices) as usize;
        self.indices[range].chunks_exact(3).map(|t| {
            let corner = |i: usize| &self.vertices[t[i] as usize];
            (
                [
                    corner(0).position_m,
                    corner(1).position_m,
                    corner(2).position_m,
                ],
                corner(0),
            )
        })
    }

    /// Corners of triangle `number` of the finest level.
    #[inline]
    pub fn triangle(&self, number: usize) -> [&Vertex; 3] {
        let first = self.lods[0].first_idx as usize + 3 * number;
        [0, 1, 2].map(|i| &self.vertices[self.indices[first + i] as usize])
    }

    /// The same mesh with only those triangles whose first corner passes, in all levels of detail.
    /// Vertices stay.
    pub fn keeping(&self, mut passes: impl FnMut(&Vertex) -> bool) -> Mesh {
        let mut kept = Mesh {
            indices: Vec::with_capacity(self.indices.len()),
            lods: Vec::new(),
            ..self.clone()
        };
        kept.indices.clear();
        for lod in &self.lods {
            let first_idx = kept.indices.len() as u32;
            let range = lod.first_idx as usize..(lod.first_idx + lod.n_indices) as usize;
            for triangle in self.indices[range].chunks_exact(3) {
                if passes(&self.vertices[triangle[0] as usize]) {
                    kept.indices.extend(triangle);
                }
            }
            kept.lods.push(Lod {
                first_idx,
                n_indices: kept.indices.len() as u32 - first_idx,
                until_m: lod.until_m,
            });
        }
        kept
    }

    /// Number of triangles of the finest level.
    pub fn n_triangles(&self) -> usize {
        self.lods
            .first()
            .map_or(0, |lod| lod.n_indices as usize / 3)
    }
}

/// Surface properties for triangles that a [`MeshBuilder`] adds next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Surface {
    /// Semantic class.
    pub class: Class,
    /// Material.
    pub material: Material,
    /// Albedo, sRGB.
    pub rgb: [u8; 3],
    /// Object shown; background (0) takes the instance's id.
    pub object: ObjectId,
    /// Lamp bit (material `Lamp` only).
    pub lamp: u8,
}

impl Surface {
    /// A surface that takes the instance's id.
    pub fn new(class: Class, material: Material, rgb: [u8; 3]) -> Self {
        Surface {
            class,
            material,
            rgb,
            object: ObjectId::BACKGROUND,
            lamp: 0,
        }
    }

    /// The same with an object id of its own.
    pub fn of(self, object: ObjectId) -> Self {
        Surface { object, ..self }
    }

    /// A lamp: `rgb` shines when the instance's lamp bit is set.
    pub fn lamp(class: Class, rgb: [u8; 3], bit: u8) -> Self {
        Surface {
            class,
            material: Material::Lamp,
            rgb,
            object: ObjectId::BACKGROUND,
            lamp: bit,
        }
    }
}

/// Collects triangles level by level.
#[derive(Clone, Debug, Default)]
pub struct MeshBuilder {
    mesh: Mesh,
    level_first_idx: u32,
}

impl MeshBuilder {
    /// An empty mesh.
    pub fn new(name: impl Into<String>) -> Self {
        MeshBuilder {
            mesh: Mesh {
                name: name.into(),
                ..Default::default()
            },
            level_first_idx: 0,
        }
    }

    /// Adds one triangle, counter-clockwise from outside; the normal is the face's.
    pub fn triangle(&mut self, surface: Surface, corners_m: [[f32; 3]; 3]) {
        self.polygon(surface, &corners_m, &[[0.0; 2]; 3]);
    }

    /// Adds a convex polygon as a fan, counter-clockwise from outside, with surface coordinates per
    /// corner. Where the corners do not lie in one plane, each triangle has its own normal.
    pub fn polygon(&mut self, surface: Surface, corners_m: &[[f32; 3]], uv_m: &[[f32; 2]]) {
        assert_eq!(
            corners_m.len(),
            uv_m.len(),
            "one surface coordinate per corner"
        );
        let normal = newell_normal(corners_m);
        let fan = |i: usize| [corners_m[0], corners_m[i], corners_m[i + 1]];
        let is_flat = corners_m.len() <= 3
            || (1..corners_m.len() - 1).all(|i| {
                is_sliver(&fan(i)) || cosine(&newell_normal(&fan(i)), &normal) > FLAT_COSINE
            });
        if is_flat {
            self.polygon_with_normals(surface, corners_m, &vec![normal; corners_m.len()], uv_m);
            return;
        }
        for i in (1..corners_m.len() - 1).filter(|i| !is_sliver(&fan(*i))) {
            let corners = fan(i);
            self.polygon_with_normals(
                surface,
                &corners,
                &[newell_normal(&corners); 3],
                &[uv_m[0], uv_m[i], uv_m[i + 1]],
            );
        }
    }

    /// As [`MeshBuilder::polygon`] with a unit normal per corner, for rounded shapes.
    pub fn polygon_with_normals(
        &mut self,
        surface: Surface,
        corners_m: &[[f32; 3]],
        normals: &[[f32; 3]],
        uv_m: &[[f32; 2]],
    ) {
        let base = self.mesh.vertices.len() as u32;
        for ((position_m, normal), uv_m) in corners_m.iter().zip(normals).zip(uv_m) {
            let snorm = |x: f32| (x.clamp(-1.0, 1.0) * 127.0).round() as i8;
            self.mesh.vertices.push(Vertex {
                position_m: *position_m,
                normal: [snorm(normal[0]), snorm(normal[1]), snorm(normal[2]), 0],
                color: [surface.rgb[0], surface.rgb[1], surface.rgb[2], 255],
                class: surface.class.0,
                material: surface.material as u8,
                lamp: surface.lamp,
                reserved: 0,
                object_id: surface.object.0,
                uv_m: *uv_m,
            });
        }
        for i in 1..corners_m.len().saturating_sub(1) as u32 {
            self.mesh.indices.extend([base, base + i, base + i + 1]);
        }
    }

    /// Adds a quad whose corners run counter-clockwise from outside.
    pub fn quad(&mut self, surface: Surface, corners_m: [[f32; 3]; 4], uv_m: [[f32; 2]; 4]) {
        self.polygon(surface, &corners_m, &uv_m);
    }

    /// Adds an axis-aligned box (six faces).
    pub fn cuboid(&mut self, surface: Surface, centre_m: [f32; 3], half_m: [f32; 3]) {
        let at = |sx: f32, sy: f32, sz: f32| {
            [
                centre_m[0] + sx * half_m[0],
                centre_m[1] + sy * half_m[1],
                centre_m[2] + sz * half_m[2],
            ]
        };
        let (w, d, h) = (2.0 * half_m[0], 2.0 * half_m[1], 2.0 * half_m[2]);
        let uv = |a: f32, b: f32| [[0.0, 0.0], [a, 0.0], [a, b], [0.0, b]];
        self.quad(
            surface,
            [
                at(1., -1., -1.),
                at(1., 1., -1.),
                at(1., 1., 1.),
                at(1., -1., 1.),
            ],
            uv(d, h),
        );
        self.quad(
            surface,
            [
                at(-1., 1., -1.),
                at(-1., -1., -1.),
                at(-1., -1., 1.),
                at(-1., 1., 1.),
            ],
            uv(d, h),
        );
        self.quad(
            surface,
            [
                at(1., 1., -1.),
                at(-1., 1., -1.),
                at(-1., 1., 1.),
                at(1., 1., 1.),
            ],
            uv(w, h),
        );
        self.quad(
            surface,
            [
                at(-1., -1., -1.),
                at(1., -1., -1.),
                at(1., -1., 1.),
                at(-1., -1., 1.),
            ],
            uv(w, h),
        );
        self.quad(
            surface,
            [
                at(-1., -1., 1.),
                at(1., -1., 1.),
                at(1., 1., 1.),
                at(-1., 1., 1.),
            ],
            uv(w, d),
        );
        self.quad(
            surface,
            [
                at(-1., 1., -1.),
                at(1., 1., -1.),
                at(1., -1., -1.),
                at(-1., -1., -1.),
            ],
            uv(w, d),
        );
    }

    /// Ends the current level of detail: what was added since the last call is drawn up to
    /// `until_m`.
    pub fn end_level(&mut self, until_m: f32) {
        let n_indices = self.mesh.indices.len() as u32 - self.level_first_idx;
        self.mesh.lods.push(Lod {
            first_idx: self.level_first_idx,
            n_indices,
            until_m,
        });
        self.level_first_idx = self.mesh.indices.len() as u32;
    }

    /// Number of triangles so far, all levels.
    pub fn n_triangles(&self) -> usize {
        self.mesh.indices.len() / 3
    }

    /// Finishes: a level still open is drawn at any distance; the bounding sphere is computed.
    pub fn finish(mut self) -> Mesh {
        if self.mesh.lods.is_empty() || self.mesh.indices.len() as u32 > self.level_first_idx {
            self.end_level(f32::INFINITY);
        }
        let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
        for vertex in &self.mesh.vertices {
            for axis in 0..3 {
                low[axis] = low[axis].min(vertex.position_m[axis]);
                high[axis] = high[axis].max(vertex.position_m[axis]);
            }
        }
        if !self.mesh.vertices.is_empty() {
            let centre: [f32; 3] = std::array::from_fn(|axis| 0.5 * (low[axis] + high[axis]));
            let distance2 = |v: &Vertex| {
                (0..3)
                    .map(|axis| (v.position_m[axis] - centre[axis]).powi(2))
                    .sum::<f32>()
            };
            self.mesh.centre_m = centre;
            self.mesh.radius_m = self
                .mesh
                .vertices
                .iter()
                .map(distance2)
                .fold(0.0, f32::max)
                .sqrt();
        }
        self.mesh
    }
}

/// Cosine of the angle, 0.1°, up to which a triangle lies in the plane of its polygon.
const FLAT_COSINE: f32 = 0.999_998_5;

fn cosine(a: &[f32; 3], b: &[f32; 3]) -> f32 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Whether a triangle is so thin, under a tenth of a millimetre, that its normal says nothing.
fn is_sliver([a, b, c]: &[[f32; 3]; 3]) -> bool {
    let side =
        |p: &[f32; 3], q: &[f32; 3]| nalgebra::Vector3::from(*q) - nalgebra::Vector3::from(*p);
    let (ab, ac, bc) = (side(a, b), side(a, c), side(b, c));
    ab.cross(&ac).norm() < 1e-4 * ab.norm().max(ac.norm()).max(bc.norm())
}

/// Newell's method: robust for nearly degenerate polygons; +z for a polygon without area.
fn newell_normal(corners_m: &[[f32; 3]]) -> [f32; 3] {
    let mut n = [0.0f32; 3];
    for (i, a) in corners_m.iter().enumerate() {
        let b = corners_m[(i + 1) % corners_m.len()];
        n[0] += (a[1] - b[1]) * (a[2] + b[2]);
        n[1] += (a[2] - b[2]) * (a[0] + b[0]);
        n[2] += (a[0] - b[0]) * (a[1] + b[1]);
    }
    let length = (n[0] * n[0] + n[1] * n[1] + n[2] * n[2]).sqrt();
    if length > 0.0 {
        n.map(|x| x / length)
    } else {
        [0.0, 0.0, 1.0]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bent_quad_has_the_normals_of_its_triangles_and_a_flat_one_has_four_corners() {
        let surface = Surface::new(Class::STATIC, Material::Matte, [200; 3]);
        for (rise_m, n_vertices) in [(0.0, 4), (0.4, 6)] {
            let mut builder = MeshBuilder::new("quad");
            builder.quad(
                surface,
                [
                    [0.0; 3],
                    [2.0, 0.0, 0.0],
                    [2.0, 1.0, rise_m],
                    [0.0, 1.0, 0.0],
                ],
                [[0.0; 2]; 4],
            );
            let mesh = builder.finish();
            assert_eq!((mesh.n_triangles(), mesh.vertices.len()), (2, n_vertices));
            for ([a, b, c], vertex) in mesh.triangles() {
                let [a, b, c] = [a, b, c].map(nalgebra::Vector3::from);
                let face = (b - a).cross(&(c - a)).normalize();
                let stored =
                    nalgebra::Vector3::new(vertex.normal[0], vertex.normal[1], vertex.normal[2])
                        .cast::<f32>()
                        .normalize();
                assert!(face.angle(&stored).to_degrees() < 0.5, "{face} {stored}");
            }
        }
    }

    #[test]
    fn cuboid_faces_point_outwards() {
        let mut builder = MeshBuilder::new("box");
        builder.cuboid(
            Surface::new(Class::STATIC, Material::Matte, [200; 3]),
            [1.0, 2.0, 3.0],
            [0.5, 1.0, 2.0],
        );
        let mesh = builder.finish();
        assert_eq!(mesh.n_triangles(), 12);
        for (corners, vertex) in mesh.triangles() {
            let centroid: [f32; 3] = std::array::from_fn(|axis| {
                (corners[0][axis] + corners[1][axis] + corners[2][axis]) / 3.0
            });
            let outwards: f32 = (0..3)
                .map(|axis| (centroid[axis] - [1.0, 2.0, 3.0][axis]) * vertex.normal[axis] as f32)
                .sum();
            assert!(outwards > 0.0, "{corners:?} {:?}", vertex.normal);
            let face = newell_normal(&corners);
            assert!(
                (0..3)
                    .map(|axis| face[axis] * vertex.normal[axis] as f32)
                    .sum::<f32>()
                    > 126.0
            );
        }
        assert!((mesh.radius_m - (0.25f32 + 1.0 + 4.0).sqrt()).abs() < 1e-5);
    }
}
