//! The topics that a launch file's processes publish, with the limits that it gives them.

use launch_spec::Launch;
use schema_bus::ResultTopic;
use schema_frames::ResultType;
use schema_frames::about::{About, BytesSchema};

/// Topics of the launch file's own processes, as they are made.
pub fn own_topics(launch: &Launch) -> impl Iterator<Item = (&str, ResultTopic)> {
    launch.topics.iter().filter_map(|(name, topic)| {
        let kind = topic.result?;
        let mut made = ResultTopic::new(kind);
        let or = |wish: Option<u32>, usual: usize| wish.map_or(usual, |wish| wish as usize);
        made.qos.readers = or(topic.limits.readers, made.qos.readers);
        made.qos.buffer = or(topic.limits.buffer, made.qos.buffer);
        made.qos.borrowed = or(topic.limits.borrowed, made.qos.borrowed);
        if let Some(bytes) = topic.max_bytes {
            made.body_bytes = usize::try_from(bytes).unwrap_or(usize::MAX);
        }
        if kind == ResultType::Bytes {
            // Which schema it is, the writer says; the topic itself carries none.
            made.about = About {
                schema: Some(BytesSchema {
                    name: "of the writer".into(),
                    message_encoding: "of the writer".into(),
                    ..Default::default()
                }),
                ..Default::default()
            };
        }
        Some((name.as_str(), made))
    })
}
