//! Painted lines of a map, from one end of the paint to the other.

use schema_roads::{MarkKind, RoadMap};

/// Distance between points of the lines, metres.
pub(super) const STEP_M: f64 = 1.0;

/// Ends that lie nearer than this are joined, metres.
const JOIN_M: f64 = 0.3;

/// Painted lines of a map, joined where one ends and another goes on.
pub(super) fn painted(map: &RoadMap) -> Vec<Vec<[f64; 3]>> {
    let is_paint = |kind: MarkKind| {
        !matches!(
            kind,
            MarkKind::None | MarkKind::Grass | MarkKind::Kerb | MarkKind::Other
        )
    };
    let lines = map.mark_lines(STEP_M).into_iter();
    let lines = lines.filter(|line| is_paint(line.kind) && line.points.len() > 1);
    joined(lines.map(|line| line.points).collect())
}

/// Lines of which one's end is another's are one; of several that begin there the straightest.
fn joined(mut open: Vec<Vec<[f64; 3]>>) -> Vec<Vec<[f64; 3]>> {
    type Ends = std::collections::HashMap<[i64; 2], Vec<usize>>;
    let cell = |point: &[f64; 3]| [point[0], point[1]].map(|part| (part / JOIN_M).floor() as i64);
    let mut ends = Ends::new();
    for (at, line) in open.iter().enumerate() {
        for point in [&line[0], &line[line.len() - 1]] {
            ends.entry(cell(point)).or_default().push(at);
        }
    }
    let direction = |from: &[f64; 3], to: &[f64; 3]| {
        let (dx, dy) = (to[0] - from[0], to[1] - from[1]);
        let length = dx.hypot(dy).max(1e-9);
        [dx / length, dy / length]
    };
    let mut taken = vec![false; open.len()];
    let mut done = Vec::new();
    for start in 0..open.len() {
        if taken[start] {
            continue;
        }
        taken[start] = true;
        let mut line = std::mem::take(&mut open[start]);
        for _ in 0..2 {
            loop {
                let n = line.len();
                let (last, heading) = (line[n - 1], direction(&line[n - 2], &line[n - 1]));
                let [cx, cy] = cell(&last);
                let mut best: Option<(f64, usize, bool)> = None;
                for key in (-1..=1).flat_map(|dx| (-1..=1).map(move |dy| [cx + dx, cy + dy])) {
                    for &other in ends.get(&key).into_iter().flatten() {
                        if taken[other] {
                            continue;
                        }
                        let points = &open[other];
                        let m = points.len();
                        for (first, second, turned) in [
                            (points[0], points[1], false),
                            (points[m - 1], points[m - 2], true),
                        ] {
                            let near = (first[0] - last[0]).hypot(first[1] - last[1]) < JOIN_M
                                && (first[2] - last[2]).abs() < 1.0;
                            let on = direction(&first, &second);
                            let straight = heading[0] * on[0] + heading[1] * on[1];
                            let is_better = best.is_none_or(|(other, ..)| straight > other);
                            if near && straight > 0.9 && is_better {
                                best = Some((straight, other, turned));
                            }
                        }
                    }
                }
                let Some((_, other, turned)) = best else {
                    break;
                };
                taken[other] = true;
                let mut points = std::mem::take(&mut open[other]);
                if turned {
                    points.reverse();
                }
                line.extend(points.into_iter().skip(1));
            }
            line.reverse();
        }
        done.push(line);
    }
    done
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stretches_are_joined_whichever_way_they_run_and_forks_go_straight() {
        let along = |from: f64, to: f64, y: f64| {
            let n = 10;
            let step = (to - from) / f64::from(n);
            (0..=n)
                .map(|i| [from + step * f64::from(i), y, 0.0])
                .collect::<Vec<_>>()
        };
        // Two stretches that meet head to head, a fork to the side, and a line apart.
        let mut back = along(20.0, 10.0, 0.1);
        let fork: Vec<[f64; 3]> = (0..10).map(|i| [10.0, f64::from(i), 0.0]).collect();
        let lines = joined(vec![
            along(0.0, 10.0, 0.0),
            fork,
            std::mem::take(&mut back),
            along(0.0, 5.0, 7.0),
        ]);
        let mut lengths: Vec<usize> = lines.iter().map(Vec::len).collect();
        lengths.sort_unstable();
        assert_eq!(lengths, [10, 11, 21]);
    }
}
