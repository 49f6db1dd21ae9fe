//! Vectors of WGSL as arrays, and its functions of geometry.

use sensor_core::vector_lanes::Lanes;

macro_rules! by_component {
    ($each:ident $zip:ident $n:literal: $($i:literal)*) => {
        /// The function of every component.
        #[inline(always)]
        pub fn $each<T: Copy, U>(a: [T; $n], f: impl Fn(T) -> U) -> [U; $n] {
            [$(f(a[$i])),*]
        }

        /// The function of every pair of components.
        #[inline(always)]
        pub fn $zip<T: Copy, U: Copy, V>(
            a: [T; $n],
            b: [U; $n],
            f: impl Fn(T, U) -> V,
        ) -> [V; $n] {
            [$(f(a[$i], b[$i])),*]
        }
    };
}
by_component!(each2 zip2 2: 0 1);
by_component!(each3 zip3 3: 0 1 2);
by_component!(each4 zip4 4: 0 1 2 3);

/// Dot product, summed from the first component on.
#[inline(always)]
pub fn dot<L: Lanes, const N: usize>(a: [L; N], b: [L; N]) -> L {
    let mut sum = a[0].mul(b[0]);
    let mut i = 1;
    while i < N {
        sum = sum.add(a[i].mul(b[i]));
        i += 1;
    }
    sum
}

/// Cross product.
#[inline(always)]
pub fn cross<L: Lanes>(a: [L; 3], b: [L; 3]) -> [L; 3] {
    [
        a[1].mul(b[2]).sub(a[2].mul(b[1])),
        a[2].mul(b[0]).sub(a[0].mul(b[2])),
        a[0].mul(b[1]).sub(a[1].mul(b[0])),
    ]
}

/// Length.
#[inline(always)]
pub fn length<L: Lanes, const N: usize>(a: [L; N]) -> L {
    dot(a, a).sqrt()
}

/// The vector of length 1 in this direction. The zero vector, for which WGSL leaves the result open,
/// stays zero.
#[inline(always)]
pub fn normalize<L: Lanes, const N: usize>(a: [L; N]) -> [L; N] {
    let squared = dot(a, a).max(L::splat(f32::MIN_POSITIVE));
    let per_length = L::splat(1.0).div(squared.sqrt());
    let mut out = a;
    let mut i = 0;
    while i < N {
        out[i] = a[i].mul(per_length);
        i += 1;
    }
    out
}

/// The direction that a mirror with this normal throws `a` into.
#[inline(always)]
pub fn reflect<L: Lanes, const N: usize>(a: [L; N], normal: [L; N]) -> [L; N] {
    let twice = L::splat(2.0).mul(dot(normal, a));
    let mut out = a;
    let mut i = 0;
    while i < N {
        out[i] = a[i].sub(twice.mul(normal[i]));
        i += 1;
    }
    out
}

#[cfg(test)]
mod tests {
    use sensor_core::vector_lanes::{LaneWork, in_arrays, in_lanes};

    use super::*;

    struct Geometry([[f32; 8]; 6]);

    impl LaneWork for Geometry {
        type Out = Vec<[f32; 8]>;

        #[inline(always)]
        fn run<L: Lanes>(self) -> Self::Out {
            let [ax, ay, az, bx, by, bz] = self.0.map(|x| L::load(&x));
            let (a, b) = ([ax, ay, az], [bx, by, bz]);
            let unit = normalize(b);
            let [cx, cy, cz] = cross(a, b);
            let [rx, ry, rz] = reflect(a, unit);
            let [x, y, z] = unit;
            [dot(a, b), length(a), cx, cy, cz, rx, ry, rz, x, y, z]
                .map(L::store)
                .to_vec()
        }
    }

    #[test]
    fn geometry_is_that_of_f64() {
        let mut rng = fastrand::Rng::with_seed(3);
        for _ in 0..500 {
            let numbers: [[f32; 8]; 6] =
                std::array::from_fn(|_| std::array::from_fn(|_| rng.f32() * 20.0 - 10.0));
            let found = in_lanes(Geometry(numbers));
            assert_eq!(found, in_arrays(Geometry(numbers)));
            for lane in 0..8 {
                let [ax, ay, az, bx, by, bz] = numbers.map(|x| x[lane] as f64);
                let long = (bx * bx + by * by + bz * bz).sqrt();
                let unit = [bx / long, by / long, bz / long];
                let along = ax * unit[0] + ay * unit[1] + az * unit[2];
                let expected = [
                    ax * bx + ay * by + az * bz,
                    (ax * ax + ay * ay + az * az).sqrt(),
                    ay * bz - az * by,
                    az * bx - ax * bz,
                    ax * by - ay * bx,
                    ax - 2.0 * along * unit[0],
                    ay - 2.0 * along * unit[1],
                    az - 2.0 * along * unit[2],
                    unit[0],
                    unit[1],
                    unit[2],
                ];
                for (i, (found, expected)) in found.iter().zip(expected).enumerate() {
                    let error = (found[lane] as f64 - expected).abs();
                    // Products reach 300, and each sum rounds to 2⁻²⁴ of them.
                    assert!(error < 1e-4, "{i}: {} for {expected}", found[lane]);
                }
            }
        }
    }

    #[test]
    fn the_zero_vector_has_no_direction() {
        let zero = in_lanes(Geometry([[0.0; 8]; 6]));
        assert!(zero.iter().flatten().all(|x| *x == 0.0), "{zero:?}");
    }
}
