//! Traces of chumpy itself, github.com/mattloper/chumpy at 51d5afd, under numpy 1.23.5; for Rosenbrock's valley by:
//!
//! ```python
//! import chumpy as ch, numpy as np
//! from chumpy import optimization_internal as oi
//! update = oi.DoglegState.updateRadius
//! def logged(self, rho, lb=.05, ub=.9):
//!     update(self, rho, lb, ub)
//!     print(self.iteration, np.linalg.norm(self.d_dl), rho, self.delta, self.p.ravel())
//! oi.DoglegState.updateRadius = logged
//! x = ch.array([-1.2, 1.0])
//! r = ch.concatenate([10 * (x[1:2] - x[0:1] ** 2), 1 - x[0:1]])
//! oi.minimize_dogleg(r, [x], disp=False, e_3=1e-4, maxiter=100)
//! ```

use super::examples::{Functions, arctan, close, log, rosenbrock};
use super::{Dogleg, StepKind, Termination};
use crate::linalg::dense::Dense;

#[test]
fn trace_of_rosenbrock_is_that_of_chumpy() {
    use StepKind::{Dogleg as Bend, GaussNewton};
    let dogleg = Dogleg { improvement_tolerance: 1e-4, max_iterations: 100, ..Dogleg::default() };
    let (solution, lines) = log(&dogleg, &rosenbrock(), &[-1.2, 1.0]);
    assert_eq!((solution.iterations, solution.evaluations), (12, 16));
    assert_eq!(solution.termination, Termination::SmallGradient);
    assert!(solution.x.iter().all(|x| (x - 1.0).abs() < 1e-14), "{:?}", solution.x);

    // (iteration, kind, ‖d‖, ρ, radius after).
    let golden = [
        (1, GaussNewton, 5.3165402284, -2318.36, 1.3291350571),
        (1, Bend, 1.3291350571, 0.1262416465, 1.3291350571),
        (2, Bend, 1.3291350571, -126.3688925, 0.3322837643),
        (2, Bend, 0.3322837643, 0.9568879552, 0.8307094107),
        (3, Bend, 0.8307094107, -36.76388204, 0.2076773527),
        (3, Bend, 0.2076773527, 0.8899453149, 0.2076773527),
        (4, Bend, 0.2076773527, 0.7002118624, 0.2076773527),
        (5, Bend, 0.2076773527, 0.7399075114, 0.2076773527),
        (6, Bend, 0.2076773527, 0.7797818752, 0.2076773527),
        (7, Bend, 0.2076773527, 0.7896884541, 0.2076773527),
        (8, Bend, 0.2076773527, 0.7882470234, 0.2076773527),
        (9, Bend, 0.2076773527, 0.7636169608, 0.2076773527),
        (10, Bend, 0.2076773527, 0.6736670427, 0.2076773527),
        (11, GaussNewton, 0.0643837296, 0.9958370354, 0.2076773527),
        (12, GaussNewton, 0.0006448464, 1.0, 0.2076773527),
    ];
    assert_eq!(lines.len(), golden.len());
    for (line, (iteration, kind, step_norm, gain_ratio, radius)) in lines.iter().zip(golden) {
        assert_eq!((line.iteration, line.kind), (iteration, kind), "{line:?}");
        assert!(close(line.step_norm, step_norm) && close(line.radius, radius), "{line:?}");
        assert_eq!(line.accepted, gain_ratio > 0.0, "{line:?}");
        assert!(close(line.gain_ratio, gain_ratio), "{line:?}");
    }
    for (trial, x) in [
        (1, [-0.5349057058, -0.1507604355]),
        (3, [-0.2200640641, -0.0445190093]),
        (5, [-0.0124794608, -0.0383129414]),
    ] {
        assert!(close(lines[trial].x[0], x[0]) && close(lines[trial].x[1], x[1]), "{:?}", lines[trial]);
    }
}

#[test]
fn trace_of_the_arctangent_is_that_of_chumpy() {
    let (solution, lines) = log(&Dogleg::default(), &arctan(), &[2.0]);
    assert_eq!((solution.iterations, solution.evaluations), (5, 7));
    assert!(solution.termination.was_successful() && solution.x[0].abs() < 1e-15, "{solution:?}");
    use StepKind::{Cauchy, GaussNewton};
    // (iteration, kind, ‖d‖, ρ, radius after). In one dimension Cauchy's and Gauss and Newton's steps are the same.
    let golden = [
        (1, GaussNewton, 5.5357435890, -0.4516846076, 1.3839358972),
        (1, Cauchy, 1.3839358972, 1.717227305, 3.4598397431),
        (2, GaussNewton, 0.7617070381, 0.9313907602, 3.4598397431),
        (3, GaussNewton, 0.1476938486, 0.9997989055, 3.4598397431),
        (4, GaussNewton, 0.0020509189, 1.0, 3.4598397431),
        (5, GaussNewton, 0.0000000058, 1.0, 3.4598397431),
    ];
    assert_eq!(lines.len(), golden.len());
    for (line, (iteration, kind, step_norm, gain_ratio, radius)) in lines.iter().zip(golden) {
        assert_eq!(
            (line.iteration, line.kind, line.accepted),
            (iteration, kind, gain_ratio > 0.0),
            "{line:?}"
        );
        assert!(close(line.step_norm, step_norm) && close(line.radius, radius), "{line:?}");
        assert!(close(line.gain_ratio, gain_ratio), "{line:?}");
    }
    assert!(close(lines[0].x[0], 2.0 - 5.5357435890), "{:?}", lines[0]);
}

#[test]
fn trace_of_powells_singular_function_is_that_of_chumpy() {
    let (a, b) = (5f64.sqrt(), 10f64.sqrt());
    let singular = Functions(
        move |x: &[f64]| {
            let (p, q) = (x[1] - 2.0 * x[2], x[0] - x[3]);
            Some(vec![x[0] + 10.0 * x[1], a * (x[2] - x[3]), p * p, b * q * q])
        },
        move |x: &[f64]| {
            let (p, q) = (2.0 * (x[1] - 2.0 * x[2]), 2.0 * b * (x[0] - x[3]));
            let rows = [[1.0, 10.0, 0.0, 0.0], [0.0, 0.0, a, -a], [0.0, p, -2.0 * p, 0.0], [q, 0.0, 0.0, -q]];
            Dense::new(4, 4, rows.concat())
        },
    );
    let (solution, lines) = log(&Dogleg::default(), &singular, &[3.0, -1.0, 0.0, 1.0]);
    assert_eq!((solution.iterations, solution.evaluations), (20, 21), "{solution:?}");
    assert!(lines.iter().all(|line| line.kind == StepKind::GaussNewton && line.accepted));
    assert!(close(lines[0].gain_ratio, 0.9531976744), "{:?}", lines[0]);
    // The linear residuals vanish at once; each step leaves a quarter of the quadratic ones: 1 − (1/4)² = 15/16.
    assert!(lines[1..14].iter().all(|line| close(line.gain_ratio, 0.9375)), "{lines:?}");
    assert!(lines.iter().all(|line| close(line.radius, 5.4440698770)), "{lines:?}");
}
