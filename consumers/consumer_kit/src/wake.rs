//! Which events wake a reader: each topic's own, so that no frame waits for another.

use std::time::Duration;

use schema_bus::{Bus, BusError, WaitSet, names};
use schema_frames::{Modality, SensorKind};

/// The events that a reader of several topics sleeps on, none twice.
///
/// A topic's own event is notified as soon as its frame is sent. Views are the exception: those of
/// one tick are drawn in one go and sent together, so a reader of several views of one rig is woken
/// once, by `<rig>/tick`, and not once per view.
#[derive(Debug, Default)]
pub struct WakeUps {
    events: Vec<String>,
    wait_set: WaitSet,
}

impl WakeUps {
    /// No events yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Listens to what announces frames of `topic` to a reader of all of `followed`. Call it before
    /// the topic is drained, so that no frame comes unseen in between. Returns whether a listener
    /// was added.
    ///
    /// # Errors
    /// [`BusError`] if the event cannot be opened.
    pub fn attach<'a>(
        &mut self,
        bus: &Bus,
        topic: &str,
        followed: impl IntoIterator<Item = &'a str>,
    ) -> Result<bool, BusError> {
        self.listen(bus, &event_of(topic, followed))
    }

    /// Listens to one more event, for example the topic of results of another program. Returns
    /// whether it is new.
    ///
    /// # Errors
    /// [`BusError`] if the event cannot be opened.
    pub fn listen(&mut self, bus: &Bus, event: &str) -> Result<bool, BusError> {
        let is_new = !self.events.iter().any(|known| known == event);
        if is_new {
            self.wait_set.add(bus.listener(event)?);
            self.events.push(event.to_owned());
        }
        Ok(is_new)
    }

    /// Waits until one of the events is notified or `timeout` is over. Returns whether one was; an
    /// event says "look", never "how many".
    ///
    /// # Errors
    /// [`BusError::Service`].
    pub fn wait(&mut self, timeout: Duration) -> Result<bool, BusError> {
        self.wait_set.wait(timeout)
    }
}

/// The event that announces frames of `topic` to a reader of all of `followed`.
pub fn event_of<'a>(topic: &str, followed: impl IntoIterator<Item = &'a str>) -> String {
    let rig = names::rig_of(topic);
    let is_sibling = |other: &&str| is_view(other) && names::rig_of(other) == rig;
    if is_view(topic) && followed.into_iter().filter(is_sibling).count() > 1 {
        names::rig_tick(rig)
    } else {
        topic.to_owned()
    }
}

/// Whether frames of a topic are drawn as views.
fn is_view(topic: &str) -> bool {
    topic
        .rsplit('/')
        .next()
        .and_then(Modality::from_name)
        .is_some_and(|modality| modality.sensor_kind() == SensorKind::Camera)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn several_views_of_a_rig_share_a_wake_up_and_all_else_has_its_own() {
        let followed = [
            "ego/front/rgb",
            "ego/front/depth",
            "ego/rear/rgb",
            "other/front/rgb",
            "ego/imu/imu",
            "ego/roof/lidar",
            "detector/boxes",
        ];
        let events = followed.map(|topic| event_of(topic, followed));
        assert_eq!(
            events,
            [
                "ego/tick",
                "ego/tick",
                "ego/tick",
                "other/front/rgb",
                "ego/imu/imu",
                "ego/roof/lidar",
                "detector/boxes",
            ]
        );
        assert_eq!(
            event_of("ego/front/rgb", ["ego/front/rgb"]),
            "ego/front/rgb"
        );
    }
}
