//! Road marks, crosswalks and parking bays, laid on the very triangles of the road.

use schema_roads::{LaneSurface, SectionSurface, SurfaceMark};
use schema_types::{Class, ObjectId};
use sensor_core::Material;
use sensor_core::mesh::Surface;

use super::builder::ImportBuilder;
use crate::geometry::{P2, cross, flat};
use crate::scenery::{Key, Layer, Levels};

/// Height of paint over the road.
pub(super) const PAINT_M: f64 = 0.004;
/// Width of a stripe of a crosswalk, and from one to the next.
const ZEBRA_M: (f64, f64) = (0.5, 1.0);
/// Greatest number of dashes in a map.
const MAX_DASHES: usize = 300_000;

/// Adds all paint.
pub(super) fn build(builder: &mut ImportBuilder, sections: &[SectionSurface]) {
    let object = builder.object(Class::ROAD_LINES, "road marks");
    let mut left = MAX_DASHES;
    for section in sections {
        let right = section.lanes.iter().rposition(|lane| lane.lane < 0);
        let left_first = section.lanes.iter().position(|lane| lane.lane > 0);
        let beside = Beside {
            right: right.map(|i| &section.lanes[i]),
            left: left_first.map(|i| &section.lanes[i]),
        };
        for mark in &section.centre_marks {
            draw(builder, section, mark, &beside, object, &mut left);
        }
        for (idx, lane) in section.lanes.iter().enumerate() {
            // A lane's marks are on its outer edge.
            let beside = if lane.lane < 0 {
                Beside {
                    right: idx.checked_sub(1).map(|i| &section.lanes[i]),
                    left: Some(lane),
                }
            } else {
                Beside {
                    right: Some(lane),
                    left: section.lanes.get(idx + 1),
                }
            };
            for mark in &lane.marks {
                draw(builder, section, mark, &beside, object, &mut left);
            }
        }
    }
    crosswalks(builder, object);
}

/// The lanes on both sides of a line.
struct Beside<'s> {
    right: Option<&'s LaneSurface>,
    left: Option<&'s LaneSurface>,
}

impl Beside<'_> {
    /// The point `t_m` to the left of the edge in row `row`, on the lane's surface.
    fn point(&self, row: usize, t_m: f64) -> Option<[f64; 3]> {
        let edge_of = |lane: &LaneSurface, leftmost: bool| {
            let points = lane.row(row);
            let n = lane.columns;
            if leftmost {
                (points[n - 1], points[n - 2])
            } else {
                (points[0], points[1])
            }
        };
        let on_left = self.left.map(|lane| edge_of(lane, false));
        let on_right = self.right.map(|lane| edge_of(lane, true));
        let usable = |pair: &Option<([f64; 3], [f64; 3])>| {
            pair.is_some_and(|(a, b)| (flat(a) - flat(b)).norm() > 0.02)
        };
        // Where two lanes meet at a step, the paint lies on the lower one: kerb stones are not
        // painted.
        let low = |pair: &Option<([f64; 3], [f64; 3])>| pair.map_or(f64::INFINITY, |(a, _)| a[2]);
        let prefer_left = if t_m >= 0.0 {
            low(&on_left) <= low(&on_right) + 0.01
        } else {
            low(&on_left) < low(&on_right) - 0.01
        };
        let (first, second) = if prefer_left {
            ((on_left, 1.0), (on_right, -1.0))
        } else {
            ((on_right, -1.0), (on_left, 1.0))
        };
        let ((edge, inner), sign) = [first, second]
            .into_iter()
            .find(|(pair, _)| usable(pair))
            .and_then(|(pair, sign)| Some((pair?, sign)))?;
        let across = nalgebra::Vector3::from(inner) - nalgebra::Vector3::from(edge);
        let p = nalgebra::Vector3::from(edge) + across.normalize() * (t_m * sign);
        Some([p.x, p.y, p.z + PAINT_M])
    }
}

fn draw(
    builder: &mut ImportBuilder,
    section: &SectionSurface,
    mark: &SurfaceMark,
    beside: &Beside,
    object: ObjectId,
    left: &mut usize,
) {
    for stripe in &mark.stripes {
        let surface =
            Surface::new(Class::ROAD_LINES, Material::Paint, stripe.colour.rgb()).of(object);
        let edges = (
            stripe.t_offset_m - 0.5 * stripe.width_m,
            stripe.t_offset_m + 0.5 * stripe.width_m,
        );
        let period = stripe.length_m + stripe.space_m;
        let mut from = mark.from_m + stripe.s_offset_m;
        let continuous = stripe.length_m <= 0.0 || period <= 0.0;
        while from < mark.to_m - 1e-3 && *left > 0 {
            *left -= 1;
            let to = if continuous {
                mark.to_m
            } else {
                (from + stripe.length_m).min(mark.to_m)
            };
            strip(builder, section, beside, surface, (from, to), edges, 0..=1);
            if continuous {
                break;
            }
            from += period;
        }
    }
}

/// A stripe between two stations; between rows it follows the chords, as the road does.
fn strip(
    builder: &mut ImportBuilder,
    section: &SectionSurface,
    beside: &Beside,
    surface: Surface,
    (from_m, to_m): (f64, f64),
    (right_m, left_m): (f64, f64),
    levels: Levels,
) {
    let rows = &section.stations_m;
    let at = |s: f64, t: f64| {
        let row = rows
            .partition_point(|station| *station <= s)
            .clamp(1, rows.len() - 1);
        let share = ((s - rows[row - 1]) / (rows[row] - rows[row - 1]).max(1e-9)).clamp(0.0, 1.0);
        let (a, b) = (beside.point(row - 1, t)?, beside.point(row, t)?);
        Some(std::array::from_fn(|i| a[i] + share * (b[i] - a[i])))
    };
    let mut stations = vec![from_m];
    let first = rows.partition_point(|s| *s <= from_m + 0.01);
    stations.extend(rows[first..].iter().take_while(|s| **s < to_m - 0.01));
    stations.push(to_m);
    for pair in stations.windows(2) {
        let corners = [
            at(pair[0], right_m),
            at(pair[1], right_m),
            at(pair[1], left_m),
            at(pair[0], left_m),
        ];
        let [Some(a), Some(b), Some(c), Some(d)] = corners else {
            continue;
        };
        patch(builder, surface, &[a, b, c, d], levels.clone());
    }
}

/// Adds a painted polygon, counter-clockwise from above.
pub(super) fn patch(
    builder: &mut ImportBuilder,
    surface: Surface,
    corners: &[[f64; 3]],
    levels: Levels,
) {
    let uv: Vec<[f32; 2]> = corners.iter().map(|c| [c[0] as f32, c[1] as f32]).collect();
    builder.chunks.polygon(
        Key::at(Layer::Ground, flat(corners[0])),
        levels,
        surface,
        corners,
        &uv,
    );
}

/// Zebra stripes across the walking direction, which is that of the outline's longest side.
fn crosswalks(builder: &mut ImportBuilder, object: ObjectId) {
    let white = Surface::new(Class::ROAD_LINES, Material::Paint, [226, 226, 220]).of(object);
    for walk in builder.roads.crosswalks() {
        let mut corners: Vec<P2> = walk
            .corners
            .iter()
            .map(|p| flat(builder.local(*p)))
            .collect();
        corners.dedup_by(|a, b| (*a - *b).norm() < 1e-3);
        let n = corners.len();
        if n < 3 {
            continue;
        }
        let longest = (0..n)
            .map(|i| corners[(i + 1) % n] - corners[i])
            .max_by(|a, b| a.norm().total_cmp(&b.norm()));
        let Some(along) = longest.and_then(|side| side.try_normalize(1e-6)) else {
            continue;
        };
        let place = |p: &P2| p.dot(&along);
        let (low, high) = corners
            .iter()
            .map(place)
            .fold((f64::MAX, f64::MIN), |(l, h), x| (l.min(x), h.max(x)));
        let stripes = ((high - low - 0.4) / ZEBRA_M.1).floor().clamp(1.0, 60.0);
        let start = 0.5 * (low + high) - 0.5 * (stripes - 1.0) * ZEBRA_M.1 - 0.5 * ZEBRA_M.0;
        for k in 0..stripes as usize {
            let from = start + k as f64 * ZEBRA_M.1;
            let cut = clip(&clip(&corners, along, from), -along, -(from + ZEBRA_M.0));
            if cut.len() < 3 {
                continue;
            }
            let mut points: Vec<[f64; 3]> = cut
                .iter()
                .map(|p| [p.x, p.y, builder.floor(*p) + PAINT_M + 0.002])
                .collect();
            let area: f64 = (0..cut.len())
                .map(|i| cross(cut[i], cut[(i + 1) % cut.len()]))
                .sum();
            if area < 0.0 {
                points.reverse();
            }
            patch(builder, white, &points, 0..=0);
        }
    }
}

/// The part of a convex polygon with `p · axis ≥ least`.
fn clip(corners: &[P2], axis: P2, least: f64) -> Vec<P2> {
    let mut out = Vec::new();
    for i in 0..corners.len() {
        let (a, b) = (corners[i], corners[(i + 1) % corners.len()]);
        let (da, db) = (a.dot(&axis) - least, b.dot(&axis) - least);
        if da >= 0.0 {
            out.push(a);
        }
        if (da >= 0.0) != (db >= 0.0) {
            out.push(a + (b - a) * (da / (da - db)));
        }
    }
    out
}
