//! The topics of a launch file and the largest frame of each. `schema_bus` computes from them how
//! much shared memory they need.

use schema_frames::Modality;

use crate::model::Launch;
use crate::topic::TopicLimits;

/// One topic of a sensor.
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
    /// All topics of this file's sensors, in the order of the sensors' ids.
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
