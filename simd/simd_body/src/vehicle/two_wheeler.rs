//! Motorcycle and bicycle, each with a rider.

use schema_types::Class;
use sensor_core::mesh::Surface;
use sensor_core::{Material, MeshBuilder};

use super::bodywork::Bodywork;
use super::shape::BodyStyle;
use crate::solid::{ellipsoid, tube};

/// Half the width of a rider at the shoulders, metres.
const WIDTH_M: f32 = 0.216;

/// One level of a two-wheeler with its rider.
pub fn body(builder: &mut MeshBuilder, body: &Bodywork, style: BodyStyle, detail: usize) {
    let n = [10, 6, 4][detail];
    if style == BodyStyle::Motorcycle {
        motorcycle(builder, body, n)
    } else {
        bicycle(builder, body, n)
    }
    rider(builder, body, style == BodyStyle::Motorcycle, n);
}

fn motorcycle(builder: &mut MeshBuilder, body: &Bodywork, n: usize) {
    let (l, h, r) = (body.half[0], body.height(), body.wheel_radius_m);
    let axle = 0.5 * body.wheelbase_m;
    let metal = Surface::new(body.class, Material::Metal, [150, 152, 156]);
    let bar = 0.66 * h;
    for side in [0.07, -0.07] {
        tube(
            builder,
            metal,
            ([axle, side, r], 0.025),
            ([axle - 0.24, side, bar], 0.03),
            n,
        );
        tube(
            builder,
            body.dark(),
            ([-axle, side * 1.3, r], 0.03),
            ([-0.1, side * 1.3, r + 0.05], 0.04),
            n,
        );
        tube(
            builder,
            metal,
            ([-0.1, side * 2.0, r - 0.02], 0.04),
            ([-axle - 0.12, side * 2.0, r + 0.08], 0.055),
            n,
        );
    }
    ellipsoid(
        builder,
        body.dark(),
        [0.02, 0.0, r + 0.1],
        [0.26, 0.16, 0.2],
        n,
    );
    ellipsoid(
        builder,
        body.paint(),
        [0.16, 0.0, 0.58 * h],
        [0.30, 0.15, 0.13],
        n,
    );
    ellipsoid(
        builder,
        body.dark(),
        [-0.28, 0.0, 0.56 * h],
        [0.34, 0.14, 0.07],
        n,
    );
    ellipsoid(
        builder,
        body.paint(),
        [-0.5 * l, 0.0, 0.56 * h],
        [0.28, 0.1, 0.08],
        n,
    );
    ellipsoid(
        builder,
        body.paint(),
        [axle, 0.0, r * 1.75],
        [0.2, 0.06, 0.05],
        n,
    );
    tube(
        builder,
        body.dark(),
        ([axle - 0.26, body.half[1], bar + 0.03], 0.018),
        ([axle - 0.26, -body.half[1], bar + 0.03], 0.018),
        n,
    );
    builder.cuboid(
        body.lamp([255, 246, 224], 1),
        [axle - 0.12, 0.0, bar - 0.06],
        [0.05, 0.08, 0.08],
    );
    builder.cuboid(
        body.lamp([255, 24, 18], 3),
        [-0.5 * l - 0.28, 0.0, 0.56 * h],
        [0.02, 0.07, 0.035],
    );
    for (side, bit) in [(0.16, 5), (-0.16, 4)] {
        builder.cuboid(
            body.lamp([255, 160, 30], bit),
            [axle - 0.16, side, bar - 0.05],
            [0.03, 0.02, 0.02],
        );
        builder.cuboid(
            body.lamp([255, 160, 30], bit),
            [-0.5 * l - 0.24, side, 0.55 * h],
            [0.03, 0.02, 0.02],
        );
    }
    extremes(builder, body);
}

fn bicycle(builder: &mut MeshBuilder, body: &Bodywork, n: usize) {
    let (h, r) = (body.height(), body.wheel_radius_m);
    let axle = 0.5 * body.wheelbase_m;
    let n = n.min(6);
    let paint = body.paint();
    let (saddle, head, crank) = (
        [-0.22, 0.0, 0.60 * h],
        [axle - 0.16, 0.0, 0.58 * h],
        [-0.06, 0.0, r * 0.85],
    );
    for (a, b) in [
        (crank, head),
        (crank, saddle),
        (saddle, head),
        ([-axle, 0.0, r], crank),
        ([-axle, 0.0, r], saddle),
        ([axle, 0.0, r], head),
    ] {
        tube(builder, paint, (a, 0.018), (b, 0.018), n);
    }
    let bar = [head[0] - 0.03, 0.66 * h];
    tube(
        builder,
        body.dark(),
        (head, 0.015),
        ([bar[0], 0.0, bar[1]], 0.015),
        n,
    );
    tube(
        builder,
        body.dark(),
        ([bar[0], body.half[1], bar[1]], 0.015),
        ([bar[0], -body.half[1], bar[1]], 0.015),
        n,
    );
    ellipsoid(
        builder,
        body.dark(),
        [saddle[0], 0.0, saddle[2] + 0.05],
        [0.13, 0.07, 0.035],
        n,
    );
    builder.cuboid(
        body.lamp([255, 246, 224], 0),
        [head[0] + 0.06, 0.0, head[2]],
        [0.02, 0.03, 0.03],
    );
    builder.cuboid(
        body.lamp([255, 24, 18], 0),
        [saddle[0] - 0.1, 0.0, saddle[2] - 0.08],
        [0.015, 0.025, 0.025],
    );
    extremes(builder, body);
}

/// Ends of the mudguards, so that the mesh fills the box's length whatever the wheelbase.
fn extremes(builder: &mut MeshBuilder, body: &Bodywork) {
    let reach = 0.5 * body.wheelbase_m + body.wheel_radius_m;
    for side in [1.0f32, -1.0] {
        let (a, b) = (reach.min(body.half[0] - 0.06) - 0.02, body.half[0]);
        builder.cuboid(
            body.dark(),
            [side * 0.5 * (a + b), 0.0, body.wheel_radius_m * 1.1],
            [0.5 * (b - a), 0.02, 0.03],
        );
    }
}

fn rider(builder: &mut MeshBuilder, body: &Bodywork, motor: bool, n: usize) {
    let h = body.height();
    let cloth = |rgb| Surface::new(Class::RIDER, Material::Cloth, rgb);
    let (jacket, trousers, skin) = (
        cloth([58, 74, 110]),
        cloth([46, 48, 56]),
        cloth([214, 170, 140]),
    );
    // The rider is scaled to the width of the box.
    let slim = (body.half[1] / WIDTH_M).min(1.0);
    let top = h;
    let (hip, shoulder) = ([-0.20, 0.0, 0.62 * h], [0.03, 0.0, top - 0.34]);
    tube(
        builder,
        jacket,
        (hip, 0.15 * slim),
        (shoulder, 0.17 * slim),
        n,
    );
    ellipsoid(
        builder,
        if motor {
            body.paint()
        } else {
            cloth([40, 120, 90])
        },
        [0.08, 0.0, top - 0.135],
        [0.135, 0.12, 0.135],
        n,
    );
    if !motor {
        ellipsoid(
            builder,
            skin,
            [0.11, 0.0, top - 0.19],
            [0.10, 0.09, 0.11],
            n,
        );
    }
    let bar = [
        0.5 * body.wheelbase_m - if motor { 0.28 } else { 0.2 },
        0.66 * h,
    ];
    let foot = body.wheel_radius_m * 0.75;
    for side in [1.0f32, -1.0] {
        let width = (body.half[1] - 0.06).min(0.26);
        let elbow = [
            0.5 * (shoulder[0] + bar[0]),
            side * slim * (width + 0.02),
            0.5 * (shoulder[2] + bar[1]) - 0.05,
        ];
        tube(
            builder,
            jacket,
            (
                [shoulder[0], side * slim * 0.16, shoulder[2] - 0.02],
                0.055 * slim,
            ),
            (elbow, 0.045 * slim),
            n,
        );
        tube(
            builder,
            jacket,
            (elbow, 0.045 * slim),
            ([bar[0], side * slim * width, bar[1] + 0.02], 0.035),
            n,
        );
        let knee = [0.20, side * slim * 0.14, 0.5 * h];
        tube(
            builder,
            trousers,
            ([hip[0], side * slim * 0.09, hip[2]], 0.085 * slim),
            (knee, 0.065 * slim),
            n,
        );
        tube(
            builder,
            trousers,
            (knee, 0.065 * slim),
            ([-0.02, side * slim * 0.13, foot], 0.05 * slim),
            n,
        );
        builder.cuboid(
            body.dark(),
            [0.05, side * slim * 0.13, foot - 0.03],
            [0.12, 0.04 * slim, 0.035],
        );
    }
}
