//! Cells of tables: text in which `{EXPRESSION}` stands for figures.
//!
//! | Expression | Gives |
//! |---|---|
//! | `{PATH}` | the value; of several files all values, with commas |
//! | `{PATH\|2}` | with two decimals |
//! | `{A ÷ B\|2}` | the quotient of two paths, or of a path and a number |
//! | `{A ≥ 30}`, `{A ≤ 8}` | the goal and whether it was met |
//!
//! A path begins with a file of `raw/`, or with `.` for the element of a table's list.

use std::collections::BTreeSet;

use anyhow::{Context as _, bail, ensure};
use consumer_report::numbers::thousands;
use serde_json::Value;

use super::figures::{Figures, walk};

/// What a cell's expressions may look at.
pub struct Context<'f> {
    /// All results.
    pub figures: &'f Figures,
    /// The element of a list that the row shows.
    pub element: Option<&'f Value>,
}

/// Fills in the expressions of `text`; the files that were looked at are added to `used`.
pub fn fill(text: &str, context: &Context, used: &mut BTreeSet<String>) -> anyhow::Result<String> {
    let mut filled = String::new();
    let mut rest = text;
    while let Some((before, after)) = rest.split_once('{') {
        let (expression, behind) = after
            .split_once('}')
            .with_context(|| format!("{text:?} has a brace that is not closed"))?;
        filled += before;
        filled += &evaluate(expression, context, used)
            .with_context(|| format!("in the expression {{{expression}}}"))?;
        rest = behind;
    }
    Ok(filled + rest)
}

fn evaluate(
    expression: &str,
    context: &Context,
    used: &mut BTreeSet<String>,
) -> anyhow::Result<String> {
    let (body, decimals) = match expression.rsplit_once('|') {
        Some((body, digits)) => {
            let digits: usize = digits
                .trim()
                .parse()
                .context("decimals are a whole number")?;
            (body, Some(digits))
        }
        None => (expression, None),
    };
    for (sign, holds) in [
        (" ≥ ", (|a, b| a >= b) as fn(f64, f64) -> bool),
        (" ≤ ", |a, b| a <= b),
    ] {
        if let Some((left, right)) = body.split_once(sign) {
            let goal: f64 = right.trim().parse().context("a goal is a number")?;
            let values = numbers(left, context, used)?;
            let n_met = values.iter().filter(|value| holds(**value, goal)).count();
            let verdict = match (n_met, values.len()) {
                (met, all) if met == all => "met".to_owned(),
                (0, _) => "missed".to_owned(),
                (met, all) => format!("met in {met} of {all} runs"),
            };
            return Ok(format!(
                "{}{}: {verdict}",
                sign.trim_start(),
                number(goal, None)
            ));
        }
    }
    if body.contains(" ÷ ") {
        let values = numbers(body, context, used)?;
        return Ok(join(values.iter().map(|value| number(*value, decimals))));
    }
    let values = find(body, context, used)?;
    Ok(join(values.iter().map(|value| match value {
        Value::Number(value) => number(value.as_f64().unwrap_or(f64::NAN), decimals),
        Value::String(text) => text.clone(),
        other => other.to_string(),
    })))
}

fn join(texts: impl Iterator<Item = String>) -> String {
    texts.collect::<Vec<_>>().join(", ")
}

/// Values of `A` or `A ÷ B`, file by file.
fn numbers(body: &str, context: &Context, used: &mut BTreeSet<String>) -> anyhow::Result<Vec<f64>> {
    let mut terms = body.split(" ÷ ");
    let mut values = single_numbers(terms.next().unwrap_or_default(), context, used)?;
    for term in terms {
        let divisors = match term.trim().parse::<f64>() {
            Ok(number) => vec![number; values.len()],
            Err(_) => single_numbers(term, context, used)?,
        };
        ensure!(
            divisors.len() == values.len(),
            "{} values cannot be divided by {}",
            values.len(),
            divisors.len()
        );
        values
            .iter_mut()
            .zip(divisors)
            .for_each(|(value, divisor)| *value /= divisor);
    }
    Ok(values)
}

fn single_numbers(
    path: &str,
    context: &Context,
    used: &mut BTreeSet<String>,
) -> anyhow::Result<Vec<f64>> {
    find(path, context, used)?
        .iter()
        .map(|value| {
            value
                .as_f64()
                .with_context(|| format!("{value} is no number"))
        })
        .collect()
}

/// Values at a path; a list of values at its end counts as several runs.
fn find<'f>(
    path: &str,
    context: &Context<'f>,
    used: &mut BTreeSet<String>,
) -> anyhow::Result<Vec<&'f Value>> {
    let path = path.trim();
    let found = match (path.strip_prefix('.'), context.element) {
        (Some(rest), Some(element)) => vec![walk(element, rest)?],
        (Some(_), None) => bail!("only tables with `each` know {path:?}"),
        (None, _) => context.figures.find(path, used)?,
    };
    Ok(found
        .into_iter()
        .flat_map(|value| match value {
            Value::Array(list) => list.iter().collect(),
            other => vec![other],
        })
        .collect())
}

/// A number with `decimals` places, or as few as show it; thousands are set apart from 10 000 on.
fn number(value: f64, decimals: Option<usize>) -> String {
    let text = match decimals {
        Some(decimals) => format!("{value:.decimals$}"),
        None => format!("{value}"),
    };
    let (whole, fraction) = text.split_once('.').unwrap_or((&text, ""));
    let digits = whole.trim_start_matches('-');
    let mut grouped = match digits.len() {
        0..=4 => digits.to_owned(),
        _ => thousands(digits, ' '),
    };
    if value < 0.0 {
        grouped.insert(0, '−');
    }
    if fraction.is_empty() {
        grouped
    } else {
        grouped + "." + fraction
    }
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn check(text: &str, expected: &str) {
        let figures = Figures::from_values(&[
            (
                "a_1",
                json!({"rows": [{"name": "x", "n": 12345, "ms": 2.0}]}),
            ),
            ("a_2", json!({"rows": [{"name": "x", "n": 678, "ms": 4.0}]})),
            ("b", json!({"text": "words", "list": [1.25, 2.5]})),
        ]);
        let element = json!({"name": "y", "deep": {"ms": 0.5}});
        let context = Context {
            figures: &figures,
            element: Some(&element),
        };
        let filled = fill(text, &context, &mut BTreeSet::new()).expect("the cell is right");
        assert_eq!(filled, expected);
    }

    #[test]
    fn values_are_shown_with_their_decimals_and_thousands() {
        check("n {a_1/x/n}", "n 12 345");
        check("{a_?/x/ms|1} ms", "2.0, 4.0 ms");
        check("{b/text}, {b/list|2}", "words, 1.25, 2.50");
        check("{./deep/ms|2} of {./name}", "0.50 of y");
    }

    #[test]
    fn quotients_are_taken_file_by_file() {
        check("{a_?/x/ms ÷ b/list|1}×", "1.6, 1.6×");
        check("{a_1/x/n ÷ 1000|1}", "12.3");
    }

    #[test]
    fn goals_say_whether_they_were_met() {
        check("{a_?/x/ms ≥ 2}", "≥ 2: met");
        check("{a_?/x/ms ≤ 3}", "≤ 3: met in 1 of 2 runs");
        check("{a_?/x/ms ≥ 20000}", "≥ 20 000: missed");
    }

    #[test]
    fn mistakes_are_refused() {
        let figures = Figures::from_values(&[("a", json!({"n": 1, "text": "words"}))]);
        let context = Context {
            figures: &figures,
            element: None,
        };
        for wrong in [
            "{a/n",
            "{b/n}",
            "{./n}",
            "{a/text ≥ 1}",
            "{a/n|x}",
            "{a/n ≥ many}",
        ] {
            assert!(
                fill(wrong, &context, &mut BTreeSet::new()).is_err(),
                "{wrong}"
            );
        }
    }
}
