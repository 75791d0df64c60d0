//! Vectors of ℝ³ as plain arrays.

/// A point or a direction of ℝ³: `[x, y, z]`.
pub type Vector3 = [f64; 3];

/// The origin.
pub const ZERO: Vector3 = [0.0; 3];

/// a + b.
pub fn add(a: Vector3, b: Vector3) -> Vector3 {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// a − b.
pub fn sub(a: Vector3, b: Vector3) -> Vector3 {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// s·a.
pub fn scale(a: Vector3, s: f64) -> Vector3 {
    [a[0] * s, a[1] * s, a[2] * s]
}

/// a + s·b.
pub fn add_scaled(a: Vector3, b: Vector3, s: f64) -> Vector3 {
    [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]]
}

/// −a.
pub fn negate(a: Vector3) -> Vector3 {
    [-a[0], -a[1], -a[2]]
}

/// The inner product a·b.
pub fn dot(a: Vector3, b: Vector3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// The vector product a × b, right-handed: x × y = z.
pub fn cross(a: Vector3, b: Vector3) -> Vector3 {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// ‖a‖².
pub fn norm_squared(a: Vector3) -> f64 {
    dot(a, a)
}

/// ‖a‖, the Euclidean length.
pub fn norm(a: Vector3) -> f64 {
    dot(a, a).sqrt()
}

/// ‖a − b‖.
pub fn distance(a: Vector3, b: Vector3) -> f64 {
    norm(sub(a, b))
}

/// a / ‖a‖.
///
/// # Panics
/// If ‖a‖ is zero or not finite: such a vector has no direction.
pub fn normalize(a: Vector3) -> Vector3 {
    let length = norm(a);
    assert!(length > 0.0 && length.is_finite(), "normalize: {a:?} has no direction");
    [a[0] / length, a[1] / length, a[2] / length]
}

/// (1 − t)·a + t·b.
pub fn lerp(a: Vector3, b: Vector3, t: f64) -> Vector3 {
    add_scaled(scale(a, 1.0 - t), b, t)
}

/// The mean of `points`.
///
/// # Panics
/// If there is no point.
pub fn centroid(points: &[Vector3]) -> Vector3 {
    assert!(!points.is_empty(), "centroid: no points");
    scale(points.iter().copied().fold(ZERO, add), 1.0 / points.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn x_cross_y_is_z() {
        assert_eq!(cross([1.0, 0.0, 0.0], [0.0, 1.0, 0.0]), [0.0, 0.0, 1.0]);
    }

    #[test]
    fn cross_is_orthogonal_to_both() {
        let (a, b) = ([1.0, 2.0, 3.0], [-4.0, 5.0, 0.5]);
        assert_eq!(dot(cross(a, b), a), 0.0);
        assert_eq!(dot(cross(a, b), b), 0.0);
    }

    #[test]
    fn normalized_has_length_one() {
        assert_eq!(normalize([3.0, 0.0, -4.0]), [0.6, 0.0, -0.8]);
    }

    #[test]
    #[should_panic(expected = "has no direction")]
    fn zero_has_no_direction() {
        normalize(ZERO);
    }

    #[test]
    fn lerp_meets_its_ends() {
        let (a, b) = ([1.0, 2.0, 3.0], [-4.0, 5.0, 0.5]);
        assert_eq!(lerp(a, b, 0.0), a);
        assert_eq!(lerp(a, b, 1.0), b);
        assert_eq!(centroid(&[a, b]), lerp(a, b, 0.5));
    }
}
