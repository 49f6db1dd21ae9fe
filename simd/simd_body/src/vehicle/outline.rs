//! Outlines of cars: stations from the front to the rear, one table for each body.

use super::shape::BodyStyle;

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

/// A cross-section of the outline. Heights and widths are shares of the box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Station {
    /// Place along the body: 0 at the front, 1 at the rear.
    pub u: f32,
    /// Height of the belt line, below the windows.
    pub belt: f32,
    /// Height of the roof line.
    pub top: f32,
    /// Width at the belt line.
    pub width: f32,
    /// Width of the roof.
    pub roof: f32,
    /// What the skin is from here to the next station.
    pub part: Part,
}

/// A row of a table: u, belt, top, width, roof, part.
const fn at(u: f32, belt: f32, top: f32, width: f32, roof: f32, part: Part) -> Station {
    Station {
        u,
        belt,
        top,
        width,
        roof,
        part,
    }
}

const SALOON: &[Station] = &[
    at(0.000, 0.40, 0.43, 0.74, 0.90, Panel),
    at(0.012, 0.435, 0.47, 0.87, 0.90, Panel),
    at(0.050, 0.475, 0.515, 0.955, 0.90, Panel),
    at(0.150, 0.530, 0.580, 1.000, 0.90, Panel),
    at(0.270, 0.585, 0.640, 1.000, 0.88, Screen),
    at(0.345, 0.600, 0.820, 1.000, 0.82, Screen),
    at(0.420, 0.612, 0.955, 1.000, 0.77, Cabin),
    at(0.520, 0.622, 0.998, 1.000, 0.76, Pillar),
    at(0.545, 0.625, 1.000, 1.000, 0.76, Gap),
    at(0.549, 0.625, 1.000, 1.000, 0.76, Cabin),
    at(0.660, 0.637, 0.985, 1.000, 0.76, Cabin),
    at(0.715, 0.645, 0.955, 1.000, 0.76, Screen),
    at(0.800, 0.655, 0.800, 1.000, 0.81, Screen),
    at(0.865, 0.660, 0.705, 0.995, 0.88, Panel),
    at(0.960, 0.655, 0.695, 0.965, 0.90, Panel),
    at(0.990, 0.620, 0.655, 0.900, 0.90, Panel),
    at(1.000, 0.560, 0.590, 0.790, 0.90, Panel),
];

const HATCH: &[Station] = &[
    at(0.000, 0.38, 0.41, 0.76, 0.90, Panel),
    at(0.014, 0.43, 0.47, 0.88, 0.90, Panel),
    at(0.055, 0.48, 0.525, 0.96, 0.90, Panel),
    at(0.140, 0.535, 0.590, 1.000, 0.90, Panel),
    at(0.235, 0.575, 0.640, 1.000, 0.88, Screen),
    at(0.325, 0.590, 0.830, 1.000, 0.83, Screen),
    at(0.405, 0.600, 0.955, 1.000, 0.79, Cabin),
    at(0.530, 0.610, 0.998, 1.000, 0.78, Pillar),
    at(0.560, 0.612, 1.000, 1.000, 0.78, Gap),
    at(0.565, 0.612, 1.000, 1.000, 0.78, Cabin),
    at(0.720, 0.630, 0.990, 1.000, 0.78, Cabin),
    at(0.800, 0.640, 0.970, 1.000, 0.78, Pillar),
    at(0.880, 0.655, 0.930, 0.985, 0.77, Screen),
    at(0.960, 0.660, 0.720, 0.960, 0.85, Panel),
    at(0.988, 0.600, 0.640, 0.910, 0.90, Panel),
    at(1.000, 0.520, 0.560, 0.810, 0.90, Panel),
];

const SUV: &[Station] = &[
    at(0.000, 0.44, 0.47, 0.78, 0.90, Panel),
    at(0.012, 0.485, 0.525, 0.90, 0.90, Panel),
    at(0.050, 0.525, 0.575, 0.965, 0.90, Panel),
    at(0.140, 0.560, 0.615, 1.000, 0.90, Panel),
    at(0.255, 0.590, 0.655, 1.000, 0.89, Screen),
    at(0.320, 0.600, 0.820, 1.000, 0.84, Screen),
    at(0.385, 0.608, 0.950, 1.000, 0.80, Cabin),
    at(0.510, 0.616, 0.992, 1.000, 0.79, Pillar),
    at(0.535, 0.618, 0.995, 1.000, 0.79, Gap),
    at(0.539, 0.618, 0.995, 1.000, 0.79, Cabin),
    at(0.700, 0.628, 1.000, 1.000, 0.79, Pillar),
    at(0.730, 0.630, 1.000, 1.000, 0.79, Cabin),
    at(0.860, 0.640, 0.985, 0.995, 0.79, Pillar),
    at(0.925, 0.650, 0.955, 0.985, 0.79, Screen),
    at(0.972, 0.655, 0.700, 0.965, 0.86, Panel),
    at(0.990, 0.600, 0.640, 0.920, 0.90, Panel),
    at(1.000, 0.480, 0.520, 0.830, 0.90, Panel),
];

const VAN: &[Station] = &[
    at(0.000, 0.34, 0.37, 0.82, 0.90, Panel),
    at(0.012, 0.385, 0.42, 0.92, 0.90, Panel),
    at(0.045, 0.42, 0.46, 0.97, 0.90, Panel),
    at(0.130, 0.465, 0.515, 1.000, 0.90, Screen),
    at(0.190, 0.490, 0.720, 1.000, 0.88, Screen),
    at(0.255, 0.500, 0.930, 1.000, 0.86, Cabin),
    at(0.340, 0.505, 0.985, 1.000, 0.86, Pillar),
    at(0.375, 0.505, 0.992, 1.000, 0.86, Gap),
    at(0.379, 0.505, 0.992, 1.000, 0.86, Panel),
    at(0.560, 0.505, 1.000, 1.000, 0.86, Gap),
    at(0.564, 0.505, 1.000, 1.000, 0.86, Panel),
    at(0.930, 0.505, 1.000, 1.000, 0.86, Panel),
    at(0.985, 0.505, 0.990, 0.985, 0.86, Panel),
    at(1.000, 0.500, 0.970, 0.960, 0.85, Panel),
];

const WEDGE: &[Station] = &[
    at(0.000, 0.47, 0.50, 0.84, 0.92, Panel),
    at(0.012, 0.51, 0.54, 0.93, 0.92, Panel),
    at(0.050, 0.535, 0.565, 0.970, 0.92, Panel),
    at(0.170, 0.575, 0.655, 1.000, 0.91, Screen),
    at(0.300, 0.598, 0.837, 1.000, 0.84, Screen),
    at(0.345, 0.606, 0.900, 1.000, 0.81, Cabin),
    at(0.417, 0.614, 1.000, 1.000, 0.76, Cabin),
    at(0.500, 0.620, 0.952, 1.000, 0.77, Pillar),
    at(0.525, 0.622, 0.938, 1.000, 0.775, Gap),
    at(0.529, 0.622, 0.936, 1.000, 0.775, Cabin),
    at(0.640, 0.632, 0.873, 1.000, 0.80, Panel),
    at(0.800, 0.645, 0.781, 1.000, 0.86, Panel),
    at(0.960, 0.655, 0.700, 0.990, 0.91, Panel),
    at(0.990, 0.620, 0.660, 0.960, 0.91, Panel),
    at(1.000, 0.540, 0.580, 0.880, 0.91, Panel),
];

const MICROBUS: &[Station] = &[
    at(0.000, 0.465, 0.490, 0.880, 0.93, Panel),
    at(0.014, 0.500, 0.530, 0.960, 0.93, Panel),
    at(0.040, 0.530, 0.580, 1.000, 0.92, Screen),
    at(0.118, 0.540, 0.895, 1.000, 0.86, Pillar),
    at(0.128, 0.540, 0.915, 1.000, 0.855, Cabin),
    at(0.170, 0.540, 0.955, 1.000, 0.85, Cabin),
    at(0.298, 0.540, 0.984, 1.000, 0.84, Pillar),
    at(0.330, 0.540, 0.987, 1.000, 0.84, Gap),
    at(0.334, 0.540, 0.987, 1.000, 0.84, Cabin),
    at(0.500, 0.540, 1.000, 1.000, 0.84, Pillar),
    at(0.530, 0.540, 1.000, 1.000, 0.84, Cabin),
    at(0.705, 0.540, 0.994, 1.000, 0.84, Pillar),
    at(0.735, 0.540, 0.991, 1.000, 0.84, Cabin),
    at(0.900, 0.540, 0.965, 1.000, 0.85, Pillar),
    at(0.938, 0.540, 0.930, 0.998, 0.86, Screen),
    at(0.962, 0.535, 0.760, 0.992, 0.89, Screen),
    at(0.984, 0.525, 0.570, 0.975, 0.92, Panel),
    at(0.993, 0.500, 0.530, 0.945, 0.93, Panel),
    at(1.000, 0.465, 0.490, 0.890, 0.93, Panel),
];

pub(super) fn table(style: BodyStyle) -> &'static [Station] {
    match style {
        BodyStyle::Saloon => SALOON,
        BodyStyle::Suv => SUV,
        BodyStyle::Van => VAN,
        BodyStyle::Microbus => MICROBUS,
        BodyStyle::Wedge => WEDGE,
        _ => HATCH,
    }
}

/// The outline at the place `u`, between the stations of a table.
pub(super) fn interpolate(table: &[Station], u: f32) -> Station {
    let next = table
        .iter()
        .position(|s| s.u > u + 1e-5)
        .unwrap_or(table.len() - 1)
        .max(1);
    let (a, b) = (table[next - 1], table[next]);
    let k = ((u - a.u) / (b.u - a.u)).clamp(0.0, 1.0);
    let mix = |p: f32, q: f32| p + (q - p) * k;
    let part = if u >= b.u - 1e-5 { b.part } else { a.part };
    Station {
        u,
        belt: mix(a.belt, b.belt),
        top: mix(a.top, b.top),
        width: mix(a.width, b.width),
        roof: mix(a.roof, b.roof),
        part,
    }
}
