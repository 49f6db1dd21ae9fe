//! The topics of a launch file and the largest frame of each. `schema_bus` computes from them how
//! much shared memory they need.

use schema_frames::Modality;

use crate::batch::{Batch, READERS};
use crate::model::Launch;
use crate::topic::TopicLimits;

/// One topic of a sensor or of a batch.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TopicBudget {
    /// Topic without the domain, such as `ego/front/rgb`.
    pub topic: String,
    /// What it carries.
    pub modality: Modality,
    /// Most payload bytes of one frame.
    pub max_payload_bytes: usize,
    /// Limits that the launch file gives it.
    pub limits: TopicLimits,
}

impl Launch {
    /// All topics of this file's sensors, in the order of the sensors' ids, and then of its batches.
    pub fn memory_budget(&self) -> Vec<TopicBudget> {
        let tick_secs = 1.0 / self.scenario.tick_hz;
        let topics = self.placed_sensors().into_iter().flat_map(|sensor| {
            sensor.spec.modalities().into_iter().map(move |modality| {
                let topic = format!("{}/{}/{}", sensor.rig, sensor.name, modality.name());
                TopicBudget {
                    limits: self.limits_of(&topic),
                    topic,
                    modality,
                    max_payload_bytes: sensor.spec.max_payload_bytes(modality, tick_secs),
                }
            })
        });
        topics.chain(self.batch_budget()).collect()
    }

    /// The topics of this file's batches, by name.
    pub fn batch_budget(&self) -> Vec<TopicBudget> {
        let tick_secs = 1.0 / self.scenario.tick_hz;
        let placed = self.placed_sensors();
        let topics = self.batches.iter().flat_map(|(name, batch)| {
            let first = placed
                .iter()
                .find(|sensor| batch.cameras.first() == Some(&sensor.full_name()));
            batch.modalities.iter().map(move |modality| {
                let topic = Batch::topic(name, *modality);
                let limits = self.limits_of(&topic);
                TopicBudget {
                    limits: TopicLimits {
                        readers: limits.readers.or(Some(READERS)),
                        ..limits
                    },
                    topic,
                    modality: *modality,
                    max_payload_bytes: first.map_or(0, |sensor| {
                        sensor.spec.max_payload_bytes(*modality, tick_secs) * batch.cameras.len()
                    }),
                }
            })
        });
        topics.collect()
    }

    /// Limits that the launch file gives a topic.
    pub fn limits_of(&self, topic: &str) -> TopicLimits {
        self.topics
            .get(topic)
            .map(|topic| topic.limits)
            .unwrap_or_default()
    }
}
