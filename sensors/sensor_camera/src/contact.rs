//! Contact shadows: the nearest vehicles and people as boxes that hide the sky from the ground about
//! them. `light.wgsl` darkens in closed form, so that nothing floats where the sun does not reach.

use nalgebra::{Isometry3, Point3, Vector3};
use schema_types::{ActorId, ObjectId};
use sensor_core::Scene;

use crate::assets::Meshes;
use crate::camera_motion::CameraMotion;
use crate::uniform::MAX_BLOCKERS;

/// Beyond this there are none, metres: a car's shade is then some six pixels high.
const REACH_M: f64 = 32.0;
/// Boxes of one view: a software rasteriser pays for each of them at every pixel.
const MOST: usize = 4;
const _: () = assert!(MOST <= MAX_BLOCKERS, "a view's uniform has room for them");
/// Nearest share of the reach within which they do not fade.
const SOLID_RATIO: f64 = 0.8;
/// How far the ground beside a wall is darker, in heights of the wall.
const SHADE_HEIGHTS: f64 = 2.2;

/// The boxes of one view, for its uniform.
#[derive(Clone, Debug, Default)]
pub(crate) struct Blockers {
    pub n: u32,
    /// Two each: middle of the foot from the eye in the world's axes, one over the reach of its shade;
    /// cosine and sine of the heading, half length, half width.
    pub boxes: [[f32; 4]; 2 * MAX_BLOCKERS],
    found: Vec<Standing>,
}

/// Something that stands on the ground.
#[derive(Clone, Copy, Debug)]
struct Standing {
    object: ObjectId,
    origin: Point3<f64>,
    heading: [f64; 2],
    /// Least and greatest along, across, up from the origin.
    low: Vector3<f64>,
    high: Vector3<f64>,
    distance_m: f64,
}

impl Standing {
    fn at(object: ObjectId, world_from_mesh: &Isometry3<f64>) -> Standing {
        let ahead = world_from_mesh.rotation * Vector3::x();
        let level = ahead.x.hypot(ahead.y);
        let heading = if level > 0.1 {
            [ahead.x / level, ahead.y / level]
        } else {
            [1.0, 0.0]
        };
        Standing {
            object,
            origin: world_from_mesh.translation.vector.into(),
            heading,
            low: Vector3::repeat(f64::INFINITY),
            high: Vector3::repeat(f64::NEG_INFINITY),
            distance_m: 0.0,
        }
    }

    /// Takes in a box of a mesh.
    fn include(&mut self, box_m: [[f32; 3]; 2], world_from_mesh: &Isometry3<f64>) {
        let [c, s] = self.heading;
        for corner in 0..8 {
            let side = |axis: usize| f64::from(box_m[(corner >> axis) & 1][axis]);
            let from_origin =
                world_from_mesh * Point3::new(side(0), side(1), side(2)) - self.origin;
            let at = Vector3::new(
                c * from_origin.x + s * from_origin.y,
                c * from_origin.y - s * from_origin.x,
                from_origin.z,
            );
            (self.low, self.high) = (self.low.inf(&at), self.high.sup(&at));
        }
    }

    fn half(&self) -> Vector3<f64> {
        0.5 * (self.high - self.low)
    }

    /// Middle of its foot in the world.
    fn foot(&self) -> Point3<f64> {
        let middle = 0.5 * (self.low + self.high);
        let [c, s] = self.heading;
        let level = [
            c * middle.x - s * middle.y,
            s * middle.x + c * middle.y,
            self.low.z,
        ];
        self.origin + Vector3::from(level)
    }

    /// How far its shade reaches. What is slim hides no more than its own width does.
    fn shade_m(&self) -> f64 {
        let half = self.half();
        SHADE_HEIGHTS * (2.0 * half.z).min(2.0 * half.x.min(half.y)).max(0.1)
    }

    /// Both halves for the shader. A box that fades shrinks until nothing of it is left.
    fn packed(&self, eye: &Point3<f64>, strength: f64) -> [[f32; 4]; 2] {
        let (foot, half, shade_m) = (self.foot() - eye, self.half(), self.shade_m());
        let size = |half_m: f64| half_m * strength - shade_m * (1.0 - strength);
        let [c, s] = self.heading;
        [
            [foot.x, foot.y, foot.z, 1.0 / shade_m],
            [c, s, size(half.x), size(half.y)],
        ]
        .map(|numbers| numbers.map(|x| x as f32))
    }
}

impl Blockers {
    /// Finds those of a view: `sees` says whether a sphere of the world reaches into it, `still` are
    /// the static instances that it shows, `hidden` are actors that it does not, and `standing` the
    /// numbers of the moving instances that stand on the ground.
    pub fn find(
        &mut self,
        scene: &Scene,
        assets: &Meshes,
        (hidden, standing): (&[ActorId], &[u32]),
        still: impl Iterator<Item = u32>,
        motion: &CameraMotion,
        sees: impl Fn(&Point3<f64>, f64) -> bool,
    ) {
        let eye = Point3::from(motion.world_from_camera.translation.vector);
        self.found.clear();
        // An actor's parts follow one another.
        for number in standing {
            let part = &scene.dynamics[*number as usize];
            let (mesh, pose) = (part.mesh, &part.world_from_mesh);
            let is_near = (pose.translation.vector - eye.coords).norm() < REACH_M;
            if !is_near || hidden.binary_search(&part.actor).is_ok() {
                continue;
            }
            let object = ObjectId(part.actor.0);
            if self.found.last().is_none_or(|last| last.object != object) {
                self.found.push(Standing::at(object, pose));
            }
            if let Some(last) = self.found.last_mut() {
                last.include(assets.box_m(mesh), pose);
            }
        }
        for i in still {
            if assets.stands(assets.still.meshes[i as usize]) {
                let instance = &assets.scene_assets.statics[i as usize];
                let mut one = Standing::at(instance.object, &instance.world_from_mesh);
                one.include(assets.box_m(instance.mesh), &instance.world_from_mesh);
                self.found.push(one);
            }
        }
        for one in &mut self.found {
            one.distance_m = (one.foot() - eye).norm();
        }
        self.found.retain(|one| {
            let half = one.half();
            one.distance_m < REACH_M && sees(&one.foot(), half.norm() + one.shade_m())
        });
        self.found.sort_unstable_by(|a, b| {
            let by_distance = a.distance_m.total_cmp(&b.distance_m);
            by_distance.then(a.object.cmp(&b.object))
        });
        // Where there are too many, they fade before the first that finds no place.
        let reach_m = self.found.get(MOST);
        let reach_m = reach_m.map_or(REACH_M, |first| first.distance_m);
        self.n = self.found.len().min(MOST) as u32;
        self.boxes = Default::default();
        for (one, halves) in self
            .found
            .iter()
            .take(MOST)
            .zip(self.boxes.as_chunks_mut::<2>().0)
        {
            let share = one.distance_m / reach_m;
            let strength = ((1.0 - share) / (1.0 - SOLID_RATIO)).clamp(0.0, 1.0);
            *halves = one.packed(&eye, strength);
        }
    }
}

#[cfg(test)]
mod tests {
    use sensor_core::vector_lanes::{LaneWork, Lanes, in_lanes};

    use super::*;

    /// A car of 4 by 2 by 1.5 m, whose mesh begins at the ground.
    fn car(pose: &Isometry3<f64>) -> Standing {
        let mut car = Standing::at(ObjectId(7), pose);
        car.include([[-2.0, -1.0, 0.0], [2.0, 1.0, 1.5]], pose);
        car
    }

    #[test]
    fn box_lies_beneath_a_turned_car() {
        let pose = Isometry3::new([10.0, 5.0, 0.2].into(), [0.0, 0.0, 0.7].into());
        let [foot, box_m] = car(&pose).packed(&Point3::new(9.0, 5.0, 1.7), 1.0);
        let expected = [1.0, 0.0, -1.5, 1.0 / (2.2 * 1.5)];
        let heading = [0.7f32.cos(), 0.7f32.sin(), 2.0, 1.0];
        for (found, expected) in foot.iter().zip(expected).chain(box_m.iter().zip(heading)) {
            assert!((found - expected).abs() < 1e-5, "{foot:?} {box_m:?}");
        }
    }

    #[test]
    fn box_takes_in_all_parts_of_an_actor() {
        let pose = Isometry3::new([3.0, 0.0, 0.0].into(), Vector3::zeros());
        let mut all = car(&pose);
        let wheel = Isometry3::new([3.0 - 2.2, 0.9, 0.3].into(), Vector3::zeros());
        all.include([[-0.3; 3], [0.3; 3]], &wheel);
        assert!(
            (all.half() - Vector3::new(2.25, 1.1, 0.75)).norm() < 1e-6,
            "{all:?}"
        );
        assert!(
            (all.foot() - Point3::new(2.75, 0.1, 0.0)).norm() < 1e-6,
            "{all:?}"
        );
    }

    #[test]
    fn box_that_fades_ends_where_its_shade_does() {
        let one = car(&Isometry3::identity());
        let [foot, box_m] = one.packed(&Point3::origin(), 0.0);
        // `hidden_by` is 0 from one reach outside the edge on, and so above the box's middle.
        assert!(1.0 + box_m[2] * foot[3] < 1e-5 && 1.0 + box_m[3] * foot[3] < 1e-5);
    }

    /// The shader's share of the sky that a long wall hides from the ground at a place.
    struct Hidden([f32; 8]);

    impl LaneWork for Hidden {
        type Out = [f32; 8];

        #[inline(always)]
        fn run<L: Lanes>(self) -> [f32; 8] {
            sensor_shade::shading::hidden_by::<L>(
                L::load(&self.0),
                L::splat(1.0 / SHADE_HEIGHTS as f32),
            )
            .store()
        }
    }

    /// Oracle: the form factor of a wall without ends and one metre high, seen from level ground beside
    /// it: half of one minus the cosine of the angle up to its edge.
    #[test]
    fn shade_beside_a_wall_is_nearly_its_form_factor() {
        let inside_m: [f32; 8] = [-0.01, -0.1, -0.25, -0.5, -1.0, -1.5, -2.0, -3.0];
        let found = in_lanes(Hidden(inside_m));
        for (inside_m, found) in inside_m.into_iter().zip(found) {
            let exact = 0.5 * (1.0 + inside_m / inside_m.hypot(1.0));
            assert!(
                (found - exact).abs() < 0.06,
                "{inside_m}: {found}, exact {exact}"
            );
        }
        assert_eq!(found[7], 0.0, "it ends");
    }

    #[test]
    fn shade_beneath_a_floor_grows_from_a_half_to_all() {
        let found = in_lanes(Hidden([0.0, 0.05, 0.1, 0.2, 0.3, 0.366, 0.4, 2.0]));
        assert!(
            found.is_sorted() && (found[0] - 0.5).abs() < 1e-6 && found[7] == 1.0,
            "{found:?}"
        );
    }
}
