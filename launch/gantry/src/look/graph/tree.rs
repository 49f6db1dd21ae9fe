//! Processes with their topics as lines of text.

use std::collections::BTreeMap;

use crate::look::census::Member;

/// Both ends of a topic.
pub struct Ends<'a> {
    /// Its name.
    pub topic: &'a str,
    /// Its type in a word.
    pub type_name: &'a str,
    /// What else there is to say, for example its rate.
    pub note: String,
    /// Processes that write it.
    pub writers: &'a [Member],
    /// Processes that read it.
    pub readers: &'a [Member],
}

/// For each process, what it writes and for whom, and what it reads and from whom. Topics that
/// nobody writes come last.
pub fn lines(topics: &[Ends]) -> Vec<String> {
    let mut processes: BTreeMap<&Member, (Vec<&Ends>, Vec<&Ends>)> = BTreeMap::new();
    for ends in topics {
        for writer in ends.writers {
            processes.entry(writer).or_default().0.push(ends);
        }
        for reader in ends.readers {
            processes.entry(reader).or_default().1.push(ends);
        }
    }
    let name = topics
        .iter()
        .map(|ends| ends.topic.chars().count())
        .max()
        .unwrap_or(0);
    let what = topics
        .iter()
        .map(|ends| label(ends).chars().count())
        .max()
        .unwrap_or(0);
    let line = |word: &str, ends: &Ends, others: String| {
        format!(
            "  {word:<6} {:name$}  {:what$}  {others}",
            ends.topic,
            label(ends)
        )
    };
    let mut lines = Vec::new();
    for (process, (writes, reads)) in processes {
        lines.push(titled(process));
        lines.extend(
            writes
                .iter()
                .map(|ends| line("writes", ends, format!("→ {}", list(ends.readers)))),
        );
        lines.extend(
            reads
                .iter()
                .map(|ends| line("reads", ends, format!("← {}", list(ends.writers)))),
        );
    }
    let orphans: Vec<&Ends> = topics
        .iter()
        .filter(|ends| ends.writers.is_empty())
        .collect();
    if !orphans.is_empty() {
        lines.push("written by nobody".into());
        lines.extend(
            orphans
                .iter()
                .map(|ends| line("", ends, format!("→ {}", list(ends.readers)))),
        );
    }
    lines
}

fn label(ends: &Ends) -> String {
    match ends.note.as_str() {
        "" => ends.type_name.to_owned(),
        note => format!("{}, {note}", ends.type_name),
    }
}

fn titled(member: &Member) -> String {
    match member.pid {
        Some(pid) => format!("{} ({pid})", member.name),
        None => member.name.clone(),
    }
}

fn list(members: &[Member]) -> String {
    match members.is_empty() {
        true => "nobody".into(),
        false => members.iter().map(titled).collect::<Vec<_>>().join(", "),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn member(pid: u32, name: &str) -> Member {
        Member {
            pid: Some(pid),
            name: name.into(),
        }
    }

    #[test]
    fn every_end_of_every_topic_has_a_line() {
        let (simd, view) = ([member(1, "simd")], [member(2, "gantry-view")]);
        let ends = |topic, writers, readers| Ends {
            topic,
            type_name: "rgb",
            note: "20.0 Hz".into(),
            writers,
            readers,
        };
        let lines = lines(&[ends("ego/front/rgb", &simd, &view), ends("a/b", &[], &view)]);
        assert_eq!(
            lines,
            [
                "simd (1)",
                "  writes ego/front/rgb  rgb, 20.0 Hz  → gantry-view (2)",
                "gantry-view (2)",
                "  reads  ego/front/rgb  rgb, 20.0 Hz  ← simd (1)",
                "  reads  a/b            rgb, 20.0 Hz  ← nobody",
                "written by nobody",
                "         a/b            rgb, 20.0 Hz  → gantry-view (2)",
            ]
        );
    }
}
