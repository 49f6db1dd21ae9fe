//! Curves of straight lines between points.

/// Value of a piecewise linear curve: constant before its first and after its last point, `empty`
/// without points.
pub(crate) fn along(points: &[[f32; 2]], x: f32, empty: f32) -> f32 {
    let after = points.partition_point(|[at, _]| *at < x);
    match (
        after.checked_sub(1).and_then(|i| points.get(i)),
        points.get(after),
    ) {
        (Some([a, low]), Some([b, high])) => low + (high - low) * (x - a) / (b - a).max(1e-9),
        (Some([_, y]), None) | (None, Some([_, y])) => *y,
        (None, None) => empty,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn curves_are_straight_between_points_and_flat_outside() {
        let points = [[1.0, 10.0], [3.0, 20.0]];
        assert_eq!(
            [0.0, 1.0, 2.0, 3.0, 9.0].map(|x| along(&points, x, 7.0)),
            [10.0, 10.0, 15.0, 20.0, 20.0]
        );
        assert_eq!(along(&[], 5.0, 7.0), 7.0);
    }
}
