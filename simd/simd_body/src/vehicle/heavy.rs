//! Bus and lorry.

use sensor_core::mesh::Surface;
use sensor_core::{Material, MeshBuilder};

use super::bodywork::Bodywork;
use super::equipment;
use super::fittings::plate;
use super::loft::{Section, loft};
use super::outfit::Outfit;

/// A rounded box section: floor, skirt, window line, window top, roof.
/// The outline of a box at one place along the body.
struct BoxOutline {
    /// Share of the body's width.
    width: f32,
    /// Heights of the lower and the upper edge of the windows, and of the roof, metres.
    low: f32,
    high: f32,
    top: f32,
}

fn box_section(body: &Bodywork, u: f32, detail: usize, outline: &BoxOutline) -> Section {
    let &BoxOutline {
        width,
        low,
        high,
        top,
    } = outline;
    let w = body.half_width_m * width;
    let floor = body.arch(u, detail).unwrap_or(body.sill_m);
    let ring_m = vec![
        [0.0, floor],
        [w * 0.98, floor],
        [w, (body.sill_m + 0.12).max(floor + 0.02)],
        [w, low.max(floor + 0.04)],
        [w * 0.985, high],
        [w * 0.95, top - 0.10],
        [w * 0.80, top - 0.02],
        [0.0, top],
    ];
    Section {
        x_m: body.x(u),
        ring_m,
    }
}

/// One level of a city bus.
pub fn bus(builder: &mut MeshBuilder, body: &Bodywork, detail: usize) {
    let h = body.height();
    let (low, high) = (0.36 * h, 0.84 * h);
    let mut places = vec![0.0, 0.008, 0.03, 0.97, 0.992, 1.0];
    if detail < 2 {
        places.extend((1..9).flat_map(|k| {
            [
                0.03 + 0.94 * k as f32 / 9.0,
                0.03 + 0.94 * k as f32 / 9.0 + 0.006,
            ]
        }));
        let arch: &[f32] = if detail == 0 {
            &[-1.0, -0.95, -0.7, -0.35, 0.0, 0.35, 0.7, 0.95, 1.0]
        } else {
            &[-1.0, -0.7, 0.7, 1.0]
        };
        places.extend(body.arch_places(arch));
    }
    places.sort_by(f32::total_cmp);
    places.dedup_by(|a, b| (*a - *b).abs() < 0.0008);
    let width = |u: f32| 1.0 - 0.07 * ((0.03 - u).max(u - 0.97).max(0.0) / 0.03).powi(2);
    let top = |u: f32| h - 0.06 * ((0.03 - u).max(u - 0.97).max(0.0) / 0.03).powi(2) * h * 0.4;
    let sections: Vec<Section> = places
        .iter()
        .map(|&u| {
            let outline = BoxOutline {
                width: width(u),
                low,
                high,
                top: top(u),
            };
            box_section(body, u, detail, &outline)
        })
        .collect();
    let is_pillar = |u: f32| (1..9).any(|k| (u - 0.03 - 0.94 * k as f32 / 9.0).abs() < 0.001);
    let surface = |segment: usize, strip: usize| match strip {
        0 => body.dark(),
        1 => body.trim(),
        3 if places[segment] > 0.02 && places[segment] < 0.96 && !is_pillar(places[segment]) => {
            body.glass()
        }
        3 if is_pillar(places[segment]) => body.dark(),
        _ => body.paint(),
    };
    loft(builder, &sections, surface, [body.paint(), body.paint()]);
    let (x, w) = (body.half[0], body.half_width_m);
    let skin = body.skin_m();
    builder.cuboid(
        body.glass(),
        [skin - 0.03, 0.0, 0.56 * h],
        [0.04, 0.86 * w, 0.20 * h],
    );
    builder.cuboid(
        body.glass(),
        [0.03 - skin, 0.0, 0.66 * h],
        [0.04, 0.80 * w, 0.13 * h],
    );
    if detail < 2 {
        let board = body.lamp([255, 176, 40], 0);
        builder.cuboid(
            body.dark(),
            [skin - 0.03, 0.0, 0.83 * h],
            [0.04, 0.72 * w, 0.05 * h],
        );
        builder.cuboid(
            board,
            [skin - 0.03, 0.0, 0.83 * h],
            [0.045, 0.6 * w, 0.03 * h],
        );
        for u in [0.075, 0.5] {
            let depth = 0.004;
            builder.cuboid(
                body.glass(),
                [body.x(u + 0.04), -w - depth, 0.48 * h],
                [0.62, 0.006, 0.33 * h],
            );
            builder.cuboid(
                body.dark(),
                [body.x(u + 0.04), -w - depth - 0.004, 0.48 * h],
                [0.02, 0.006, 0.33 * h],
            );
        }
        builder.cuboid(
            body.dark(),
            [-0.2 * x, 0.0, h - 0.03],
            [0.25 * x, 0.5 * w, 0.028],
        );
    }
    lamps(builder, body, 0.24 * h, detail);
    long_mirrors(builder, body, x - 0.25, 0.70 * h);
}

/// One level of a lorry: cab, chassis, box.
pub fn lorry(builder: &mut MeshBuilder, body: &Bodywork, detail: usize) {
    let h = body.height();
    let cab_end = 0.26;
    let cab_top = 0.80 * h;
    let table = [
        (0.0, 0.93, 0.42, 0.90),
        (0.008, 0.97, 0.43, 0.93),
        (0.03, 1.0, 0.44, 0.97),
        (0.12, 1.0, 0.44, 1.0),
        (0.135, 1.0, 0.44, 1.0),
        (0.235, 1.0, 0.44, 1.0),
        (cab_end, 0.98, 0.44, 0.99),
    ];
    let mut places: Vec<f32> = table.iter().map(|t| t.0).collect();
    if detail < 2 {
        let arch: &[f32] = if detail == 0 {
            &[-1.0, -0.95, -0.7, -0.35, 0.0, 0.35, 0.7, 0.95, 1.0]
        } else {
            &[-1.0, -0.7, 0.7, 1.0]
        };
        places.extend(
            body.arch_places(arch)
                .into_iter()
                .filter(|&u| u < cab_end - 0.002),
        );
    }
    places.sort_by(f32::total_cmp);
    places.dedup_by(|a, b| (*a - *b).abs() < 0.0015);
    let sections: Vec<Section> = places
        .iter()
        .map(|&u| {
            let next = table
                .iter()
                .position(|t| t.0 > u + 1e-6)
                .unwrap_or(table.len() - 1)
                .max(1);
            let (a, b) = (table[next - 1], table[next]);
            let k = ((u - a.0) / (b.0 - a.0)).clamp(0.0, 1.0);
            let mix = |p: f32, q: f32| p + (q - p) * k;
            let outline = BoxOutline {
                width: mix(a.1, b.1),
                low: mix(a.2, b.2) * h,
                high: 0.66 * h,
                top: mix(a.3, b.3) * cab_top,
            };
            box_section(body, u, detail, &outline)
        })
        .collect();
    let surface = |segment: usize, strip: usize| match strip {
        0 => body.dark(),
        1 => body.trim(),
        3 if places[segment] > 0.02 && places[segment] < 0.13 => body.glass(),
        _ => body.paint(),
    };
    loft(builder, &sections, surface, [body.paint(), body.paint()]);
    let (x, w) = (body.half[0], body.half_width_m);
    let skin = body.skin_m();
    builder.cuboid(
        body.glass(),
        [skin - 0.03, 0.0, 0.57 * h],
        [0.04, 0.84 * w, 0.11 * h],
    );
    builder.cuboid(
        body.dark(),
        [skin - 0.03, 0.0, 0.33 * h],
        [0.04, 0.55 * w, 0.05 * h],
    );
    builder.cuboid(
        body.dark(),
        [skin - 0.03, 0.0, 0.15 * h],
        [0.04, 0.8 * w, 0.02 * h],
    );
    cargo(builder, body, [cab_end, cab_top], detail);
    lamps(builder, body, 0.20 * h, detail);
    long_mirrors(builder, body, x - 0.25, 0.56 * h);
}

fn cargo(builder: &mut MeshBuilder, body: &Bodywork, [cab_end, cab_top]: [f32; 2], detail: usize) {
    let (h, w) = (body.height(), body.half_width_m);
    let front = body.x(cab_end) - 0.12;
    let rear = -body.half[0] + 0.03;
    let (middle, half) = (0.5 * (front + rear), 0.5 * (front - rear));
    let floor = 2.0 * body.wheel_radius_m + 0.12;
    let skin = match body.outfit {
        Outfit::FireEngine => body.paint(),
        Outfit::Drinks => Surface::new(body.class, Material::Matte, [188, 24, 26]),
        _ => Surface::new(body.class, Material::Matte, [226, 226, 222]),
    };
    builder.cuboid(
        skin,
        [middle, 0.0, 0.5 * (floor + h)],
        [half, w, 0.5 * (h - floor)],
    );
    equipment::on_lorry(builder, body, [rear, front, floor, h], cab_top, detail);
    builder.cuboid(
        body.dark(),
        [middle + 0.4, 0.0, floor - 0.16],
        [half + 0.3, 0.45 * w, 0.15],
    );
    if detail < 2 {
        for side in [1.0, -1.0] {
            builder.cuboid(
                body.trim(),
                [middle + 0.15 * half, side * (w - 0.05), floor - 0.3],
                [0.42 * half, 0.03, 0.2],
            );
            builder.cuboid(
                body.dark(),
                [rear - 0.004, side * 0.03, 0.5 * (floor + h)],
                [0.006, 0.008, 0.47 * (h - floor)],
            );
        }
    }
}

fn lamps(builder: &mut MeshBuilder, body: &Bodywork, z: f32, detail: usize) {
    let (x, w) = (body.half[0], body.half_width_m);
    for side in [1.0f32, -1.0] {
        let blinker = if side > 0.0 { 5 } else { 4 };
        let mut lamp = |rgb: [u8; 3], bit: u8, at: [f32; 2], half_y: f32, x: f32| {
            builder.cuboid(
                body.lamp(rgb, bit),
                [x, side * at[0] * w, z + at[1]],
                [0.03, half_y, 0.07],
            );
        };
        lamp([255, 246, 224], 1, [0.74, 0.0], 0.13, x - 0.045);
        lamp([255, 24, 18], 3, [0.78, 0.0], 0.12, -x + 0.045);
        if detail < 2 {
            lamp([255, 250, 235], 2, [0.56, 0.0], 0.07, x - 0.045);
            lamp([255, 160, 30], blinker, [0.88, 0.0], 0.04, x - 0.045);
            lamp([255, 150, 25], blinker, [0.78, 0.15], 0.12, -x + 0.045);
            lamp([235, 20, 16], 0, [0.78, -0.15], 0.12, -x + 0.045);
            lamp([245, 245, 245], 6, [0.60, 0.0], 0.06, -x + 0.045);
        }
    }
    if detail < 2 {
        plate(builder, body, [x - 0.006, 0.0, z - 0.05]);
        plate(builder, body, [-x + 0.006, 0.0, z - 0.1]);
    }
}

fn long_mirrors(builder: &mut MeshBuilder, body: &Bodywork, x: f32, z: f32) {
    let (outer, inner) = (body.half[1], body.half_width_m);
    let half_y = (0.5 * (outer - inner)).min(0.12);
    for side in [1.0f32, -1.0] {
        builder.cuboid(
            body.dark(),
            [x, side * 0.5 * (outer + inner), z + 0.24],
            [0.03, 0.5 * (outer - inner), 0.02],
        );
        builder.cuboid(
            body.dark(),
            [x, side * (outer - half_y), z],
            [0.06, half_y, 0.22],
        );
    }
}
