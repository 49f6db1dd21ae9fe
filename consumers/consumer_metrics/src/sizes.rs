//! What every metric says about arrays that do not fit each other.

use thiserror::Error;

/// Two arrays that must be of one length are not.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[error("{what} has {found} entries, the truth has {expected}: they must be as many")]
pub struct SizesDiffer {
    /// What does not fit, e.g. `the result`.
    pub what: &'static str,
    /// How many entries it must have.
    pub expected: usize,
    /// How many entries it has.
    pub found: usize,
}

/// Checks that an array has as many entries as the truth.
///
/// # Errors
///
/// [`SizesDiffer`] if it has not.
pub(crate) fn same(what: &'static str, expected: usize, found: usize) -> Result<(), SizesDiffer> {
    if expected == found {
        return Ok(());
    }
    Err(SizesDiffer {
        what,
        expected,
        found,
    })
}

/// Checks an array that may be absent.
///
/// # Errors
///
/// [`SizesDiffer`] if it is there and does not fit.
pub(crate) fn same_if_any<T>(
    what: &'static str,
    expected: usize,
    found: Option<&[T]>,
) -> Result<(), SizesDiffer> {
    found.map_or(Ok(()), |found| same(what, expected, found.len()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_sentence_says_both_numbers() {
        let error = same("the mask", 4, 3).unwrap_err();
        assert_eq!(
            error.to_string(),
            "the mask has 3 entries, the truth has 4: they must be as many"
        );
        assert_eq!(same_if_any::<u8>("the mask", 4, None), Ok(()));
    }
}
