//! The Geman–McClure loss: quadratic for small residuals, bounded for large ones.
//!
//! | name | formula | meaning |
//! |---|---|---|
//! | [`rho`] | σ² x²/(σ² + x²) | the loss: x² near zero, σ² far away |
//! | [`influence`] | ½ dρ/dx = σ⁴ x/(σ² + x²)² | how hard a residual pulls; fades for outliers |
//! | [`weight`] | influence/x = σ⁴/(σ² + x²)² | of the same pull in weighted least squares |
//! | [`residual`] | σ x/√(σ² + x²) | ρ as a square: what a least-squares solver sees |
//! | [`residual_derivative`] | σ³/(σ² + x²)^{3/2} | its derivative |
//! | [`gmof_normalised`] | x²/(σ² + x²) | the literal eq. 2.4 |
//!
//! # Conventions
//! Li 2021 prints ρ(x) = x²/(σ² + x²) in eq. 2.4 and 3.2, at most 1 for each residual. Beside a prior of thousands the
//! joints would then not count at all; the factor σ² that the systems before it have is meant (erratum E2). ρ acts on
//! each coordinate of a 2-D error and the two are summed (erratum E3); [`radial`] is the other reading, ρ(‖e‖), which is
//! invariant under turning the image.
//!
//! # References
//! Geman, McClure 1987, "Statistical methods for tomographic image reconstruction"; Li 2021, eq. 2.4.

/// ρ(x) = σ² x²/(σ² + x²).
///
/// ```
/// use vitruvian_reference::robust_loss::rho;
/// assert_eq!(rho(100.0, 100.0), 5000.0);
/// ```
pub fn rho(x: f64, sigma: f64) -> f64 {
    let r = residual(x, sigma);
    r * r
}

/// ½ dρ/dx = σ⁴ x/(σ² + x²)², largest at x = σ/√3.
pub fn influence(x: f64, sigma: f64) -> f64 {
    weight(x, sigma) * x
}

/// The weight w(x) = σ⁴/(σ² + x²)², 1 at zero: the gradient of ½ Σ w x² with w held is that of ½ Σ ρ.
pub fn weight(x: f64, sigma: f64) -> f64 {
    let fraction = sigma * sigma / (sigma * sigma + x * x);
    fraction * fraction
}

/// The signed root of ρ: σ x/√(σ² + x²), odd in x.
pub fn residual(x: f64, sigma: f64) -> f64 {
    sigma * x / sigma.hypot(x)
}

/// The derivative of [`residual`]: (σ²/(σ² + x²))^{3/2}, and 1 at x = 0.
///
/// # Conventions
/// The code that Li 2021 builds on differentiates √|q| and guards against 0/0, so its derivative is 0 at x = 0; the closed
/// form has no such hole.
pub fn residual_derivative(x: f64, sigma: f64) -> f64 {
    let fraction = sigma / sigma.hypot(x);
    fraction * fraction * fraction
}

/// x²/(σ² + x²) ∈ \[0, 1): eq. 2.4 to the letter, without the factor σ² (erratum E2).
pub fn gmof_normalised(x: f64, sigma: f64) -> f64 {
    rho(x, sigma) / (sigma * sigma)
}

/// The radial form (erratum E3): two residuals f with ‖f‖² = ρ(‖e‖), and their 2×2 derivative by e.
///
/// f = σ e/√(σ² + ‖e‖²); ∂f/∂e = g I − (g³/σ²) e eᵀ with g = σ/√(σ² + ‖e‖²).
pub fn radial(e: [f64; 2], sigma: f64) -> ([f64; 2], [[f64; 2]; 2]) {
    let g = sigma / sigma.hypot(e[0].hypot(e[1]));
    let bend = g * g * g / (sigma * sigma);
    let derivative =
        std::array::from_fn(|i| std::array::from_fn(|j| if i == j { g } else { 0.0 } - bend * e[i] * e[j]));
    (e.map(|x| g * x), derivative)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn loss_and_residual_golden() {
        // σ = 100; computed once by an independent script, ten digits kept.
        let golden = [
            (1.0, 0.999_900_01, 0.999_950_003_7),
            (10.0, 99.009_900_99, 9.950_371_902),
            (100.0, 5000.0, 70.710_678_12),
            (300.0, 9000.0, 94.868_329_81),
        ];
        for (x, q, r) in golden {
            assert!((rho(x, 100.0) - q).abs() < 1e-8 * q, "ρ({x}) = {}", rho(x, 100.0));
            assert!((residual(x, 100.0) - r).abs() < 1e-9 * r, "{x}: {}", residual(x, 100.0));
            assert_eq!(residual(-x, 100.0), -residual(x, 100.0));
            assert!((gmof_normalised(x, 100.0) - 1e-4 * q).abs() < 1e-12);
        }
    }

    #[test]
    fn derivatives_are_central_differences() {
        const STEP: f64 = 1e-4;
        for x in [-300.0, -40.0, -0.5, 0.0, 3.0, 70.0] {
            let numeric = |f: fn(f64, f64) -> f64| (f(x + STEP, 50.0) - f(x - STEP, 50.0)) / (2.0 * STEP);
            assert!((residual_derivative(x, 50.0) - numeric(residual)).abs() < 1e-9, "{x}");
            assert!((influence(x, 50.0) - 0.5 * numeric(rho)).abs() < 1e-7, "{x}");
        }
    }

    #[test]
    fn residuals_beyond_every_bound_stay_finite() {
        assert_eq!(rho(1e300, 100.0), 1e4);
        assert_eq!(residual_derivative(1e300, 100.0), 0.0);
    }

    #[test]
    fn radial_form_is_the_loss_of_the_length_and_its_derivative_is_numeric() {
        const STEP: f64 = 1e-4;
        let e = [30.0, -40.0];
        let (f, derivative) = radial(e, 60.0);
        assert!((f[0] * f[0] + f[1] * f[1] - rho(50.0, 60.0)).abs() < 1e-10);
        for j in 0..2 {
            let moved = |step: f64| {
                let mut e = e;
                e[j] += step;
                radial(e, 60.0).0
            };
            let (above, below) = (moved(STEP), moved(-STEP));
            for i in 0..2 {
                assert!((derivative[i][j] - (above[i] - below[i]) / (2.0 * STEP)).abs() < 1e-9);
            }
        }
        // Per coordinate and radial are different losses.
        assert!((rho(30.0, 60.0) + rho(40.0, 60.0) - rho(50.0, 60.0)).abs() > 100.0);
    }
}
