//! Many distances in a few numbers.

use crate::audit::variant::report::{Statistic, Summary};

impl Summary {
    /// The summary of these distances; `None` where there are none or one is not finite.
    ///
    /// The 99th percentile is the ⌈0.99 n⌉-th smallest: at most a hundredth of the distances exceed it.
    pub fn of(distances: &[f64]) -> Option<Summary> {
        if distances.is_empty() || distances.iter().any(|d| !d.is_finite()) {
            return None;
        }
        let n = distances.len();
        let mut sorted = distances.to_vec();
        let place = (n * 99).div_ceil(100) - 1;
        let (_, &mut p99, rest) = sorted.select_nth_unstable_by(place, f64::total_cmp);
        Some(Summary {
            count: n as u64,
            mean: distances.iter().sum::<f64>() / n as f64,
            rms: (distances.iter().map(|d| d * d).sum::<f64>() / n as f64).sqrt(),
            p99,
            max: rest.iter().copied().fold(p99, f64::max),
        })
    }

    /// One of its numbers.
    pub fn statistic(&self, statistic: Statistic) -> f64 {
        match statistic {
            Statistic::Mean => self.mean,
            Statistic::P99 => self.p99,
            Statistic::Max => self.max,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hundredth_lies_above_the_percentile() {
        let distances: Vec<f64> = (1..=200).rev().map(f64::from).collect();
        let summary = Summary::of(&distances).expect("finite distances");
        assert_eq!((summary.count, summary.p99, summary.max), (200, 198.0, 200.0));
        assert!((summary.mean - 100.5).abs() < 1e-12);
        // Σ n² = n(n+1)(2n+1)/6.
        assert!((summary.rms - (201.0 * 401.0 / 6.0_f64).sqrt()).abs() < 1e-9);
    }

    #[test]
    fn one_distance_is_every_statistic() {
        let summary = Summary::of(&[3.0]).expect("a distance");
        for statistic in [Statistic::Mean, Statistic::P99, Statistic::Max] {
            assert_eq!(summary.statistic(statistic), 3.0);
        }
    }

    #[test]
    fn nothing_and_what_is_not_finite_have_no_summary() {
        assert_eq!(Summary::of(&[]), None);
        assert_eq!(Summary::of(&[1.0, f64::NAN]), None);
        assert_eq!(Summary::of(&[f64::INFINITY]), None);
    }
}
