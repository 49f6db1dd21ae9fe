//! Casts the rays of one frame on the CPU, in parallel tasks of some bunches each.

use nalgebra::{Matrix3, Vector3};
use rayon::prelude::*;
use schema_stages::Stage;
use schema_types::ActorId;
use schema_types::noise::Noise;
use sensor_core::vector_lanes::{LaneWork, Lanes, in_lanes};
use sensor_spec::LidarSpec;

use super::beams::{Beams, Bunch};
use super::path::{Pose, Times};
use super::points::{Point, Returns};
use crate::ray_scene::{Moment, RayScene};
use crate::rays::{Caster, GROUP, Hits, Stacks};

/// Casting rays, on whatever threads it is done.
static RAYS: Stage = Stage::new("lidar rays");

/// Bunches of rays per parallel task.
const TASK_BUNCHES: usize = 16;

/// What all rays of a frame share.
pub(crate) struct Turn<'a> {
    pub scene: &'a RayScene,
    pub spec: &'a LidarSpec,
    pub beams: &'a Beams,
    pub poses: Vec<Pose>,
    /// When its rays are fired; `None` if they see everything as it is at the tick.
    pub times: Option<Times>,
    pub noise: Noise,
    pub ignored: Option<ActorId>,
}

impl Turn<'_> {
    /// Casts all rays, some bunches per task.
    pub fn cast<P: Point>(&self, points: &mut [P]) {
        let n_slots = (TASK_BUNCHES * self.beams.bunch_rays).max(1);
        let bunches = self.beams.bunches.par_chunks(TASK_BUNCHES);
        points.par_chunks_mut(n_slots).zip(bunches).for_each_init(
            || (RAYS.span(), Stacks::default()),
            |(_span, stacks), (points, bunches)| {
                let caster = Caster {
                    scene: self.scene,
                    ignored: self.ignored,
                    moment: None,
                    stacks: std::mem::take(stacks),
                };
                *stacks = in_lanes(Task {
                    turn: self,
                    caster,
                    bunches,
                    points,
                });
            },
        );
    }

    #[inline(always)]
    fn cast_bunch<L: Lanes, P: Point>(&self, caster: &mut Caster, bunch: &Bunch, points: &mut [P]) {
        let Bunch { bundle, rays } = bunch;
        let pose = &self.poses[if self.poses.len() == 1 {
            0
        } else {
            rays[0].1 as usize
        }];
        // From the head's axis to where the beams of the bunch's column begin. Negative zeros change
        // no sum, not even another negative zero.
        let (mut lever_m, mut origin_m) = ([-0.0; 2], pose.origin_m);
        if self.spec.origin_offset_m > 0.0 {
            let (cos, sin) = self.beams.azimuths[rays[0].1 as usize];
            lever_m = [cos, sin].map(|part| part * self.spec.origin_offset_m);
            origin_m += pose.world_from_sensor * Vector3::new(lever_m[0], lever_m[1], 0.0);
        }
        let mut hits = Hits::new(bundle, self.spec.range_m);
        if P::can_misfire(self.spec) {
            for (ray, beam) in rays.iter().enumerate() {
                if P::misfires(self.spec, self.noise, self.beams.number(*beam)) {
                    hits.switch_off(ray);
                }
            }
        }
        hits.begin::<L>();
        let ages_nanos = &self.scene.motion.ages_nanos;
        let times = self.times.as_ref().filter(|_| !ages_nanos.is_empty());
        caster.moment =
            times.and_then(|times| Moment::at(ages_nanos, times.age_of_column(rays[0].1)));
        caster.cast::<L>(&origin_m, &pose.world_from_sensor, bundle, &mut hits);
        for (group, (rays, points)) in rays
            .chunks_exact(GROUP)
            .zip(points.chunks_exact_mut(GROUP))
            .enumerate()
        {
            let mut returns = Returns {
                scene: self.scene,
                spec: self.spec,
                noise: self.noise,
                bundle,
                hits: &hits,
                group,
                origin_m,
                lever_m,
                directions_in_world: [[0.0; GROUP]; 3],
                directions_in_sensor: [[0.0; GROUP]; 3],
                rays: [0; GROUP],
                channels: [0; GROUP],
                fired_nanos: [0; GROUP],
                moments: [caster.moment; GROUP],
            };
            self.aim(rays, &pose.world_from_sensor, &mut returns);
            if let Some(times) = times.filter(|times| times.differ_in_columns()) {
                for (moment, beam) in returns.moments.iter_mut().zip(rays) {
                    let age_nanos = times.age_of_ray(self.beams.fired_nanos(*beam));
                    *moment = Moment::at(ages_nanos, age_nanos);
                }
            }
            P::write(&returns, points);
        }
    }

    #[inline(always)]
    fn aim(&self, rays: &[(u32, u32)], world_from_sensor: &Matrix3<f64>, returns: &mut Returns) {
        for (lane, beam) in rays.iter().enumerate().take(GROUP) {
            returns.rays[lane] = self.beams.number(*beam);
            returns.channels[lane] = beam.0 as u16;
            returns.fired_nanos[lane] = self.beams.fired_nanos(*beam).round() as i32;
            let direction = self.beams.direction(beam.0 as usize, beam.1 as usize);
            for axis in 0..3 {
                returns.directions_in_sensor[axis][lane] = direction[axis];
            }
        }
        let m = world_from_sensor;
        let [x, y, z] = &returns.directions_in_sensor;
        for axis in 0..3 {
            let (mx, my, mz) = (m[(axis, 0)], m[(axis, 1)], m[(axis, 2)]);
            for lane in 0..GROUP {
                returns.directions_in_world[axis][lane] =
                    mx * x[lane] + my * y[lane] + mz * z[lane];
            }
        }
    }
}

/// Some bunches, and where their points go.
struct Task<'t, P> {
    turn: &'t Turn<'t>,
    caster: Caster<'t>,
    bunches: &'t [Bunch],
    points: &'t mut [P],
}

impl<P: Point> LaneWork for Task<'_, P> {
    type Out = Stacks;

    #[inline(always)]
    fn run<L: Lanes>(mut self) -> Stacks {
        let n_slots = self.turn.beams.bunch_rays;
        for (bunch, points) in self.bunches.iter().zip(self.points.chunks_mut(n_slots)) {
            self.turn
                .cast_bunch::<L, P>(&mut self.caster, bunch, points);
        }
        self.caster.stacks
    }
}
