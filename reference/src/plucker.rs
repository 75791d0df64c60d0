//! Lines of space in Plücker coordinates: a unit direction and a moment.
//!
//! The line through p along the unit vector d has the moment m = p × d, whichever of its points p is. A point v lies on it
//! if and only if v × d = m, so v × d − m is a residual that is *linear* in v: three numbers in metres whose norm is the
//! distance. That is why Li 2021 (eq. 3.8) pulls vertices towards rays in this form.
//!
//! # Conventions
//! Two are in use. Here, in Li 2021 and in Alldieck et al. 2018 the moment is **p × d**. Kinematics often writes d × p,
//! which turns the sign of every moment round; distances and nearest points do not feel it as long as one convention is
//! kept. A line and its reverse, (d, m) and (−d, −m), are the same set of points; the reciprocal product changes its sign.
//!
//! # References
//! Plücker 1865, "On a New Geometry of Space"; Li 2021, eq. 3.5–3.8 (read with errata E9 and E10); Alldieck, Magnor, Xu,
//! Theobalt, Pons-Moll 2018, "Video Based Reconstruction of 3D People Models", eq. 4–7.

use crate::body::kinematic_tree::Rigid;
use crate::linalg::matrix::{self, Matrix3};
use crate::linalg::vector::{Vector3, add, add_scaled, cross, dot, negate, norm, scale, sub};
use crate::rotation::skew;

/// A directed line of space.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Line {
    /// d, of unit length.
    pub direction: Vector3,
    /// m = p × d for every point p of the line; d·m = 0, and ‖m‖ is the distance from the origin.
    pub moment: Vector3,
}

impl Line {
    /// The line from `from` through `to`; `None` if the points coincide or are not finite.
    ///
    /// ```
    /// use vitruvian_reference::plucker::Line;
    /// let vertical = Line::through([1.0, 0.0, 0.0], [1.0, 0.0, 5.0]).expect("two points");
    /// assert_eq!((vertical.direction, vertical.moment), ([0.0, 0.0, 1.0], [0.0, -1.0, 0.0]));
    /// assert_eq!(vertical.distance([4.0, 4.0, 7.0]), 5.0);
    /// ```
    pub fn through(from: Vector3, to: Vector3) -> Option<Line> {
        Line::along(from, sub(to, from))
    }

    /// The line through `point` along a vector of any length; `None` if the vector is zero or not finite.
    pub fn along(point: Vector3, vector: Vector3) -> Option<Line> {
        let length = norm(vector);
        if !(length > 0.0 && length.is_finite()) {
            return None;
        }
        let direction = scale(vector, 1.0 / length);
        Some(Line { direction, moment: cross(point, direction) })
    }

    /// v × d − m: zero on the line, perpendicular to it, and as long as v is far from it.
    pub fn residual(&self, v: Vector3) -> Vector3 {
        sub(cross(v, self.direction), self.moment)
    }

    /// ∂(v × d − m)/∂v = −`[d]×`, the same for every v.
    pub fn residual_derivative(&self) -> Matrix3 {
        skew(negate(self.direction))
    }

    /// The distance of a point from the line.
    pub fn distance(&self, v: Vector3) -> f64 {
        norm(self.residual(v))
    }

    /// The point of the line nearest to the origin: d × m.
    pub fn point_nearest_origin(&self) -> Vector3 {
        cross(self.direction, self.moment)
    }

    /// The point of the line nearest to v: d × m + (v·d) d.
    pub fn nearest_point(&self, v: Vector3) -> Vector3 {
        add_scaled(self.point_nearest_origin(), self.direction, dot(v, self.direction))
    }

    /// d₁·m₂ + d₂·m₁: zero if and only if the lines meet or are parallel.
    ///
    /// Its size is the distance of the lines times the sine of the angle between them; its sign tells on which side one
    /// passes the other.
    pub fn reciprocal_product(&self, other: &Line) -> f64 {
        dot(self.direction, other.moment) + dot(other.direction, self.moment)
    }

    /// The points of this line and of the other where they come closest, or `None` if the lines are parallel.
    ///
    /// With c = d₁ × d₂ the plane through line 2 along c has the normal d₂ × c and the offset m₂·c; line 1 meets it in
    /// (−m₁ × (d₂ × c) + (m₂·c) d₁)/‖c‖².
    ///
    /// # References
    /// Lengyel 2012, "Mathematics for 3D Game Programming and Computer Graphics", §5.1.
    pub fn nearest_points(&self, other: &Line) -> Option<[Vector3; 2]> {
        let common = cross(self.direction, other.direction);
        let sine_squared = dot(common, common);
        // Rounding of d leaves a sine of a few ε between parallel lines.
        if sine_squared < 1e-28 {
            return None;
        }
        let on = |line: &Line, partner: &Line, common: Vector3| {
            let along = scale(line.direction, dot(partner.moment, common));
            scale(add(cross(cross(partner.direction, common), line.moment), along), 1.0 / sine_squared)
        };
        Some([on(self, other, common), on(other, self, negate(common))])
    }

    /// The distance of two lines, parallel or not.
    pub fn distance_to_line(&self, other: &Line) -> f64 {
        match self.nearest_points(other) {
            Some([a, b]) => norm(sub(a, b)),
            None => self.distance(other.point_nearest_origin()),
        }
    }

    /// The line moved by x ↦ R x + t: d′ = R d, m′ = R m + t × R d.
    pub fn moved(&self, motion: &Rigid) -> Line {
        let direction = matrix::apply(&motion.rotation, self.direction);
        let moment = add(matrix::apply(&motion.rotation, self.moment), cross(motion.translation, direction));
        Line { direction, moment }
    }

    /// The same points, run through in the other direction.
    pub fn reversed(&self) -> Line {
        Line { direction: negate(self.direction), moment: negate(self.moment) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::vector::distance;

    const TOWARDS: Vector3 = [1.0, 2.0, 4.0];
    const POINT: Vector3 = [0.5, 1.2, 2.0];

    fn ray() -> Line {
        Line::through([0.0; 3], TOWARDS).expect("two points")
    }

    #[test]
    fn residual_of_a_point_beside_a_ray_by_hand() {
        // d = (1, 2, 4)/√21, m = 0: v × d = (0.8, 0, −0.2)/√21.
        let root = 21f64.sqrt();
        assert!(distance(ray().residual(POINT), [0.8 / root, 0.0, -0.2 / root]) < 1e-15);
        assert!((ray().distance(POINT) - 0.179947082).abs() < 5e-10);
    }

    #[test]
    fn shifting_everything_changes_the_moment_and_not_the_residual() {
        let shift = [0.1, -0.2, 0.3];
        let shifted = Line::through(shift, add(TOWARDS, shift)).expect("two points");
        assert!(distance(shifted.moment, [-0.305505046, -0.021821789, 0.087287156]) < 1e-9);
        assert!(distance(shifted.residual(add(POINT, shift)), ray().residual(POINT)) < 1e-15);
    }

    #[test]
    fn residual_derivative_is_minus_the_skew_matrix() {
        let line = Line::through([0.3, -0.1, 0.2], TOWARDS).expect("two points");
        for axis in 0..3 {
            let mut step = [0.0; 3];
            step[axis] = 0.5;
            // Linear: any step is exact but for rounding.
            let slope = sub(line.residual(add(POINT, step)), line.residual(sub(POINT, step)));
            assert!(distance(slope, matrix::column(&line.residual_derivative(), axis)) < 1e-15);
        }
    }

    #[test]
    fn perpendicular_lines_by_hand() {
        let x_axis = Line::along([7.0, 0.0, 0.0], [3.0, 0.0, 0.0]).expect("a direction");
        let over_it = Line::along([2.0, -5.0, 1.5], [0.0, 2.0, 0.0]).expect("a direction");
        let [a, b] = x_axis.nearest_points(&over_it).expect("not parallel");
        assert!(distance(a, [2.0, 0.0, 0.0]) < 1e-15 && distance(b, [2.0, 0.0, 1.5]) < 1e-15, "{a:?} {b:?}");
        assert_eq!(x_axis.reciprocal_product(&over_it).abs(), 1.5);
        assert_eq!(x_axis.distance_to_line(&over_it), 1.5);
    }

    #[test]
    fn parallel_lines_have_a_distance_and_no_nearest_points() {
        let a = Line::along([0.0, 1.0, 0.0], [1.0, 1.0, 0.0]).expect("a direction");
        let b = Line::along([0.0, 1.0, 2.0], [-1.0, -1.0, 0.0]).expect("a direction");
        assert_eq!(a.nearest_points(&b), None);
        assert!((a.distance_to_line(&b) - 2.0).abs() < 1e-15);
    }

    #[test]
    fn a_point_alone_is_no_line() {
        assert_eq!(Line::through(POINT, POINT), None);
        assert_eq!(Line::along(POINT, [f64::NAN, 0.0, 0.0]), None);
    }
}
