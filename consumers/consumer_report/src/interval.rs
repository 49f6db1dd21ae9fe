//! Quantiles of single values, and the interval of a mean by resampling: the percentile bootstrap
//! (Efron), as `scipy.stats.bootstrap(method="percentile")` computes it.

use fastrand::Rng;

/// An interval that holds the mean of what `differences` are a sample of, with this confidence
/// (0 to 1). `None` for fewer than two differences, about whose noise nothing is known.
pub fn interval(
    differences: &[f64],
    confidence: f64,
    n_resamples: usize,
    seed: u64,
) -> Option<(f64, f64)> {
    let n = differences.len();
    if n < 2 {
        return None;
    }
    let mut random = Rng::with_seed(seed);
    let mut means: Vec<f64> = (0..n_resamples.max(1))
        .map(|_| (0..n).map(|_| differences[random.usize(..n)]).sum::<f64>() / n as f64)
        .collect();
    let beyond = (1.0 - confidence) / 2.0;
    Some((
        quantile(&mut means, beyond)?,
        quantile(&mut means, 1.0 - beyond)?,
    ))
}

/// The value below which this share of the values lies, linear between two neighbours, as NumPy's
/// `percentile` does by default. Sorts the values; `None` of none.
pub fn quantile(values: &mut [f64], share: f64) -> Option<f64> {
    let last = values.len().checked_sub(1)?;
    values.sort_unstable_by(f64::total_cmp);
    let place = share.clamp(0.0, 1.0) * last as f64;
    let (below, above) = (place.floor() as usize, place.ceil() as usize);
    Some(values[below] + (values[above] - values[below]) * (place - below as f64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_those_of_numpy() {
        // numpy.percentile([1, 2, 4, 8], [0, 2.5, 50, 97.5, 100])
        let mut values = [4.0, 1.0, 8.0, 2.0];
        for (share, expected) in [
            (0.0, 1.0),
            (0.025, 1.075),
            (0.5, 3.0),
            (0.975, 7.7),
            (1.0, 8.0),
        ] {
            let found = quantile(&mut values, share).unwrap();
            assert!((found - expected).abs() < 1e-12, "{share}");
        }
        assert_eq!(quantile(&mut [], 0.5), None);
    }

    #[test]
    fn one_difference_has_no_interval_and_equal_ones_have_no_width() {
        assert_eq!(interval(&[0.5], 0.95, 100, 1), None);
        assert_eq!(interval(&[0.5; 4], 0.95, 100, 1), Some((0.5, 0.5)));
        assert_eq!(
            interval(&[1.0, 2.0, 4.0], 0.9, 500, 7),
            interval(&[1.0, 2.0, 4.0], 0.9, 500, 7)
        );
    }

    /// The exact distribution of resampled means of two values is known: a, b with a quarter each,
    /// the middle with a half.
    #[test]
    fn two_differences_give_their_own_range() {
        let (low, high) = interval(&[-1.0, 3.0], 0.95, 10_000, 1).unwrap();
        assert_eq!((low, high), (-1.0, 3.0));
        let (low, high) = interval(&[-1.0, 3.0], 0.4, 10_000, 1).unwrap();
        assert_eq!((low, high), (1.0, 1.0));
    }
}
