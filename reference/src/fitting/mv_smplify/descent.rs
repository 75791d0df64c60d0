//! A fixed number of Adam's steps.

use crate::least_squares::adam::Adam;

/// How far and how fast a stage goes: Adam with the paper's β₁ = 0.9, β₂ = 0.999, from a fresh state.
///
/// The step length α falls geometrically from `learning_rate` to `final_learning_rate`: radians, metres and standard deviations
/// alike. Adam's steps stay about α long however near the minimum is, so a constant α leaves every unknown about α/2 away from it.
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
