//! Pixels that other programs print, and the way back over whole fields.

use std::f64::consts::PI;

use super::*;

const PLANE: Plane = Plane {
    focal_px: [500.0, 510.0],
    shear_px: [0.0; 2],
    centre_px: [400.5, 300.5],
};

fn lens(model: LensModel) -> Lens {
    Lens::new(model, PLANE, None).unwrap()
}

fn opencv(coefficients: &[f64]) -> LensModel {
    LensModel::OpenCv {
        coefficients: coefficients.to_vec(),
    }
}

const COEFFICIENTS: [f64; 14] = [
    -0.28, 0.07, 0.001, -0.0005, -0.008, 0.02, 0.01, -0.002, 0.003, -0.001, 0.002, 0.0007, 0.02,
    -0.015,
];

fn kannala_brandt() -> LensModel {
    LensModel::KannalaBrandt {
        coefficients: [0.083092, 0.011121, 0.008587, 0.000854],
    }
}

fn unified(mirror: f64) -> LensModel {
    LensModel::Unified {
        mirror,
        coefficients: vec![-0.1, 0.02, 0.001, -0.0005],
    }
}

fn ftheta(direction: PolynomialDirection, polynomial: &[f64]) -> (LensModel, Plane) {
    let plane = Plane {
        focal_px: [0.9997, 1.0],
        shear_px: [0.006, -0.01],
        centre_px: [478.36, 371.9],
    };
    let polynomial = polynomial.to_vec();
    (
        LensModel::FTheta {
            direction,
            polynomial,
        },
        plane,
    )
}

fn every_lens() -> Vec<Lens> {
    let mut all: Vec<Lens> = [
        LensModel::Pinhole {},
        opencv(&COEFFICIENTS[..5]),
        opencv(&COEFFICIENTS[..8]),
        opencv(&COEFFICIENTS[..12]),
        opencv(&COEFFICIENTS),
        // Turns back at 43°.
        opencv(&[-0.38]),
        unified(0.0),
        unified(0.8),
        unified(1.2),
        kannala_brandt(),
        LensModel::KannalaBrandt {
            coefficients: [-0.1, 0.0, 0.0, 0.0],
        },
        LensModel::Equidistant {},
        LensModel::Equisolid {},
        LensModel::Stereographic {},
        LensModel::Orthographic {},
        LensModel::DoubleSphere {
            xi: -0.2,
            alpha: 0.6,
        },
        LensModel::DoubleSphere {
            xi: 0.3,
            alpha: 0.4,
        },
        LensModel::Table {
            angles_rad: vec![0.0, 0.5, 1.2, 1.92],
            radii: vec![0.0, 0.52, 1.1, 1.5],
        },
    ]
    .map(lens)
    .into();
    for (direction, polynomial) in [
        (
            PolynomialDirection::AngleToDistance,
            [0.0, 473.6, -9.6, 24.9, -42.3, 15.1],
        ),
        (
            PolynomialDirection::DistanceToAngle,
            [0.0, 0.0021, 1.4e-7, -8.1e-10, 2.5e-12, -1.8e-15],
        ),
    ] {
        let (model, plane) = ftheta(direction, &polynomial);
        all.push(Lens::new(model, plane, None).unwrap());
    }
    all
}

/// OpenCV 5.0.0's `projectPoints`, `fisheye.projectPoints` and `omnidir.projectPoints`, and
/// dscamera 0.0.4's `world2cam`, with 0.5 added, because their first pixel's middle is (0, 0).
#[test]
fn pixels_are_those_of_other_programs() {
    let double_sphere = Plane {
        focal_px: [350.0, 360.0],
        ..PLANE
    };
    let cases: [(LensModel, Plane, [[f64; 5]; 3]); 7] = [
        (
            opencv(&COEFFICIENTS[..5]),
            PLANE,
            [
                [0.3, -0.2, 1.0, 545.077313600, 202.231626752],
                [-0.5, 0.4, 1.0, 175.968592000, 483.843088928],
                [0.6, 0.5, 1.0, 656.496845600, 518.538043760],
            ],
        ),
        (
            opencv(&COEFFICIENTS[..8]),
            PLANE,
            [
                [0.3, -0.2, 1.0, 544.678337171, 202.502930724],
                [-0.5, 0.4, 1.0, 178.131003071, 482.078561494],
                [0.6, 0.5, 1.0, 652.597146772, 515.223299757],
            ],
        ),
        (
            opencv(&COEFFICIENTS[..12]),
            PLANE,
            [
                [0.3, -0.2, 1.0, 544.864887171, 202.641564024],
                [-0.5, 0.4, 1.0, 178.661953071, 482.556773194],
                [0.6, 0.5, 1.0, 653.326096772, 515.978339457],
            ],
        ),
        (
            opencv(&COEFFICIENTS),
            PLANE,
            [
                [0.3, -0.2, 1.0, 544.952495109, 202.617816183],
                [-0.5, 0.4, 1.0, 178.529679859, 482.613338809],
                [0.6, 0.5, 1.0, 657.475955373, 519.612985088],
            ],
        ),
        (
            kannala_brandt(),
            PLANE,
            [
                [0.3, -0.2, 1.0, 545.921795927, 201.613178770],
                [-2.0, 0.5, 0.7, -318.286640146, 483.790593237],
                [3.0, 4.0, 0.2, 1039.791722381, 1169.936742438],
            ],
        ),
        (
            unified(1.2),
            PLANE,
            [
                [0.3, -0.2, 1.0, 466.224976191, 255.815551588],
                [-2.0, 0.5, 0.7, 109.037026579, 374.995893788],
                [3.0, 4.0, 0.2, 628.621468028, 611.297151462],
            ],
        ),
        (
            LensModel::DoubleSphere {
                xi: -0.2,
                alpha: 0.6,
            },
            double_sphere,
            [
                [0.3, -0.2, 1.0, 526.31298323, 214.22824007],
                [-2.0, 0.5, 0.7, -116.90559886, 433.54715399],
                [3.0, 4.0, -2.0, 858.66299886, 928.83782701],
            ],
        ),
    ];
    for (model, plane, rows) in cases {
        let lens = Lens::new(model, plane, None).unwrap();
        assert_eq!(lens.project([0.0, 0.0, 1.0]), Some(plane.centre_px));
        for [x, y, z, u, v] in rows {
            let [px, py] = lens.project([x, y, z]).unwrap();
            assert!(
                (px - u).hypot(py - v) < 1e-7,
                "{lens:?}\n{px} {py}, {u} {v}"
            );
        }
    }
}

/// Radii of the textbook's projections at 110°, which is 220° from rim to rim.
#[test]
fn fields_reach_220_degrees() {
    let theta = 110f64.to_radians();
    for (model, radius) in [
        (LensModel::Equidistant {}, theta),
        (LensModel::Equisolid {}, 2.0 * 55f64.to_radians().sin()),
        (LensModel::Stereographic {}, 2.0 * 55f64.to_radians().tan()),
        (
            kannala_brandt(),
            theta
                + 0.083092 * theta.powi(3)
                + 0.011121 * theta.powi(5)
                + 0.008587 * theta.powi(7)
                + 0.000854 * theta.powi(9),
        ),
    ] {
        let [u, v] = lens(model)
            .project([theta.sin(), 0.0, theta.cos()])
            .unwrap();
        assert!((u - 400.5 - 500.0 * radius).abs() < 1e-9 && v == 300.5);
    }
}

/// Angles from the axis up to 0.999 of the field, in 24 directions about it. A lens that is not
/// round may fold over a little earlier on one side, where it has no pixel.
#[test]
fn directions_and_pixels_come_back_over_the_whole_field() {
    for lens in every_lens() {
        let mut n_seen = 0;
        for step in 0..=200 {
            for turn in 0..24 {
                let theta = lens.max_angle_rad() * 0.999 * step as f64 / 200.0;
                let about = turn as f64 * PI / 12.0;
                let ray = [
                    theta.sin() * about.cos(),
                    theta.sin() * about.sin(),
                    theta.cos(),
                ];
                let Some(pixel) = lens.project(ray) else {
                    continue;
                };
                n_seen += 1;
                let again = lens.unproject(pixel);
                let again = again.unwrap_or_else(|| panic!("{lens:?}\n{theta} {about} {pixel:?}"));
                let off = (0..3).map(|axis| (again[axis] - ray[axis]).abs());
                let off = off.fold(0.0, f64::max);
                assert!(off < 1e-9, "{lens:?}\n{theta} {about} {off}");
                let length: f64 = again.iter().map(|it| it * it).sum();
                assert!((length - 1.0).abs() < 1e-12);
                let back = lens.project(again).unwrap();
                // Near 90° a pinhole's pixels are many focal lengths away.
                let scale = 1.0 + pixel[0].hypot(pixel[1]) / 1e3;
                let off = (back[0] - pixel[0]).hypot(back[1] - pixel[1]) / scale;
                assert!(off < 1e-9, "{lens:?}\n{theta} {about} {off}");
            }
        }
        assert!(n_seen > 201 * 24 * 9 / 10, "{lens:?}\n{n_seen}");
    }
}

/// r (1 − 0.38 r²) is greatest at r = 1 / √1.14, and θ (1 − 0.1 θ²) at θ = 1 / √0.3.
#[test]
fn what_folds_over_has_no_pixel() {
    let folds = [
        (opencv(&[-0.38]), (1.0 / 1.14f64.sqrt()).atan()),
        (
            LensModel::KannalaBrandt {
                coefficients: [-0.1, 0.0, 0.0, 0.0],
            },
            1.0 / 0.3f64.sqrt(),
        ),
    ];
    for (model, end) in folds {
        let lens = lens(model);
        assert!((lens.max_angle_rad() - end).abs() < 1e-9, "{lens:?}");
        let at = |theta: f64| lens.project([theta.sin(), 0.0, theta.cos()]);
        let last = at(end - 1e-6).unwrap();
        assert_eq!(at(end + 1e-6), None);
        assert_eq!(lens.unproject([last[0] + 1.0, last[1]]), None);
    }
    let narrow = Lens::new(LensModel::Equidistant {}, PLANE, Some(1.0)).unwrap();
    assert!(narrow.project([0.84, 0.0, 0.54]).is_some());
    assert_eq!(narrow.project([0.85, 0.0, 0.53]), None);
    assert_eq!(narrow.unproject([400.5 + 501.0, 300.5]), None);
}

#[test]
fn what_is_no_direction_and_no_pixel_is_not_seen() {
    for lens in every_lens() {
        for ray in [
            [0.0; 3],
            [f64::NAN, 0.0, 1.0],
            [0.0, 0.0, f64::NAN],
            [f64::INFINITY, f64::INFINITY, f64::INFINITY],
        ] {
            assert_eq!(lens.project(ray), None, "{lens:?} {ray:?}");
        }
        for pixel in [[f64::NAN, 0.0], [0.0, f64::INFINITY]] {
            assert_eq!(lens.unproject(pixel), None, "{lens:?} {pixel:?}");
        }
        for pixel in [[1e300, -1e300], [-1e9, 7.0], [1e5, 1e5]] {
            // Wherever it is, what is found is a direction.
            if let Some(ray) = lens.unproject(pixel) {
                assert!(ray.iter().all(|it| it.is_finite()), "{lens:?} {pixel:?}");
            }
        }
    }
}

#[test]
fn values_of_no_lens_are_refused_with_what_is_allowed() {
    let flat = |focal_px, shear_px| Plane {
        focal_px,
        shear_px,
        ..PLANE
    };
    let table = |angles: &[f64], radii: &[f64]| LensModel::Table {
        angles_rad: angles.to_vec(),
        radii: radii.to_vec(),
    };
    let folded = LensModel::FTheta {
        direction: PolynomialDirection::AngleToDistance,
        polynomial: vec![0.1, 500.0],
    };
    for (model, plane, angle, wanted) in [
        (
            LensModel::Pinhole {},
            flat([0.0, 5.0], [0.0; 2]),
            None,
            "focal_px is [0, 5], but both must be greater than 0",
        ),
        (
            LensModel::Pinhole {},
            flat([1.0, 1.0], [1.0, 1.0]),
            None,
            "shear_px is [1, 1], but its product must be less than that of the focal lengths",
        ),
        (
            LensModel::Pinhole {},
            PLANE,
            Some(4.0),
            "max_angle_rad is 4, but must lie between 0 and π",
        ),
        (
            opencv(&[0.0; 15]),
            PLANE,
            None,
            "but must be at most 14 numbers",
        ),
        (
            unified(-0.1),
            PLANE,
            None,
            "mirror is -0.1, but must be 0 to 10",
        ),
        (
            LensModel::DoubleSphere {
                xi: 0.0,
                alpha: 1.1,
            },
            PLANE,
            None,
            "alpha is 1.1, but must be 0 to 1",
        ),
        (folded, PLANE, None, "polynomial is [0.1, 500.0], but must"),
        (
            table(&[0.0, 1.0], &[0.0, -1.0]),
            PLANE,
            None,
            "radii is [0.0, -1.0], but must be two numbers or more",
        ),
        (
            table(&[0.0, 1.0], &[0.0, 1.0, 2.0]),
            PLANE,
            None,
            "but must have as many numbers as angles_rad",
        ),
    ] {
        let error = Lens::new(model, plane, angle).unwrap_err().to_string();
        assert!(error.contains(wanted), "{error}\n{wanted}");
    }
}

#[test]
fn name_and_numbers_make_a_model_again() {
    for lens in every_lens() {
        let model = lens.model();
        let again = LensModel::of(model.name(), &model.numbers());
        assert_eq!(again.as_ref(), Some(model));
    }
    for (name, numbers) in [
        ("heptafocal", &[][..]),
        ("pinhole", &[1.0]),
        ("kannala_brandt", &[1.0; 3]),
        ("ftheta", &[2.0, 0.0, 1.0]),
        ("unified", &[]),
        ("double_sphere", &[0.1]),
        ("table", &[0.0, 1.0, 0.0]),
    ] {
        assert_eq!(LensModel::of(name, numbers), None, "{name}");
    }
}
