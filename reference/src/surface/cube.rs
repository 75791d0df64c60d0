//! The cube that a voxel grid fills, and the three coordinates used in it.

use super::bounding_box::BoundingBox;
use crate::linalg::vector::{Vector3, add_scaled, scale, sub};

/// An axis-aligned cube, in the units of the world (metres).
///
/// # Conventions
///
/// With D cells along each side,
///
/// * cell (i, j, k) has its *centre* at origin + side·((i+½)/D, (j+½)/D, (k+½)/D);
/// * lattice point (i, j, k) of D cells, 0 ≤ i, j, k ≤ D, is at origin + side/D·(i, j, k);
/// * the normalised coordinate 2(p − origin)/side − 1 runs from −1 to 1 between *faces* of the cube, so that
///   the centre of cell i is (2i+1)/D − 1 on every level of a pyramid (grid sampling with `align_corners` =
///   false).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cube {
    /// The corner with the least coordinates.
    pub origin: Vector3,
    /// Length of a side.
    pub side: f64,
}

impl Cube {
    /// The cube about the centre of `bounds` whose side is longest side / `fill`.
    ///
    /// VSR reads its body in the cube with fill 0.9 (the normalisation that Li 2021 leaves open, erratum E39).
    ///
    /// # Panics
    ///
    /// If `fill` is not positive, or if the bounds are one point.
    pub fn around(bounds: &BoundingBox, fill: f64) -> Cube {
        assert!(fill > 0.0, "cube: fill {fill} is not positive");
        let side = bounds.longest_side() / fill;
        assert!(side > 0.0, "cube: the bounds {bounds:?} have no extent");
        Cube { origin: bounds.center().map(|middle| middle - 0.5 * side), side }
    }

    /// Centre of a cell of a grid with `resolution` cells a side.
    pub fn cell_center(&self, cell: [usize; 3], resolution: usize) -> Vector3 {
        let fraction = cell.map(|index| (index as f64 + 0.5) / resolution as f64);
        add_scaled(self.origin, fraction, self.side)
    }

    /// Distance between neighbouring lattice points, or cell centres, with `resolution` cells a side.
    pub fn spacing(&self, resolution: usize) -> f64 {
        self.side / resolution as f64
    }

    /// World to normalised coordinates, −1 … 1.
    pub fn normalize(&self, point: Vector3) -> Vector3 {
        scale(sub(point, self.origin), 2.0 / self.side).map(|x| x - 1.0)
    }

    /// Normalised to world coordinates.
    pub fn denormalize(&self, point: Vector3) -> Vector3 {
        add_scaled(self.origin, point.map(|x| x + 1.0), 0.5 * self.side)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_cube_is_centred_and_the_body_fills_its_share() {
        let bounds = BoundingBox { min: [-0.25, 0.0, 1.0], max: [0.25, 1.8, 1.5] };
        let cube = Cube::around(&bounds, 0.9);
        assert!((cube.side - 2.0).abs() < 1e-15);
        for (found, expected) in cube.origin.into_iter().zip([-1.0, -0.1, 0.25]) {
            assert!((found - expected).abs() < 1e-15);
        }
    }

    #[test]
    fn cell_centres_register_on_every_level() {
        let cube = Cube { origin: [1.0, 2.0, 3.0], side: 4.0 };
        // The centre of a coarse cell is the mean of the centres of its two fine cells.
        let coarse = cube.cell_center([1, 0, 3], 4);
        let fine = [2, 3].map(|i| cube.cell_center([i, 0, 6], 8)[0]);
        assert_eq!(coarse[0], 0.5 * (fine[0] + fine[1]));
        assert_eq!(coarse, [2.5, 2.5, 6.5]);
        assert_eq!(cube.normalize(coarse), [-0.25, -0.75, 0.75]);
        assert_eq!(cube.denormalize(cube.normalize(coarse)), coarse);
        assert_eq!(cube.spacing(4), 1.0);
    }

    #[test]
    #[should_panic(expected = "have no extent")]
    fn a_point_has_no_cube() {
        Cube::around(&BoundingBox { min: [1.0; 3], max: [1.0; 3] }, 0.9);
    }
}
