//! The ways in which a minimisation ends.

use std::fmt;

/// Why a minimisation ended. Ending is not failing: most of these are what the caller asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Termination {
    /// ‖Jᵀr‖_∞ < e₁: x is a stationary point.
    SmallGradient,
    /// ‖d‖ ≤ e₂‖x‖: the next step would not move x.
    SmallStep,
    /// radius ≤ e₂‖x‖ after rejected steps: no step of visible length lowers the energy. At a minimum rounding does this;
    /// elsewhere it betrays a Jacobian that is not the derivative of the residuals, or a point that is walled in by
    /// undefined residuals.
    SmallRadius,
    /// An accepted step lowered the energy by less than the fraction e₃.
    SmallImprovement,
    /// As many iterations as allowed were made.
    IterationLimit,
    /// The residuals were evaluated as often as allowed.
    EvaluationLimit,
    /// At x₀ the residuals are undefined, or their sum of squares is not finite; x₀ is returned.
    NotFinite,
    /// The residuals at x are fine but their Jacobian is not finite, or so large or small that a step overflows.
    JacobianNotFinite,
}

impl Termination {
    /// True if one of the criteria of convergence was met; false for exhausted limits and for numbers that are not finite.
    pub fn was_successful(self) -> bool {
        use Termination::*;
        match self {
            SmallGradient | SmallStep | SmallRadius | SmallImprovement => true,
            IterationLimit | EvaluationLimit | NotFinite | JacobianNotFinite => false,
        }
    }
}

impl fmt::Display for Termination {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Termination::SmallGradient => "the gradient vanishes",
            Termination::SmallStep => "the next step would not move the parameters",
            Termination::SmallRadius => "no step of visible length lowers the energy",
            Termination::SmallImprovement => "the last step hardly lowered the energy",
            Termination::IterationLimit => "the limit of iterations is reached",
            Termination::EvaluationLimit => "the limit of evaluations is reached",
            Termination::NotFinite => "the residuals at the start are undefined or not finite",
            Termination::JacobianNotFinite => "the Jacobian is not finite",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::Termination::*;

    #[test]
    fn running_out_is_not_succeeding() {
        for ending in [SmallGradient, SmallStep, SmallRadius, SmallImprovement] {
            assert!(ending.was_successful(), "{ending}");
        }
        for ending in [IterationLimit, EvaluationLimit, NotFinite, JacobianNotFinite] {
            assert!(!ending.was_successful(), "{ending}");
        }
    }
}
