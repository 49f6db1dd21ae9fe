//! What is called and coloured the same on the whole page.

use crate::report::rows::programs;
use crate::report::types::Report;
use consumer_report::plot::N_COLOURS;

/// The colour and pattern of a program's run: programs have colours, further runs of one have other
/// patterns.
pub fn style_of(report: &Report, program: &str, nth_run: usize) -> usize {
    let at = programs(report).iter().position(|name| *name == program);
    let (n, at) = (N_COLOURS, at.unwrap_or(0));
    at % n + (at / n + nth_run) * n
}
