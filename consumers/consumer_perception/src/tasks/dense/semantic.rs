//! A class for every pixel: mean intersection over union.

use consumer_metrics::classes::{Collector, Settings};
use schema_frames::Modality;

use super::pixels::read_pixels;
use crate::evidence::moment::Moment;
use crate::picture::Picture;
use crate::picture::pixels::Pixels;
use crate::suite::SuiteFault;
use crate::tasks::Unreadable;
use crate::tasks::classes::{semantic_table, semantic_targets};
use crate::tasks::{Bad, Drawn, Headline, Measure, Reading, Spec};

/// Classes that do not count.
pub fn ignored(asked: &[u8]) -> Vec<u8> {
    (0..=u8::MAX)
        .filter(|class| !asked.contains(class))
        .collect()
}

/// The measure.
pub struct Semantic {
    spec: Spec,
    ignored: Vec<u8>,
    now: Option<(u64, Pixels<u8>)>,
}

impl Semantic {
    /// For a task.
    ///
    /// # Errors
    /// A sentence if a class cannot be asked for.
    pub fn new(spec: &Spec) -> Result<Semantic, SuiteFault> {
        Ok(Semantic {
            spec: spec.clone(),
            ignored: ignored(&semantic_targets(&spec.classes)?),
            now: None,
        })
    }
}

/// Exact classes of a tick.
fn exact(moment: &Moment<'_>, sensor: &str) -> Option<Pixels<u8>> {
    let frame = moment.frame(sensor, Modality::Semantic)?;
    Some(Pixels {
        width: frame.header.width,
        height: frame.header.height,
        values: frame.elements(),
    })
}

/// What is wrong with some classes, in words.
pub fn bad(of: &Collector) -> Option<Bad> {
    let scores = of.scores();
    let wrong = 1.0 - scores.accuracy?;
    Some(Bad {
        badness: wrong,
        why: format!("{:.1} % have a wrong class", wrong * 100.0),
    })
}

impl Measure for Semantic {
    type Estimate = Pixels<u8>;
    type Part = Collector;
    type Total = Collector;

    fn headline(&self) -> Headline {
        Headline {
            metric: "mIoU",
            unit: "",
            higher_is_better: true,
        }
    }

    fn watch(&mut self, moment: &Moment<'_>) {
        let found = exact(moment, &self.spec.truth);
        self.now = found.map(|truth| (moment.set.tick, truth));
    }

    fn empty(&self) -> Collector {
        Collector::new(Settings {
            ignored: self.ignored.clone(),
        })
    }

    fn read(&self, reading: &Reading<'_>) -> Result<Pixels<u8>, Unreadable> {
        let mut found: Pixels<u8> = read_pixels(reading)?;
        let table = semantic_table(reading.about);
        for class in &mut found.values {
            *class = table[usize::from(*class)];
        }
        Ok(found)
    }

    fn part(&self, moment: &Moment<'_>, estimate: Option<&Pixels<u8>>) -> Option<Collector> {
        let (_, truth) = self
            .now
            .as_ref()
            .filter(|(tick, _)| *tick == moment.set.tick)?;
        let none = || vec![u8::MAX; truth.values.len()];
        let found = estimate.and_then(|found| found.of_size(truth.width, truth.height));
        let mut part = self.empty();
        match found {
            Some(found) => part.add(&truth.values, found, None).ok()?,
            None => part.add(&truth.values, &none(), None).ok()?,
        }
        Some(part)
    }

    fn add(&self, total: &mut Collector, part: &Collector) {
        total.merge(part);
    }

    fn bad(&self, part: &Collector) -> Option<Bad> {
        bad(part)
    }

    fn draw(&self, picture: &mut Picture, moment: &Moment<'_>, what: Drawn<'_, Pixels<u8>>) {
        match what {
            Drawn::Truth => {
                if let Some(truth) = exact(moment, &self.spec.truth) {
                    picture.classes(&truth);
                }
            }
            Drawn::Result(found) => picture.classes(found),
        }
    }
}
