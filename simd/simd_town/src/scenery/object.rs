//! What stands in a town as objects with names, places and layers.

use nalgebra::{Isometry3, Point3, Vector3};
use schema_types::{Class, ObjectId, Pose};
use sensor_core::SceneAssets;

/// A group of objects that is shown or hidden as one; the numbers are CARLA's layer bits.
#[repr(u16)]
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum MapLayer {
    /// Houses.
    Buildings = 1,
    /// Manhole covers, patches and stains on the road.
    Decals = 2,
    /// Trees, bushes, hedges.
    Foliage = 4,
    /// Paved yards inside blocks.
    Ground = 8,
    /// Parked cars.
    ParkedVehicles = 16,
    /// Smoke and the like; our towns have none.
    Particles = 32,
    /// Benches, bins, shelters, hydrants and other small things.
    Props = 64,
    /// Street lamps.
    StreetLights = 128,
    /// Walls and fences.
    Walls = 256,
}

/// One object of the scenery.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneryObject {
    /// Stable id.
    pub id: ObjectId,
    /// Main class of its triangles.
    pub class: Class,
    /// Kind of object and a number, such as `tree_17`.
    pub name: String,
    /// Layer, if it belongs to one: roads, signs, traffic lights, bridges and terrain do not.
    pub layer: Option<MapLayer>,
    /// Where it stands: the pose of its mesh, or the middle of its box.
    pub pose: Pose,
    /// Pose of the middle of the box about its triangles.
    pub box_pose: Pose,
    /// Half extents of the box.
    pub box_half_m: [f64; 3],
}

impl SceneryObject {
    pub(crate) fn new(
        id: ObjectId,
        class: Class,
        name: String,
        layer: Option<MapLayer>,
    ) -> SceneryObject {
        SceneryObject {
            id,
            class,
            name,
            layer,
            pose: Pose::default(),
            box_pose: Pose::default(),
            box_half_m: [0.0; 3],
        }
    }
}

/// Smallest and largest coordinates.
#[derive(Clone, Copy)]
struct Extent {
    low: Vector3<f64>,
    high: Vector3<f64>,
}

impl Extent {
    const NONE: Extent = Extent {
        low: Vector3::new(f64::MAX, f64::MAX, f64::MAX),
        high: Vector3::new(f64::MIN, f64::MIN, f64::MIN),
    };

    fn add(&mut self, p: Vector3<f64>) {
        (self.low, self.high) = (self.low.inf(&p), self.high.sup(&p));
    }

    fn is_empty(&self) -> bool {
        self.low.x > self.high.x
    }
}

/// Measures every object's box: along its mesh's axes if the object is one mesh, along the world's
/// axes if it is part of larger meshes. Removes objects without triangles.
pub fn measure(objects: &mut Vec<SceneryObject>, assets: &SceneAssets) {
    let index = |id: ObjectId| (id.0 & !schema_types::id::SCENERY_BIT) as usize;
    let mut part_of = vec![Extent::NONE; objects.len() + 1];
    let mut whole: Vec<Option<(Isometry3<f64>, Extent)>> = vec![None; objects.len() + 1];
    let mut of_mesh: Vec<Option<Extent>> = vec![None; assets.meshes.len()];
    for each in &assets.statics {
        let mesh = assets.mesh(each.mesh);
        if each.object != ObjectId::BACKGROUND {
            let local = of_mesh[each.mesh.0 as usize].get_or_insert_with(|| {
                let mut extent = Extent::NONE;
                mesh.vertices
                    .iter()
                    .for_each(|v| extent.add(Vector3::from(v.position_m).cast()));
                extent
            });
            whole[index(each.object)] = Some((each.world_from_mesh, *local));
            continue;
        }
        for vertex in &mesh.vertices {
            let p =
                each.world_from_mesh * Point3::from(Vector3::from(vertex.position_m).cast::<f64>());
            part_of[index(ObjectId(vertex.object_id))].add(p.coords);
        }
    }
    for object in objects.iter_mut() {
        let idx = index(object.id);
        let (pose, extent) = whole[idx].unwrap_or((Isometry3::identity(), part_of[idx]));
        if extent.is_empty() {
            continue;
        }
        let middle = Isometry3::from_parts(
            nalgebra::Translation3::from(0.5 * (extent.low + extent.high)),
            nalgebra::UnitQuaternion::identity(),
        );
        object.box_pose = (pose * middle).into();
        object.box_half_m = (0.5 * (extent.high - extent.low)).into();
        object.pose = if whole[idx].is_some() {
            pose.into()
        } else {
            object.box_pose
        };
    }
    objects.retain(|object| object.box_half_m != [0.0; 3]);
}
