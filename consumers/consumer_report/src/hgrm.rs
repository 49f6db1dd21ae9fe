//! Percentile files in HdrHistogram's text form (`.hgrm`), as its plotters read them; values in
//! milliseconds.

use std::fmt::Write as _;

use hdrhistogram::Histogram;

/// Percentile steps per halving of the distance to 100 %, HdrHistogram's own default.
const TICKS_PER_HALF: u32 = 5;
const NANOS_PER_MS: f64 = 1e6;

/// The text of a histogram of nanoseconds.
pub fn text(histogram: &Histogram<u64>) -> String {
    let mut text = format!(
        "{:>12} {:>14} {:>10} {:>14}\n\n",
        "Value", "Percentile", "TotalCount", "1/(1-Percentile)"
    );
    let ms = |nanos: u64| nanos as f64 / NANOS_PER_MS;
    let mut count = 0;
    for step in histogram.iter_quantiles(TICKS_PER_HALF) {
        count += step.count_since_last_iteration();
        let value = ms(step.value_iterated_to());
        let quantile = step.quantile_iterated_to().min(1.0);
        let _ = write!(text, "{value:>12.6} {quantile:>14.12} {count:>10}");
        let _ = if quantile < 1.0 {
            writeln!(text, " {:>14.2}", 1.0 / (1.0 - quantile))
        } else {
            writeln!(text)
        };
    }
    let (mean, std_dev) = (
        histogram.mean() / NANOS_PER_MS,
        histogram.stdev() / NANOS_PER_MS,
    );
    let _ = writeln!(
        text,
        "#[Mean    = {mean:>12.6}, StdDeviation   = {std_dev:>12.6}]"
    );
    let _ = writeln!(
        text,
        "#[Max     = {:>12.6}, Total count    = {:>12}]",
        ms(histogram.max()),
        histogram.len()
    );
    let _ = writeln!(
        text,
        "#[Buckets = {:>12}, SubBuckets     = {:>12}]",
        histogram.buckets(),
        (2 * 10_u64.pow(histogram.sigfig().into())).next_power_of_two()
    );
    text
}
