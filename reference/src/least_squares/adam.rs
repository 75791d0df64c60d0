//! Adam: gradient descent with a step length for each unknown.
//!
//! Two averages follow the gradient g and its square, and forget at the rates β₁ and β₂:
//!
//! ```text
//! m ← β₁ m + (1 − β₁) g,        v ← β₂ v + (1 − β₂) g²,
//! m̂ = m/(1 − β₁ᵗ),  v̂ = v/(1 − β₂ᵗ),        x ← x − α m̂/(√v̂ + ε).
//! ```
//!
//! Both start at zero; the divisions make up for it. A step is about α long in each unknown, whatever the units of the
//! energy: the sign of a steady gradient, and less where the sign changes.
//!
//! # Conventions
//! ε stands outside of the root and after the correction of the start, as in the paper's Algorithm 1 and in PyTorch.
//! TensorFlow follows the remark after the algorithm, in which ε comes before the correction.
//!
//! # References
//! Kingma, Ba 2015, "Adam: a method for stochastic optimization", Algorithm 1.

/// The state of a descent; the numbers of the method may be changed between steps.
///
/// ```
/// use vitruvian_reference::least_squares::adam::Adam;
///
/// let mut x = [5.0];
/// let mut adam = Adam::new(1, 0.1);
/// for _ in 0..500 {
///     let gradient = [2.0 * (x[0] - 3.0)];
///     adam.step(&mut x, &gradient);
/// }
/// assert!((x[0] - 3.0f64).abs() < 1e-3);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct Adam {
    /// α.
    pub learning_rate: f64,
    /// β₁; 0.9.
    pub beta_1: f64,
    /// β₂; 0.999.
    pub beta_2: f64,
    /// ε; 10⁻⁸.
    pub epsilon: f64,
    /// m.
    mean: Vec<f64>,
    /// v.
    mean_square: Vec<f64>,
    /// β₁ᵗ and β₂ᵗ.
    beta_powers: [f64; 2],
}

impl Adam {
    /// The state before the first step, for n unknowns, with the paper's β₁, β₂ and ε.
    pub fn new(unknowns: usize, learning_rate: f64) -> Adam {
        Adam {
            learning_rate,
            beta_1: 0.9,
            beta_2: 0.999,
            epsilon: 1e-8,
            mean: vec![0.0; unknowns],
            mean_square: vec![0.0; unknowns],
            beta_powers: [1.0; 2],
        }
    }

    /// One step from x, whose gradient this is.
    ///
    /// # Panics
    /// If x or the gradient does not have n numbers.
    pub fn step(&mut self, x: &mut [f64], gradient: &[f64]) {
        let n = self.mean.len();
        assert!(
            x.len() == n && gradient.len() == n,
            "Adam::step: x has {} numbers, the gradient {}, the state {n}",
            x.len(),
            gradient.len()
        );
        self.beta_powers[0] *= self.beta_1;
        self.beta_powers[1] *= self.beta_2;
        let [start_1, start_2] = self.beta_powers.map(|power| 1.0 - power);
        for i in 0..n {
            let g = gradient[i];
            self.mean[i] = self.beta_1 * self.mean[i] + (1.0 - self.beta_1) * g;
            self.mean_square[i] = self.beta_2 * self.mean_square[i] + (1.0 - self.beta_2) * g * g;
            let (m, v) = (self.mean[i] / start_1, self.mean_square[i] / start_2);
            x[i] -= self.learning_rate * m / (v.sqrt() + self.epsilon);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// PyTorch 2.15, float64:
    /// ```python
    /// import torch
    /// x = torch.tensor([-1.2, 1.0], dtype=torch.float64, requires_grad=True)
    /// adam = torch.optim.Adam([x], lr=0.1)
    /// for _ in range(10):
    ///     adam.zero_grad()
    ///     ((1 - x[0]) ** 2 + 100 * (x[1] - x[0] ** 2) ** 2).backward()
    ///     adam.step()
    ///     print(x.tolist())
    /// ```
    #[test]
    fn ten_steps_are_those_of_pytorch() {
        let golden = [
            [-1.1000000000046382, 1.0999999999886363],
            [-1.017259582788236, 1.1830597533458147],
            [-0.9709867583811591, 1.2242180561995206],
            [-0.9608829586707753, 1.2236970659053639],
            [-0.9751825797273527, 1.1972757977820128],
            [-1.0034491977751945, 1.1570370545985598],
            [-1.0373266171591597, 1.111744298007672],
            [-1.0689738253425922, 1.0693129066343736],
            [-1.0910294814690933, 1.037010001616437],
            [-1.0989041046967079, 1.0192858816261177],
        ];
        let mut x = [-1.2, 1.0];
        let mut adam = Adam::new(2, 0.1);
        for golden in golden {
            let valley = x[1] - x[0] * x[0];
            let gradient = [-2.0 * (1.0 - x[0]) - 400.0 * x[0] * valley, 200.0 * valley];
            adam.step(&mut x, &gradient);
            // The order of operations differs; nothing here amplifies a rounding by more than a few.
            for (found, golden) in x.iter().zip(golden) {
                assert!((found - golden).abs() < 1e-13, "{x:?} for {golden:?}");
            }
        }
    }

    #[test]
    fn first_step_is_the_learning_rate_against_the_sign() {
        let mut x = [0.0; 3];
        Adam::new(3, 0.5).step(&mut x, &[1e-3, -1e6, 0.0]);
        assert!((x[0] + 0.5).abs() < 1e-5 && (x[1] - 0.5).abs() < 1e-12 && x[2] == 0.0, "{x:?}");
    }
}
