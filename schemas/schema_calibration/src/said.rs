//! Numbers as all these formats take them.

/// A number that every reader takes for one with a fraction: PyYAML reads `1e-7` as a text.
pub fn number(value: f64) -> String {
    let text = value.to_string();
    match text.contains('.') {
        true => text,
        false => format!("{text}.0"),
    }
}

/// `[1.0, 2.0]`.
pub fn list(values: &[f64]) -> String {
    let texts: Vec<String> = values.iter().map(|it| number(*it)).collect();
    format!("[{}]", texts.join(", "))
}
