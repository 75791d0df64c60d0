//! Axis-aligned bounding boxes.

use crate::linalg::vector::Vector3;

/// The points p with min ≤ p ≤ max in every coordinate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BoundingBox {
    /// Least coordinates.
    pub min: Vector3,
    /// Greatest coordinates.
    pub max: Vector3,
}

impl BoundingBox {
    /// The smallest box around some points; none around no points.
    pub fn around(points: impl IntoIterator<Item = Vector3>) -> Option<BoundingBox> {
        let mut points = points.into_iter();
        let first = points.next()?;
        let start = BoundingBox { min: first, max: first };
        Some(points.fold(start, |found, point| found.union(&BoundingBox { min: point, max: point })))
    }

    /// The smallest box around two boxes.
    pub fn union(&self, other: &BoundingBox) -> BoundingBox {
        BoundingBox {
            min: [0, 1, 2].map(|axis| self.min[axis].min(other.min[axis])),
            max: [0, 1, 2].map(|axis| self.max[axis].max(other.max[axis])),
        }
    }

    /// Lengths of the sides.
    pub fn extent(&self) -> Vector3 {
        [0, 1, 2].map(|axis| self.max[axis] - self.min[axis])
    }

    /// Length of the longest side.
    pub fn longest_side(&self) -> f64 {
        self.extent().into_iter().fold(0.0, f64::max)
    }

    /// Middle of the box.
    pub fn center(&self) -> Vector3 {
        [0, 1, 2].map(|axis| 0.5 * (self.min[axis] + self.max[axis]))
    }

    /// The box grown on all six sides by `fraction` of its extent along that axis.
    pub fn padded(&self, fraction: f64) -> BoundingBox {
        let extent = self.extent();
        BoundingBox {
            min: [0, 1, 2].map(|axis| self.min[axis] - fraction * extent[axis]),
            max: [0, 1, 2].map(|axis| self.max[axis] + fraction * extent[axis]),
        }
    }

    /// Whether a point lies in the box, its faces included.
    pub fn contains(&self, point: Vector3) -> bool {
        (0..3).all(|axis| self.min[axis] <= point[axis] && point[axis] <= self.max[axis])
    }

    /// Squared distance from a point to the box; 0 inside it.
    pub fn distance_squared(&self, point: Vector3) -> f64 {
        (0..3)
            .map(|axis| (self.min[axis] - point[axis]).max(point[axis] - self.max[axis]).max(0.0).powi(2))
            .sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_box_reaches_from_the_least_to_the_greatest_coordinates() {
        let found = BoundingBox::around([[1.0, -2.0, 0.5], [-1.0, 4.0, 0.5]]).unwrap();
        assert_eq!(found, BoundingBox { min: [-1.0, -2.0, 0.5], max: [1.0, 4.0, 0.5] });
        assert_eq!((found.extent(), found.longest_side()), ([2.0, 6.0, 0.0], 6.0));
        assert_eq!(found.center(), [0.0, 1.0, 0.5]);
        assert_eq!(BoundingBox::around([]), None);
    }

    #[test]
    fn distance_is_to_the_nearest_face_edge_or_corner() {
        let unit = BoundingBox { min: [0.0; 3], max: [1.0; 3] };
        let cases =
            [([0.5; 3], 0.0), ([3.0, 0.5, 0.5], 4.0), ([2.0, -1.0, 0.5], 2.0), ([2.0, 2.0, 2.0], 3.0)];
        for (point, expected) in cases {
            assert_eq!(unit.distance_squared(point), expected);
            assert_eq!(unit.contains(point), expected == 0.0);
        }
    }

    #[test]
    fn padding_grows_every_side() {
        let found = BoundingBox { min: [0.0, 0.0, 0.0], max: [1.0, 2.0, 4.0] }.padded(0.5);
        assert_eq!(found, BoundingBox { min: [-0.5, -1.0, -2.0], max: [1.5, 3.0, 6.0] });
    }
}
