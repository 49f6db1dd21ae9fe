//! Saloon, hatchback, SUV and van: one loft, four tables.

use schema_types::Class;
use sensor_core::mesh::Surface;
use sensor_core::{Material, MeshBuilder};

use super::loft::{Section, loft_with_holes};
use super::{BodyStyle, Frame, outfit};

/// What the skin is from one station to the next.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Part {
    /// Painted all round.
    Panel,
    /// Side windows under a painted roof.
    Cabin,
    /// Windscreen or rear window.
    Screen,
    /// Painted pillar between side windows.
    Pillar,
    /// Gap of a door: a dark line on the side.
    Gap,
}
use Part::{Cabin, Gap, Panel, Pillar, Screen};

/// (place from the front 0…1, belt line, roof line, width, roof width, part behind it); heights and widths are shares of the box.
pub(super) type Station = (f32, f32, f32, f32, f32, Part);

const SALOON: &[Station] = &[
    (0.000, 0.40, 0.43, 0.74, 0.90, Panel),
    (0.012, 0.435, 0.47, 0.87, 0.90, Panel),
    (0.050, 0.475, 0.515, 0.955, 0.90, Panel),
    (0.150, 0.530, 0.580, 1.000, 0.90, Panel),
    (0.270, 0.585, 0.640, 1.000, 0.88, Screen),
    (0.345, 0.600, 0.820, 1.000, 0.82, Screen),
    (0.420, 0.612, 0.955, 1.000, 0.77, Cabin),
    (0.520, 0.622, 0.998, 1.000, 0.76, Pillar),
    (0.545, 0.625, 1.000, 1.000, 0.76, Gap),
    (0.549, 0.625, 1.000, 1.000, 0.76, Cabin),
    (0.660, 0.637, 0.985, 1.000, 0.76, Cabin),
    (0.715, 0.645, 0.955, 1.000, 0.76, Screen),
    (0.800, 0.655, 0.800, 1.000, 0.81, Screen),
    (0.865, 0.660, 0.705, 0.995, 0.88, Panel),
    (0.960, 0.655, 0.695, 0.965, 0.90, Panel),
    (0.990, 0.620, 0.655, 0.900, 0.90, Panel),
    (1.000, 0.560, 0.590, 0.790, 0.90, Panel),
];

const HATCH: &[Station] = &[
    (0.000, 0.38, 0.41, 0.76, 0.90, Panel),
    (0.014, 0.43, 0.47, 0.88, 0.90, Panel),
    (0.055, 0.48, 0.525, 0.96, 0.90, Panel),
    (0.140, 0.535, 0.590, 1.000, 0.90, Panel),
    (0.235, 0.575, 0.640, 1.000, 0.88, Screen),
    (0.325, 0.590, 0.830, 1.000, 0.83, Screen),
    (0.405, 0.600, 0.955, 1.000, 0.79, Cabin),
    (0.530, 0.610, 0.998, 1.000, 0.78, Pillar),
    (0.560, 0.612, 1.000, 1.000, 0.78, Gap),
    (0.565, 0.612, 1.000, 1.000, 0.78, Cabin),
    (0.720, 0.630, 0.990, 1.000, 0.78, Cabin),
    (0.800, 0.640, 0.970, 1.000, 0.78, Pillar),
    (0.880, 0.655, 0.930, 0.985, 0.77, Screen),
    (0.960, 0.660, 0.720, 0.960, 0.85, Panel),
    (0.988, 0.600, 0.640, 0.910, 0.90, Panel),
    (1.000, 0.520, 0.560, 0.810, 0.90, Panel),
];

const SUV: &[Station] = &[
    (0.000, 0.44, 0.47, 0.78, 0.90, Panel),
    (0.012, 0.485, 0.525, 0.90, 0.90, Panel),
    (0.050, 0.525, 0.575, 0.965, 0.90, Panel),
    (0.140, 0.560, 0.615, 1.000, 0.90, Panel),
    (0.255, 0.590, 0.655, 1.000, 0.89, Screen),
    (0.320, 0.600, 0.820, 1.000, 0.84, Screen),
    (0.385, 0.608, 0.950, 1.000, 0.80, Cabin),
    (0.510, 0.616, 0.992, 1.000, 0.79, Pillar),
    (0.535, 0.618, 0.995, 1.000, 0.79, Gap),
    (0.539, 0.618, 0.995, 1.000, 0.79, Cabin),
    (0.700, 0.628, 1.000, 1.000, 0.79, Pillar),
    (0.730, 0.630, 1.000, 1.000, 0.79, Cabin),
    (0.860, 0.640, 0.985, 0.995, 0.79, Pillar),
    (0.925, 0.650, 0.955, 0.985, 0.79, Screen),
    (0.972, 0.655, 0.700, 0.965, 0.86, Panel),
    (0.990, 0.600, 0.640, 0.920, 0.90, Panel),
    (1.000, 0.480, 0.520, 0.830, 0.90, Panel),
];

const VAN: &[Station] = &[
    (0.000, 0.34, 0.37, 0.82, 0.90, Panel),
    (0.012, 0.385, 0.42, 0.92, 0.90, Panel),
    (0.045, 0.42, 0.46, 0.97, 0.90, Panel),
    (0.130, 0.465, 0.515, 1.000, 0.90, Screen),
    (0.190, 0.490, 0.720, 1.000, 0.88, Screen),
    (0.255, 0.500, 0.930, 1.000, 0.86, Cabin),
    (0.340, 0.505, 0.985, 1.000, 0.86, Pillar),
    (0.375, 0.505, 0.992, 1.000, 0.86, Gap),
    (0.379, 0.505, 0.992, 1.000, 0.86, Panel),
    (0.560, 0.505, 1.000, 1.000, 0.86, Gap),
    (0.564, 0.505, 1.000, 1.000, 0.86, Panel),
    (0.930, 0.505, 1.000, 1.000, 0.86, Panel),
    (0.985, 0.505, 0.990, 0.985, 0.86, Panel),
    (1.000, 0.500, 0.970, 0.960, 0.85, Panel),
];

const WEDGE: &[Station] = &[
    (0.000, 0.47, 0.50, 0.84, 0.92, Panel),
    (0.012, 0.51, 0.54, 0.93, 0.92, Panel),
    (0.050, 0.535, 0.565, 0.970, 0.92, Panel),
    (0.170, 0.575, 0.655, 1.000, 0.91, Screen),
    (0.300, 0.598, 0.837, 1.000, 0.84, Screen),
    (0.345, 0.606, 0.900, 1.000, 0.81, Cabin),
    (0.417, 0.614, 1.000, 1.000, 0.76, Cabin),
    (0.500, 0.620, 0.952, 1.000, 0.77, Pillar),
    (0.525, 0.622, 0.938, 1.000, 0.775, Gap),
    (0.529, 0.622, 0.936, 1.000, 0.775, Cabin),
    (0.640, 0.632, 0.873, 1.000, 0.80, Panel),
    (0.800, 0.645, 0.781, 1.000, 0.86, Panel),
    (0.960, 0.655, 0.700, 0.990, 0.91, Panel),
    (0.990, 0.620, 0.660, 0.960, 0.91, Panel),
    (1.000, 0.540, 0.580, 0.880, 0.91, Panel),
];

pub(super) fn table(style: BodyStyle) -> &'static [Station] {
    match style {
        BodyStyle::Saloon => SALOON,
        BodyStyle::Suv => SUV,
        BodyStyle::Van => VAN,
        BodyStyle::Wedge => WEDGE,
        _ => HATCH,
    }
}

/// What a strip of the finest level is made of.
pub(super) fn skin(frame: &Frame, style: BodyStyle, part: Part, strip: usize) -> Surface {
    if part != Gap
        && let Some(surface) = frame.outfit.livery(frame.class, strip, matches!(part, Cabin | Pillar))
    {
        return surface;
    }
    match (strip, part) {
        (0, _) => frame.dark(),
        (1, _) => frame.trim(),
        (2..=4, Gap) => frame.dark(),
        (5, Cabin | Screen | Gap) => frame.glass(),
        (5, Pillar) if style != BodyStyle::Van => frame.dark(),
        (7, Screen) => frame.glass(),
        _ => frame.paint(),
    }
}

/// The finest level without the sides of doors: where they begin and end.
pub(super) fn open_body(builder: &mut MeshBuilder, frame: &Frame, style: BodyStyle, doors: [[f32; 2]; 2]) {
    let table = table(style);
    let stations = stations(frame, table, 0, doors.as_flattened());
    let sections: Vec<Section> = stations.iter().map(|s| section(frame, s, 0)).collect();
    let surface = |segment: usize, strip: usize| {
        let middle = 0.5 * (stations[segment].0 + stations[segment + 1].0);
        let is_door = (2..=5).contains(&strip) && doors.iter().any(|[from, to]| (*from..*to).contains(&middle));
        (!is_door).then(|| skin(frame, style, stations[segment].5, strip))
    };
    loft_with_holes(builder, &sections, surface, [frame.paint(); 2]);
    front(builder, frame, table, 0);
    rear(builder, frame, table, style, 0);
    mirrors(builder, frame, table);
    outfit::on_car(builder, frame, style, 0);
}

/// Adds one level of a car's body; `detail` 0 is the finest of four.
pub fn body(builder: &mut MeshBuilder, frame: &Frame, style: BodyStyle, detail: usize) {
    let table = table(style);
    let stations = stations(frame, table, detail, &[]);
    let sections: Vec<Section> = stations.iter().map(|s| section(frame, s, detail)).collect();
    let paint = frame.paint();
    let surface = |segment: usize, strip: usize| {
        let part = stations[segment].5;
        // Coarse rings have fewer strips: floor, side, window, roof.
        let strip = match detail {
            0 => strip,
            1 => [0, 2, 4, 5, 7][strip],
            _ => [0, 2, 5, 7][strip],
        };
        // The underside of a car far away is not seen.
        (detail < 3 || strip > 0).then(|| skin(frame, style, part, strip))
    };
    loft_with_holes(builder, &sections, surface, [paint, paint]);
    front(builder, frame, table, detail);
    rear(builder, frame, table, style, detail);
    if detail < 2 {
        mirrors(builder, frame, table);
    }
    outfit::on_car(builder, frame, style, detail);
}

/// The table with stations for wheel arches and at `also` put in; far levels keep what shapes the outline.
pub(super) fn stations(frame: &Frame, table: &[Station], detail: usize, also: &[f32]) -> Vec<Station> {
    let mut places: Vec<f32> = table.iter().map(|s| s.0).collect();
    match detail {
        0 => places.extend(frame.arch_places(&[-1.0, -0.96, -0.8, -0.5, 0.0, 0.5, 0.8, 0.96, 1.0])),
        1 => {
            places
                .retain(|&u| (u == 0.0 || u == 1.0 || (0.02..0.98).contains(&u)) && !table.iter().any(|s| s.0 == u && matches!(s.5, Gap)));
            places.extend(frame.arch_places(&[-1.0, -0.8, 0.8, 1.0]));
        }
        3 => {
            // Where bonnet, cabin and boot begin and end, and where nose and tail have their full width.
            let kind = |i: usize| match table[i].5 {
                Pillar | Gap => Cabin,
                part => part,
            };
            let keep = |i: usize| i == 0 || i == 2 || i + 3 == table.len() || i + 1 == table.len() || i > 2 && kind(i) != kind(i - 1);
            places = (0..table.len()).filter(|&i| keep(i)).map(|i| table[i].0).collect();
        }
        _ => {
            let keep =
                |i: usize| i == 0 || i + 1 == table.len() || (i > 1 && i + 2 < table.len() && i.is_multiple_of(2) && table[i].5 != Gap);
            places = (0..table.len()).filter(|&i| keep(i)).map(|i| table[i].0).collect();
        }
    }
    places.retain(|u| also.iter().all(|place| (u - place).abs() > 0.002));
    places.extend(also);
    places.sort_by(f32::total_cmp);
    places.dedup_by(|a, b| (*a - *b).abs() < 0.002);
    places.iter().map(|&u| interpolate(table, u)).collect()
}

pub(super) fn interpolate(table: &[Station], u: f32) -> Station {
    let next = table.iter().position(|s| s.0 > u + 1e-5).unwrap_or(table.len() - 1).max(1);
    let (a, b) = (table[next - 1], table[next]);
    let k = ((u - a.0) / (b.0 - a.0)).clamp(0.0, 1.0);
    let mix = |p: f32, q: f32| p + (q - p) * k;
    let part = if u >= b.0 - 1e-5 { b.5 } else { a.5 };
    (u, mix(a.1, b.1), mix(a.2, b.2), mix(a.3, b.3), mix(a.4, b.4), part)
}

pub(super) fn section(frame: &Frame, &(u, belt, top, width, roof, _): &Station, detail: usize) -> Section {
    let (w, h) = (frame.body_half_m * width, frame.height());
    let (belt, top) = (belt * h, top * h);
    let nose = (0.10 - u).max(u - 0.90).max(0.0) * 10.0;
    let floor = frame.arch(u, detail).unwrap_or(frame.sill_m + 0.05 * nose);
    let lift = |z: f32, n: f32| z.max(floor + 0.012 * n);
    let crown = (top - belt).min(0.05);
    let fine = [
        [0.0, floor],
        [w * 0.93, floor],
        [w * 0.985, lift(frame.sill_m + 0.07, 1.0)],
        [w, lift(frame.sill_m + 0.5 * (belt - frame.sill_m), 2.0)],
        [w * 0.992, lift(belt - 0.09, 3.0)],
        [w * 0.955, lift(belt, 4.0)],
        [w * (roof + 0.02), lift(top - crown, 5.0)],
        [w * (roof - 0.09), lift(top - 0.2 * crown, 6.0)],
        [0.0, lift(top, 7.0)],
    ];
    let ring_m = match detail {
        0 => fine.to_vec(),
        1 => [0, 1, 3, 5, 6, 8].map(|i| fine[i]).to_vec(),
        _ => [0, 1, 5, 6, 8].map(|i| fine[i]).to_vec(),
    };
    Section { x_m: frame.x(u), ring_m }
}

fn front(builder: &mut MeshBuilder, frame: &Frame, table: &[Station], detail: usize) {
    let (h, w, skin) = (frame.height(), frame.body_half_m, frame.skin_m());
    let lamp_z = (table[0].1 - 0.045) * h;
    let flat = table[0].3;
    for side in [1.0f32, -1.0] {
        let blinker = if side > 0.0 { 5 } else { 4 };
        // Front faces end at these x: the outer ones lie further back, as the bumper is round.
        let mut lamp = |rgb: [u8; 3], bit: u8, (from, to): (f32, f32), x: f32, (low, high): (f32, f32)| {
            let (y, half_y) = (side * 0.5 * (from + to) * w, 0.5 * (to - from) * w);
            let (centre, half) = ([x - 0.06, y, lamp_z + 0.5 * (low + high) * h], [0.06, half_y, 0.5 * (high - low) * h]);
            lamp_block(builder, frame.lamp(rgb, bit), (centre, half), [1.0, side], detail);
        };
        lamp([255, 246, 224], 1, (flat - 0.16, flat), skin + 0.012, (-0.03, 0.03));
        if detail < 2 {
            lamp([255, 250, 235], 2, (flat - 0.27, flat - 0.17), skin + 0.012, (-0.03, 0.03));
            lamp([255, 160, 30], blinker, (flat + 0.005, flat + 0.075), skin - 0.005, (-0.03, 0.03));
            lamp([250, 250, 255], 0, (flat - 0.27, flat), skin + 0.014, (-0.045, -0.033));
        }
    }
    if detail == 0 {
        let bar = |builder: &mut MeshBuilder, surface: Surface, half_y: f32, z: f32, half_z: f32, out: f32| {
            builder.cuboid(surface, [skin - 0.03 + out, 0.0, z], [0.03, half_y * w, half_z]);
        };
        bar(builder, frame.dark(), flat - 0.29, lamp_z, 0.03 * h, 0.010);
        let chrome = Surface::new(frame.class, Material::Metal, [196, 198, 200]);
        for k in [-0.6f32, 0.0, 0.6] {
            bar(builder, chrome, flat - 0.31, lamp_z + k * 0.03 * h, 0.004, 0.013);
        }
        bar(builder, frame.dark(), flat - 0.12, frame.sill_m + 0.10, 0.06, 0.010);
        plate(builder, frame, [frame.half[0] - 0.006, 0.0, 0.5 * (lamp_z + frame.sill_m) + 0.03]);
        builder.cuboid(frame.dark(), [skin - 0.01, 0.0, 0.5 * (lamp_z + frame.sill_m) + 0.03], [0.03, 0.27, 0.06]);
    }
}

fn rear(builder: &mut MeshBuilder, frame: &Frame, table: &[Station], style: BodyStyle, detail: usize) {
    let (h, w, skin) = (frame.height(), frame.body_half_m, frame.skin_m());
    let last = table[table.len() - 1];
    let lamp_z = if style == BodyStyle::Van { 0.40 * h } else { (last.1 - 0.055) * h };
    let tall = if matches!(style, BodyStyle::Suv | BodyStyle::Van | BodyStyle::Wedge) { 0.05 } else { 0.036 };
    let flat = last.3 - 0.01;
    for side in [1.0f32, -1.0] {
        let blinker = if side > 0.0 { 5 } else { 4 };
        let mut lamp = |rgb: [u8; 3], bit: u8, (from, to): (f32, f32), (low, high): (f32, f32)| {
            let (y, half_y) = (side * 0.5 * (from + to) * w, 0.5 * (to - from) * w);
            let (centre, half) = ([0.06 - skin - 0.014, y, lamp_z + 0.5 * (low + high) * h], [0.06, half_y, 0.5 * (high - low) * h]);
            lamp_block(builder, frame.lamp(rgb, bit), (centre, half), [-1.0, side], detail);
        };
        let inner = flat - if style == BodyStyle::Van { 0.10 } else { 0.22 };
        lamp([255, 24, 18], 3, (inner, flat), (0.0, tall));
        lamp([235, 20, 16], 0, (inner, flat), (-tall, 0.0));
        if detail < 2 {
            lamp([255, 150, 25], blinker, (inner - 0.075, inner - 0.005), (0.0, tall));
            lamp([245, 245, 245], 6, (inner - 0.075, inner - 0.005), (-tall, 0.0));
        }
    }
    if detail == 0 {
        let z = if style == BodyStyle::Van { 0.36 * h } else { lamp_z - 0.065 * h };
        plate(builder, frame, [-frame.half[0] + 0.006, 0.0, z]);
        builder.cuboid(frame.dark(), [0.01 - skin, 0.0, z], [0.03, 0.27, 0.06]);
        builder.cuboid(frame.dark(), [0.02 - skin, 0.0, frame.sill_m + 0.08], [0.03, (flat - 0.06) * w, 0.05]);
        if style == BodyStyle::Van {
            for y in [0.42, -0.42] {
                builder.cuboid(frame.glass(), [0.02 - skin, y * w, 0.72 * h], [0.03, 0.33 * w, 0.13 * h]);
            }
            builder.cuboid(frame.dark(), [0.024 - skin, 0.0, 0.55 * h], [0.03, 0.006, 0.38 * h]);
        }
    }
}

/// A lamp that stands out of the skin a little. From farther away only what shows: its front, and up to the third level its outer side.
/// `towards` are the signs of x and y in which it looks.
fn lamp_block(builder: &mut MeshBuilder, surface: Surface, (centre_m, half_m): ([f32; 3], [f32; 3]), towards: [f32; 2], detail: usize) {
    if detail == 0 {
        builder.cuboid(surface, centre_m, half_m);
        return;
    }
    let ([x, y, z], [hx, hy, hz], [ahead, out]) = (centre_m, half_m, towards);
    let front_x = x + ahead * hx;
    // Counter-clockwise from where it looks.
    let front = [(-ahead, -1.0), (ahead, -1.0), (ahead, 1.0), (-ahead, 1.0)].map(|(a, b)| [front_x, y + a * hy, z + b * hz]);
    builder.polygon(surface, &front, &[[0.0; 2]; 4]);
    if detail < 3 {
        let side = [(out, -1.0), (-out, -1.0), (-out, 1.0), (out, 1.0)].map(|(a, b)| [x + a * hx, y + out * hy, z + b * hz]);
        builder.polygon(surface, &side, &[[0.0; 2]; 4]);
    }
}

/// Number plate.
pub fn plate(builder: &mut MeshBuilder, frame: &Frame, centre_m: [f32; 3]) {
    builder.cuboid(Surface::new(frame.class, Material::Matte, [236, 236, 230]), centre_m, [0.006, 0.26, 0.055]);
}

fn mirrors(builder: &mut MeshBuilder, frame: &Frame, table: &[Station]) {
    let belt = interpolate(table, 0.34).1 * frame.height();
    let (outer, inner) = (frame.half[1], frame.body_half_m * 0.97);
    let x = frame.x(if table.len() == VAN.len() { 0.20 } else { 0.325 });
    for side in [1.0f32, -1.0] {
        builder.cuboid(frame.dark(), [x, side * 0.5 * (outer + inner - 0.05), belt + 0.035], [0.025, 0.5 * (outer - inner), 0.018]);
        let half_y = 0.5 * (outer - inner + 0.03).min(0.2);
        builder.cuboid(frame.paint(), [x + 0.01, side * (outer - half_y), belt + 0.085], [0.045, half_y, 0.06]);
        let glass = Surface::new(frame.class, Material::Glass, [150, 160, 170]);
        builder.cuboid(glass, [x - 0.037, side * (outer - half_y), belt + 0.085], [0.004, half_y * 0.88, 0.05]);
    }
}

/// Class of a car body.
pub fn class_of(style: BodyStyle) -> Class {
    match style {
        BodyStyle::Bus => Class::BUS,
        BodyStyle::Lorry | BodyStyle::Wedge => Class::TRUCK,
        BodyStyle::Motorcycle => Class::MOTORCYCLE,
        BodyStyle::Bicycle => Class::BICYCLE,
        _ => Class::CAR,
    }
}
