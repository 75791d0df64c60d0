//! A problem as a value: what to solve, from where, and what is known of the answer.

use vitruvian_reference::least_squares::Problem;
use vitruvian_reference::linalg::dense::Dense;

/// Row by row.
pub type Matrix = Vec<Vec<f64>>;

/// Where a minimisation goes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Destination {
    /// The published minimum.
    Minimum,
    /// Another published minimum or infimum.
    OtherMinimum(f64),
    /// Nowhere in the time given.
    Valley(f64),
}

/// One problem of the collection.
pub struct Case {
    pub number: usize,
    pub name: &'static str,
    pub start: Vec<f64>,
    /// Residuals and Jacobian.
    function: fn(&[f64]) -> (Vec<f64>, Matrix),
    /// The published minimum, six digits; 0 where it is exactly that.
    pub minimum: f64,
    /// Where the dogleg ends up.
    pub destination: Destination,
}

impl Case {
    pub fn new(
        number: usize,
        name: &'static str,
        start: &[f64],
        function: fn(&[f64]) -> (Vec<f64>, Matrix),
    ) -> Case {
        Case {
            number,
            name,
            start: start.to_vec(),
            function,
            minimum: f64::NAN,
            destination: Destination::Minimum,
        }
    }

    pub fn zero(self) -> Case {
        self.minimum(0.0)
    }

    pub fn minimum(self, minimum: f64) -> Case {
        Case { minimum, ..self }
    }

    /// The dogleg goes to this other published minimum or infimum instead.
    pub fn but_reaches(self, energy: f64) -> Case {
        Case { destination: Destination::OtherMinimum(energy), ..self }
    }

    /// The dogleg creeps along a valley instead, and has got down to this energy when its iterations are used up.
    pub fn but_creeps(self, energy: f64) -> Case {
        Case { destination: Destination::Valley(energy), ..self }
    }
}

impl Problem for Case {
    type Jacobian = Dense;

    fn residuals(&self, x: &[f64]) -> Option<Vec<f64>> {
        Some((self.function)(x).0)
    }

    fn jacobian(&self, x: &[f64]) -> Dense {
        let rows = (self.function)(x).1;
        Dense::new(rows.len(), x.len(), rows.concat())
    }
}
