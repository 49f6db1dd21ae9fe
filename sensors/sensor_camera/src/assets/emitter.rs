//! Finds the lamps in a mesh, once, when it is uploaded.
//!
//! Every triangle of material `Lamp` belongs to a lamp. The kind of lamp follows from the
//! triangle's class and lamp bit, so a mesh needs no separate list of lamps. Candelas are those of
//! usual lamps.

use schema_types::{Class, ObjectId};
use sensor_core::{Material, Mesh};

/// Corners nearer to one another than this belong to one lamp, metres.
const SAME_LAMP_M: f32 = 1.0;
/// A lamp of a mesh, mesh space.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Emitter {
    pub place_m: [f32; 3],
    /// Bit that lights it.
    pub bit: u8,
    /// Object it belongs to; 0 means that of the instance.
    pub object: ObjectId,
    /// Linear colour of luminance 1.
    pub rgb: [f32; 3],
    pub beam: Beam,
}

/// How a lamp shines.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Beam {
    pub axis: [f32; 3],
    pub candela: f32,
    /// Angle from the axis to the full beam and to its edge, degrees.
    pub full_deg: f32,
    pub edge_deg: f32,
    pub reach_m: f32,
}

/// Lamps of a mesh's finest level.
pub(crate) fn emitters_of(mesh: &Mesh) -> Vec<Emitter> {
    struct Cluster {
        key: (u8, [u8; 4], u8, u32),
        first: [f32; 3],
        sum: [f32; 3],
        n: f32,
    }
    let mut clusters: Vec<Cluster> = Vec::new();
    for (corners, vertex) in mesh
        .triangles()
        .filter(|(_, vertex)| vertex.material == Material::Lamp as u8)
    {
        let key = (vertex.lamp, vertex.color, vertex.class, vertex.object_id);
        for corner in corners {
            let near = |a: &[f32; 3]| {
                (0..3).map(|i| (a[i] - corner[i]).powi(2)).sum::<f32>() < SAME_LAMP_M * SAME_LAMP_M
            };
            match clusters
                .iter_mut()
                .find(|cluster| cluster.key == key && near(&cluster.first))
            {
                Some(cluster) => {
                    (0..3).for_each(|i| cluster.sum[i] += corner[i]);
                    cluster.n += 1.0;
                }
                None => clusters.push(Cluster {
                    key,
                    first: corner,
                    sum: corner,
                    n: 1.0,
                }),
            }
        }
    }
    let emitter = |cluster: Cluster| {
        let place_m = cluster.sum.map(|x| x / cluster.n);
        let (bit, [r, g, b, _], class, object) = cluster.key;
        Emitter {
            place_m,
            bit,
            object: ObjectId(object),
            rgb: unit_luminance([r, g, b]),
            beam: beam_of(Class(class), bit, place_m[0] >= 0.0),
        }
    };
    clusters.into_iter().map(emitter).collect()
}

/// Lamp bits of vehicles are CARLA's light states: position, low beam, high beam, brake, blinkers,
/// reverse, fog, interior.
fn beam_of(class: Class, bit: u8, in_front: bool) -> Beam {
    let ahead = if in_front { 1.0 } else { -1.0 };
    let beam = |axis: [f32; 3], candela, full_deg, edge_deg, reach_m| Beam {
        axis,
        candela,
        full_deg,
        edge_deg,
        reach_m,
    };
    let is_vehicle = [
        Class::CAR,
        Class::TRUCK,
        Class::BUS,
        Class::MOTORCYCLE,
        Class::BICYCLE,
    ]
    .contains(&class);
    match (class, bit) {
        (Class::TRAFFIC_LIGHT, _) => beam([1.0, 0.0, -0.1], 120.0, 30.0, 85.0, 8.0),
        (_, 1) if is_vehicle => beam([ahead, 0.0, -0.035], 16_000.0, 2.0, 21.0, 80.0),
        (_, 2) if is_vehicle => beam([ahead, 0.0, -0.005], 32_000.0, 2.0, 16.0, 130.0),
        (_, 3) if is_vehicle => beam([ahead, 0.0, -0.1], 60.0, 20.0, 85.0, 9.0),
        (_, 4 | 5) if is_vehicle => beam([ahead, 0.0, -0.1], 120.0, 20.0, 85.0, 8.0),
        (_, 6) if is_vehicle => beam([ahead, 0.0, -0.2], 300.0, 20.0, 80.0, 12.0),
        (_, 7) if is_vehicle => beam([ahead, 0.0, -0.15], 2000.0, 20.0, 60.0, 20.0),
        _ if is_vehicle => beam([ahead, 0.0, -0.2], 12.0, 20.0, 85.0, 4.0),
        (Class::POLES, _) => beam([0.0, 0.0, -1.0], 2600.0, 35.0, 82.0, 32.0),
        // 3000 lm from a ceiling, evenly over all directions below.
        (Class::BUILDINGS, _) => beam([0.0, 0.0, -1.0], 950.0, 45.0, 85.0, 18.0),
        _ => beam([0.0, 0.0, -1.0], 500.0, 45.0, 85.0, 14.0),
    }
}

impl Emitter {
    /// The same lamp with another colour and strength.
    pub fn set(mut self, rgb: Option<[u8; 3]>, strength_ratio: f32) -> Emitter {
        self.rgb = rgb.map_or(self.rgb, unit_luminance);
        self.beam.candela *= strength_ratio;
        // Scaling the reach like this keeps the brightness at its end. The limit is what the
        // culling of tiles is made for.
        self.beam.reach_m *= strength_ratio.sqrt().clamp(0.1, 3.0);
        self
    }
}

fn unit_luminance(color: [u8; 3]) -> [f32; 3] {
    let linear = |c: usize| (color[c] as f32 / 255.0).powf(2.2);
    let luminance = (0.2126 * linear(0) + 0.7152 * linear(1) + 0.0722 * linear(2)).max(0.02);
    std::array::from_fn(|c| linear(c) / luminance)
}

#[cfg(test)]
mod tests {
    use super::*;
    use sensor_core::MeshBuilder;
    use sensor_core::mesh::Surface;

    #[test]
    fn two_headlights_are_two_lamps_that_shine_forward() {
        let mut builder = MeshBuilder::new("car");
        for side in [-0.6, 0.6] {
            builder.cuboid(
                Surface::lamp(Class::CAR, [255, 250, 240], 1),
                [2.0, side, 0.7],
                [0.05, 0.1, 0.1],
            );
        }
        builder.cuboid(
            Surface::new(Class::CAR, Material::CarPaint, [90; 3]),
            [0.0, 0.0, 0.7],
            [2.0, 0.9, 0.4],
        );
        let emitters = emitters_of(&builder.finish());
        assert_eq!(emitters.len(), 2);
        for (emitter, side) in emitters.iter().zip([-0.6, 0.6]) {
            assert!(
                (emitter.place_m[0] - 2.0).abs() < 1e-3 && (emitter.place_m[1] - side).abs() < 1e-3
            );
            assert!(emitter.beam.axis[0] > 0.9 && emitter.bit == 1);
        }
    }
}
