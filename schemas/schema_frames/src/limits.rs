//! Limits of the contract: how much of everything a world holds and a request may ask for. They
//! stand in one place so that both ends know them, and so that a table can list them.

/// Most actors of a world, those of the map included: a snapshot has a record of 256 bytes for
/// each.
pub const MAX_ACTORS: usize = 16_384;

/// Longest role of an actor, bytes.
pub const MAX_ROLE_BYTES: usize = 256;

/// Most attributes of an actor.
pub const MAX_ATTRIBUTES: usize = 256;

/// Longest name of an attribute, bytes.
pub const MAX_ATTRIBUTE_NAME_BYTES: usize = 256;

/// Longest value of an attribute, bytes.
pub const MAX_ATTRIBUTE_BYTES: usize = 1024;

/// Longest sum of the roles and attributes of all actors, bytes of JSON: `world/actors` is sent
/// whole whenever it changes.
pub const MAX_ACTOR_TEXT_BYTES: usize = 16 << 20;

/// Most commands of one request on `control/world`.
pub const MAX_COMMANDS: usize = 16_384;

/// Length of an answer beyond which further questions of the same request are refused, bytes, about.
pub const MAX_ANSWER_BYTES: usize = 64 << 20;

/// Longest sentence of a refusal, bytes; a longer one is cut.
pub const MAX_SENTENCE_BYTES: usize = 4096;

/// Most vehicle controls of one sample: one for each actor.
pub const MAX_CONTROL_RECORDS: usize = 16_384;
const _: () = assert!(MAX_CONTROL_RECORDS == MAX_ACTORS);

/// A text of an actor that is too long, or one too many.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TextLimit {
    /// The role.
    #[error("the role has {0} bytes, at most {MAX_ROLE_BYTES} are kept; choose a shorter one")]
    Role(usize),
    /// Number of attributes.
    #[error("{0} attributes are given, at most {MAX_ATTRIBUTES} are kept; leave some out")]
    Attributes(usize),
    /// Name of an attribute.
    #[error(
        "the name of an attribute has {0} bytes, at most {MAX_ATTRIBUTE_NAME_BYTES} are kept; choose a shorter one"
    )]
    AttributeName(usize),
    /// Value of an attribute.
    #[error(
        "attribute {name:?} has {n_bytes} bytes, at most {MAX_ATTRIBUTE_BYTES} are kept; choose a shorter value"
    )]
    Attribute {
        /// Name of the attribute.
        name: String,
        /// Length of its value.
        n_bytes: usize,
    },
}

/// Checks the texts that come with a new actor.
///
/// # Errors
/// [`TextLimit`] for the first one that is too long.
pub fn check_actor_texts<'t>(
    role: &str,
    attributes: impl ExactSizeIterator<Item = (&'t str, &'t str)>,
) -> Result<(), TextLimit> {
    if role.len() > MAX_ROLE_BYTES {
        return Err(TextLimit::Role(role.len()));
    }
    if attributes.len() > MAX_ATTRIBUTES {
        return Err(TextLimit::Attributes(attributes.len()));
    }
    for (name, value) in attributes {
        if name.len() > MAX_ATTRIBUTE_NAME_BYTES {
            return Err(TextLimit::AttributeName(name.len()));
        }
        // The role is an attribute, too, for clients of CARLA.
        if name == "role_name" && value.len() > MAX_ROLE_BYTES {
            return Err(TextLimit::Role(value.len()));
        }
        if value.len() > MAX_ATTRIBUTE_BYTES {
            return Err(TextLimit::Attribute {
                name: name.to_owned(),
                n_bytes: value.len(),
            });
        }
    }
    Ok(())
}

/// Bytes of a text in JSON, quotes included.
pub fn json_bytes(text: &str) -> usize {
    let of_char = |byte: u8| match byte {
        b'"' | b'\\' | b'\n' | b'\r' | b'\t' | 8 | 12 => 2,
        0..=31 => 6,
        _ => 1,
    };
    text.bytes().map(of_char).sum::<usize>() + 2
}

/// A sentence that is no longer than [`MAX_SENTENCE_BYTES`]: what a client sent may stand in it.
pub fn cut(mut sentence: String) -> String {
    if sentence.len() > MAX_SENTENCE_BYTES {
        let mut end = MAX_SENTENCE_BYTES - '…'.len_utf8();
        while !sentence.is_char_boundary(end) {
            end -= 1;
        }
        sentence.truncate(end);
        sentence.push('…');
    }
    sentence
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_of_actors_are_bounded_one_by_one() {
        let long = "x".repeat(MAX_ATTRIBUTE_BYTES + 1);
        let check = |role: &str, name: &str, value: &str| {
            check_actor_texts(role, [(name, value)].into_iter()).map_err(|e| e.to_string())
        };
        assert_eq!(check("hero", "color", &long[1..]), Ok(()));
        assert!(check(&long[..257], "a", "").unwrap_err().contains("257"));
        assert!(check("", &long[..257], "").unwrap_err().contains("256"));
        assert!(
            check("", "a", &long)
                .unwrap_err()
                .contains("\"a\" has 1025")
        );
        assert!(check("", "role_name", &long).unwrap_err().contains("role"));
        let many = vec![("a", ""); MAX_ATTRIBUTES + 1];
        assert_eq!(
            check_actor_texts("", many.into_iter()),
            Err(TextLimit::Attributes(MAX_ATTRIBUTES + 1))
        );
    }

    #[test]
    fn a_text_takes_as_much_json_as_serde_writes() {
        for text in ["", "plain", "a\"b\\c\n\u{1}\u{7f}é😀\t\r\u{8}\u{c}"] {
            let written = serde_json::to_string(text).unwrap().len();
            assert_eq!(json_bytes(text), written, "{text:?}");
        }
    }

    #[test]
    fn a_sentence_is_cut_between_characters() {
        let short = "short".to_owned();
        assert_eq!(cut(short.clone()), short);
        let long = cut("é".repeat(MAX_SENTENCE_BYTES));
        assert!(long.len() <= MAX_SENTENCE_BYTES && long.ends_with('…'));
    }
}
