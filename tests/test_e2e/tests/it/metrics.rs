//! Metrics of `consumer_metrics` other than detection against independent public implementations,
//! to 1e-6, on random cases: Python computes every figure again from the same numbers.

mod dense;
mod driving;
mod lanes;
mod odometry;
mod tracking;

use std::collections::BTreeMap;

use fastrand::Rng;
use serde_json::{Value, json};

/// A case for Python: what it is about, what went in, and the figures that came out.
fn case(kind: &str, input: Value, figures: &BTreeMap<String, f64>) -> String {
    json!({ "kind": kind, "input": input, "figures": figures }).to_string()
}

/// A normally distributed number.
fn normal(rng: &mut Rng) -> f64 {
    let radius = (-2.0 * (1.0 - rng.f64()).ln()).sqrt();
    radius * (std::f64::consts::TAU * rng.f64()).cos()
}

/// Exact in JSON, where 32-bit numbers would be rounded to other decimals; what is not a number
/// becomes null.
fn exact(values: &[f32]) -> Vec<Option<f64>> {
    let number = |&value: &f32| Some(f64::from(value)).filter(|it| it.is_finite());
    values.iter().map(number).collect()
}
