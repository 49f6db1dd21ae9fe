//! What a commit message must look like: an imperative subject, and a body with the reason wherever
//! the change is not trivial.
//!
//! A program cannot judge whether the reason is a good one, or whether a commit holds one idea. It
//! sees the form only, and lets pass what it cannot tell.

/// Longest subject, characters: what `git log --oneline` and web pages show without cutting.
pub const MAX_SUBJECT: usize = 72;

/// Most changed lines, added and deleted ones together, of a commit that needs no body.
pub const MAX_LINES_WITHOUT_BODY: u64 = 60;

/// Verbs that look like another form, because they end in -ed, -ing or -s.
const VERBS: [&str; 14] = [
    "bring", "ping", "ring", "string", "swing", "bed", "embed", "shed", "wed", "alias", "bias",
    "canvas", "focus", "gas",
];

/// Lines at the end of a message that give no reason.
const TRAILERS: [&str; 6] = [
    "signed-off-by:",
    "co-authored-by:",
    "reviewed-by:",
    "acked-by:",
    "tested-by:",
    "change-id:",
];

/// One commit.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Commit {
    /// Short hash, for messages.
    pub hash: String,
    /// First line.
    pub subject: String,
    /// Everything below it.
    pub body: String,
    /// Added and deleted lines.
    pub n_changed_lines: u64,
}

/// What is wrong with a commit's message, one sentence each.
pub fn faults(commit: &Commit) -> Vec<String> {
    let mut faults = Vec::new();
    let subject = commit.subject.trim();
    let length = subject.chars().count();
    if length > MAX_SUBJECT {
        faults.push(format!(
            "the subject has {length} characters, but must have {MAX_SUBJECT} or less"
        ));
    }
    if subject.ends_with('.') {
        faults.push("the subject ends with a full stop".to_owned());
    }
    let first = first_word(subject);
    if !may_be_imperative(first) {
        faults.push(format!(
            "the subject begins with {first:?}, but must begin with an imperative (\"Add\", not \"Added\", \"Adds\" or \"Adding\")"
        ));
    }
    if commit.n_changed_lines > MAX_LINES_WITHOUT_BODY && !has_reason(&commit.body) {
        faults.push(format!(
            "{} lines change, but there is no body; say why (needed above {MAX_LINES_WITHOUT_BODY} lines)",
            commit.n_changed_lines
        ));
    }
    faults
}

/// The first word of a subject, after an area such as `simd_world:`.
fn first_word(subject: &str) -> &str {
    let mut words = subject.split_whitespace();
    let first = words.next().unwrap_or("");
    if first.ends_with(':') {
        words.next().unwrap_or("")
    } else {
        first
    }
}

fn may_be_imperative(word: &str) -> bool {
    let word = word.to_lowercase();
    if word.is_empty() {
        return false;
    }
    if VERBS.contains(&word.as_str()) || word.ends_with("eed") || word.ends_with("ss") {
        return true;
    }
    !["ed", "ing", "s"]
        .iter()
        .any(|ending| word.ends_with(ending))
}

fn has_reason(body: &str) -> bool {
    body.lines().map(str::trim).any(|line| {
        let lower = line.to_lowercase();
        !line.is_empty() && !TRAILERS.iter().any(|trailer| lower.starts_with(trailer))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn commit(subject: &str, body: &str, n_changed_lines: u64) -> Commit {
        Commit {
            hash: "0123456".into(),
            subject: subject.into(),
            body: body.into(),
            n_changed_lines,
        }
    }

    #[test]
    fn a_short_imperative_needs_no_body_for_a_small_change() {
        for subject in [
            "Add a test",
            "simd: feed the gate before it is asked",
            "Pass the seed on",
            "Bring lamps back",
            "Embed the quickstart",
        ] {
            assert_eq!(
                faults(&commit(subject, "", MAX_LINES_WITHOUT_BODY)),
                Vec::<String>::new(),
                "{subject}"
            );
        }
    }

    #[test]
    fn other_forms_of_the_verb_and_full_stops_are_refused() {
        for subject in [
            "Added a test",
            "Adds a test",
            "Adding a test",
            "world: fixed lamps",
            "",
            "world:",
            "Add a test.",
        ] {
            assert_eq!(faults(&commit(subject, "", 1)).len(), 1, "{subject:?}");
        }
    }

    #[test]
    fn a_subject_is_counted_in_characters() {
        let longest = format!("Add {}", "ä".repeat(MAX_SUBJECT - 4));
        assert!(faults(&commit(&longest, "", 1)).is_empty());
        assert_eq!(faults(&commit(&format!("{longest}ä"), "", 1)).len(), 1);
    }

    #[test]
    fn a_large_change_needs_a_reason_and_a_trailer_is_none() {
        let n = MAX_LINES_WITHOUT_BODY + 1;
        assert_eq!(faults(&commit("Split the renderer", "", n)).len(), 1);
        let signed = "\n\nSigned-off-by: A <a@b.c>\n";
        assert_eq!(faults(&commit("Split the renderer", signed, n)).len(), 1);
        let reason = "Two ideas were in one file.\n";
        assert!(faults(&commit("Split the renderer", reason, n)).is_empty());
    }
}
