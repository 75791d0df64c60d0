//! Rotations in f64 as networks and body files write them: matrices, six numbers, axis–angle vectors.
//!
//! Matrices act on columns, x ↦ R x. An axis–angle vector v turns by ‖v‖ radians about v. Whatever comes out of here is a
//! rotation to rounding (‖R Rᵀ − I‖ ≈ 10⁻¹⁶); what is none goes in and comes out as `None`.

/// A 3 × 3 matrix by rows.
pub type Matrix3 = [[f64; 3]; 3];

/// The largest entry of |M Mᵀ − I| at which [`nearest`] still takes M for a rotation that lost digits: half precision,
/// quantised or not fully trained heads stay far below, a scaled, sheared or unrelated matrix is far above.
pub const LARGEST_DEFECT: f64 = 0.1;

/// Where the second column of six numbers is parallel to the first to within this sine, rounding of f32 decides.
const LEAST_SINE: f64 = 1e-6;

/// R − I of an axis–angle vector (radians): sin α \[n\]× + 2 sin²(α/2) (n nᵀ − I).
///
/// No term cancels: a turn by 10⁻⁴ has all its digits, which R itself would hide behind its 1s.
pub fn rotation_minus_identity(axis_angle: [f64; 3]) -> Matrix3 {
    let largest = axis_angle.iter().fold(0.0_f64, |a, x| a.max(x.abs()));
    if largest == 0.0 {
        return [[0.0; 3]; 3];
    }
    // Scaled first, so that squares neither vanish nor overflow.
    let scaled = axis_angle.map(|x| x / largest);
    let length = scaled.iter().map(|x| x * x).sum::<f64>().sqrt();
    let n = scaled.map(|x| x / length);
    // Beyond the range of f64 there is no angle left to speak of: the largest one stands for it.
    let angle = (largest * length).min(f64::MAX);
    let (sin, half) = (angle.sin(), (0.5 * angle).sin());
    let versine = 2.0 * half * half;
    let [x, y, z] = n;
    let mixed = |a: f64, b: f64| versine * a * b;
    [
        [-versine * (y * y + z * z), mixed(x, y) - sin * z, mixed(x, z) + sin * y],
        [mixed(x, y) + sin * z, -versine * (x * x + z * z), mixed(y, z) - sin * x],
        [mixed(x, z) - sin * y, mixed(y, z) + sin * x, -versine * (x * x + y * y)],
    ]
}

/// The rotation matrix of an axis–angle vector (radians).
pub fn rodrigues(axis_angle: [f64; 3]) -> Matrix3 {
    let mut r = rotation_minus_identity(axis_angle);
    (0..3).for_each(|i| r[i][i] += 1.0);
    r
}

/// The axis–angle vector of a rotation matrix, 0 ≤ ‖v‖ ≤ π: the inverse of [`rodrigues`], half turns included.
///
/// By way of the unit quaternion (w, q) = (cos α/2, sin α/2 n), whose largest component comes from the diagonal of R and the
/// others from sums and differences across it: v = 2 atan2(‖q‖, w) q/‖q‖. No branch loses digits.
///
/// # Conventions
/// At exactly half a turn ±n are the same rotation; the one whose largest component is positive is returned.
///
/// ```
/// use vitruvian_runtime::rotation::{logarithm, rodrigues};
/// let half_turn = [0.0, std::f64::consts::PI, 0.0];
/// assert_eq!(logarithm(&[[-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, -1.0]]), half_turn);
/// ```
pub fn logarithm(r: &Matrix3) -> [f64; 3] {
    let trace = r[0][0] + r[1][1] + r[2][2];
    // Four times the square of w, q₀, q₁, q₂; they sum to 4, so the largest is at least 1.
    let squares =
        [1.0 + trace, 1.0 + 2.0 * r[0][0] - trace, 1.0 + 2.0 * r[1][1] - trace, 1.0 + 2.0 * r[2][2] - trace];
    let largest = (0..4).fold(0, |best, i| if squares[i] > squares[best] { i } else { best });
    let root = squares[largest].max(0.0).sqrt();
    let difference = |i: usize| r[(i + 2) % 3][(i + 1) % 3] - r[(i + 1) % 3][(i + 2) % 3];
    // Twice the quaternion.
    let mut w = root;
    let mut q = [0, 1, 2].map(|i| difference(i) / root);
    if let Some(axis) = largest.checked_sub(1) {
        w = difference(axis) / root;
        q = [0, 1, 2].map(|i| if i == axis { root } else { (r[i][axis] + r[axis][i]) / root });
    }
    // A component of q that comes from the diagonal is positive: at w = 0 the convention holds by itself.
    if w < 0.0 {
        (w, q) = (-w, q.map(|x| -x));
    }
    // Scaled by the largest component, so that the squares of tiny turns do not vanish.
    let greatest = q.iter().fold(0.0_f64, |a, x| a.max(x.abs()));
    if greatest == 0.0 {
        return [0.0; 3];
    }
    let length = greatest * q.iter().map(|x| (x / greatest).powi(2)).sum::<f64>().sqrt();
    let angle = 2.0 * length.atan2(w);
    q.map(|x| x / length * angle)
}

/// The rotation of six numbers, its first two columns interleaved (a 3×2 array row by row), by Gram–Schmidt.
///
/// a₁ = (x₀, x₂, x₄), a₂ = (x₁, x₃, x₅); b₁ = a₁/‖a₁‖, b₂ ∝ a₂ − (b₁·a₂) b₁, b₃ = b₁ × b₂, R = \[b₁ b₂ b₃\].
///
/// `None` when a number is not finite, a column is zero, or the two are parallel: no rotation is meant.
pub fn from_six_d(x: [f64; 6]) -> Option<Matrix3> {
    let b1 = unit([x[0], x[2], x[4]])?;
    let a2 = unit([x[1], x[3], x[5]])?;
    let along = dot(b1, a2);
    let rejected: [f64; 3] = std::array::from_fn(|i| a2[i] - along * b1[i]);
    if dot(rejected, rejected).sqrt() < LEAST_SINE {
        return None;
    }
    let b2 = unit(rejected)?;
    // Where the columns were nearly parallel, what is left of b₁ in b₂ is no longer rounding: once more.
    let rest = dot(b1, b2);
    let b2 = unit(std::array::from_fn(|i| b2[i] - rest * b1[i]))?;
    let b3 = cross(b1, b2);
    Some(std::array::from_fn(|row| [b1[row], b2[row], b3[row]]))
}

/// The rotation nearest to a matrix that is one but for lost digits: the orthogonal factor of its polar decomposition.
///
/// Newton's iteration X ← (X + X⁻ᵀ)/2 doubles the correct digits in each step.
///
/// `None` when a number is not finite, the determinant is not positive, or an entry of |M Mᵀ − I| exceeds
/// [`LARGEST_DEFECT`].
///
/// # References
/// Higham 1986, "Computing the polar decomposition – with applications".
pub fn nearest(m: &Matrix3) -> Option<Matrix3> {
    let entry = |i: usize, j: usize| dot(m[i], m[j]) - f64::from(u8::from(i == j));
    let defect = (0..9).fold(0.0_f64, |most, k| most.max(entry(k / 3, k % 3).abs()));
    // A comparison that a NaN fails, wherever it stands.
    let is_close = m.as_flattened().iter().all(|x| x.is_finite()) && defect <= LARGEST_DEFECT;
    if !is_close || dot(m[0], cross(m[1], m[2])) <= 0.0 {
        return None;
    }
    let mut x = *m;
    // From a defect of 0.1 four steps reach rounding; the fifth is for the last bit.
    for _ in 0..5 {
        let cofactors = [cross(x[1], x[2]), cross(x[2], x[0]), cross(x[0], x[1])];
        let determinant = dot(x[0], cofactors[0]);
        x = std::array::from_fn(|r| std::array::from_fn(|c| 0.5 * (x[r][c] + cofactors[r][c] / determinant)));
    }
    Some(x)
}

fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: [f64; 3], b: [f64; 3]) -> [f64; 3] {
    std::array::from_fn(|i| a[(i + 1) % 3] * b[(i + 2) % 3] - a[(i + 2) % 3] * b[(i + 1) % 3])
}

/// `None` for a vector that is zero or not finite.
fn unit(v: [f64; 3]) -> Option<[f64; 3]> {
    let largest = v.iter().fold(0.0_f64, |a, x| a.max(x.abs()));
    if largest == 0.0 || !v.iter().all(|x| x.is_finite()) {
        return None;
    }
    let scaled = v.map(|x| x / largest);
    let length = dot(scaled, scaled).sqrt();
    Some(scaled.map(|x| x / length))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::PI;

    fn distance(a: &Matrix3, b: &Matrix3) -> f64 {
        a.as_flattened().iter().zip(b.as_flattened()).fold(0.0, |most, (x, y)| most.max((x - y).abs()))
    }

    fn six(r: &Matrix3) -> [f64; 6] {
        [r[0][0], r[0][1], r[1][0], r[1][1], r[2][0], r[2][1]]
    }

    #[test]
    fn no_turn_and_half_turns_about_an_axis_are_exact() {
        assert_eq!(logarithm(&rodrigues([0.0; 3])), [0.0; 3]);
        for axis in 0..3 {
            let mut half_turn = [[-1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]];
            half_turn[axis][axis] = 1.0;
            let mut v = [0.0; 3];
            v[axis] = PI;
            assert_eq!(logarithm(&half_turn), v);
        }
    }

    #[test]
    fn columns_are_interleaved() {
        let r = rodrigues([0.3, -0.2, 0.5]);
        let stretched = [2.0 * r[0][0], r[0][1], 2.0 * r[1][0], r[1][1], 2.0 * r[2][0], r[2][1]];
        assert!(distance(&from_six_d(stretched).unwrap(), &r) < 1e-15);
    }

    #[test]
    fn numbers_that_mean_no_rotation_are_none() {
        assert_eq!(from_six_d([0.0; 6]), None);
        assert_eq!(from_six_d([1.0, 2.0, 0.5, 1.0, 0.0, 0.0]), None, "parallel");
        assert_eq!(from_six_d([1.0, 0.0, f64::NAN, 1.0, 0.0, 0.0]), None);
        assert_eq!(from_six_d([1.0, f64::INFINITY, 0.0, 1.0, 0.0, 0.0]), None);
        let r = rodrigues([0.3, -0.2, 0.5]);
        assert_eq!(nearest(&r.map(|row| row.map(|x| 1.1 * x))), None, "scaled");
        assert_eq!(nearest(&r.map(|row| row.map(|x| -x))), None, "a reflection");
        assert_eq!(nearest(&[[f64::NAN; 3]; 3]), None);
        assert_eq!(nearest(&[[0.0; 3]; 3]), None);
    }

    proptest! {
        #[test]
        fn a_rotation_survives_every_way_of_writing_it(
            axis in prop::array::uniform3(-1.0f64..1.0),
            angle in prop_oneof![0.0..PI, (0.0f64..16.0).prop_map(|k| PI - 10f64.powf(-k)), (0.0f64..300.0).prop_map(|k| 10f64.powf(-k))],
        ) {
            let Some(n) = unit(axis) else { return Ok(()) };
            let v = n.map(|x| x * angle);
            let r = rodrigues(v);
            prop_assert!(distance(&rodrigues(logarithm(&r)), &r) < 2e-15);
            prop_assert!(distance(&from_six_d(six(&r)).unwrap(), &r) < 2e-15);
            prop_assert!(distance(&nearest(&r).unwrap(), &r) < 2e-15);
            let back = logarithm(&r);
            // At half a turn both signs are right.
            let apart = |sign: f64| (0..3).fold(0.0_f64, |most, i| most.max((back[i] - sign * v[i]).abs()));
            prop_assert!(apart(1.0) <= 4e-15 * angle || (PI - angle < 1e-14 && apart(-1.0) < 1e-14), "{v:?} {back:?}");
        }

        #[test]
        fn lost_digits_are_found_again(v in prop::array::uniform3(-4.0f64..4.0), noise in prop::array::uniform9(-1.0f64..1.0), size in 0.0f64..0.02) {
            let r = rodrigues(v);
            let spoiled = std::array::from_fn(|i| std::array::from_fn(|j| r[i][j] + size * noise[3 * i + j]));
            let found = nearest(&spoiled).unwrap();
            prop_assert!(distance(&found, &r) <= 3.0 * size + 1e-15);
            for i in 0..3 {
                for j in 0..3 {
                    prop_assert!((dot(found[i], found[j]) - f64::from(u8::from(i == j))).abs() < 1e-15);
                }
            }
        }
    }
}
