//! What must hold for every triangle of a generated mesh.

use nalgebra::Vector3;
use sensor_core::Mesh;

/// Checks levels of detail, classes, normals and the bounding sphere.
pub fn check_triangles(mesh: &Mesh) {
    assert!(!mesh.lods.is_empty(), "{} has no levels", mesh.name);
    for pair in mesh.lods.windows(2) {
        assert!(pair[0].until_m <= pair[1].until_m, "{}", mesh.name);
    }
    for t in mesh.indices.chunks_exact(3) {
        let v = [0, 1, 2].map(|i| &mesh.vertices[t[i] as usize]);
        let p = v.map(|v| Vector3::from(v.position_m));
        let face = (p[1] - p[0]).cross(&(p[2] - p[0]));
        assert!(
            p.iter().all(|p| p.iter().all(|x| x.is_finite())),
            "{}",
            mesh.name
        );
        for v in v {
            assert!(
                v.class > 0 && v.class <= 28,
                "{} has class {}",
                mesh.name,
                v.class
            );
            let normal = Vector3::new(v.normal[0], v.normal[1], v.normal[2]).map(f32::from) / 127.0;
            assert!(
                (normal.norm() - 1.0).abs() < 0.03,
                "{} has a normal of length {}",
                mesh.name,
                normal.norm()
            );
            if face.norm() > 1e-3 {
                assert!(
                    face.normalize().dot(&normal) > 0.1,
                    "{}: corners and normal disagree: {p:?} {normal:?}",
                    mesh.name
                );
            }
        }
        let within = |q: Vector3<f32>| {
            (q - Vector3::from(mesh.centre_m)).norm() <= mesh.radius_m * 1.001 + 1e-3
        };
        assert!(
            p.into_iter().all(within),
            "{} sticks out of its sphere",
            mesh.name
        );
    }
}
