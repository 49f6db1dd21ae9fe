//! Saloon, hatchback, SUV, van, microbus, wedge: one loft; `outline` has a table for each.

use sensor_core::mesh::Surface;
use sensor_core::{Material, MeshBuilder};

use super::bodywork::Bodywork;
use super::fittings::{far_plate, lamp_block, plate};
use super::loft::{Section, loft_with_holes};
use super::outline::Part::{self, Cabin, Gap, Pillar, Screen};
use super::outline::{Station, interpolate, table};
use super::shape::BodyStyle;
use super::{equipment, microbus};

/// What a strip of the finest level is made of.
pub(super) fn skin(body: &Bodywork, style: BodyStyle, part: Part, strip: usize) -> Surface {
    if part != Gap
        && let Some(surface) = body
            .outfit
            .livery(body.class, strip, matches!(part, Cabin | Pillar))
    {
        return surface;
    }
    match (strip, part) {
        (0, _) => body.dark(),
        (1, _) => body.trim(),
        (2..=4, Gap) => body.dark(),
        (5, Cabin | Screen | Gap) => body.glass(),
        (5, Pillar) if style == BodyStyle::Microbus => microbus::upper(body),
        (5, Pillar) if style != BodyStyle::Van => body.dark(),
        (7, Screen) => body.glass(),
        (6 | 7, Cabin | Screen | Pillar | Gap) if style == BodyStyle::Microbus => {
            microbus::upper(body)
        }
        _ => body.paint(),
    }
}

/// Adds the finest level of a body whose door openings, given by their spans, are left open.
pub(super) fn open_body(
    builder: &mut MeshBuilder,
    body: &Bodywork,
    style: BodyStyle,
    doors: [[f32; 2]; 2],
) {
    let table = table(style);
    let stations = stations(body, table, 0, doors.as_flattened());
    let sections: Vec<Section> = stations.iter().map(|s| section(body, s, 0)).collect();
    let surface = |segment: usize, strip: usize| {
        let middle = 0.5 * (stations[segment].u + stations[segment + 1].u);
        let is_door = (2..=5).contains(&strip)
            && doors
                .iter()
                .any(|[from, to]| (*from..*to).contains(&middle));
        (!is_door).then(|| skin(body, style, stations[segment].part, strip))
    };
    loft_with_holes(builder, &sections, surface, [body.paint(); 2]);
    ends(builder, body, style, 0);
    mirrors(builder, body, style);
    equipment::on_car(builder, body, style, 0);
}

/// Adds one level of a car's body; `detail` 0 is the finest of four.
pub fn body(builder: &mut MeshBuilder, body: &Bodywork, style: BodyStyle, detail: usize) {
    let table = table(style);
    let stations = stations(body, table, detail, &[]);
    let sections: Vec<Section> = stations.iter().map(|s| section(body, s, detail)).collect();
    let paint = body.paint();
    let surface = |segment: usize, strip: usize| {
        let part = stations[segment].part;
        // Coarse rings have fewer strips: floor, side, window, roof.
        let strip = match detail {
            0 => strip,
            1 => [0, 2, 4, 5, 7][strip],
            _ => [0, 2, 5, 7][strip],
        };
        // The underside of a distant car is invisible.
        (detail < 3 || strip > 0).then(|| skin(body, style, part, strip))
    };
    loft_with_holes(builder, &sections, surface, [paint, paint]);
    ends(builder, body, style, detail);
    if detail < 2 {
        mirrors(builder, body, style);
    }
    equipment::on_car(builder, body, style, detail);
}

/// The table's stations for a level of detail, with stations for wheel arches and at `also`
/// inserted. Coarse levels keep only what shapes the outline.
pub(super) fn stations(
    body: &Bodywork,
    table: &[Station],
    detail: usize,
    also: &[f32],
) -> Vec<Station> {
    let mut places: Vec<f32> = table.iter().map(|s| s.u).collect();
    match detail {
        0 => places.extend(body.arch_places(&[-1.0, -0.96, -0.8, -0.5, 0.0, 0.5, 0.8, 0.96, 1.0])),
        1 => {
            places.retain(|&u| {
                (u == 0.0 || u == 1.0 || (0.02..0.98).contains(&u))
                    && !table.iter().any(|s| s.u == u && matches!(s.part, Gap))
            });
            places.extend(body.arch_places(&[-1.0, -0.8, 0.8, 1.0]));
        }
        3 => {
            // Kept: where bonnet, cabin and boot begin and end, and where nose and tail have their
            // full width.
            let kind = |i: usize| match table[i].part {
                Pillar | Gap => Cabin,
                part => part,
            };
            let keep = |i: usize| {
                i == 0
                    || i == 2
                    || i + 3 == table.len()
                    || i + 1 == table.len()
                    || i > 2 && kind(i) != kind(i - 1)
            };
            places = (0..table.len())
                .filter(|&i| keep(i))
                .map(|i| table[i].u)
                .collect();
        }
        _ => {
            let keep = |i: usize| {
                i == 0
                    || i + 1 == table.len()
                    || (i > 1 && i + 2 < table.len() && i.is_multiple_of(2) && table[i].part != Gap)
            };
            places = (0..table.len())
                .filter(|&i| keep(i))
                .map(|i| table[i].u)
                .collect();
        }
    }
    places.retain(|u| also.iter().all(|place| (u - place).abs() > 0.002));
    places.extend(also);
    places.sort_by(f32::total_cmp);
    places.dedup_by(|a, b| (*a - *b).abs() < 0.002);
    places.iter().map(|&u| interpolate(table, u)).collect()
}

pub(super) fn section(body: &Bodywork, station: &Station, detail: usize) -> Section {
    let &Station {
        u,
        belt,
        top,
        width,
        roof,
        ..
    } = station;
    let (w, h) = (body.half_width_m * width, body.height());
    let (belt, top) = (belt * h, top * h);
    let nose = (0.10 - u).max(u - 0.90).max(0.0) * 10.0;
    let floor = body.arch(u, detail).unwrap_or(body.sill_m + 0.05 * nose);
    let lift = |z: f32, n: f32| z.max(floor + 0.012 * n);
    let crown = (top - belt).min(0.05);
    let fine = [
        [0.0, floor],
        [w * 0.93, floor],
        [w * 0.985, lift(body.sill_m + 0.07, 1.0)],
        [w, lift(body.sill_m + 0.5 * (belt - body.sill_m), 2.0)],
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
    Section {
        x_m: body.x(u),
        ring_m,
    }
}

/// Lamps, plates, bumpers.
fn ends(builder: &mut MeshBuilder, body: &Bodywork, style: BodyStyle, detail: usize) {
    if style == BodyStyle::Microbus {
        microbus::ends(builder, body, detail);
        return;
    }
    let table = table(style);
    front(builder, body, table, detail);
    rear(builder, body, table, style, detail);
}

fn front(builder: &mut MeshBuilder, body: &Bodywork, table: &[Station], detail: usize) {
    let (h, w, skin) = (body.height(), body.half_width_m, body.skin_m());
    let lamp_z = (table[0].belt - 0.045) * h;
    let flat = table[0].width;
    for side in [1.0f32, -1.0] {
        let blinker = if side > 0.0 { 5 } else { 4 };
        // The front faces end at `x`; outer lamps lie further back because the bumper is round.
        let mut lamp =
            |rgb: [u8; 3], bit: u8, (from, to): (f32, f32), x: f32, (low, high): (f32, f32)| {
                let (y, half_y) = (side * 0.5 * (from + to) * w, 0.5 * (to - from) * w);
                let (centre, half) = (
                    [x - 0.06, y, lamp_z + 0.5 * (low + high) * h],
                    [0.06, half_y, 0.5 * (high - low) * h],
                );
                lamp_block(
                    builder,
                    body.lamp(rgb, bit),
                    centre,
                    half,
                    [1.0, side],
                    detail,
                );
            };
        lamp(
            [255, 246, 224],
            1,
            (flat - 0.16, flat),
            skin + 0.012,
            (-0.03, 0.03),
        );
        if detail < 2 {
            lamp(
                [255, 250, 235],
                2,
                (flat - 0.27, flat - 0.17),
                skin + 0.012,
                (-0.03, 0.03),
            );
            lamp(
                [255, 160, 30],
                blinker,
                (flat + 0.005, flat + 0.075),
                skin - 0.005,
                (-0.03, 0.03),
            );
            lamp(
                [250, 250, 255],
                0,
                (flat - 0.27, flat),
                skin + 0.014,
                (-0.045, -0.033),
            );
        }
    }
    let bar = |builder: &mut MeshBuilder,
               surface: Surface,
               half_y: f32,
               z: f32,
               half_z: f32,
               out: f32| {
        lamp_block(
            builder,
            surface,
            [skin - 0.03 + out, 0.0, z],
            [0.03, half_y * w, half_z],
            [1.0, 1.0],
            detail,
        );
    };
    let plate_z = 0.5 * (lamp_z + body.sill_m) + 0.03;
    if detail < 3 {
        // Grille and the intake below the bumper.
        bar(builder, body.dark(), flat - 0.29, lamp_z, 0.03 * h, 0.010);
        let intake_z = body.sill_m + 0.11;
        bar(builder, body.dark(), flat - 0.1, intake_z, 0.075, 0.010);
    }
    if (1..3).contains(&detail) {
        far_plate(builder, body, [body.half[0] - 0.006, 0.0, plate_z], 1.0);
    }
    if detail == 0 {
        let chrome = Surface::new(body.class, Material::Metal, [196, 198, 200]);
        for k in [-0.6f32, 0.0, 0.6] {
            bar(
                builder,
                chrome,
                flat - 0.31,
                lamp_z + k * 0.03 * h,
                0.004,
                0.013,
            );
        }
        // Where the bumper ends.
        let seam_z = lamp_z - 0.052 * h;
        bar(builder, body.dark(), flat - 0.01, seam_z, 0.005, 0.006);
        plate(builder, body, [body.half[0] - 0.006, 0.0, plate_z]);
        let frame = [[skin - 0.01, 0.0, plate_z], [0.03, 0.27, 0.06]];
        builder.cuboid(body.dark(), frame[0], frame[1]);
    }
}

fn rear(
    builder: &mut MeshBuilder,
    body: &Bodywork,
    table: &[Station],
    style: BodyStyle,
    detail: usize,
) {
    let (h, w, skin) = (body.height(), body.half_width_m, body.skin_m());
    let last = table[table.len() - 1];
    let lamp_z = if style == BodyStyle::Van {
        0.40 * h
    } else {
        (last.belt - 0.055) * h
    };
    let tall = if matches!(style, BodyStyle::Suv | BodyStyle::Van | BodyStyle::Wedge) {
        0.05
    } else {
        0.036
    };
    let flat = last.width - 0.01;
    for side in [1.0f32, -1.0] {
        let blinker = if side > 0.0 { 5 } else { 4 };
        let mut lamp = |rgb: [u8; 3], bit: u8, (from, to): (f32, f32), (low, high): (f32, f32)| {
            let (y, half_y) = (side * 0.5 * (from + to) * w, 0.5 * (to - from) * w);
            let (centre, half) = (
                [0.06 - skin - 0.014, y, lamp_z + 0.5 * (low + high) * h],
                [0.06, half_y, 0.5 * (high - low) * h],
            );
            lamp_block(
                builder,
                body.lamp(rgb, bit),
                centre,
                half,
                [-1.0, side],
                detail,
            );
        };
        let inner = flat - if style == BodyStyle::Van { 0.10 } else { 0.22 };
        lamp([255, 24, 18], 3, (inner, flat), (0.0, tall));
        lamp([235, 20, 16], 0, (inner, flat), (-tall, 0.0));
        if detail < 2 {
            lamp(
                [255, 150, 25],
                blinker,
                (inner - 0.075, inner - 0.005),
                (0.0, tall),
            );
            lamp(
                [245, 245, 245],
                6,
                (inner - 0.075, inner - 0.005),
                (-tall, 0.0),
            );
        }
    }
    let z = if style == BodyStyle::Van {
        0.36 * h
    } else {
        lamp_z - 0.065 * h
    };
    if (1..3).contains(&detail) {
        let valance = [0.02 - skin, 0.0, body.sill_m + 0.1];
        let half_m = [0.03, (flat - 0.06) * w, 0.08];
        lamp_block(builder, body.dark(), valance, half_m, [-1.0, 1.0], detail);
        far_plate(builder, body, [-body.half[0] + 0.006, 0.0, z], -1.0);
    }
    if detail == 0 {
        if style != BodyStyle::Van {
            // The lid's seams, and the bumper's below it.
            let (lid_y, seam_z) = ((flat - 0.32) * w, lamp_z - 0.125 * h);
            for side in [1.0f32, -1.0] {
                let upright = [0.024 - skin, side * lid_y, lamp_z - 0.055 * h];
                builder.cuboid(body.dark(), upright, [0.03, 0.005, 0.07 * h]);
            }
            let level = [0.024 - skin, 0.0, seam_z];
            builder.cuboid(body.dark(), level, [0.03, (flat - 0.02) * w, 0.005]);
        }
        plate(builder, body, [-body.half[0] + 0.006, 0.0, z]);
        builder.cuboid(body.dark(), [0.01 - skin, 0.0, z], [0.03, 0.27, 0.06]);
        builder.cuboid(
            body.dark(),
            [0.02 - skin, 0.0, body.sill_m + 0.1],
            [0.03, (flat - 0.06) * w, 0.08],
        );
        if style == BodyStyle::Van {
            for y in [0.42, -0.42] {
                builder.cuboid(
                    body.glass(),
                    [0.02 - skin, y * w, 0.72 * h],
                    [0.03, 0.33 * w, 0.13 * h],
                );
            }
            builder.cuboid(
                body.dark(),
                [0.024 - skin, 0.0, 0.55 * h],
                [0.03, 0.006, 0.38 * h],
            );
        }
    }
}

fn mirrors(builder: &mut MeshBuilder, body: &Bodywork, style: BodyStyle) {
    let belt = interpolate(table(style), 0.34).belt * body.height();
    let (outer, inner) = (body.half[1], body.half_width_m * 0.97);
    let x = body.x(match style {
        BodyStyle::Van => 0.20,
        BodyStyle::Microbus => 0.105,
        _ => 0.325,
    });
    for side in [1.0f32, -1.0] {
        builder.cuboid(
            body.dark(),
            [x, side * 0.5 * (outer + inner - 0.05), belt + 0.035],
            [0.025, 0.5 * (outer - inner), 0.018],
        );
        let half_y = 0.5 * (outer - inner + 0.03).min(0.2);
        builder.cuboid(
            body.paint(),
            [x + 0.01, side * (outer - half_y), belt + 0.085],
            [0.045, half_y, 0.06],
        );
        let glass = Surface::new(body.class, Material::Glass, [150, 160, 170]);
        builder.cuboid(
            glass,
            [x - 0.037, side * (outer - half_y), belt + 0.085],
            [0.004, half_y * 0.88, 0.05],
        );
    }
}
