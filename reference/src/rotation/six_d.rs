//! The six numbers that networks regress for a rotation: two columns, made orthonormal by Gram–Schmidt.

use crate::linalg::matrix::{Matrix3, from_columns};
use crate::linalg::vector::{Vector3, add_scaled, cross, dot, norm, normalize};

/// Columns within this angle (radians) of one line mean no rotation: four digits at most would be left of the second.
const PARALLEL_RAD: f64 = 1e-12;

/// The rotation matrix of the continuous six-number representation by Gram–Schmidt, or `None` where the numbers mean none.
///
/// With a₁ = (x₀, x₂, x₄) and a₂ = (x₁, x₃, x₅), that is, x = the first two *columns* of R laid out row by row
/// (a 3×2 array): b₁ = a₁/‖a₁‖, b₂ = (a₂ − (b₁·a₂) b₁)/‖…‖, b₃ = b₁ × b₂, R = \[b₁ b₂ b₃\].
///
/// Lengths do not matter, from the smallest to the largest number of f64; R is orthonormal to 10⁻¹⁵ however close to
/// parallel the columns are. There is no rotation where a column is zero or not finite, or the two lie within
/// 10⁻¹² rad of one line.
///
/// # Conventions
/// PyTorch's `normalize` divides by max(‖a‖, 10⁻¹²) instead: there a zero column gives a singular matrix, and one shorter
/// than 10⁻¹² a matrix that is no rotation.
///
/// # References
/// Zhou, Barnes, Lu, Yang, Li 2019, "On the Continuity of Rotation Representations in Neural Networks"; the 3×2
/// row-by-row layout is the one of the regressors that Li 2021, ch. 4 builds on (erratum E50).
///
/// ```
/// use vitruvian_reference::rotation::from_six_d;
/// // Columns (2, 0, 0) and (5, 3, 0): x stays, y is cleared of its x.
/// let r = from_six_d(&[2.0, 5.0, 0.0, 3.0, 0.0, 0.0]).expect("two directions");
/// assert_eq!(r, [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
/// ```
pub fn from_six_d(x: &[f64; 6]) -> Option<Matrix3> {
    let b1 = direction([x[0], x[2], x[4]])?;
    let a2 = direction([x[1], x[3], x[5]])?;
    let rejected = add_scaled(a2, b1, -dot(b1, a2));
    if norm(rejected) <= PARALLEL_RAD {
        return None;
    }
    // Of nearly parallel columns the rejection keeps few digits, and a part along b₁ as large as its rounding: once more.
    let once = normalize(rejected);
    let b2 = normalize(add_scaled(once, b1, -dot(b1, once)));
    Some(from_columns(b1, b2, cross(b1, b2)))
}

/// a/‖a‖ without overflow or underflow of ‖a‖², or `None` if a is zero or not finite.
fn direction(a: Vector3) -> Option<Vector3> {
    let largest = a.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
    let directed = largest > 0.0 && a.iter().all(|x| x.is_finite());
    directed.then(|| normalize(a.map(|x| x / largest)))
}

/// The six numbers of a rotation matrix: its first two columns, row by row; the inverse of [`from_six_d`].
pub fn to_six_d(r: &Matrix3) -> [f64; 6] {
    [r[0][0], r[0][1], r[1][0], r[1][1], r[2][0], r[2][1]]
}

#[cfg(test)]
mod tests {
    use super::super::rodrigues;
    use super::*;
    use crate::linalg::matrix::{IDENTITY, determinant, max_abs, mul, sub, transpose};

    fn assert_close(a: &Matrix3, b: &Matrix3, bound: f64) {
        assert!(max_abs(&sub(a, b)) <= bound, "{a:?}\nagainst {b:?}");
    }

    #[test]
    fn six_d_golden() {
        // Computed once in plain double precision by an independent script, nine digits kept.
        let golden = from_columns(
            [0.953462589, 0.095346259, -0.286038777],
            [0.045828956, 0.891831482, 0.450040347],
            [0.29800805, -0.442205493, 0.845958335],
        );
        let r = from_six_d(&[1.0, 0.2, 0.1, 0.9, -0.3, 0.4]).expect("two directions");
        assert_close(&r, &golden, 5e-10);
    }

    #[test]
    fn six_d_of_a_rotation_gives_it_back() {
        let r = rodrigues([-1.2, 0.4, 2.0]);
        assert_close(&from_six_d(&to_six_d(&r)).expect("a rotation"), &r, 1e-15);
    }

    #[test]
    fn lengths_do_not_matter_from_the_smallest_to_the_largest_number() {
        let wanted = from_six_d(&[1.0, 0.0, 1.0, 1.0, 0.0, 1.0]).expect("two directions");
        for (a, b) in [(5e-324, 1.0), (1e-310, 1e308), (1e-150, 1e150), (1e150, 1e-150), (f64::MAX, f64::MAX)]
        {
            let r = from_six_d(&[a, 0.0, a, b, 0.0, b]).expect("two directions");
            assert_close(&r, &wanted, 1e-15);
        }
    }

    #[test]
    fn nearly_parallel_columns_still_make_a_rotation() {
        for angle in [1e-2, 1e-6, 1e-9, 2e-12] {
            let r = from_six_d(&[0.6, 0.6, 0.8, 0.8, 0.0, angle]).expect("two directions");
            assert_close(&mul(&transpose(&r), &r), &IDENTITY, 1e-15);
            assert!((determinant(&r) - 1.0).abs() < 1e-15, "angle {angle:e}");
            // The second column is z, as exactly as the rounding of (0.6, 0.8) allows.
            assert!((r[2][1] - 1.0).abs() < (1e-16 / angle).powi(2) + 1e-15, "angle {angle:e}: {r:?}");
        }
    }

    #[test]
    fn parallel_zero_and_infinite_columns_mean_no_rotation() {
        for (what, x) in [
            ("parallel", [1.0, 2.0, 0.0, 0.0, 0.0, 0.0]),
            ("opposite", [1.0, -2.0, 1.0, -2.0, 1.0, -2.0]),
            ("parallel but for rounding", [0.1, 0.3, 0.1, 0.3, 0.1, 0.3]),
            ("no first column", [0.0, 1.0, 0.0, 1.0, -0.0, 0.0]),
            ("no second column", [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
            ("nothing", [0.0; 6]),
            ("infinite", [f64::INFINITY, 0.0, 0.0, 1.0, 0.0, 0.0]),
            ("not a number", [1.0, 0.0, f64::NAN, 1.0, 0.0, 0.0]),
        ] {
            assert_eq!(from_six_d(&x), None, "{what}");
        }
    }
}
