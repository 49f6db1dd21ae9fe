//! Which topics are recorded: patterns that take them in, and patterns that leave them out.

use schema_bus::names;
use schema_recording::pattern::matches;

/// Patterns of topics with `*` and `?`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Select {
    /// Topics to take; empty means all but the spectator's, which is rendered only for its readers.
    pub topics: Vec<String>,
    /// Topics to leave out of those.
    pub exclude: Vec<String>,
}

impl Select {
    /// Whether `topic` is taken.
    pub fn takes(&self, topic: &str) -> bool {
        let any = |patterns: &[String]| patterns.iter().any(|pattern| matches(pattern, topic));
        let is_usual = self.topics.is_empty() && topic != names::SPECTATOR_RGB;
        (is_usual || any(&self.topics)) && !any(&self.exclude)
    }

    /// Whether a channel of a recording is taken: by the topic that it belongs to. Channels of the
    /// world, transforms, calibrations and odometry always are.
    pub fn takes_channel(&self, channel: &str) -> bool {
        let name = channel.strip_prefix('/').unwrap_or(channel);
        let is_world = ["world/", "control/"].iter().any(|it| name.starts_with(it))
            || name == "tf"
            || ["/calibration", "/odometry"]
                .iter()
                .any(|it| name.ends_with(it));
        let topic = ["/gantry", "/about", "/space"]
            .iter()
            .find_map(|suffix| name.strip_suffix(suffix))
            .unwrap_or(name);
        is_world || self.takes(topic)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_excluded_is_not_taken() {
        let select = Select {
            topics: vec!["ego/*".into()],
            exclude: vec!["*/dvs".into(), "ego/rear/*".into()],
        };
        assert!(select.takes("ego/front/rgb"));
        assert!(!select.takes("ego/front/dvs") && !select.takes("ego/rear/rgb"));
        assert!(!select.takes("other/front/rgb"));
        assert!(Select::default().takes("anything"));
        assert!(!Select::default().takes("spectator/rgb"));
        let asked = Select {
            topics: vec!["spectator/*".into()],
            exclude: vec![],
        };
        assert!(asked.takes("spectator/rgb"));
    }

    #[test]
    fn a_channel_goes_with_its_topic() {
        let select = Select {
            topics: vec!["ego/front/rgb".into(), "detector/boxes".into()],
            exclude: vec![],
        };
        for channel in [
            "/ego/front/rgb",
            "/ego/front/rgb/gantry",
            "/detector/boxes/about",
            "/ego/front/calibration",
            "/tf",
            "/world/snapshot",
            "/control/journal",
        ] {
            assert!(select.takes_channel(channel), "{channel}");
        }
        assert!(!select.takes_channel("/ego/front/depth/gantry"));
        assert!(!select.takes_channel("/detector/tracks/space"));
    }
}
