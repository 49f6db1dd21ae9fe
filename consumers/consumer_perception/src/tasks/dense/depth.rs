//! Depth of every pixel, in metres along the optical axis: KITTI's and Eigen's errors.

use std::sync::Arc;

use consumer_metrics::depth::{Collector, Settings};
use schema_frames::Modality;

use super::pixels::{depth_strata, in_depth, read_pixels};
use crate::evidence::moment::Moment;
use crate::picture::pixels::Pixels;
use crate::picture::{Picture, Scale};
use crate::tasks::Unreadable;
use crate::tasks::{Bad, Drawn, Headline, Measure, Reading, Spec};

/// Nearest and usual farthest depth that counts, metres.
pub const DEPTHS_M: (f64, f64) = (0.5, 80.0);

/// The exact depth of a tick.
#[derive(Clone, Debug)]
struct Truth {
    depth: Pixels<f32>,
    mask: Vec<bool>,
}

/// What a moment and a result gave.
pub struct Part {
    all: Collector,
    truth: Arc<TruthOf>,
    result: Arc<Vec<f32>>,
}

/// What a stratum is made of.
struct TruthOf {
    depth: Vec<f32>,
    mask: Vec<bool>,
}

/// The measure.
pub struct Depth {
    spec: Spec,
    settings: Settings,
    now: Option<(u64, u32, u32, Arc<TruthOf>)>,
}

impl Depth {
    /// For a task.
    pub fn new(spec: &Spec) -> Depth {
        let settings = Settings {
            min_m: DEPTHS_M.0,
            max_m: spec.rules.distance_or(DEPTHS_M.1),
            ..Settings::default()
        };
        Depth {
            spec: spec.clone(),
            settings,
            now: None,
        }
    }
}

/// The exact depth of a tick, and which of its pixels count.
fn exact(moment: &Moment<'_>, sensor: &str, (near, far): (f64, f64)) -> Option<Truth> {
    let frame = moment.frame(sensor, Modality::Depth)?;
    let values: Vec<f32> = frame.elements();
    let counts = |depth: &f32| (near..far).contains(&f64::from(*depth));
    Some(Truth {
        mask: values.iter().map(counts).collect(),
        depth: Pixels {
            width: frame.header.width,
            height: frame.header.height,
            values,
        },
    })
}

impl Measure for Depth {
    type Estimate = Pixels<f32>;
    type Part = Part;
    type Total = Collector;

    fn headline(&self) -> Headline {
        Headline {
            metric: "AbsRel",
            unit: "",
            higher_is_better: false,
        }
    }

    fn watch(&mut self, moment: &Moment<'_>) {
        let limits = (self.settings.min_m, self.settings.max_m);
        let found = exact(moment, &self.spec.truth, limits);
        self.now = found.map(|truth| {
            let of = TruthOf {
                depth: truth.depth.values,
                mask: truth.mask,
            };
            let (width, height) = (truth.depth.width, truth.depth.height);
            (moment.set.tick, width, height, Arc::new(of))
        });
    }

    fn empty(&self) -> Collector {
        Collector::new(self.settings)
    }

    fn read(&self, reading: &Reading<'_>) -> Result<Pixels<f32>, Unreadable> {
        read_pixels(reading)
    }

    fn part(&self, moment: &Moment<'_>, estimate: Option<&Pixels<f32>>) -> Option<Part> {
        let (tick, width, height, truth) = self.now.as_ref()?;
        if *tick != moment.set.tick {
            return None;
        }
        let found = estimate.and_then(|found| found.of_size(*width, *height));
        let found = found.map_or_else(|| vec![f32::NAN; truth.depth.len()], <[f32]>::to_vec);
        let mut all = self.empty();
        all.add(&truth.depth, &found, Some(&truth.mask)).ok()?;
        Some(Part {
            all,
            truth: truth.clone(),
            result: Arc::new(found),
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
        if mask.contains(&true) {
            let _ = total.add(&part.truth.depth, &part.result, Some(&mask));
        }
    }

    fn bad(&self, part: &Part) -> Option<Bad> {
        let scores = part.all.scores();
        let Some(abs_rel) = scores.abs_rel else {
            return Some(Bad {
                badness: 10.0,
                why: "no depth".into(),
            });
        };
        Some(Bad {
            badness: abs_rel,
            why: format!("AbsRel {abs_rel:.3}"),
        })
    }

    fn draw(&self, picture: &mut Picture, moment: &Moment<'_>, what: Drawn<'_, Pixels<f32>>) {
        let scale = Scale::Depth;
        match what {
            Drawn::Truth => {
                let limits = (0.0, f64::INFINITY);
                if let Some(truth) = exact(moment, &self.spec.truth, limits) {
                    picture.values(&truth.depth, scale);
                }
            }
            Drawn::Result(found) => picture.values(found, scale),
        }
    }
}
