//! What a new actor would touch at the place where it is to be put.

use rapier3d::math::Pose as EnginePose;
use rapier3d::parry::shape::{Cuboid, Shape};
use schema_types::Pose;

use crate::physics::Physics;
use crate::props::Props;
use crate::vehicles::{VehicleModel, Vehicles, chassis_box};
use crate::walkers::{Touchable, Walker, Walkers};

/// Name of the obstacle that is no actor.
const SCENERY: &str = "scenery";

/// Everything that can be in the way.
pub(crate) struct Obstacles<'w> {
    pub physics: &'w Physics,
    pub vehicles: &'w Vehicles,
    pub walkers: &'w Walkers,
    pub props: &'w Props,
}

impl Obstacles<'_> {
    /// What a new vehicle would touch.
    pub fn of_vehicle(&self, model: &VehicleModel, pose: &Pose) -> Option<String> {
        let (centre, half) = chassis_box(model);
        let shape = Cuboid::new(half);
        let mut at = self.physics.engine_pose(&pose.isometry());
        at.translation += at.rotation * centre;
        self.actor_in(&at, &shape).or_else(|| {
            let touches = self.physics.touches_scenery(&at, &shape);
            touches.then(|| SCENERY.to_owned())
        })
    }

    /// What a new walker would touch. Props do not count.
    pub fn of_walker(&self, walker: &Walker) -> Option<String> {
        let standing = walker.standing();
        let (body, at) = standing.whole_body(self.physics);
        let (vehicles, walkers) = (self.vehicles, self.walkers);
        vehicles
            .touching(&at, &body, self.physics)
            .or_else(|| walkers.touching(&at, &body, Touchable::Everybody, self.physics))
            .or_else(|| {
                let touches = standing.is_stuck(self.physics);
                touches.then(|| SCENERY.to_owned())
            })
    }

    /// The vehicle, walker or prop that a shape would touch.
    fn actor_in(&self, at: &EnginePose, shape: &dyn Shape) -> Option<String> {
        let (vehicles, walkers, props) = (self.vehicles, self.walkers, self.props);
        vehicles
            .touching(at, shape, self.physics)
            .or_else(|| walkers.touching(at, shape, Touchable::Colliding, self.physics))
            .or_else(|| props.touching(at, shape, self.physics))
    }
}
