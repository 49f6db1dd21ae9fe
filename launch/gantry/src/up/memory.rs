//! Compares, before anything starts, the shared memory that a launch file needs with what `/dev/shm`
//! has.

use std::fmt::Write as _;

use launch_cli::wrong_usage;
use launch_spec::{Launch, Process, TopicBudget};
use schema_bus::{
    FrameTopic, MemoryShortage, OTHER_BYTES, ResultTopic, check_shared_memory, shared_memory_free,
    shared_memory_needed,
};

use super::topics::own_topics;

/// The topic as the daemon makes it.
fn frame_topic(topic: &TopicBudget) -> FrameTopic {
    let usual = FrameTopic::new(topic.modality, topic.max_payload_bytes);
    let or = |wish: Option<u32>, usual: usize| wish.map_or(usual, |wish| wish as usize);
    FrameTopic {
        max_readers: or(topic.limits.readers, usual.max_readers),
        buffer: or(topic.limits.buffer, usual.buffer),
        borrowed: or(topic.limits.borrowed, usual.borrowed),
        ..usual
    }
}

fn topic_bytes(topic: &TopicBudget) -> u64 {
    frame_topic(topic).segment_bytes(topic.modality)
}

/// Shared memory that a launch file needs in all. A replay counts the topics of its recording itself.
pub fn total_bytes(launch: &Launch) -> u64 {
    let is_replayed = |process: &Process| process.is_daemon() && !process.is_simulator();
    let budget = if launch.processes.iter().any(is_replayed) {
        Vec::new()
    } else {
        launch.memory_budget()
    };
    let frames = budget.into_iter();
    let results = own_topics(launch).map(|(_, topic)| topic.segment_bytes());
    shared_memory_needed(frames.map(|topic| topic_bytes(&topic)).chain(results))
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
         `mount -o remount,size={size}G /dev/shm` as root), or take fewer or smaller sensors, or fewer places in [topic] (`gantry up --dry-run` lists each)",
        mebibytes(short.need_bytes),
        mebibytes(free_bytes),
    )
}

/// Shared memory of each topic as TOML comments, for `--dry-run`.
pub fn table(launch: &Launch, domain: &str) -> String {
    let mut text =
        String::from("\n# Shared memory, reserved when a topic gets its first reader:\n");
    for topic in launch.memory_budget() {
        let made = frame_topic(&topic);
        let _ = writeln!(
            text,
            "# {:>6} MiB  {domain}/{} (frames of up to {} bytes; {})",
            mebibytes(topic_bytes(&topic)),
            topic.topic,
            topic.max_payload_bytes,
            places(made.max_readers, made.buffer, made.borrowed)
        );
    }
    for (name, topic) in own_topics(launch) {
        let ResultTopic {
            kind,
            body_bytes,
            qos,
            ..
        } = &topic;
        let _ = writeln!(
            text,
            "# {:>6} MiB  {domain}/{name} ({} of up to {body_bytes} bytes; {})",
            mebibytes(topic.segment_bytes()),
            kind.name(),
            places(qos.readers, qos.buffer, qos.borrowed)
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

/// Readers' places of a topic in words.
fn places(readers: usize, buffer: usize, borrowed: usize) -> String {
    format!("{readers} readers, {buffer} wait and {borrowed} are held")
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

    #[test]
    fn places_of_readers_count_for_sensors_and_for_topics_of_ones_own() {
        let sensor = "version = 1\n[sensor.front]\nkind = \"camera\"\n";
        let total = |topics: &str| {
            let launch = Launch::parse(&format!("{sensor}{topics}"), "x").unwrap();
            total_bytes(&launch)
        };
        let usual = total("");
        // 43 slots of 1 920 000 + 384 bytes become 2 × (5 + 1) + 3 = 15.
        let fewer = total("[topic.\"ego/front/rgb\"]\nreaders = 2\nbuffer = 5\nborrowed = 1\n");
        assert_eq!(usual - fewer, 28 * 1_920_384);
        let own = |more: &str| total(&format!("[topic.\"a/b\"]\ntype = \"image\"\n{more}")) - usual;
        let (one, two) = (own("max_bytes = 1000000"), own("max_bytes = 2000000"));
        // The rest is the header of a slot and the room for inputs.
        let places = |bytes: u64| (one / bytes, two / bytes);
        assert!(two > one && places(1_000_000).0 >= 43, "{one} {two}");
        assert!(own("readers = 2\nmax_bytes = 1000000") < one);
        let launch = Launch::parse(
            &format!("{sensor}[topic.\"a/b\"]\ntype = \"image\"\nreaders = 5\nmax_bytes = 7777\n"),
            "x",
        )
        .unwrap();
        let table = table(&launch, "lab");
        assert!(
            table.contains("lab/a/b (image of up to 7777 bytes; 5 readers,"),
            "{table}"
        );
    }
}
