//! Percentage of correct keypoints, and the area under its curve.

/// Threshold of PCK@150, metres: about half a head.
pub const PCK_THRESHOLD_M: f64 = 0.150;

/// The number of thresholds of [`pck_curve`].
pub const THRESHOLD_COUNT: usize = 31;

/// The thresholds 0, 5, …, 150 mm of the PCK curve, in metres.
pub fn thresholds_m() -> [f64; THRESHOLD_COUNT] {
    // Dividing whole millimetres by 1000 gives the same double as writing 0.06; adding up steps of 0.005 would
    // not.
    std::array::from_fn(|step| (5 * step) as f64 / 1000.0)
}

/// Percentage of correct keypoints: the share of errors *strictly* below a threshold, in 0 … 100.
///
/// ```text
/// PCK(T) = 100 · #{e : e < T} / #{e}
/// ```
///
/// # Panics
///
/// If there are no errors to share.
///
/// # References
///
/// Mehta et al. 2017, "Monocular 3D Human Pose Estimation In The Wild Using Improved CNN Supervision" (MPI-INF-3DHP),
/// with 150 mm. Li 2021, tables 4.3, 4.6 and 4.8.
///
/// ```
/// use vitruvian_reference::metric::pck::pck;
/// assert_eq!(pck(&[0.10, 0.15, 0.20, 0.30], 0.15), 25.0);
/// ```
pub fn pck(errors: &[f64], threshold_m: f64) -> f64 {
    assert!(!errors.is_empty(), "PCK of no errors");
    let correct = errors.iter().filter(|&&error| error < threshold_m).count();
    100.0 * correct as f64 / errors.len() as f64
}

/// PCK at each of [`thresholds_m`], in 0 … 100: the curve of Li 2021, figure 4.8.
///
/// It never falls, and begins at PCK(0) = 0, since no error is below 0.
///
/// # Panics
///
/// If there are no errors.
pub fn pck_curve(errors: &[f64]) -> [f64; THRESHOLD_COUNT] {
    thresholds_m().map(|threshold| pck(errors, threshold))
}

/// Area under the PCK curve: the mean of [`pck_curve`] over its 31 thresholds, in 0 … 100.
///
/// PCK(0) is 0 whatever the errors. So errors of exactly zero reach 100·30/31 = 96.774 and no more.
///
/// # Panics
///
/// If there are no errors.
pub fn auc(errors: &[f64]) -> f64 {
    pck_curve(errors).iter().sum::<f64>() / THRESHOLD_COUNT as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pck_is_strict_and_auc_takes_31_thresholds() {
        let errors = [0.010, 0.060, 0.149, 0.150, 0.151, 0.300];
        assert_eq!(pck(&errors, PCK_THRESHOLD_M), 50.0);
        // Thresholds passed: 10 mm by 28, 60 mm by 18, 149 mm by 1; 47 / (6·31) of 100.
        assert!((auc(&errors) - 25.268_817_20).abs() < 1e-8);
    }

    #[test]
    fn the_curve_steps_behind_each_error() {
        let curve = pck_curve(&[0.010, 0.060, 0.149, 0.150, 0.151, 0.300]);
        let sixth = 100.0 / 6.0;
        // Thresholds of 10, 15, 60, 65, 145 and 150 mm.
        for (step, errors) in [(0, 0.0), (2, 0.0), (3, 1.0), (12, 1.0), (13, 2.0), (29, 2.0), (30, 3.0)] {
            assert!((curve[step] - errors * sixth).abs() < 1e-12, "{} mm: {}", 5 * step, curve[step]);
        }
    }

    #[test]
    fn zero_error_does_not_reach_an_auc_of_100() {
        assert!((auc(&[0.0; 5]) - 96.774_193_55).abs() < 1e-8);
        assert_eq!(auc(&[0.150; 5]), 0.0);
    }

    #[test]
    fn thresholds_are_the_doubles_of_whole_millimetres() {
        let thresholds = thresholds_m();
        assert_eq!((thresholds[0], thresholds[12], thresholds[30]), (0.0, 0.060, PCK_THRESHOLD_M));
    }
}
