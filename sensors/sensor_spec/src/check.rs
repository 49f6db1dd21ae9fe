//! The error of a check: a value that cannot be used, and what is allowed.

/// One value that cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{key} is {value}, but {allowed}")]
pub struct SpecError {
    /// Key in the sensor's table, e.g. `channels`.
    pub key: &'static str,
    /// The value found.
    pub value: String,
    /// What is allowed and what to do, e.g. `must be 1 to 128`.
    pub allowed: String,
}

impl SpecError {
    /// A value outside `low..=high`.
    pub fn range(
        key: &'static str,
        value: impl std::fmt::Display,
        low: impl std::fmt::Display,
        high: impl std::fmt::Display,
    ) -> Self {
        SpecError {
            key,
            value: value.to_string(),
            allowed: format!("must be {low} to {high}"),
        }
    }
}

/// Pushes an error unless `low <= value <= high` (NaN is outside).
pub(crate) fn check_range<T: PartialOrd + std::fmt::Display>(
    key: &'static str,
    value: T,
    low: T,
    high: T,
    errors: &mut Vec<SpecError>,
) {
    if !(value >= low && value <= high) {
        errors.push(SpecError::range(key, value, low, high));
    }
}
