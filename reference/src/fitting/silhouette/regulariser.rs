//! What keeps offsets smooth and small: ω_L κ L D and ω_B κ D.
//!
//! L is the cotangent Laplacian of the body without offsets (eq. 3.9), κ_i a multiplier of vertex i. The code that Li 2021
//! follows multiplies both terms by 5 to 15 at face, hands and feet, from lists of SMPL's vertices. Those are the places where
//! the mesh is dense, and that is the reason: the Laplacian sees the *difference* of neighbouring offsets, so a millimetre
//! between vertices 4 mm apart costs what a millimetre between vertices 4 cm apart costs, and folds the surface. Hence
//!
//! κ_i = the mesh's mean edge length / the mean length of the edges at i, within 1 … [`LARGEST_MULTIPLIER`],
//!
//! which needs no list, and asks the same *strain* everywhere.

use super::shape_problem::Weights;
use crate::linalg::sparse::Sparse;
use crate::linalg::sparse_cholesky::SymbolicCholesky;
use crate::linalg::vector::{Vector3, distance};
use crate::surface::laplacian::cotangent_laplacian;
use std::cell::OnceCell;
use std::rc::Rc;
use std::sync::Arc;

/// The largest multiplier: the fingers' and toes' in Alldieck et al. 2018 are 8 and 15.
pub const LARGEST_MULTIPLIER: f64 = 15.0;

/// L and κ of a body.
#[derive(Clone, Debug)]
pub struct Regulariser {
    /// K L, V×V.
    laplacian: Rc<Sparse>,
    /// κ, V.
    multipliers: Rc<Vec<f64>>,
    /// How matrices of LᵀL's pattern are factored; the pattern is that of the triangles, the same in all stages.
    ordering: Rc<OnceCell<Arc<SymbolicCholesky>>>,
}

impl Regulariser {
    /// That of a surface: V×3 vertices, F×3 faces.
    ///
    /// # Panics
    /// If a face names a vertex that is not there.
    pub fn of(vertices: &[Vector3], faces: &[[u32; 3]]) -> Regulariser {
        let multipliers = multipliers(vertices, faces);
        let mut entries = cotangent_laplacian(vertices, faces);
        for (row, _, value) in &mut entries {
            *value *= multipliers[*row];
        }
        let laplacian = Sparse::from_triplets(vertices.len(), vertices.len(), &entries);
        Regulariser {
            laplacian: Rc::new(laplacian),
            multipliers: Rc::new(multipliers),
            ordering: Rc::default(),
        }
    }

    /// That of the same triangles with other vertices; the analysis of the pattern is kept.
    ///
    /// # Panics
    /// As [`Regulariser::of`].
    pub fn of_moved(&self, vertices: &[Vector3], faces: &[[u32; 3]]) -> Regulariser {
        Regulariser { ordering: Rc::clone(&self.ordering), ..Regulariser::of(vertices, faces) }
    }

    /// The analysis of the pattern of [`Regulariser::gram`] and a diagonal, made once.
    pub fn ordering(&self, matrix: &Sparse) -> &Arc<SymbolicCholesky> {
        self.ordering.get_or_init(|| SymbolicCholesky::analyze(matrix))
    }

    /// V.
    pub fn vertex_count(&self) -> usize {
        self.multipliers.len()
    }

    /// ω_L κ L D, then ω_B κ D: 6V numbers from 3V.
    pub fn apply(&self, weights: &Weights, offsets: &[f64]) -> Vec<f64> {
        let mut image = Vec::with_capacity(2 * offsets.len());
        for i in 0..self.vertex_count() {
            let mut sum = [0.0; 3];
            for (j, w) in self.laplacian.entries(i) {
                for axis in 0..3 {
                    sum[axis] += w * offsets[3 * j + axis];
                }
            }
            image.extend(sum.map(|s| weights.laplacian * s));
        }
        let kappa = |n: usize| weights.model * self.multipliers[n / 3];
        image.extend(offsets.iter().enumerate().map(|(n, d)| kappa(n) * d));
        image
    }

    /// The transposed map: 3V numbers from 6V.
    pub fn apply_transposed(&self, weights: &Weights, r: &[f64]) -> Vec<f64> {
        let (differences, sizes) = r.split_at(3 * self.vertex_count());
        let mut image: Vec<f64> =
            sizes.iter().enumerate().map(|(n, s)| weights.model * self.multipliers[n / 3] * s).collect();
        for i in 0..self.vertex_count() {
            let row = [0, 1, 2].map(|axis| weights.laplacian * differences[3 * i + axis]);
            for (j, w) in self.laplacian.entries(i) {
                for axis in 0..3 {
                    image[3 * j + axis] += w * row[axis];
                }
            }
        }
        image
    }

    /// ω_L² LᵀK²L + ω_B² K², V×V: the normal equations of each axis.
    pub fn gram(&self, weights: &Weights) -> Sparse {
        let square = |i: usize| (weights.model * self.multipliers[i]).powi(2);
        let entries: Vec<(usize, usize, f64)> = (0..self.vertex_count()).map(|i| (i, i, square(i))).collect();
        let sizes = Sparse::from_triplets(entries.len(), entries.len(), &entries);
        Sparse::combination(weights.laplacian * weights.laplacian, &self.laplacian.gram(), 1.0, &sizes)
    }
}

/// κ; 1 for a vertex without edges of any length.
fn multipliers(vertices: &[Vector3], faces: &[[u32; 3]]) -> Vec<f64> {
    let mut lengths = vec![(0.0, 0.0); vertices.len()];
    let (mut total, mut count) = (0.0, 0.0);
    for &[a, b, c] in faces {
        for (from, to) in [(a, b), (b, c), (c, a)].map(|(from, to)| (from as usize, to as usize)) {
            let length = distance(vertices[from], vertices[to]);
            for end in [from, to] {
                lengths[end].0 += length;
                lengths[end].1 += 1.0;
            }
            total += length;
            count += 1.0;
        }
    }
    let mean = total / count;
    lengths
        .into_iter()
        .map(|(sum, n)| if sum > 0.0 { (mean * n / sum).clamp(1.0, LARGEST_MULTIPLIER) } else { 1.0 })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::mesh::tests::cuboid;

    const WEIGHTS: Weights = Weights { laplacian: 6.5, model: 0.9, shape: 0.0, sigma_m: 1.0 };

    #[test]
    fn short_edges_are_stiffer() {
        // A long box: the four corners of its near end get a neighbour close by.
        let mut mesh = cuboid([1.0, 1.0, 4.0]);
        mesh.vertices.push([0.05, 0.05, 0.0]);
        mesh.faces.push([0, 8, 1]);
        let found = multipliers(&mesh.vertices, &mesh.faces);
        assert!(found[8] > 3.0 && found[..8].iter().all(|k| (1.0..1.5).contains(k)), "{found:?}");
    }

    #[test]
    fn transposed_and_gram_belong_to_the_map() {
        let mesh = cuboid([1.0, 2.0, 0.3]);
        let regulariser = Regulariser::of(&mesh.vertices, &mesh.faces);
        let x: Vec<f64> = (0..24).map(|n| (1.7 * f64::from(n)).sin()).collect();
        let y: Vec<f64> = (0..48).map(|n| (0.9 * f64::from(n)).cos()).collect();
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
        let image = regulariser.apply(&WEIGHTS, &x);
        let back = regulariser.apply_transposed(&WEIGHTS, &y);
        assert!((dot(&image, &y) - dot(&x, &back)).abs() < 1e-10);
        let gram = regulariser.gram(&WEIGHTS);
        let per_axis = |axis: usize| x.iter().skip(axis).step_by(3).copied().collect::<Vec<f64>>();
        let squared: f64 = (0..3).map(|axis| dot(&per_axis(axis), &gram.apply(&per_axis(axis)))).sum();
        assert!((squared - dot(&image, &image)).abs() < 1e-9 * squared);
    }
}
