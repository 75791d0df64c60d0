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
//!
//! SMPL, SMPL-H and SMPL-X alike: whatever else a file holds (texture coordinates, hand components, pickled
//! dictionaries) is left packed. The keys of SMPL's first release are understood too.

use std::path::Path;

use super::npz::Npz;
use crate::error::{Error, Result};

/// How far a row of skinning weights may sum from 1: converted models round to three or four digits.
const WEIGHT_TOLERANCE: f64 = 1e-3;

/// The keys of SMPL's first release, by those of today.
const OLD_KEYS: [(&str, &[&str]); 3] = [
    ("v_template", &["default_v", "template_v"]),
    ("posedirs", &["blendshapes"]),
    ("J_regressor", &["joint_regressor"]),
];

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
        let old = OLD_KEYS.iter().filter(|(key, _)| *key == name).flat_map(|(_, old)| old.iter().copied());
        let stored = [name].into_iter().chain(old).find(|key| npz.contains(key)).unwrap_or(name);
        let array = npz.shaped::<f64>(stored, shape)?;
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

/// SMPL writes the root's parent as 2³² − 1, others as −1 (2⁶⁴ − 1 where that is unsigned); all are "no joint".
fn parents(of: &[f64], numbers: &[f64]) -> std::result::Result<Vec<Option<usize>>, String> {
    if let Some(k) = numbers.iter().enumerate().position(|(i, &n)| n != i as f64) {
        return Err(format!(
            "numbers its joint {k} as {}; expected 0, 1, 2, … in the second row",
            numbers[k]
        ));
    }
    let root = |p: f64| p < 0.0 || p == f64::from(u32::MAX) || p == u64::MAX as f64;
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
    use crate::file::npy::{self, Values};
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

    /// An archive of raw `.npy` members, as other writers make them.
    fn archive(path: &Path, members: &[(&str, Vec<u8>)]) {
        let mut zip = zip::ZipWriter::new(std::fs::File::create(path).unwrap());
        for (name, bytes) in members {
            zip.start_file(format!("{name}.npy"), zip::write::SimpleFileOptions::default()).unwrap();
            std::io::Write::write_all(&mut zip, bytes).unwrap();
        }
        zip.finish().unwrap();
    }

    /// What numpy.save writes for a Python object: a header of type '|O', then a pickle.
    fn pickled() -> Vec<u8> {
        let text = String::from_utf8_lossy(&npy::encode(&[], Values::F64(&[0.0]))[10..]).replace("<f8", "|O");
        let header = text.split('\n').next().unwrap().to_owned() + " \n";
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend((header.len() as u16).to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(b"\x80\x03}q\x00X\x04\x00\x00\x00headq\x01K\x00s.");
        bytes
    }

    /// A body of 4 vertices, 2 joints and 3 betas as the keys `names` in single precision, with unsigned 64-bit numbers.
    fn members(names: [&'static str; 3]) -> Vec<(&'static str, Vec<u8>)> {
        let f32s =
            |shape: &[usize], x: f32| npy::encode(shape, Values::F32(&vec![x; shape.iter().product()]));
        let unsigned = |bytes: Vec<u8>| {
            let at = bytes.windows(3).position(|w| w == b"<i8").unwrap();
            let mut bytes = bytes;
            bytes[at..at + 3].copy_from_slice(b"<u8");
            bytes
        };
        vec![
            (names[0], f32s(&[4, 3], 0.25)),
            ("f", unsigned(npy::encode(&[1, 3], Values::I64(&[0, 1, 3])))),
            ("shapedirs", f32s(&[4, 3, 3], 0.5)),
            (names[1], f32s(&[4, 3, 9], 0.125)),
            (names[2], f32s(&[2, 4], 0.25)),
            ("weights", f32s(&[4, 2], 0.5)),
            ("kintree_table", unsigned(npy::encode(&[2, 2], Values::I64(&[-1, 0, 0, 1])))),
        ]
    }

    #[test]
    fn keys_of_the_first_release_and_numbers_of_other_types_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("body.npz");
        archive(&path, &members(["v_template", "posedirs", "J_regressor"]));
        let today = read(&path).unwrap();
        assert_eq!((today.vertex_count(), today.joint_count(), today.beta_count()), (4, 2, 3));
        assert_eq!((&today.parents[..], &today.faces[..]), (&[None, Some(0)][..], &[[0, 1, 3]][..]));
        for names in
            [["default_v", "blendshapes", "joint_regressor"], ["template_v", "posedirs", "J_regressor"]]
        {
            archive(&path, &members(names));
            assert_eq!(read(&path).unwrap(), today, "{names:?}");
        }
    }

    #[test]
    fn pickled_objects_that_nobody_asks_for_do_no_harm() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("body.npz");
        let needed = members(["v_template", "posedirs", "J_regressor"]);
        let mut all = vec![("part2num", pickled()), ("bs_type", b"no array at all".to_vec())];
        all.extend(needed.clone());
        all.push(("joint2num", pickled()));
        archive(&path, &all);
        assert!(read(&path).is_ok());
        // Asked for, they are refused by name.
        let wanted = all
            .into_iter()
            .map(|(name, bytes)| (name, if name == "J_regressor" { pickled() } else { bytes }));
        archive(&path, &wanted.collect::<Vec<_>>());
        let message = read(&path).unwrap_err().to_string();
        assert!(message.contains("\"J_regressor\"") && message.contains("pickled"), "{message}");
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
