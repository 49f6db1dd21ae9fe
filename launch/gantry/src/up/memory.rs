//! Compares, before anything starts, the shared memory that a launch file needs with what `/dev/shm`
//! has.

use std::fmt::Write as _;

use launch_cli::wrong_usage;
use launch_spec::{Launch, TopicBudget};
use schema_bus::{
    FrameTopic, MemoryShortage, OTHER_BYTES, check_shared_memory, shared_memory_free,
    shared_memory_needed,
};

fn topic_bytes(topic: &TopicBudget) -> u64 {
    FrameTopic::new(topic.modality, topic.max_payload_bytes).segment_bytes(topic.modality)
}

/// Shared memory that a launch file needs in all.
pub fn total_bytes(launch: &Launch) -> u64 {
    shared_memory_needed(launch.memory_budget().iter().map(topic_bytes))
}

/// Refuses a launch file that cannot fit.
pub fn check(launch: &Launch) -> anyhow::Result<()> {
    check_shared_memory(total_bytes(launch), 0).map_err(|short| wrong_usage(sentence(short)))
}

fn sentence(short: MemoryShortage) -> String {
    let Some(free_bytes) = short.free_bytes else {
        return "cannot look at /dev/shm, where all frames live; mount it with `mount -t tmpfs tmpfs /dev/shm`".into();
    };
    let size = short.need_bytes.div_ceil(1 << 30);
    format!(
        "this launch file needs {} MiB of shared memory, but /dev/shm has {} MiB free; enlarge it (Docker: --shm-size={size}g, else \
         `mount -o remount,size={size}G /dev/shm` as root), or take fewer or smaller sensors (`gantry up --dry-run` lists each)",
        mebibytes(short.need_bytes),
        mebibytes(free_bytes),
    )
}

/// Shared memory of each topic as TOML comments, for `--dry-run`.
pub fn table(launch: &Launch, domain: &str) -> String {
    let mut text =
        String::from("\n# Shared memory, reserved when a topic gets its first reader:\n");
    for topic in launch.memory_budget() {
        let name = format!("{domain}/{}", topic.topic);
        let _ = writeln!(
            text,
            "# {:>6} MiB  {name} (frames of up to {} bytes)",
            mebibytes(topic_bytes(&topic)),
            topic.max_payload_bytes
        );
    }
    let free = shared_memory_free().map_or("unknown".to_owned(), |free| {
        format!("{} MiB", mebibytes(free))
    });
    let _ = write!(
        text,
        "# {:>6} MiB  in all, with {} MiB for everything else; free in /dev/shm: {free}",
        mebibytes(total_bytes(launch)),
        mebibytes(OTHER_BYTES)
    );
    text
}

fn mebibytes(bytes: u64) -> u64 {
    bytes.div_ceil(1 << 20)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn too_little_is_one_sentence_with_both_figures_and_a_remedy() {
        let message = sentence(MemoryShortage {
            need_bytes: 900 << 20,
            free_bytes: Some(64 << 20),
        });
        assert!(
            message.contains("900 MiB")
                && message.contains("64 MiB free")
                && message.contains("--shm-size=1g"),
            "{message}"
        );
        assert_eq!(message.lines().count(), 1);
    }

    #[test]
    fn the_quickstart_needs_less_than_a_gibibyte() {
        let launch = Launch::parse(include_str!("../../../quickstart.toml"), "quickstart").unwrap();
        let need = total_bytes(&launch);
        assert!((500 << 20..1 << 30).contains(&need), "{need}");
        assert!(table(&launch, "gantry").contains("gantry/ego/front/rgb"));
    }
}
