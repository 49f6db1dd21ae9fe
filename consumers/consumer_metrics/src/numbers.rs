//! Means, shares and percentiles that may not exist, and lists of named figures.

use std::collections::BTreeMap;

/// A mean; `None` of nothing.
pub(crate) fn mean(sum: f64, n: u64) -> Option<f64> {
    (n > 0).then(|| sum / n as f64)
}

/// A share, 0 to 1; `None` of nothing.
pub(crate) fn share(part: u64, whole: u64) -> Option<f64> {
    mean(part as f64, whole)
}

/// A share in percent; `None` of nothing.
pub(crate) fn percent(part: u64, whole: u64) -> Option<f64> {
    mean(100.0 * part as f64, whole)
}

/// The figures that exist, by name.
pub(crate) fn existing(
    figures: impl IntoIterator<Item = (impl Into<String>, Option<f64>)>,
) -> BTreeMap<String, f64> {
    figures
        .into_iter()
        .filter_map(|(name, figure)| Some((name.into(), figure?)))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_exist_has_no_name() {
        let named = existing([("a", Some(1.0)), ("b", None)]);
        assert_eq!(named, BTreeMap::from([("a".to_owned(), 1.0)]));
        assert_eq!(percent(1, 0), None);
    }
}
