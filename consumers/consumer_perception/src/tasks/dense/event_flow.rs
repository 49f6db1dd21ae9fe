//! Optical flow from events, over windows of 100 ms that end ten times a second: DSEC's errors.
//!
//! As all flow here it stands on the pixels of the window's end and says where their points are now
//! minus where they were at its beginning. DSEC's stands on those of the beginning; the displacements
//! are of the same points.

use consumer_metrics::event_flow::Collector;
use schema_frames::Modality;

use super::flow::{has_truth, pairs_of};
use super::pixels::read_pixels;
use crate::evidence::moment::Moment;
use crate::picture::Picture;
use crate::picture::pixels::Pixels;
use crate::tasks::Unreadable;
use crate::tasks::{Bad, Drawn, Headline, Measure, Reading, Spec};

/// The measure.
pub struct EventFlow {
    spec: Spec,
    now: Option<(u64, Pixels<[f32; 2]>)>,
}

impl EventFlow {
    /// For a task.
    pub fn new(spec: &Spec) -> EventFlow {
        EventFlow {
            spec: spec.clone(),
            now: None,
        }
    }
}

fn exact(moment: &Moment<'_>, sensor: &str) -> Option<Pixels<[f32; 2]>> {
    let frame = moment.frame(sensor, Modality::Flow)?;
    has_truth(&frame.header).then(|| Pixels {
        width: frame.header.width,
        height: frame.header.height,
        values: frame.elements(),
    })
}

impl Measure for EventFlow {
    type Estimate = Pixels<[f32; 2]>;
    type Part = Collector;
    type Total = Collector;

    fn headline(&self) -> Headline {
        Headline {
            metric: "EPE",
            unit: "px",
            higher_is_better: false,
        }
    }

    fn watch(&mut self, moment: &Moment<'_>) {
        let found = exact(moment, &self.spec.truth);
        self.now = found.map(|truth| (moment.set.tick, truth));
    }

    fn empty(&self) -> Collector {
        Collector::new()
    }

    fn read(&self, reading: &Reading<'_>) -> Result<Self::Estimate, Unreadable> {
        read_pixels(reading)
    }

    fn part(&self, moment: &Moment<'_>, estimate: Option<&Self::Estimate>) -> Option<Collector> {
        let (_, truth) = self
            .now
            .as_ref()
            .filter(|(tick, _)| *tick == moment.set.tick)?;
        let found = pairs_of(estimate, truth.width, truth.height);
        let is_finite = |flow: &[f32; 2]| flow.iter().all(|part| part.is_finite());
        let mask: Vec<bool> = truth.values.iter().map(is_finite).collect();
        let mut part = Collector::new();
        part.add(&truth.values, &found, Some(&mask)).ok()?;
        Some(part)
    }

    fn add(&self, total: &mut Collector, part: &Collector) {
        total.merge(part);
    }

    fn bad(&self, part: &Collector) -> Option<Bad> {
        let scores = part.scores();
        Some(match scores.epe_px {
            Some(epe) => Bad {
                badness: epe,
                why: format!("EPE {epe:.2} px"),
            },
            None => Bad {
                badness: 1e3,
                why: "no flow".into(),
            },
        })
    }

    fn draw(&self, picture: &mut Picture, moment: &Moment<'_>, what: Drawn<'_, Self::Estimate>) {
        match what {
            Drawn::Truth => {
                if let Some(truth) = exact(moment, &self.spec.truth) {
                    picture.flow(&truth);
                }
            }
            Drawn::Result(found) => picture.flow(found),
        }
    }
}
