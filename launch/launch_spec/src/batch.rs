//! `[batch.NAME]`: cameras whose images come as one frame.

use schema_frames::Modality;
use schema_frames::document::BATCH_RIG;

/// Most cameras of a batch.
pub const MAX_CAMERAS: usize = 1024;
/// Most bytes of a frame of a batch.
pub const MAX_FRAME_BYTES: u64 = 1 << 30;
/// Readers of a batch's topic at a time, if `[topic]` does not say: its frames are large, and each
/// reader takes five slots.
pub const READERS: u32 = 2;

/// One batch.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Batch {
    /// Cameras in the order of their images, each as `RIG/SENSOR`. In a pattern, `*` stands for any
    /// part of a name: what it finds comes by rig (`ego` first, then by name) and then by sensor.
    pub cameras: Vec<String>,
    /// What of them: images only. Each has a topic `batch/NAME/MODALITY` of its own.
    pub modalities: Vec<Modality>,
}

impl Batch {
    /// Name of one of its topics, without the domain.
    pub fn topic(name: &str, modality: Modality) -> String {
        format!("{BATCH_RIG}/{name}/{}", modality.name())
    }
}

/// Whether a name fits a pattern in which `*` stands for any letters, also for none.
pub(crate) fn fits(pattern: &str, name: &str) -> bool {
    let mut parts = pattern.split('*');
    let first = parts.next().unwrap_or_default();
    let Some(mut rest) = name.strip_prefix(first) else {
        return false;
    };
    let mut parts: Vec<&str> = parts.collect();
    // Without a star the whole name was the first part.
    let Some(last) = parts.pop() else {
        return rest.is_empty();
    };
    for part in parts {
        match rest.find(part) {
            Some(at) => rest = &rest[at + part.len()..],
            None => return false,
        }
    }
    rest.ends_with(last)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_star_stands_for_any_part_of_a_name() {
        for (pattern, name) in [
            ("front", "front"),
            ("*", "front"),
            ("f*t", "front"),
            ("front*", "front"),
            ("*ro*", "front"),
            ("a*b*c", "a1b2b3c"),
        ] {
            assert!(fits(pattern, name), "{pattern} {name}");
        }
        for (pattern, name) in [
            ("front", "front_left"),
            ("*left", "left_1"),
            ("ab*ba", "aba"),
            ("", "front"),
            ("f*x*t", "front"),
        ] {
            assert!(!fits(pattern, name), "{pattern} {name}");
        }
    }
}
