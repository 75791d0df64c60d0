//! The few 3-vector and 3×3 operations that cameras need, in f64; matrices are `m[row][column]`.

pub(crate) type Vector3 = [f64; 3];
pub(crate) type Matrix3 = [[f64; 3]; 3];

pub(crate) const IDENTITY: Matrix3 = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

pub(crate) fn add(a: Vector3, b: Vector3) -> Vector3 {
    std::array::from_fn(|i| a[i] + b[i])
}

pub(crate) fn subtract(a: Vector3, b: Vector3) -> Vector3 {
    std::array::from_fn(|i| a[i] - b[i])
}

pub(crate) fn scale(a: Vector3, s: f64) -> Vector3 {
    a.map(|x| x * s)
}

pub(crate) fn dot(a: Vector3, b: Vector3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

pub(crate) fn cross(a: Vector3, b: Vector3) -> Vector3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

pub(crate) fn norm(a: Vector3) -> f64 {
    dot(a, a).sqrt()
}

/// a / ‖a‖, or `None` for a vector without direction.
pub(crate) fn normalize(a: Vector3) -> Option<Vector3> {
    let length = norm(a);
    (length > 0.0 && length.is_finite()).then(|| scale(a, 1.0 / length))
}

/// M v
pub(crate) fn apply(m: &Matrix3, v: Vector3) -> Vector3 {
    m.map(|row| dot(row, v))
}

/// Mᵀ v
pub(crate) fn apply_transposed(m: &Matrix3, v: Vector3) -> Vector3 {
    std::array::from_fn(|j| m[0][j] * v[0] + m[1][j] * v[1] + m[2][j] * v[2])
}

/// A B
pub(crate) fn multiply(a: &Matrix3, b: &Matrix3) -> Matrix3 {
    std::array::from_fn(|i| std::array::from_fn(|j| (0..3).map(|k| a[i][k] * b[k][j]).sum()))
}

pub(crate) fn determinant(m: &Matrix3) -> f64 {
    dot(m[0], cross(m[1], m[2]))
}

/// The largest entry of |R Rᵀ − I|: zero for a rotation or a reflection.
pub(crate) fn orthonormality_defect(r: &Matrix3) -> f64 {
    let mut worst = 0.0f64;
    for i in 0..3 {
        for j in 0..3 {
            worst = worst.max((dot(r[i], r[j]) - IDENTITY[i][j]).abs());
        }
    }
    worst
}

/// The rotation of the axis-angle vector ω: R = I + sin θ [a]ₓ + (1 − cos θ) [a]ₓ², θ = ‖ω‖, a = ω/θ (Rodrigues).
pub(crate) fn rotation_matrix(axis_angle: Vector3) -> Matrix3 {
    let Some(a) = normalize(axis_angle) else { return IDENTITY };
    let (sine, cosine) = norm(axis_angle).sin_cos();
    let skew = [[0.0, -a[2], a[1]], [a[2], 0.0, -a[0]], [-a[1], a[0], 0.0]];
    let square = multiply(&skew, &skew);
    std::array::from_fn(|i| {
        std::array::from_fn(|j| IDENTITY[i][j] + sine * skew[i][j] + (1.0 - cosine) * square[i][j])
    })
}

/// The symmetric system A x = b solved by Cramer's rule, or `None` where A is singular to working precision.
pub(crate) fn solve(a: &Matrix3, b: Vector3) -> Option<Vector3> {
    let scale_of = a.iter().flatten().fold(0.0f64, |m, x| m.max(x.abs()));
    let d = determinant(a);
    // det is a product of three entries; 1e-12 of that size leaves four digits of an f64 answer.
    if d.is_nan() || d.abs() <= 1e-12 * scale_of.powi(3) {
        return None;
    }
    Some(std::array::from_fn(|j| {
        let mut m = *a;
        for i in 0..3 {
            m[i][j] = b[i];
        }
        determinant(&m) / d
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rotation_matrix_is_orthonormal_and_turns_x_into_y_about_z() {
        let r = rotation_matrix([0.0, 0.0, std::f64::consts::FRAC_PI_2]);
        assert!(orthonormality_defect(&r) < 1e-15);
        let y = apply(&r, [1.0, 0.0, 0.0]);
        assert!(norm(subtract(y, [0.0, 1.0, 0.0])) < 1e-15);
        assert_eq!(rotation_matrix([0.0; 3]), IDENTITY);
    }

    #[test]
    fn solving_returns_the_planted_vector() {
        let a = [[4.0, 1.0, 0.5], [1.0, 3.0, -0.2], [0.5, -0.2, 2.0]];
        let x = solve(&a, apply(&a, [1.0, -2.0, 0.25])).unwrap();
        assert!(norm(subtract(x, [1.0, -2.0, 0.25])) < 1e-14);
        assert_eq!(solve(&[[1.0, 2.0, 3.0], [2.0, 4.0, 6.0], [0.0, 0.0, 1.0]], [1.0; 3]), None);
    }
}
