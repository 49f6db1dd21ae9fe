//! Disparity of a pair of cameras, in pixels of the left image: KITTI 2015's errors.

use std::sync::Arc;

use consumer_metrics::stereo::{Collector, disparity_px};
use schema_frames::{ElementType, Modality, ResultType};

use super::depth::DEPTHS_M;
use super::pixels::{depth_strata, has_elements, in_depth, read_pixels};
use crate::evidence::moment::Moment;
use crate::picture::pixels::Pixels;
use crate::picture::{Picture, Scale};
use crate::tasks::Unreadable;
use crate::tasks::{Bad, Context, Drawn, Headline, Measure, Reading, Spec};

/// The truth of a tick.
struct Truth {
    tick: u64,
    disparity: Pixels<f32>,
    depth: Vec<f32>,
    mask: Vec<bool>,
    /// Focal length times baseline: disparity times depth, px·m.
    px_m: f64,
}

/// What a program found: disparity, or depth that becomes one.
pub struct Estimate {
    pixels: Pixels<f32>,
    is_depth: bool,
}

/// What a moment and a result gave.
pub struct Part {
    all: Collector,
    truth: Arc<Truth>,
    result: Vec<f32>,
}

/// The measure.
pub struct Stereo {
    spec: Spec,
    baseline_m: f64,
    now: Option<Arc<Truth>>,
}

impl Stereo {
    /// For a task.
    pub fn new(spec: &Spec) -> Stereo {
        Stereo {
            spec: spec.clone(),
            baseline_m: spec.options.baseline_m,
            now: None,
        }
    }

    fn truth(&self, moment: &Moment<'_>) -> Option<Truth> {
        let frame = moment.frame(&self.spec.truth, Modality::Depth)?;
        let depth: Vec<f32> = frame.elements();
        let [fx, ..] = frame.header.intrinsics_px;
        let (width, height) = (frame.header.width, frame.header.height);
        let far = self.spec.rules.distance_or(DEPTHS_M.1);
        let of = |depth: &f32| disparity_px(*depth, fx, self.baseline_m);
        let values: Vec<f32> = depth.iter().map(of).collect();
        let mask = values.iter().zip(&depth).enumerate();
        let mask = mask.map(|(at, (disparity, depth))| {
            // The partner of this pixel's middle lies inside the right image.
            let x = (at % width as usize) as f32 + 0.5;
            let in_range = (DEPTHS_M.0..far).contains(&f64::from(*depth));
            in_range && x - *disparity >= 0.0
        });
        Some(Truth {
            tick: moment.set.tick,
            mask: mask.collect(),
            disparity: Pixels {
                width,
                height,
                values,
            },
            depth,
            px_m: fx * self.baseline_m,
        })
    }
}

impl Estimate {
    /// Disparities, pixels; what is none becomes NaN.
    fn disparities(&self, truth: &Truth) -> Vec<f32> {
        let size = &truth.disparity;
        let Some(values) = self.pixels.of_size(size.width, size.height) else {
            return vec![f32::NAN; truth.depth.len()];
        };
        let of = |value: &f32| match *value {
            value if !value.is_finite() || value <= 0.0 => f32::NAN,
            value if self.is_depth => (truth.px_m / f64::from(value)) as f32,
            value => value,
        };
        values.iter().map(of).collect()
    }
}

impl Measure for Stereo {
    type Estimate = Estimate;
    type Part = Part;
    type Total = Collector;

    fn headline(&self) -> Headline {
        Headline {
            metric: "D1",
            unit: "%",
            higher_is_better: false,
        }
    }

    fn begin(&mut self, context: &Context<'_>) -> anyhow::Result<()> {
        if self.spec.options.baseline_m > 0.0 {
            return Ok(());
        }
        let own = self.spec.input.split('/').nth(1).unwrap_or_default();
        let place = |name: &str| {
            let sensor = context.scenario.sensor(name);
            sensor
                .map(|sensor| sensor.carrier_from_sensor)
                .ok_or_else(|| {
                    anyhow::anyhow!(
                        "the task {} needs the camera {name:?}; the recording has {}",
                        self.spec.name,
                        context.scenario.topic_list()
                    )
                })
        };
        let (left, right) = (place(own)?, place(&self.spec.options.partner)?);
        self.baseline_m = (left.translation.vector - right.translation.vector).norm();
        Ok(())
    }

    fn watch(&mut self, moment: &Moment<'_>) {
        self.now = self.truth(moment).map(Arc::new);
    }

    fn empty(&self) -> Collector {
        Collector::new()
    }

    fn read(&self, reading: &Reading<'_>) -> Result<Estimate, Unreadable> {
        if !has_elements(reading, ElementType::F32) {
            return Err("is a tensor of another type than f32".into());
        }
        let is_depth = reading.result.header.kind() == Some(ResultType::Depth);
        let pixels = read_pixels(reading)?;
        Ok(Estimate { pixels, is_depth })
    }

    fn part(&self, moment: &Moment<'_>, estimate: Option<&Estimate>) -> Option<Part> {
        let truth = self.now.as_ref()?;
        if truth.tick != moment.set.tick {
            return None;
        }
        let none = || vec![f32::NAN; truth.depth.len()];
        let result = estimate.map_or_else(none, |found| found.disparities(truth));
        let mut all = Collector::new();
        all.add(&truth.disparity.values, &result, Some(&truth.mask))
            .ok()?;
        Some(Part {
            all,
            truth: truth.clone(),
            result,
        })
    }

    fn add(&self, total: &mut Collector, part: &Part) {
        total.merge(&part.all);
    }

    fn strata(&self) -> Vec<(&'static str, &'static str)> {
        depth_strata()
    }

    fn add_stratum(&self, total: &mut Collector, part: &Part, stratum: usize) {
        let mask = in_depth(&part.truth.depth, &part.truth.mask, stratum);
        let _ = total.add(&part.truth.disparity.values, &part.result, Some(&mask));
    }

    fn bad(&self, part: &Part) -> Option<Bad> {
        let scores = part.all.scores();
        let d1 = scores.d1?;
        Some(Bad {
            badness: d1,
            why: format!("D1 {d1:.1} %"),
        })
    }

    fn draw(&self, picture: &mut Picture, moment: &Moment<'_>, what: Drawn<'_, Estimate>) {
        match what {
            Drawn::Truth => {
                if let Some(truth) = self.truth(moment) {
                    picture.values(&truth.disparity, Scale::Disparity);
                }
            }
            Drawn::Result(found) => {
                let scale = match found.is_depth {
                    true => Scale::Depth,
                    false => Scale::Disparity,
                };
                picture.values(&found.pixels, scale);
            }
        }
    }
}
