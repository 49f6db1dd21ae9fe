//! What is written is read again as the same lens; what a format cannot say is refused.

use nalgebra::{Isometry3, Translation3, UnitQuaternion};
use schema_calibration::{Camera, Format, read, write};
use schema_types::lens::{Lens, LensModel, Plane, PolynomialDirection};

const SIZE: [u32; 2] = [1234, 567];

fn camera(model: LensModel) -> Camera {
    let is_polynomial = matches!(model, LensModel::FTheta { .. });
    let plane = Plane {
        focal_px: match is_polynomial {
            true => [1.0004, 0.998],
            false => [431.7123456789012, 433.1],
        },
        shear_px: match is_polynomial {
            true => [-0.0002, 0.0003],
            false => [0.0; 2],
        },
        centre_px: [615.123456789, 281.987654321012],
    };
    Camera {
        name: "front".into(),
        size_px: SIZE,
        lens: Lens::new(model, plane, None).unwrap(),
        max_angle_rad: None,
        carrier_from_sensor: Some(Isometry3::from_parts(
            Translation3::new(1.5, -0.25, 1.4),
            UnitQuaternion::from_euler_angles(0.01, 0.1, -0.7),
        )),
    }
}

/// A lens of each model and what some formats tell apart.
fn all() -> Vec<(&'static str, Camera)> {
    let opencv = |n: usize| LensModel::OpenCv {
        coefficients: [
            -0.28, 0.07, 2e-4, 1.76e-5, 0.0123, 0.3, 0.02, -0.004, 1e-3, -2e-4, 3e-4, 1e-5, 0.01,
            -0.02,
        ][..n]
            .to_vec(),
    };
    let polynomial = |direction| LensModel::FTheta {
        direction,
        polynomial: match direction {
            PolynomialDirection::AngleToDistance => vec![0.0, 435.25, 3.5, -8.5, 1.25],
            PolynomialDirection::DistanceToAngle => vec![0.0, 2.3e-3, -2e-8, 5e-11],
        },
    };
    [
        ("pinhole", LensModel::Pinhole {}),
        ("opencv 4", opencv(4)),
        ("opencv 5", opencv(5)),
        ("opencv 8", opencv(8)),
        ("opencv 12", opencv(12)),
        ("opencv 14", opencv(14)),
        (
            "unified",
            LensModel::Unified {
                mirror: 1.3,
                coefficients: vec![-0.1, 0.02, 1e-3, -5e-4],
            },
        ),
        (
            "unified 5",
            LensModel::Unified {
                mirror: 0.9,
                coefficients: vec![-0.1, 0.02, 1e-3, -5e-4, 1e-4],
            },
        ),
        (
            "kannala_brandt",
            LensModel::KannalaBrandt {
                coefficients: [-0.0132, 0.0204, -0.0113, 0.0021],
            },
        ),
        (
            "ftheta to angle",
            polynomial(PolynomialDirection::DistanceToAngle),
        ),
        (
            "ftheta to distance",
            polynomial(PolynomialDirection::AngleToDistance),
        ),
        ("equidistant", LensModel::Equidistant {}),
        ("equisolid", LensModel::Equisolid {}),
        ("stereographic", LensModel::Stereographic {}),
        ("orthographic", LensModel::Orthographic {}),
        (
            "double_sphere",
            LensModel::DoubleSphere {
                xi: -0.2,
                alpha: 0.59,
            },
        ),
        (
            "table",
            LensModel::Table {
                angles_rad: vec![0.0, 1.0],
                radii: vec![0.0, 0.9],
            },
        ),
    ]
    .map(|(name, model)| (name, camera(model)))
    .into()
}

#[test]
fn what_a_format_writes_it_reads_again_and_it_refuses_the_rest() {
    let can = |format: Format| -> &[&str] {
        match format {
            Format::Kalibr => &[
                "pinhole",
                "opencv 4",
                "unified",
                "kannala_brandt",
                "equidistant",
                "double_sphere",
            ],
            Format::OpenCv => &[
                "pinhole",
                "opencv 4",
                "opencv 5",
                "opencv 8",
                "opencv 12",
                "opencv 14",
                "unified",
                "kannala_brandt",
                "equidistant",
            ],
            Format::Ros => &[
                "pinhole",
                "opencv 4",
                "opencv 5",
                "opencv 8",
                "kannala_brandt",
                "equidistant",
            ],
            Format::NuScenes | Format::Kitti => &["pinhole"],
            Format::Kitti360 => &["unified"],
            Format::NCore => &["ftheta to angle", "ftheta to distance"],
        }
    };
    for format in Format::ALL {
        for (name, camera) in all() {
            let written = write(format, std::slice::from_ref(&camera));
            if !can(format).contains(&name) {
                let sentence = written.unwrap_err().to_string();
                let wanted = format!("which {} cannot say; it can say ", format.name());
                assert!(sentence.contains(&wanted), "{name}: {sentence}");
                continue;
            }
            let text = written.unwrap();
            let (found, again) = read(&text, None, Some(SIZE)).unwrap_or_else(|fault| {
                panic!("{name}: {}\n{text}", fault.of_file("f"));
            });
            assert_eq!((found, again.len()), (format, 1), "{text}");
            assert_eq!(again[0].size_px, SIZE);
            same_lens(&camera, &again[0], &text);
        }
    }
}

/// Both project and unproject alike to 1e-9, over all of both fields.
fn same_lens(one: &Camera, other: &Camera, text: &str) {
    let mut n_seen = 0;
    for step in 0..400 {
        let (theta, phi) = (0.0045 * f64::from(step), 0.7 * f64::from(step));
        let at = [
            theta.sin() * phi.cos(),
            theta.sin() * phi.sin(),
            theta.cos(),
        ];
        let (Some(a), Some(b)) = (one.lens.project(at), other.lens.project(at)) else {
            continue;
        };
        n_seen += 1;
        let size = a[0].abs().max(a[1].abs()).max(1.0);
        let off = (a[0] - b[0]).abs().max((a[1] - b[1]).abs());
        assert!(off <= 1e-9 * size.max(1.0), "{at:?}: {a:?} {b:?}\n{text}");
    }
    assert!(n_seen > 100, "{n_seen}\n{text}");
    for corner in [[0.5, 0.5], [617.0, 283.5], [1200.5, 500.5]] {
        if let (Some(a), Some(b)) = (one.lens.unproject(corner), other.lens.unproject(corner)) {
            let off = (0..3).map(|axis| (a[axis] - b[axis]).abs());
            assert!(off.fold(0.0, f64::max) < 1e-9, "{corner:?}\n{text}");
        }
    }
}

#[test]
fn poses_come_back_from_formats_that_have_them() {
    let mut second = camera(LensModel::Pinhole {});
    second.name = "left".into();
    second.carrier_from_sensor = Some(Isometry3::from_parts(
        Translation3::new(0.3, 0.9, 1.6),
        UnitQuaternion::from_euler_angles(-0.02, 0.3, 1.4),
    ));
    let both = [camera(LensModel::Pinhole {}), second];
    let [first, left] = [0, 1].map(|idx| both[idx].carrier_from_sensor.unwrap());
    let text = write(Format::NuScenes, &both).unwrap();
    let (_, again) = read(&text, None, Some(SIZE)).unwrap();
    for (camera, wanted) in again.iter().zip([first, left]) {
        let off = camera.carrier_from_sensor.unwrap().inverse() * wanted;
        assert!(off.translation.vector.norm() < 1e-9 && off.rotation.angle() < 1e-7);
    }
    // A chain has no vehicle: places count from its first camera.
    let text = write(Format::Kalibr, &both).unwrap();
    let (_, again) = read(&text, None, None).unwrap();
    let step = again[1].carrier_from_sensor.unwrap();
    let off = step.inverse() * (first.inverse() * left);
    assert!(
        off.translation.vector.norm() < 1e-9 && off.rotation.angle() < 1e-7,
        "{off}"
    );
    let sentence = write(Format::Ros, &both).unwrap_err().to_string();
    assert_eq!(
        sentence,
        "a file of ros holds one camera, and there are 2: front, left; name one with --sensor"
    );
}

/// The other polynomial of NCore is only an approximation; within the field it is one.
#[test]
fn the_polynomial_that_is_not_the_reference_comes_near_its_inverse() {
    let lens = camera(LensModel::FTheta {
        direction: PolynomialDirection::AngleToDistance,
        polynomial: vec![0.0, 435.25, 3.5, -8.5, 1.25],
    });
    let lens = Camera {
        lens: Lens::new(lens.lens.model().clone(), *lens.lens.plane(), Some(1.2)).unwrap(),
        ..lens
    };
    let text = write(Format::NCore, std::slice::from_ref(&lens)).unwrap();
    let turned = text.replace("\"ANGLE_TO_PIXELDIST\"", "\"PIXELDIST_TO_ANGLE\"");
    assert_ne!(turned, text);
    let (_, again) = read(&turned, None, None).unwrap();
    for step in 1..100 {
        let theta = 0.0118 * f64::from(step);
        let at = [theta.sin(), 0.0, theta.cos()];
        let [a, b] = [&lens, &again[0]].map(|it| it.lens.project(at).unwrap());
        assert!((a[0] - b[0]).abs() < 0.02, "{theta}: {a:?} {b:?}");
    }
}
