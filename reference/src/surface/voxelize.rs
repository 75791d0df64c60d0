//! A closed mesh as occupied cells.

use super::cube::Cube;
use super::inside::Inside;
use super::mesh::Mesh;
use super::ray_crossings::RayCrossings;

/// Occupancy of the D³ cells of a cube, D = `resolution`: 1 where the cell's *centre* is inside the mesh, else 0.
///
/// The result holds cell (i, j, k) at (i·D + j)·D + k, axis 0 = x, 1 = y, 2 = z. Its centre is
/// [`Cube::cell_center`]`([i, j, k], D)` and inside is as in [`Inside::contains`]. The cells along z share
/// their ray, so that a column costs one search.
///
/// # Panics
///
/// If the resolution is 0.
///
/// # References
///
/// Li 2021, ch. 6: the coarse surface enters VSR as 128³ such cells. Inside is 1 (erratum E17).
pub fn voxelize(mesh: &Mesh, cube: &Cube, resolution: usize) -> Vec<f64> {
    assert!(resolution > 0, "voxelize: a grid of resolution 0 has no cells");
    let inside = Inside::new(mesh);
    let rays = RayCrossings::new(mesh, [0.0, 0.0]);
    let mut values = Vec::with_capacity(resolution.pow(3));
    for i in 0..resolution {
        for j in 0..resolution {
            let column = rays.crossings(cube.cell_center([i, j, 0], resolution));
            for k in 0..resolution {
                let center = cube.cell_center([i, j, k], resolution);
                // A column that runs along an edge, or a centre in a triangle's plane, is decided by other
                // directions.
                let along_column = column.as_ref().and_then(|crossings| rays.winding(crossings, center));
                let winding = along_column.unwrap_or_else(|| inside.winding(center));
                values.push(if winding != 0 { 1.0 } else { 0.0 });
            }
        }
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::mesh::tests::cuboid;

    #[test]
    fn a_box_fills_the_cells_whose_centres_it_holds() {
        // 4 cells of side 1; the box reaches to x = 2.2, y = 1.6, z = 3.4, over the centres ½ … of 2, 2 and 3
        // cells.
        let mesh = cuboid([2.2, 1.6, 3.4]);
        let values = voxelize(&mesh, &Cube { origin: [0.0; 3], side: 4.0 }, 4);
        for i in 0..4 {
            for j in 0..4 {
                for k in 0..4 {
                    let expected = if i < 2 && j < 2 && k < 3 { 1.0 } else { 0.0 };
                    assert_eq!(values[(i * 4 + j) * 4 + k], expected, "cell ({i}, {j}, {k})");
                }
            }
        }
    }

    #[test]
    fn columns_along_edges_are_decided_by_other_rays() {
        // Cell centres on the diagonals of the box's top and bottom.
        let values = voxelize(&cuboid([1.0, 1.0, 1.0]), &Cube { origin: [-0.5; 3], side: 2.0 }, 8);
        assert_eq!(values.iter().sum::<f64>(), 64.0);
    }

    #[test]
    fn centres_on_the_surface_are_outside() {
        // Centres at 0, 1, 2, 3 and the box from 0 to 2: only the centre 1 is inside.
        let values = voxelize(&cuboid([2.0, 2.0, 2.0]), &Cube { origin: [-0.5; 3], side: 4.0 }, 4);
        assert_eq!(values.iter().sum::<f64>(), 1.0);
        assert_eq!(values[(4 + 1) * 4 + 1], 1.0);
    }

    #[test]
    #[should_panic(expected = "resolution 0")]
    fn a_grid_without_cells_is_refused() {
        voxelize(&Mesh::default(), &Cube { origin: [0.0; 3], side: 1.0 }, 0);
    }
}
