//! Body models: an `.npz` with SMPL's arrays, for any number of vertices V, joints J and betas B.
//!
//! | key | shape | meaning |
//! |---|---|---|
//! | v_template | \[V,3\] | rest vertices in metres |
//! | f | \[F,3\] | triangles |
//! | shapedirs | \[V,3,B\] | displacement per unit of each beta |
//! | posedirs | \[V,3,9(J−1)\] | displacement per unit of the pose feature vec(R_j − I) |
//! | J_regressor | \[J,V\] | rest joints from rest vertices |
//! | weights | \[V,J\] | linear blend skinning weights |
//! | kintree_table | \[2,J\] | parents and joint numbers |

use std::path::Path;

use super::npz::Npz;
use crate::error::{Error, Result};

/// How far a row of skinning weights may sum from 1: converted models round to three or four digits.
const WEIGHT_TOLERANCE: f64 = 1e-3;

/// SMPL's arrays, checked.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyArrays {
    /// V rest vertices in metres.
    pub v_template: Vec<[f64; 3]>,
    /// F triangles, every index < V.
    pub faces: Vec<[u32; 3]>,
    /// \[V,3,B\], row-major.
    pub shapedirs: Vec<f64>,
    /// \[V,3,9(J−1)\], row-major.
    pub posedirs: Vec<f64>,
    /// \[J,V\], row-major.
    pub j_regressor: Vec<f64>,
    /// \[V,J\], row-major; rows sum to 1.
    pub lbs_weights: Vec<f64>,
    /// J parents, each before its child; `None` for the root, which comes first.
    pub parents: Vec<Option<usize>>,
}

impl BodyArrays {
    /// V.
    pub fn vertex_count(&self) -> usize {
        self.v_template.len()
    }

    /// J.
    pub fn joint_count(&self) -> usize {
        self.parents.len()
    }

    /// B.
    pub fn beta_count(&self) -> usize {
        self.shapedirs.len() / (3 * self.v_template.len())
    }
}

/// Reads and checks a body model.
///
/// # Errors
/// The file cannot be read, lacks an array, or an array has another shape, a number that is not finite, a face
/// beyond the vertices, a parent after its child or a row of weights that does not sum to 1; the array is named.
pub fn read(path: &Path) -> Result<BodyArrays> {
    let mut npz = Npz::open(path)?;
    let fail = |name: &str, message: String| Error::file(path, format!("array \"{name}\" {message}"));
    let mut array = |name: &str, shape: &[Option<usize>]| -> Result<(Vec<usize>, Vec<f64>)> {
        let array = npz.shaped::<f64>(name, shape)?;
        if let Some(i) = array.values.iter().position(|x| !x.is_finite()) {
            return Err(fail(
                name,
                format!("holds {} (element {i}); every number must be finite", array.values[i]),
            ));
        }
        Ok((array.shape, array.values))
    };
    let (shape, template) = array("v_template", &[None, Some(3)])?;
    let v = shape[0];
    let (shape, tree) = array("kintree_table", &[Some(2), None])?;
    let j = shape[1];
    if v == 0 || j == 0 {
        return Err(fail(
            "v_template",
            format!("has {v} vertices and kintree_table {j} joints; both must be there"),
        ));
    }
    let parents = parents(&tree[..j], &tree[j..]).map_err(|m| fail("kintree_table", m))?;
    let (_, faces) = array("f", &[None, Some(3)])?;
    let faces = faces
        .chunks_exact(3)
        .enumerate()
        .map(|(i, f)| {
            let index = |x: f64| (x >= 0.0 && x < v as f64 && x.fract() == 0.0).then_some(x as u32);
            match [index(f[0]), index(f[1]), index(f[2])] {
                [Some(a), Some(b), Some(c)] => Ok([a, b, c]),
                _ => Err(fail(
                    "f",
                    format!("names the vertices {f:?} in face {i}; expected numbers from 0 to {}", v - 1),
                )),
            }
        })
        .collect::<Result<_>>()?;
    let (_, shapedirs) = array("shapedirs", &[Some(v), Some(3), None])?;
    let (_, posedirs) = array("posedirs", &[Some(v), Some(3), Some(9 * (j - 1))])?;
    let (_, j_regressor) = array("J_regressor", &[Some(j), Some(v)])?;
    let (_, lbs_weights) = array("weights", &[Some(v), Some(j)])?;
    for (i, row) in lbs_weights.chunks_exact(j).enumerate() {
        let sum: f64 = row.iter().sum();
        if (sum - 1.0).abs() > WEIGHT_TOLERANCE {
            return Err(fail(
                "weights",
                format!("has a row (vertex {i}) that sums to {sum}; every row must sum to 1"),
            ));
        }
    }
    let v_template = template.chunks_exact(3).map(|p| [p[0], p[1], p[2]]).collect();
    Ok(BodyArrays { v_template, faces, shapedirs, posedirs, j_regressor, lbs_weights, parents })
}

/// SMPL writes the root's parent as 2³² − 1, others as −1; both are "no joint".
fn parents(of: &[f64], numbers: &[f64]) -> std::result::Result<Vec<Option<usize>>, String> {
    if let Some(k) = numbers.iter().enumerate().position(|(i, &n)| n != i as f64) {
        return Err(format!(
            "numbers its joint {k} as {}; expected 0, 1, 2, … in the second row",
            numbers[k]
        ));
    }
    let root = |p: f64| p < 0.0 || p == f64::from(u32::MAX);
    of.iter()
        .enumerate()
        .map(|(i, &p)| match i {
            0 if root(p) => Ok(None),
            0 => Err(format!(
                "gives its first joint the parent {p}; the root must come first, with parent −1 or 4294967295"
            )),
            _ if p >= 0.0 && p < i as f64 && p.fract() == 0.0 => Ok(Some(p as usize)),
            _ => Err(format!("gives joint {i} the parent {p}; parents must come before their children")),
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::file::npy::Values;
    use crate::file::npz::{Named, write};
    use proptest::prelude::*;

    /// A body of 4 vertices, 2 joints and 1 beta, with one value of one array replaced.
    fn fault(name: &str, at: usize, value: f64) -> std::result::Result<BodyArrays, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("body.npz");
        let arrays: [(&str, &[usize], Vec<f64>); 7] = [
            ("v_template", &[4, 3], (0..12).map(f64::from).collect()),
            ("f", &[2, 3], vec![0.0, 1.0, 2.0, 0.0, 2.0, 3.0]),
            ("shapedirs", &[4, 3, 1], vec![0.5; 12]),
            ("posedirs", &[4, 3, 9], vec![0.25; 108]),
            ("J_regressor", &[2, 4], vec![0.25; 8]),
            ("weights", &[4, 2], vec![0.5; 8]),
            ("kintree_table", &[2, 2], vec![4294967295.0, 0.0, 0.0, 1.0]),
        ];
        let values: Vec<Vec<f64>> = arrays
            .iter()
            .map(|(n, _, v)| {
                let mut v = v.clone();
                if *n == name {
                    v[at] = value;
                }
                v
            })
            .collect();
        let named: Vec<Named<'_>> = arrays
            .iter()
            .zip(&values)
            .filter(|((n, _, _), _)| name.strip_prefix('-') != Some(n))
            .map(|((n, shape, _), v)| Named { name: n, shape, values: Values::F64(v) })
            .collect();
        write(&path, &named).unwrap();
        read(&path).map_err(|e| e.to_string())
    }

    #[test]
    fn a_small_body_is_read_with_its_counts() {
        let body = fault("", 0, 0.0).unwrap();
        assert_eq!((body.vertex_count(), body.joint_count(), body.beta_count()), (4, 2, 1));
        assert_eq!(body.parents, [None, Some(0)]);
        assert_eq!(body.faces, [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(body.v_template[1], [3.0, 4.0, 5.0]);
        assert!(fault("kintree_table", 0, -1.0).is_ok(), "−1 is a root too");
    }

    #[test]
    fn every_fault_names_its_array() {
        let message = |name: &str, at, value| fault(name, at, value).unwrap_err();
        assert!(message("v_template", 5, f64::NAN).contains("\"v_template\" holds NaN (element 5)"));
        assert!(message("f", 4, 4.0).contains("\"f\" names the vertices [0.0, 4.0, 3.0] in face 1"));
        assert!(message("f", 4, 0.5).contains("\"f\""));
        assert!(message("weights", 6, 0.6).contains("row (vertex 3) that sums to 1.1"));
        assert!(message("kintree_table", 1, 1.0).contains("gives joint 1 the parent 1"));
        assert!(message("kintree_table", 0, 1.0).contains("the root must come first"));
        assert!(message("kintree_table", 3, 7.0).contains("numbers its joint 1 as 7"));
        assert!(message("-posedirs", 0, 0.0).contains("\"posedirs\" is missing"));
    }

    proptest! {
        #[test]
        fn arbitrary_values_never_panic(which in 0usize..7, at in 0usize..4, value in any::<f64>()) {
            let names = ["v_template", "f", "shapedirs", "posedirs", "J_regressor", "weights", "kintree_table"];
            let _ = fault(names[which], at, value);
        }
    }
}
