//! Motions over a part of a trajectory, and how wrong they are.

use nalgebra::Isometry3;

/// KITTI's lengths, metres, and what stands for them where no drive is long enough.
const LENGTHS_M: [f64; 8] = [100.0, 200.0, 300.0, 400.0, 500.0, 600.0, 700.0, 800.0];
const SHORT: f64 = 0.1;

/// Errors over segments.
pub(super) struct Errors {
    /// Of translation and of rotation, radians; both per metre.
    pub(super) found: Vec<(f64, f64)>,
    /// Lengths of segments that occurred, metres.
    pub(super) shortest_and_longest_m: [f64; 2],
}

/// A trajectory, and the results that were laid on it.
pub(super) struct Laid<'a> {
    pub(super) truths: &'a [Isometry3<f64>],
    pub(super) results: Vec<Isometry3<f64>>,
}

/// What takes the true motion between two poses to the one that was given.
pub(super) fn error(
    truths: &[Isometry3<f64>],
    results: &[Isometry3<f64>],
    from: usize,
    to: usize,
) -> Isometry3<f64> {
    let motion = |poses: &[Isometry3<f64>]| poses[from].inv_mul(&poses[to]);
    motion(truths).inv_mul(&motion(results))
}

/// Length of the path to each pose, metres.
fn path_m(poses: &[Isometry3<f64>]) -> Vec<f64> {
    let mut path = vec![0.0; poses.len()];
    for at in 1..poses.len() {
        let step = poses[at].translation.vector - poses[at - 1].translation.vector;
        path[at] = path[at - 1] + step.norm();
    }
    path
}

/// Steps of so many metres of the true path, as pairs of poses.
pub(super) fn steps(
    truths: &[Isometry3<f64>],
    metres: f64,
    all_pairs: bool,
) -> Vec<(usize, usize)> {
    let path = path_m(truths);
    let mut steps = Vec::new();
    if !all_pairs {
        let mut from = 0;
        for to in 1..path.len() {
            if path[to] - path[from] >= metres {
                steps.push((from, to));
                from = to;
            }
        }
        return steps;
    }
    for from in 0..path.len().saturating_sub(1) {
        let end = path[from] + metres;
        let above = path.partition_point(|&length| length < end).max(from + 1);
        let off = |at: &usize| (path[*at] - end).abs();
        // Of poses that are equally near, the first, as evo takes it.
        let near = [above.saturating_sub(1), above]
            .into_iter()
            .filter(|at| (from + 1..path.len()).contains(at));
        let Some(nearest) = near.min_by(|a, b| off(a).total_cmp(&off(b))) else {
            continue;
        };
        let to = path
            .partition_point(|&length| length < path[nearest])
            .max(from + 1);
        if off(&to) <= 0.1 * metres {
            steps.push((from, to));
        }
    }
    steps
}

/// Errors over KITTI's lengths in all sequences.
pub(super) fn errors(sequences: &[Laid<'_>], segment_frames: usize) -> Errors {
    let paths: Vec<_> = sequences.iter().map(|laid| path_m(laid.truths)).collect();
    let is_long = |path: &Vec<f64>| path.last().is_some_and(|&length| length > LENGTHS_M[0]);
    let factor = if paths.iter().any(is_long) {
        1.0
    } else {
        SHORT
    };
    let mut errors = Errors {
        found: Vec::new(),
        shortest_and_longest_m: [f64::INFINITY, 0.0],
    };
    for (Laid { truths, results }, path) in sequences.iter().zip(&paths) {
        for from in (0..truths.len()).step_by(segment_frames.max(1)) {
            for length in LENGTHS_M.map(|length| factor * length) {
                let to = path.partition_point(|&at| at <= path[from] + length);
                if to == path.len() {
                    break;
                }
                let error = error(truths, results, from, to);
                let shift = error.translation.vector.norm();
                errors
                    .found
                    .push((shift / length, error.rotation.angle() / length));
                let [shortest, longest] = &mut errors.shortest_and_longest_m;
                (*shortest, *longest) = (shortest.min(length), longest.max(length));
            }
        }
    }
    errors
}
