//! Props: a few parametric families of shapes that fill their box.

use schema_types::Class;
use sensor_core::mesh::Surface;
use sensor_core::{Material, Mesh, MeshBuilder};

use crate::solid::{ellipsoid, tube};
use crate::stack::{Ring, stack};

/// Family of a prop's shape.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum PropStyle {
    /// A box with edges: cartons, kiosks, machines, advertising pillars.
    Crate,
    /// Traffic cone on a foot.
    Cone,
    /// Barrel, can, bottle: a standing cylinder with rings.
    Barrel,
    /// Round or square bin with a lid.
    Bin,
    /// Bench with a back.
    Bench,
    /// Chair with a back and arms.
    Chair,
    /// Table on legs.
    Table,
    /// Barrier of boards on two feet.
    Barrier,
    /// Sign on a pole.
    Sign,
    /// Warning board that stands on the ground.
    Board,
    /// Pot with a plant.
    Plant,
    /// Trunk with a crown.
    Tree,
    /// Soft bag, filled.
    Bag,
    /// Rubble: flat pieces.
    Debris,
    /// Skip or freight container with ribs.
    Container,
    /// Roof on posts: bus stop, pergola, swing.
    Shelter,
    /// Pole with a lamp on top.
    Lamp,
    /// Basin with a jet.
    Fountain,
    /// Trolley or cart on wheels.
    Cart,
    /// Ball-like: helmet, gnome's hat, ball.
    Round,
    /// Flat plate: plank, trampoline's sheet, mesh, tile.
    Plate,
}

/// Measures and colours of a prop. Its origin is on the ground in the middle; x forward, y left, z
/// up.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PropShape {
    /// Family.
    pub style: PropStyle,
    /// Half extents, metres; the box stands on the ground.
    pub half_m: [f64; 3],
    /// Main colour, sRGB.
    pub rgb: [u8; 3],
    /// Second colour, sRGB.
    pub accent_rgb: [u8; 3],
    /// Semantic class.
    pub class: Class,
}

/// Distance up to which the fine level is drawn, metres.
const NEAR_M: f32 = 30.0;

/// Adds pieces of a prop, measured in shares of its box.
struct Pieces<'b> {
    builder: &'b mut MeshBuilder,
    half: [f32; 3],
    class: Class,
    main: [u8; 3],
    accent: [u8; 3],
}

impl Pieces<'_> {
    fn surface(&self, material: Material, rgb: [u8; 3]) -> Surface {
        Surface::new(self.class, material, rgb)
    }

    fn height(&self) -> f32 {
        2.0 * self.half[2]
    }

    /// A box from shares of the half extents: middle and half size, heights as shares of the whole
    /// height.
    fn block(&mut self, material: Material, rgb: [u8; 3], middle: [f32; 3], half: [f32; 3]) {
        let [x, y, z] = self.half;
        let surface = self.surface(material, rgb);
        let centre_m = [middle[0] * x, middle[1] * y, middle[2] * 2.0 * z];
        self.builder.cuboid(
            surface,
            centre_m,
            [half[0] * x, half[1] * y, half[2] * 2.0 * z],
        );
    }

    /// A turned body: (height, width) as shares of the height and the half extents, with the
    /// material of the band above.
    fn turned(&mut self, n: usize, profile: &[(f32, f32, Material, [u8; 3])]) {
        let [x, y, _] = self.half;
        let height = self.height();
        let rings: Vec<Ring> = profile
            .iter()
            .map(|(z, w, ..)| Ring {
                z_m: z * height,
                x_m: 0.0,
                half_x_m: w * x,
                half_y_m: w * y,
            })
            .collect();
        let class = self.class;
        stack(self.builder, &rings, n, |i| {
            Surface::new(class, profile[i].2, profile[i].3)
        });
    }

    /// A round bar between two points in shares of the box.
    fn bar(
        &mut self,
        material: Material,
        rgb: [u8; 3],
        from: [f32; 3],
        to: [f32; 3],
        radius_m: f32,
        n: usize,
    ) {
        let [x, y, z] = self.half;
        let at = |p: [f32; 3]| [p[0] * x, p[1] * y, p[2] * 2.0 * z];
        let surface = self.surface(material, rgb);
        tube(
            self.builder,
            surface,
            (at(from), radius_m),
            (at(to), radius_m),
            n,
        );
    }

    fn blob(
        &mut self,
        material: Material,
        rgb: [u8; 3],
        middle: [f32; 3],
        half: [f32; 3],
        n: usize,
    ) {
        let [x, y, z] = self.half;
        let surface = self.surface(material, rgb);
        ellipsoid(
            self.builder,
            surface,
            [middle[0] * x, middle[1] * y, middle[2] * 2.0 * z],
            [half[0] * x, half[1] * y, half[2] * 2.0 * z],
            n,
        );
    }

    fn thin_m(&self) -> f32 {
        (0.06 * self.half[0].min(self.half[1])).clamp(0.004, 0.03)
    }
}

/// Builds the mesh for a shape; it fits its box to 1 cm.
pub fn prop_mesh(shape: &PropShape) -> Mesh {
    let mut builder = MeshBuilder::new(format!("prop {:?}", shape.style).to_lowercase());
    for (n, until_m) in [(12, NEAR_M), (8, f32::INFINITY)] {
        let half = shape.half_m.map(|x| x as f32);
        let mut pieces = Pieces {
            builder: &mut builder,
            half,
            class: shape.class,
            main: shape.rgb,
            accent: shape.accent_rgb,
        };
        build(&mut pieces, shape.style, n);
        builder.end_level(until_m);
    }
    builder.finish()
}

fn build(pieces: &mut Pieces<'_>, style: PropStyle, n: usize) {
    use Material::{Bark, Cloth, Concrete, Foliage, Glass, Lamp, Matte, Metal, Rubber, Water};
    let (main, accent) = (pieces.main, pieces.accent);
    let dark = main.map(|c| (f32::from(c) * 0.7) as u8);
    let thin = pieces.thin_m();
    match style {
        PropStyle::Crate => {
            pieces.block(Matte, main, [0.0, 0.0, 0.5], [0.985, 0.985, 0.5]);
            pieces.block(Matte, accent, [0.0, 0.0, 0.62], [1.0, 0.80, 0.22]);
            pieces.block(Matte, dark, [0.0, 0.0, 0.03], [1.0, 1.0, 0.03]);
            pieces.block(Matte, dark, [0.0, 0.0, 0.98], [1.0, 1.0, 0.02]);
        }
        PropStyle::Cone => {
            pieces.block(Rubber, [36, 36, 38], [0.0, 0.0, 0.025], [1.0, 1.0, 0.025]);
            let (o, w) = ((Matte, main), (Matte, accent));
            let rows = [
                (0.05, 0.78, o),
                (0.36, 0.56, w),
                (0.52, 0.45, o),
                (0.66, 0.36, w),
                (0.78, 0.28, o),
                (1.0, 0.12, o),
            ];
            pieces.turned(
                n,
                &rows.map(|(z, w, (material, rgb))| (z, w, material, rgb)),
            );
        }
        PropStyle::Barrel => {
            let rows = [
                (0.0, 0.94, main),
                (0.30, 0.97, accent),
                (0.34, 1.0, main),
                (0.64, 0.97, accent),
                (0.68, 1.0, main),
                (0.98, 0.94, dark),
                (1.0, 0.84, dark),
            ];
            pieces.turned(n, &rows.map(|(z, w, rgb)| (z, w, Metal, rgb)));
        }
        PropStyle::Bin => {
            let rows = [
                (0.0, 0.78, main),
                (0.80, 0.96, accent),
                (0.84, 1.0, accent),
                (0.90, 1.0, dark),
                (1.0, 0.55, dark),
            ];
            pieces.turned(n, &rows.map(|(z, w, rgb)| (z, w, Metal, rgb)));
            pieces.block(Matte, [24, 24, 26], [0.80, 0.0, 0.70], [0.14, 0.42, 0.05]);
        }
        PropStyle::Bench => {
            for side in [-0.86, 0.86] {
                pieces.block(Metal, accent, [0.0, side, 0.22], [0.80, 0.04, 0.22]);
                pieces.block(Metal, accent, [-0.86, side, 0.60], [0.10, 0.04, 0.40]);
            }
            for x in [-0.66, -0.26, 0.14, 0.54] {
                pieces.block(Bark, main, [x, 0.0, 0.46], [0.17, 1.0, 0.02]);
            }
            for z in [0.62, 0.78, 0.94] {
                pieces.block(Bark, main, [-0.88, 0.0, z], [0.12, 1.0, 0.06]);
            }
            pieces.block(Metal, accent, [0.90, 0.0, 0.46], [0.10, 0.98, 0.02]);
        }
        PropStyle::Chair => {
            for (x, y) in [(-0.88, -0.88), (-0.88, 0.88), (0.88, -0.88), (0.88, 0.88)] {
                pieces.block(Matte, dark, [x, y, 0.26], [0.12, 0.12, 0.26]);
            }
            pieces.block(Matte, main, [0.0, 0.0, 0.50], [1.0, 1.0, 0.03]);
            pieces.block(Matte, main, [-0.92, 0.0, 0.77], [0.08, 0.96, 0.23]);
            for y in [-0.92, 0.92] {
                pieces.block(Matte, accent, [0.0, y, 0.70], [0.92, 0.08, 0.02]);
                pieces.block(Matte, accent, [0.80, y, 0.60], [0.06, 0.06, 0.10]);
            }
        }
        PropStyle::Table => {
            for (x, y) in [(-0.85, -0.85), (-0.85, 0.85), (0.85, -0.85), (0.85, 0.85)] {
                pieces.block(Metal, accent, [x, y, 0.46], [0.06, 0.06, 0.46]);
            }
            pieces.block(Bark, main, [0.0, 0.0, 0.96], [1.0, 1.0, 0.04]);
        }
        PropStyle::Barrier => {
            for y in [-0.84, 0.84] {
                pieces.block(Rubber, [40, 40, 42], [0.0, y, 0.03], [1.0, 0.10, 0.03]);
                pieces.block(Metal, [150, 152, 156], [0.0, y, 0.5], [0.16, 0.03, 0.5]);
            }
            for z in [0.42, 0.86] {
                for k in 0..8 {
                    let rgb = if k % 2 == 0 { main } else { accent };
                    pieces.block(
                        Matte,
                        rgb,
                        [0.0, -0.875 + 0.25 * k as f32, z],
                        [0.22, 0.125, 0.11],
                    );
                }
            }
            pieces.block(
                Lamp,
                [255, 170, 40],
                [0.0, 0.84, 0.985],
                [0.30, 0.03, 0.015],
            );
        }
        PropStyle::Sign => {
            pieces.bar(
                Metal,
                [150, 152, 156],
                [0.0, 0.0, 0.0],
                [0.0, 0.0, 0.98],
                thin.max(0.02),
                n,
            );
            pieces.block(Metal, main, [0.0, 0.0, 0.84], [0.5, 1.0, 0.16]);
            pieces.block(Matte, accent, [0.55, 0.0, 0.84], [0.45, 0.86, 0.12]);
            pieces.block(Metal, [120, 122, 126], [0.0, 0.0, 0.01], [1.0, 0.3, 0.01]);
        }
        PropStyle::Board => {
            pieces.block(Rubber, [40, 40, 42], [0.0, 0.0, 0.03], [1.0, 0.8, 0.03]);
            pieces.block(Metal, [150, 152, 156], [-0.2, 0.0, 0.3], [0.10, 0.05, 0.3]);
            pieces.block(Matte, accent, [0.0, 0.0, 0.66], [0.22, 1.0, 0.34]);
            pieces.block(Matte, main, [0.18, 0.0, 0.66], [0.10, 0.86, 0.27]);
        }
        PropStyle::Plant => {
            let rows = [
                (0.0, 0.42, Concrete, main),
                (0.28, 0.60, Concrete, dark),
                (0.32, 0.62, Concrete, dark),
                (0.33, 0.50, Bark, [70, 52, 38]),
            ];
            pieces.turned(n, &rows);
            let leaves: [([f32; 3], [f32; 3]); 4] = [
                ([0.0, 0.0, 0.72], [0.72, 0.72, 0.28]),
                ([0.45, 0.2, 0.60], [0.55, 0.5, 0.20]),
                ([-0.40, 0.35, 0.62], [0.60, 0.65, 0.20]),
                ([-0.1, -0.5, 0.58], [0.55, 0.50, 0.20]),
            ];
            for (middle, half) in leaves {
                pieces.blob(Foliage, accent, middle, half, n.max(8));
            }
        }
        PropStyle::Tree => {
            let stem = 0.10;
            let rows = [
                (0.0, 1.5 * stem, Bark, main),
                (0.06, stem, Bark, main),
                (0.55, 0.7 * stem, Bark, main),
                (0.8, 0.3 * stem, Bark, main),
            ];
            pieces.turned(8, &rows);
            for (middle, half) in [
                ([0.0, 0.0, 0.72], [1.0, 1.0, 0.28]),
                ([0.35, 0.3, 0.55], [0.6, 0.6, 0.16]),
                ([-0.35, -0.25, 0.52], [0.62, 0.6, 0.15]),
            ] {
                pieces.blob(Foliage, accent, middle, half, n.max(8));
            }
        }
        PropStyle::Bag => {
            let rows = [
                (0.0, 0.82, main),
                (0.12, 0.98, main),
                (0.40, 1.0, main),
                (0.68, 0.78, main),
                (0.84, 0.30, accent),
                (0.90, 0.16, accent),
                (1.0, 0.28, accent),
            ];
            pieces.turned(n, &rows.map(|(z, w, rgb)| (z, w, Cloth, rgb)));
        }
        PropStyle::Debris => {
            let rubble = [
                (-0.6, -0.5, 0.36, 0.5),
                (0.2, 0.6, 0.5, 0.38),
                (0.55, -0.55, 0.42, 0.44),
                (-0.1, -0.05, 0.6, 0.6),
                (-0.75, 0.7, 0.22, 0.30),
            ];
            for (i, (x, y, a, b)) in rubble.into_iter().enumerate() {
                let top = if i == 3 { 1.0 } else { 0.5 };
                let rgb = if i % 2 == 0 { main } else { accent };
                pieces.block(Concrete, rgb, [x, y, 0.5 * top], [a, b, 0.5 * top]);
            }
            pieces.block(Concrete, main, [0.93, 0.1, 0.1], [0.07, 0.1, 0.1]);
            pieces.block(Concrete, main, [-0.97, 0.0, 0.1], [0.03, 0.1, 0.1]);
            pieces.block(Concrete, accent, [0.0, -0.97, 0.1], [0.1, 0.03, 0.1]);
        }
        PropStyle::Container => {
            pieces.block(Metal, main, [0.0, 0.0, 0.5], [0.97, 0.96, 0.5]);
            for k in 0..9 {
                let x = -0.98 + 0.245 * k as f32;
                pieces.block(Metal, dark, [x, 0.0, 0.5], [0.02, 1.0, 0.48]);
            }
            pieces.block(Metal, accent, [0.98, 0.0, 0.5], [0.02, 0.94, 0.46]);
            pieces.block(Metal, dark, [0.0, 0.0, 0.985], [1.0, 1.0, 0.015]);
            pieces.block(Metal, dark, [0.0, 0.0, 0.02], [1.0, 1.0, 0.02]);
        }
        PropStyle::Shelter => {
            for (x, y) in [(-0.9, -0.9), (-0.9, 0.9), (0.9, -0.9), (0.9, 0.9)] {
                pieces.bar(Metal, accent, [x, y, 0.0], [x, y, 0.96], thin.max(0.03), 8);
            }
            pieces.block(Metal, main, [0.0, 0.0, 0.97], [1.0, 1.0, 0.03]);
            pieces.block(
                Glass,
                [160, 180, 190],
                [-0.9, 0.0, 0.55],
                [0.02, 0.88, 0.35],
            );
            pieces.block(Bark, dark, [-0.45, 0.0, 0.2], [0.3, 0.6, 0.02]);
            pieces.block(Metal, accent, [-0.45, 0.0, 0.09], [0.06, 0.5, 0.09]);
        }
        PropStyle::Lamp => {
            let rows = [
                (0.0, 0.8, dark),
                (0.04, 0.4, main),
                (0.10, 0.22, main),
                (0.72, 0.18, main),
                (0.74, 0.7, dark),
                (0.77, 0.9, dark),
            ];
            pieces.turned(n, &rows.map(|(z, w, rgb)| (z, w, Metal, rgb)));
            let bulb = [
                (0.77, 0.70, Lamp, accent),
                (0.92, 0.92, Lamp, accent),
                (0.93, 0.8, Lamp, accent),
            ];
            pieces.turned(n, &bulb);
            let hat = [
                (0.93, 1.0, Metal, dark),
                (0.95, 1.0, Metal, dark),
                (1.0, 0.1, Metal, dark),
            ];
            pieces.turned(n, &hat);
        }
        PropStyle::Fountain => {
            let basin = [
                (0.0, 0.96, Concrete, main),
                (0.30, 1.0, Concrete, main),
                (0.34, 1.0, Concrete, dark),
                (0.345, 0.86, Water, [60, 110, 130]),
            ];
            pieces.turned(n, &basin);
            let column = [
                (0.2, 0.16, Concrete, main),
                (0.62, 0.10, Concrete, main),
                (0.70, 0.42, Concrete, main),
                (0.74, 0.44, Concrete, accent),
                (0.76, 0.12, Concrete, accent),
                (1.0, 0.03, Concrete, accent),
            ];
            pieces.turned(n, &column);
        }
        PropStyle::Cart => {
            for (x, y) in [(-0.8, -0.8), (-0.8, 0.8), (0.8, -0.8), (0.8, 0.8)] {
                pieces.block(Rubber, [34, 34, 36], [x, y, 0.06], [0.14, 0.06, 0.06]);
                pieces.block(Metal, accent, [x, y, 0.28], [0.03, 0.03, 0.22]);
            }
            pieces.block(Metal, main, [0.06, 0.0, 0.42], [0.94, 0.96, 0.03]);
            for y in [-0.97, 0.97] {
                pieces.block(Metal, main, [0.06, y, 0.62], [0.94, 0.03, 0.22]);
            }
            for x in [-0.84, 0.97] {
                pieces.block(Metal, main, [x, 0.0, 0.62], [0.03, 0.94, 0.22]);
            }
            pieces.block(Rubber, accent, [-0.95, 0.0, 0.97], [0.05, 1.0, 0.03]);
            for y in [-0.9, 0.9] {
                pieces.block(Metal, accent, [-0.92, y, 0.90], [0.04, 0.04, 0.10]);
            }
        }
        PropStyle::Round => {
            let rows = [
                (0.0, 0.72, main),
                (0.18, 0.94, main),
                (0.45, 1.0, accent),
                (0.55, 1.0, main),
                (0.80, 0.80, main),
                (0.95, 0.42, main),
                (1.0, 0.10, main),
            ];
            pieces.turned(n, &rows.map(|(z, w, rgb)| (z, w, Matte, rgb)));
        }
        PropStyle::Plate => {
            pieces.block(Metal, main, [0.0, 0.0, 0.5], [1.0, 1.0, 0.5]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_family_fits_its_box_to_a_centimetre() {
        use PropStyle::*;
        let all = [
            Crate, Cone, Barrel, Bin, Bench, Chair, Table, Barrier, Sign, Board, Plant, Tree, Bag,
            Debris, Container, Shelter, Lamp, Fountain, Cart, Round, Plate,
        ];
        for style in all {
            for half_m in [[0.3, 0.4, 0.5], [1.1, 0.6, 1.2]] {
                let shape = PropShape {
                    style,
                    half_m,
                    rgb: [200, 90, 30],
                    accent_rgb: [240; 3],
                    class: Class::STATIC,
                };
                let mesh = prop_mesh(&shape);
                let (mut low, mut high) = ([f32::MAX; 3], [f32::MIN; 3]);
                for (corners, vertex) in mesh.triangles() {
                    assert_eq!(vertex.class, Class::STATIC.0);
                    for corner in corners {
                        (0..3).for_each(|i| {
                            (low[i], high[i]) = (low[i].min(corner[i]), high[i].max(corner[i]))
                        });
                    }
                }
                let expected = [
                    (-half_m[0], half_m[0]),
                    (-half_m[1], half_m[1]),
                    (0.0, 2.0 * half_m[2]),
                ];
                for (axis, (from, to)) in expected.into_iter().enumerate() {
                    let off = (f64::from(low[axis]) - from)
                        .abs()
                        .max((f64::from(high[axis]) - to).abs());
                    assert!(
                        off < 0.01,
                        "{style:?} axis {axis}: {low:?} {high:?} {half_m:?}"
                    );
                }
                assert!(
                    mesh.n_triangles() < 800,
                    "{style:?}: {}",
                    mesh.n_triangles()
                );
            }
        }
    }
}
