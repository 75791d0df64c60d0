//! A fixed number of Adam's steps.

use crate::least_squares::adam::Adam;

/// How far and how fast a stage goes: Adam with the paper's β₁ = 0.9, β₂ = 0.999, from a fresh state.
///
/// The step length α falls geometrically from `learning_rate` to `final_learning_rate`: radians, metres and standard deviations
/// alike. An unknown whose slope keeps its sign moves by α a step, so Σ α bounds how far off a start may be; short last steps
/// let the swinging about the minimum die out.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Descent {
    /// Steps.
    pub steps: usize,
    /// α of the first step.
    pub learning_rate: f64,
    /// α of the last step.
    pub final_learning_rate: f64,
}

impl Descent {
    /// `steps` steps of one length: the thesis has 100 of 10⁻² in both stages.
    pub fn constant(steps: usize, learning_rate: f64) -> Descent {
        Descent { steps, learning_rate, final_learning_rate: learning_rate }
    }

    /// Moves x; `gradient_at` writes the gradient at its first argument into its second.
    pub(super) fn run(&self, x: &mut [f64], mut gradient_at: impl FnMut(&[f64], &mut [f64])) {
        assert!(
            [self.learning_rate, self.final_learning_rate].iter().all(|rate| rate.is_finite() && *rate > 0.0),
            "Descent: learning rates {} to {}; both are positive numbers",
            self.learning_rate,
            self.final_learning_rate
        );
        let mut adam = Adam::new(x.len(), self.learning_rate);
        let mut gradient = vec![0.0; x.len()];
        let ratio = self.final_learning_rate / self.learning_rate;
        for step in 0..self.steps {
            if self.steps > 1 {
                adam.learning_rate = self.learning_rate * ratio.powf(step as f64 / (self.steps - 1) as f64);
            }
            gradient_at(x, &mut gradient);
            adam.step(x, &gradient);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hundred_steps_of_a_hundredth_go_no_farther_than_one() {
        let mut x = [5.0];
        Descent::constant(100, 1e-2).run(&mut x, |_, gradient| gradient[0] = 1e6);
        assert!((x[0] - 4.0).abs() < 1e-6, "{x:?}");
    }

    #[test]
    fn steps_fall_geometrically() {
        let mut x = [0.0];
        let falling = Descent { steps: 3, learning_rate: 4e-2, final_learning_rate: 1e-2 };
        falling.run(&mut x, |_, gradient| gradient[0] = -1e6);
        assert!((x[0] - (4e-2 + 2e-2 + 1e-2)).abs() < 1e-9, "{x:?}");
    }

    #[test]
    fn no_steps_change_nothing() {
        let mut x = [0.3];
        Descent::constant(0, 1e-2).run(&mut x, |_, gradient| gradient[0] = 1.0);
        assert_eq!(x, [0.3]);
    }

    #[test]
    #[should_panic(expected = "learning rates 0 to 0")]
    fn a_rate_of_zero_is_a_mistake() {
        Descent::constant(1, 0.0).run(&mut [0.0], |_, _| {});
    }
}
