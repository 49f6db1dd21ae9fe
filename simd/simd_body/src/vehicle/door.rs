//! Doors that open: a body with door openings and an interior behind them, and a slab for each
//! door.
//!
//! While every door is shut, which is most of the time, the plain body is drawn instead. From
//! outside the two look the same.

use nalgebra::{Isometry3, Translation3, UnitQuaternion, Vector3};
use sensor_core::mesh::Surface;
use sensor_core::{Material, Mesh, MeshBuilder};

use super::bodywork::Bodywork;
use super::car::{self, section};
use super::loft::{Section, end_cap};
use super::outfit::Outfit;
use super::outline::{Station, interpolate, table};
use super::shape::{BodyStyle, VehicleShape};

/// Thickness of a door and of the lining of the body, metres.
const THICKNESS_M: f32 = 0.05;
const LINING_M: f32 = 0.03;
/// Widest angle of a hinged door.
const WIDEST_RAD: f64 = 1.15;
/// How far a sliding door comes out before it runs back, metres.
const SLIDE_OUT_M: f64 = 0.09;
/// Rings of a fine section between sill and roof edge.
const FIRST_RING: usize = 2;
const LAST_RING: usize = 6;

/// How a door moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum DoorMotion {
    /// Turns about the vertical through its front edge.
    Hinged,
    /// Slides out and then back along the body, by this length, metres.
    Sliding(f64),
}

/// One door.
#[derive(Clone, Debug)]
pub struct Door {
    /// Mesh whose origin is the lower end of the hinge.
    pub mesh: Mesh,
    /// The hinge when the door is shut, vehicle space, metres.
    pub hinge_m: [f64; 3],
    /// How it moves.
    pub motion: DoorMotion,
    /// On the left side.
    pub left: bool,
}

impl Door {
    /// Pose of the mesh in the vehicle; `opening` runs from 0 (shut) to 1.
    pub fn vehicle_from_mesh(&self, opening: f64) -> Isometry3<f64> {
        let outwards = if self.left { 1.0 } else { -1.0 };
        let hinge = Translation3::from(Vector3::from(self.hinge_m));
        match self.motion {
            DoorMotion::Hinged => {
                let angle = -outwards * WIDEST_RAD * opening;
                hinge * UnitQuaternion::from_axis_angle(&Vector3::z_axis(), angle)
            }
            DoorMotion::Sliding(length_m) => {
                let out_m = SLIDE_OUT_M * (opening * 5.0).min(1.0);
                Isometry3::from(
                    Translation3::new(-length_m * opening, outwards * out_m, 0.0) * hinge,
                )
            }
        }
    }
}

/// A body that shows its interior through its doors.
#[derive(Clone, Debug)]
pub struct DoorMeshes {
    /// Drawn in place of the plain body while any door is open.
    pub body: Mesh,
    /// Front left, front right, rear left, rear right.
    pub doors: Vec<Door>,
}

/// Where the front and the rear door begin and end, as shares of the length from the front.
pub(super) fn spans(style: BodyStyle) -> Option<[[f32; 2]; 2]> {
    match style {
        BodyStyle::Saloon => Some([[0.355, 0.545], [0.549, 0.690]]),
        BodyStyle::Hatch => Some([[0.335, 0.560], [0.565, 0.720]]),
        BodyStyle::Suv => Some([[0.330, 0.535], [0.539, 0.700]]),
        BodyStyle::Van => Some([[0.200, 0.375], [0.379, 0.560]]),
        BodyStyle::Microbus => Some([[0.135, 0.330], [0.334, 0.530]]),
        _ => None,
    }
}

/// The meshes of a body's doors; `None` for bodies whose doors do not open.
pub fn door_meshes(shape: &VehicleShape) -> Option<DoorMeshes> {
    outfitted_door_meshes(shape, Outfit::Plain)
}

/// As without an outfit, with equipment and livery added.
pub fn outfitted_door_meshes(shape: &VehicleShape, outfit: Outfit) -> Option<DoorMeshes> {
    let spans = spans(shape.style)?;
    let body = Bodywork::new(shape, outfit);
    let table = table(shape.style);
    let mut builder =
        MeshBuilder::new(format!("{:?} body with open doors", shape.style).to_lowercase());
    car::open_body(&mut builder, &body, shape.style, spans);
    interior(&mut builder, &body, table, spans);
    builder.end_level(45.0);
    car::body(&mut builder, &body, shape.style, 2);
    builder.end_level(f32::INFINITY);
    let mut doors = Vec::new();
    for (row, span) in spans.into_iter().enumerate() {
        for left in [true, false] {
            doors.push(door(
                &body,
                shape.style,
                span,
                row == 1 && matches!(shape.style, BodyStyle::Van | BodyStyle::Microbus),
                left,
            ));
        }
    }
    Some(DoorMeshes {
        body: builder.finish(),
        doors,
    })
}

/// Adds a polygon so that it faces a direction.
fn facing(builder: &mut MeshBuilder, surface: Surface, corners: &[[f32; 3]], direction: [f32; 3]) {
    let mut corners = corners.to_vec();
    let [a, b, c] = [0, 1, 2].map(|i| Vector3::from(corners[i]));
    // A quad's first edge may have length 0.
    let first = (b - a).cross(&(c - a));
    let normal = match corners.get(3) {
        Some(d) => first + (c - a).cross(&(Vector3::from(*d) - a)),
        None => first,
    };
    if normal.norm() < 1e-9 {
        return;
    }
    if normal.dot(&Vector3::from(direction)) < 0.0 {
        corners.reverse();
    }
    let uv: Vec<[f32; 2]> = corners.iter().map(|p| [p[0], p[2]]).collect();
    builder.polygon(surface, &corners, &uv);
}

/// Stations of the fine body between two places, both ends included.
fn stations_between(body: &Bodywork, table: &[Station], [from, to]: [f32; 2]) -> Vec<Station> {
    let inside = car::stations(body, table, 0, &[])
        .into_iter()
        .filter(|s| s.u > from + 0.003 && s.u < to - 0.003);
    let mut all = vec![interpolate(table, from)];
    all.extend(inside);
    all.push(interpolate(table, to));
    all
}

/// Distances up to which the three levels of a door are drawn, as those of the body.
const LEVELS_M: [f32; 3] = [16.0, 45.0, f32::INFINITY];

/// A door's cross-sections, and where its hinge is.
struct Slab<'t> {
    body: &'t Bodywork,
    style: BodyStyle,
    stations: Vec<Station>,
    sections: Vec<Section>,
    side: f32,
    hinge: [f32; 3],
}

impl Slab<'_> {
    /// Place of section `i`, ring `j`, `inwards_m` under the skin, relative to the hinge.
    fn at(&self, i: usize, j: usize, inwards_m: f32) -> [f32; 3] {
        let [y, z] = self.sections[i].ring_m[j];
        [
            self.sections[i].x_m - self.hinge[0],
            self.side * (y - inwards_m) - self.hinge[1],
            z,
        ]
    }

    /// Adds skin and inner side between these sections and rings, and the edges if `with_edges`.
    fn build(
        &self,
        builder: &mut MeshBuilder,
        picked: &[usize],
        rings: &[usize],
        with_edges: bool,
    ) {
        let trim = Surface::new(self.body.class, Material::Matte, [62, 58, 54]);
        let dark = self.body.dark();
        for (a, b) in picked.iter().zip(&picked[1..]).map(|(a, b)| (*a, *b)) {
            for (j, k) in rings.iter().zip(&rings[1..]).map(|(j, k)| (*j, *k)) {
                let quad = |inwards_m: f32| {
                    [(a, j), (b, j), (b, k), (a, k)].map(|(i, j)| self.at(i, j, inwards_m))
                };
                let skin = car::skin(self.body, self.style, self.stations[a].part, j);
                facing(builder, skin, &quad(0.0), [0.0, self.side, 0.0]);
                facing(
                    builder,
                    if j == LAST_RING - 1 { skin } else { trim },
                    &quad(THICKNESS_M),
                    [0.0, -self.side, 0.0],
                );
            }
            for (ring, up) in [(FIRST_RING, -1.0), (LAST_RING, 1.0)]
                .into_iter()
                .filter(|_| with_edges)
            {
                let edge = [(a, 0.0), (b, 0.0), (b, THICKNESS_M), (a, THICKNESS_M)]
                    .map(|(i, inwards_m)| self.at(i, ring, inwards_m));
                facing(builder, dark, &edge, [0.0, 0.0, up]);
            }
        }
        for (i, forward) in [(0, 1.0), (self.sections.len() - 1, -1.0)]
            .into_iter()
            .filter(|_| with_edges)
        {
            for (j, k) in rings.iter().zip(&rings[1..]).map(|(j, k)| (*j, *k)) {
                let edge = [(j, 0.0), (k, 0.0), (k, THICKNESS_M), (j, THICKNESS_M)]
                    .map(|(ring, inwards_m)| self.at(i, ring, inwards_m));
                facing(builder, dark, &edge, [forward, 0.0, 0.0]);
            }
        }
    }
}

fn door(body: &Bodywork, style: BodyStyle, span: [f32; 2], slides: bool, left: bool) -> Door {
    let stations = stations_between(body, table(style), span);
    let sections: Vec<Section> = stations.iter().map(|s| section(body, s, 0)).collect();
    let side = if left { 1.0f32 } else { -1.0 };
    let hinge = [
        sections[0].x_m,
        side * (sections[0].ring_m[4][0] - 0.5 * THICKNESS_M),
        0.0,
    ];
    let slab = Slab {
        body,
        style,
        stations,
        sections,
        side,
        hinge,
    };
    let last = slab.sections.len() - 1;
    let length_m = slab.sections[0].x_m - slab.sections[last].x_m;
    let mut builder = MeshBuilder::new("door");
    slab.build(
        &mut builder,
        &Vec::from_iter(0..=last),
        &Vec::from_iter(FIRST_RING..=LAST_RING),
        true,
    );
    // The handle, below the window near the rear edge.
    let [handle_x, handle_y, handle_z] = slab.at(last - 1, 4, 0.0);
    let handle_x = handle_x.clamp(0.15 - length_m, -0.12);
    builder.cuboid(
        body.dark(),
        [handle_x - 0.02, handle_y + side * 0.008, handle_z - 0.03],
        [0.07, 0.012, 0.011],
    );
    builder.end_level(LEVELS_M[0]);
    slab.build(
        &mut builder,
        &[0, last / 2, last],
        &[FIRST_RING, 3, LAST_RING - 1, LAST_RING],
        true,
    );
    builder.end_level(LEVELS_M[1]);
    slab.build(
        &mut builder,
        &[0, last],
        &[FIRST_RING, LAST_RING - 1, LAST_RING],
        false,
    );
    builder.end_level(LEVELS_M[2]);
    let motion = if slides {
        DoorMotion::Sliding(0.95 * f64::from(length_m))
    } else {
        DoorMotion::Hinged
    };
    Door {
        mesh: builder.finish(),
        hinge_m: hinge.map(f64::from),
        motion,
        left,
    }
}

/// Lining, bulkheads and seats: what one sees through the openings.
fn interior(builder: &mut MeshBuilder, body: &Bodywork, table: &[Station], spans: [[f32; 2]; 2]) {
    let lining = Surface::new(body.class, Material::Matte, [74, 72, 70]);
    let carpet = Surface::new(body.class, Material::Matte, [34, 33, 33]);
    let [from, to] = [spans[0][0] - 0.012, spans[1][1] + 0.012];
    let stations = stations_between(body, table, [from, to]);
    let shrunk = |s: &Station| {
        let mut section = section(body, s, 0);
        for (j, [y, z]) in section.ring_m.iter_mut().enumerate() {
            *y = (*y - LINING_M).max(0.0);
            *z += if j < FIRST_RING {
                LINING_M
            } else {
                -LINING_M * (j as f32 - 4.0).clamp(0.0, 1.0)
            };
        }
        section
    };
    let sections: Vec<Section> = stations.iter().map(shrunk).collect();
    let in_door = |i: usize| {
        let middle = 0.5 * (stations[i].u + stations[i + 1].u);
        spans.iter().any(|[a, b]| (*a..*b).contains(&middle))
    };
    for i in 0..sections.len() - 1 {
        for j in 0..sections[0].ring_m.len() - 1 {
            if in_door(i) && (FIRST_RING..LAST_RING).contains(&j) {
                continue;
            }
            for side in [1.0f32, -1.0] {
                let at = |i: usize, j: usize| {
                    [
                        sections[i].x_m,
                        side * sections[i].ring_m[j][0],
                        sections[i].ring_m[j][1],
                    ]
                };
                let inwards = if j == 0 {
                    [0.0, 0.0, 1.0]
                } else {
                    [0.0, -side, if j > 5 { -4.0 } else { 0.0 }]
                };
                let surface = if j < FIRST_RING { carpet } else { lining };
                facing(
                    builder,
                    surface,
                    &[at(i, j), at(i + 1, j), at(i + 1, j + 1), at(i, j + 1)],
                    inwards,
                );
            }
        }
    }
    end_cap(builder, &sections[0], carpet, false);
    end_cap(builder, &sections[sections.len() - 1], lining, true);
    seats(builder, body, table, spans);
}

fn seats(builder: &mut MeshBuilder, body: &Bodywork, table: &[Station], spans: [[f32; 2]; 2]) {
    let cloth = Surface::new(body.class, Material::Matte, [48, 50, 58]);
    let half_y = 0.21 * body.half_width_m;
    for [from, to] in spans {
        let u = from + 0.72 * (to - from);
        let room_m = interpolate(table, u).top * body.height() - body.sill_m;
        let x = body.x(u);
        for side in [1.0f32, -1.0] {
            let y = side * 0.42 * body.half_width_m;
            // Over a wheel the seat stands on the wheel arch.
            let over_wheel = [0.5, -0.5].iter().any(|share| {
                let axle = share * body.wheelbase_m;
                x - 0.10 < axle + body.arch_radius_m() && x + 0.46 > axle - body.arch_radius_m()
            });
            let arch_m = if over_wheel {
                body.wheel_radius_m + body.arch_radius_m() + 0.04 + 0.07 * room_m
            } else {
                0.0
            };
            let cushion_z = (body.sill_m + 0.24 * room_m).max(arch_m);
            builder.cuboid(
                cloth,
                [x + 0.22, y, cushion_z],
                [0.24, half_y, 0.07 * room_m],
            );
            builder.cuboid(
                cloth,
                [x - 0.04, y, cushion_z + 0.25 * room_m],
                [0.06, half_y, 0.29 * room_m],
            );
            builder.cuboid(
                cloth,
                [x - 0.05, y, cushion_z + 0.60 * room_m],
                [0.04, 0.6 * half_y, 0.06 * room_m],
            );
        }
    }
}
