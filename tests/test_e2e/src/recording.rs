//! Reads recordings back with the `mcap` crate alone, independently of our own code.

use std::collections::BTreeMap;
use std::path::Path;

/// Sequence numbers of every channel in file order.
pub type Sequences = BTreeMap<String, Vec<u64>>;

/// Reads a complete file.
///
/// # Panics
/// If it cannot be read to its end, or its summary disagrees with its messages.
pub fn sequences(path: &Path) -> Sequences {
    let bytes = std::fs::read(path).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let messages = mcap::MessageStream::new(&bytes)
        .unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let mut found = Sequences::new();
    let mut n_messages = 0;
    for message in messages {
        let message = message.unwrap_or_else(|error| panic!("{}: {error}", path.display()));
        found
            .entry(message.channel.topic.clone())
            .or_default()
            .push(u64::from(message.sequence));
        n_messages += 1;
    }
    let summary =
        mcap::Summary::read(&bytes).unwrap_or_else(|error| panic!("{}: {error}", path.display()));
    let counted = summary
        .and_then(|summary| summary.stats)
        .map(|stats| stats.message_count);
    assert_eq!(
        counted,
        Some(n_messages),
        "{}: the summary counts what is there",
        path.display()
    );
    found
}

/// Asserts that a channel's numbers have no gap, and returns the first and the last.
///
/// # Panics
/// If the channel is missing, or has a gap.
pub fn gapless(found: &Sequences, channel: &str) -> (u64, u64) {
    let numbers = found
        .get(channel)
        .unwrap_or_else(|| panic!("no channel {channel} among {:?}", found.keys()));
    for pair in numbers.windows(2) {
        assert_eq!(pair[1], pair[0] + 1, "{channel} has a gap");
    }
    (numbers[0], numbers[numbers.len() - 1])
}
