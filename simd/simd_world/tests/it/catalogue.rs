//! Compares the catalogue with CARLA 0.9.16's list of vehicles, and every body's mesh with its box.

use nalgebra::Vector3;
use schema_types::Pose;
use simd_body::outfitted_meshes;
use simd_world::{MapData, VehicleModel, World, WorldOptions, vehicle_models};

/// Id behind `vehicle.`, type, special type, generation, wheels, half extents in metres.
type Row = (
    &'static str,
    &'static str,
    &'static str,
    u8,
    usize,
    [f64; 3],
);

/// Where the published extents are a range (mirrors of the Vespa), its middle stands here.
const LISTED: &[Row] = &[
    ("audi.a2", "car", "", 1, 4, [1.853, 0.894, 0.775]),
    ("audi.etron", "car", "", 1, 4, [2.428, 1.016, 0.825]),
    ("audi.tt", "car", "", 1, 4, [2.091, 0.997, 0.693]),
    ("bmw.grandtourer", "car", "", 1, 4, [2.306, 1.121, 0.834]),
    ("chevrolet.impala", "car", "", 1, 4, [2.679, 1.017, 0.705]),
    ("citroen.c3", "car", "", 1, 4, [1.994, 0.925, 0.809]),
    ("dodge.charger_2020", "car", "", 2, 4, [2.503, 1.049, 0.767]),
    (
        "dodge.charger_police",
        "car",
        "emergency",
        1,
        4,
        [2.487, 1.019, 0.771],
    ),
    (
        "dodge.charger_police_2020",
        "car",
        "emergency",
        2,
        4,
        [2.619, 1.049, 0.819],
    ),
    ("ford.crown", "car", "taxi", 2, 4, [2.683, 0.901, 0.787]),
    ("ford.mustang", "car", "", 1, 4, [2.359, 0.947, 0.650]),
    (
        "jeep.wrangler_rubicon",
        "car",
        "",
        1,
        4,
        [1.933, 0.953, 0.939],
    ),
    ("lincoln.mkz_2017", "car", "", 1, 4, [2.451, 1.064, 0.755]),
    ("lincoln.mkz_2020", "car", "", 2, 4, [2.446, 1.115, 0.740]),
    ("mercedes.coupe", "car", "", 1, 4, [2.513, 1.076, 0.825]),
    (
        "mercedes.coupe_2020",
        "car",
        "",
        2,
        4,
        [2.337, 1.001, 0.721],
    ),
    ("micro.microlino", "car", "", 1, 4, [1.104, 0.740, 0.688]),
    ("mini.cooper_s", "car", "", 1, 4, [1.903, 0.985, 0.738]),
    ("mini.cooper_s_2021", "car", "", 2, 4, [2.276, 1.049, 0.884]),
    ("nissan.micra", "car", "", 1, 4, [1.817, 0.923, 0.751]),
    ("nissan.patrol", "car", "", 1, 4, [2.302, 0.966, 0.927]),
    ("nissan.patrol_2021", "car", "", 2, 4, [2.783, 1.075, 1.023]),
    ("seat.leon", "car", "", 1, 4, [2.096, 0.908, 0.737]),
    ("tesla.model3", "car", "", 1, 4, [2.396, 1.082, 0.744]),
    ("toyota.prius", "car", "", 1, 4, [2.257, 1.003, 0.762]),
    ("tesla.cybertruck", "truck", "", 2, 4, [3.137, 1.195, 1.049]),
    (
        "carlamotors.carlacola",
        "truck",
        "",
        1,
        4,
        [2.602, 1.313, 1.234],
    ),
    (
        "carlamotors.european_hgv",
        "truck",
        "",
        2,
        6,
        [3.962, 1.432, 1.892],
    ),
    (
        "carlamotors.firetruck",
        "truck",
        "emergency",
        2,
        4,
        [4.234, 1.446, 1.914],
    ),
    ("mitsubishi.fusorosa", "bus", "", 2, 4, [5.1, 1.97, 2.12]),
    (
        "ford.ambulance",
        "van",
        "emergency",
        2,
        4,
        [3.183, 1.176, 1.216],
    ),
    ("mercedes.sprinter", "van", "", 2, 4, [2.958, 0.994, 1.280]),
    ("volkswagen.t2", "van", "", 1, 4, [2.240, 1.035, 1.019]),
    ("volkswagen.t2_2021", "van", "", 2, 4, [2.221, 0.939, 0.994]),
    (
        "harley-davidson.low_rider",
        "motorcycle",
        "",
        1,
        2,
        [1.178, 0.382, 0.638],
    ),
    (
        "kawasaki.ninja",
        "motorcycle",
        "",
        1,
        2,
        [1.017, 0.401, 0.600],
    ),
    ("vespa.zx125", "motorcycle", "", 1, 2, [0.902, 0.315, 0.618]),
    ("yamaha.yzf", "motorcycle", "", 1, 2, [1.105, 0.434, 0.626]),
    ("bh.crossbike", "bicycle", "", 1, 2, [0.744, 0.430, 0.638]),
    (
        "diamondback.century",
        "bicycle",
        "",
        1,
        2,
        [0.821, 0.186, 0.748],
    ),
    (
        "gazelle.omafiets",
        "bicycle",
        "",
        1,
        2,
        [0.918, 0.16, 0.586],
    ),
];

fn model(id: &str) -> &'static VehicleModel {
    let found = vehicle_models()
        .iter()
        .find(|model| model.type_id.strip_prefix("vehicle.") == Some(id));
    found.unwrap_or_else(|| panic!("vehicle.{id} is missing"))
}

#[test]
fn every_listed_vehicle_is_there_with_its_type_and_size() {
    assert_eq!(LISTED.len(), vehicle_models().len());
    for (id, base_type, special_type, generation, n_wheels, half_m) in LISTED {
        let model = model(id);
        assert_eq!(
            (model.base_type, model.generation),
            (*base_type, *generation),
            "{id}"
        );
        assert!(
            special_type.is_empty() || model.special_type == *special_type,
            "{id}: {:?}",
            model.special_type
        );
        assert_eq!(model.n_wheels(), *n_wheels, "{id}");
        for axis in 0..3 {
            // The Vespa's width is published as 0.2 to 0.43 m.
            let most = if *id == "vespa.zx125" && axis == 1 {
                0.115
            } else {
                1e-9
            };
            assert!(
                (model.half_m[axis] - half_m[axis]).abs() <= most,
                "{id}: {:?} instead of {half_m:?}",
                model.half_m
            );
        }
    }
}

#[test]
fn every_body_with_its_wheels_fills_its_box_to_a_centimetre() {
    let mut wrong = Vec::new();
    for model in vehicle_models() {
        let shape = model.shape();
        let meshes = outfitted_meshes(&shape, model.outfit());
        let lod = meshes.body.lods[0];
        let body = meshes.body.indices[..lod.n_indices as usize]
            .iter()
            .map(|&i| Vector3::from(meshes.body.vertices[i as usize].position_m));
        let wheels = meshes.wheels.iter().flat_map(|site| {
            let centre = Vector3::from(site.centre_m).cast::<f32>();
            meshes
                .wheel
                .vertices
                .iter()
                .map(move |vertex| centre + Vector3::from(vertex.position_m))
        });
        let (mut low, mut high) = (Vector3::repeat(f32::MAX), Vector3::repeat(f32::MIN));
        for corner in body.chain(wheels) {
            (low, high) = (low.inf(&corner), high.sup(&corner));
        }
        let [x, y, z] = shape.half_m.map(|half| half as f32);
        for (got, want) in [
            (high.x, x),
            (-low.x, x),
            (high.y, y),
            (-low.y, y),
            (high.z, 2.0 * z),
            (low.z, 0.0),
        ] {
            if (got - want).abs() > 0.0101 {
                wrong.push(format!("{}: {got} instead of {want}", model.type_id));
            }
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// Types that are no vehicle, walker or sensor and do not come with the map.
#[test]
fn helpers_can_be_spawned() {
    let mut world = World::new(WorldOptions::default());
    world.load(&MapData::flat(100.0)).unwrap();
    let mut spawn = |type_id: &str, name: &str, value: &str| {
        let attributes = [(name.to_owned(), value.to_owned())]
            .into_iter()
            .filter(|(name, _)| !name.is_empty())
            .collect();
        world
            .spawn(
                type_id,
                Pose::from_xyz_yaw(1.0, 2.0, 3.0, 0.5),
                None,
                "",
                &attributes,
            )
            .map_err(|error| error.to_string())
    };
    let empty = spawn("util.actor.empty", "", "").unwrap();
    let mesh = spawn("static.prop.mesh", "mesh_path", "/Game/Own/Thing").unwrap();
    assert!(
        spawn("static.prop.mesh", "scale", "3")
            .unwrap_err()
            .contains("only 1.0")
    );
    assert!(
        spawn("static.prop.mesh", "mass", "-1")
            .unwrap_err()
            .contains("above 0")
    );
    assert!(
        spawn("static.prop.table", "mesh_path", "x")
            .unwrap_err()
            .contains("only size")
    );
    assert!(
        spawn("vehicle.tesla.model3", "driver_id", "1")
            .unwrap_err()
            .contains("driver_id")
    );
    spawn("static.trigger.friction", "friction", "0.5").unwrap();
    let pose = world.record(empty).unwrap().world_from_actor;
    assert_eq!(pose.translation_m, [1.0, 2.0, 3.0]);
    world.step(50_000_000);
    assert_eq!(world.record(empty).unwrap().world_from_actor, pose);
    let moved = Pose::from_xyz_yaw(-4.0, 0.0, 1.0, 0.0);
    world.set_pose(empty, moved).unwrap();
    assert_eq!(world.record(empty).unwrap().world_from_actor, moved);
    assert!(world.destroy(empty).is_ok() && world.destroy(mesh).is_ok());
    let bike = [("driver_id".to_owned(), "3".to_owned())].into();
    world
        .spawn(
            "vehicle.vespa.zx125",
            Pose::from_xyz_yaw(20.0, 0.0, 0.1, 0.0),
            None,
            "",
            &bike,
        )
        .unwrap();
}
