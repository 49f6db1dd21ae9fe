//! Where a sensor is: absolute and relative errors of its trajectory, as evo and KITTI define them.
//!
//! The pose is that of the sensor whose frames are answered, in any space that stands still; the
//! trajectory is laid onto the true one as a rigid body before absolute errors are taken. Relative
//! errors are over steps of [`STEP_M`], and KITTI's segments begin once a second, so that neither
//! depends on the rate of queries.

use consumer_metrics::odometry::{Collector, Settings, Step};
use nalgebra::Isometry3;
use schema_frames::{Odometry as OdometryRecord, PoseEstimate, ResultType};

use crate::evidence::moment::Moment;
use crate::tasks::Unreadable;
use crate::tasks::objects::detect::records;
use crate::tasks::spaces::{is_finite, normalised};
use crate::tasks::{Context, Headline, Measure, Reading, Spec};

/// Length of the steps of relative errors, metres of the true path.
pub const STEP_M: f64 = 10.0;

/// The measure.
pub struct Odometry {
    spec: Spec,
    ego_from_sensor: Isometry3<f64>,
}

impl Odometry {
    /// For a task.
    pub fn new(spec: &Spec) -> Odometry {
        Odometry {
            spec: spec.clone(),
            ego_from_sensor: Isometry3::identity(),
        }
    }
}

/// A true pose and what was said about it.
pub struct Part {
    truth: Isometry3<f64>,
    result: Option<Isometry3<f64>>,
}

impl Measure for Odometry {
    type Estimate = Isometry3<f64>;
    type Part = Part;
    type Total = Collector;

    fn headline(&self) -> Headline {
        Headline {
            metric: "ATE",
            unit: "m",
            higher_is_better: false,
        }
    }

    fn begin(&mut self, context: &Context<'_>) -> anyhow::Result<()> {
        let name = self.spec.input.split('/').nth(1).unwrap_or_default();
        let sensor = context.scenario.sensor(name);
        self.ego_from_sensor =
            sensor.map_or_else(Isometry3::identity, |sensor| sensor.carrier_from_sensor);
        Ok(())
    }

    fn empty(&self) -> Collector {
        Collector::new(Settings {
            step: Step::Metres(STEP_M),
            segment_frames: (self.spec.options.query_hz.round() as usize).max(1),
            ..Settings::default()
        })
    }

    fn read(&self, reading: &Reading<'_>) -> Result<Isometry3<f64>, Unreadable> {
        let pose = match reading.result.header.kind() {
            Some(ResultType::Odometry) => records::<OdometryRecord>(reading.body)
                .first()
                .map(|first| first.pose),
            _ => records::<PoseEstimate>(reading.body)
                .first()
                .map(|first| first.pose),
        };
        let pose = pose.ok_or("has no pose")?;
        match is_finite(&pose) {
            true => Ok(normalised(&pose)),
            false => Err("has a pose that is not finite".into()),
        }
    }

    fn part(&self, moment: &Moment<'_>, estimate: Option<&Isometry3<f64>>) -> Option<Part> {
        let ego = moment.ego().filter(|_| moment.is_query)?;
        Some(Part {
            truth: ego.world_from_ego * self.ego_from_sensor,
            result: estimate.copied(),
        })
    }

    fn add(&self, total: &mut Collector, part: &Part) {
        total.add(&part.truth, part.result.as_ref());
    }
}
