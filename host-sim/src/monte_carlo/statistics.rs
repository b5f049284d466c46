//! Means over screens and their errors.

/// A mean over independent values.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mean {
    /// The mean.
    pub mean: f64,
    /// Its standard error, from the scatter: s / sqrt(M), s^2 with M - 1. NaN for a single value.
    pub standard_error: f64,
}

impl Mean {
    /// That of `values`.
    pub fn of(values: &[f64]) -> Self {
        let count = values.len() as f64;
        let mean = values.iter().sum::<f64>() / count;
        let square = values.iter().map(|value| (value - mean).powi(2)).sum::<f64>();
        // For one value 0 / 0: nothing is known about its scatter.
        Self { mean, standard_error: (square / (count - 1.0) / count).sqrt() }
    }

    /// That of the differences a - b, value by value: what both have in common drops out.
    ///
    /// # Panics
    /// If there is not one b for each a.
    pub fn of_differences(a: &[f64], b: &[f64]) -> Self {
        assert_eq!(a.len(), b.len(), "pairs");
        Self::of(&a.iter().zip(b).map(|(a, b)| a - b).collect::<Vec<_>>())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_and_errors() {
        // 2, 4, 9: mean 5, squares 9 + 1 + 16 = 26, s^2 = 13, error sqrt(13 / 3).
        let Mean { mean, standard_error } = Mean::of(&[2.0, 4.0, 9.0]);
        assert_eq!(mean, 5.0);
        assert!((standard_error - (13.0_f64 / 3.0).sqrt()).abs() < 1e-15);
        assert!(Mean::of(&[3.0]).standard_error.is_nan());
    }

    #[test]
    fn what_is_common_drops_out() {
        let Mean { mean, standard_error } =
            Mean::of_differences(&[10.0, 200.0, 3000.0], &[9.0, 199.0, 2999.0]);
        assert_eq!((mean, standard_error), (1.0, 0.0));
    }
}
