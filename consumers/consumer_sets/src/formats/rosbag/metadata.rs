//! `metadata.yaml` of a bag. It is version 5, which ROS 2 Humble writes and every later one reads.

use std::fmt::Write as _;

/// A topic of the bag.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TopicCount {
    /// Its name.
    pub name: String,
    /// Its type, e.g. `sensor_msgs/msg/Image`.
    pub kind: String,
    /// Whether late subscribers get the last message.
    pub latched: bool,
    /// Messages.
    pub n_messages: u64,
}

/// The quality of service under which a topic is played back, as YAML.
pub fn quality_of_service(latched: bool) -> String {
    let forever = "    sec: 9223372036\n    nsec: 854775807\n";
    let (depth, durability) = if latched { (1, 1) } else { (10, 2) };
    format!(
        "- history: 1\n  depth: {depth}\n  reliability: 1\n  durability: {durability}\n  deadline:\n{forever}  \
         lifespan:\n{forever}  liveliness: 1\n  liveliness_lease_duration:\n{forever}  \
         avoid_ros_namespace_conventions: false"
    )
}

/// The text of the file.
pub fn yaml(file: &str, start_nanos: u64, end_nanos: u64, topics: &[TopicCount]) -> String {
    let n_messages: u64 = topics.iter().map(|topic| topic.n_messages).sum();
    let duration = end_nanos.saturating_sub(start_nanos);
    let mut text = format!(
        "rosbag2_bagfile_information:\n  version: 5\n  storage_identifier: mcap\n  duration:\n    nanoseconds: {duration}\n  \
         starting_time:\n    nanoseconds_since_epoch: {start_nanos}\n  message_count: {n_messages}\n  \
         topics_with_message_count:\n"
    );
    for topic in topics {
        let quality = quality_of_service(topic.latched).replace('\n', "\\n");
        let _ = write!(
            text,
            "    - topic_metadata:\n        name: {}\n        type: {}\n        serialization_format: cdr\n        \
             offered_qos_profiles: \"{quality}\"\n      message_count: {}\n",
            topic.name, topic.kind, topic.n_messages
        );
    }
    let _ = write!(
        text,
        "  compression_format: \"\"\n  compression_mode: \"\"\n  relative_file_paths:\n    - {file}\n  files:\n    - path: {file}\n      \
         starting_time:\n        nanoseconds_since_epoch: {start_nanos}\n      duration:\n        nanoseconds: {duration}\n      \
         message_count: {n_messages}\n"
    );
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_add_up_and_the_quality_is_one_line() {
        let topic = |name: &str, n_messages| TopicCount {
            name: name.into(),
            kind: "std_msgs/msg/String".into(),
            latched: name == "/map",
            n_messages,
        };
        let text = yaml("a_0.mcap", 5, 25, &[topic("/map", 1), topic("/b", 6)]);
        assert!(text.contains("\n  message_count: 7\n"));
        assert!(text.contains("nanoseconds: 20\n"));
        assert_eq!(text.matches("offered_qos_profiles: \"- history").count(), 2);
        assert!(text.contains("durability: 1\\n") && text.contains("durability: 2\\n"));
    }
}
