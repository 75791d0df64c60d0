//! Joints of a body put into the poses of a parameter file: those of its skeleton, or regressed from its skin.

use std::path::{Path, PathBuf};

use rayon::prelude::*;
use vitruvian_reference::body::BodyModel;
use vitruvian_reference::body::blend_shapes::regress_joints;
use vitruvian_reference::linalg::vector::{Vector3, add};
use vitruvian_runtime::error::Error;
use vitruvian_runtime::file::npy::{self, Array};
use vitruvian_runtime::file::npz::Npz;
use vitruvian_runtime::file::params::{self, Counts};

use super::array::Sequence;
use crate::failure::Result;

/// A matrix \[J, V\] from the vertices of a posed body to joints, as `J_regressor_h36m`.
pub struct Regressor {
    path: PathBuf,
    matrix: Array<f64>,
}

/// What a regressor may be called in an archive; the only array of an archive may have any name.
const NAMES: [&str; 3] = ["J_regressor_h36m", "J_regressor_extra", "J_regressor"];

/// Reads a regressor from a .npy, or from a .npz.
pub fn read_regressor(path: &Path) -> Result<Regressor> {
    let matrix = if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("npy")) {
        npy::read::<f64>(path)?
    } else {
        let mut npz = Npz::open(path)?;
        let names = npz.names();
        let only = (names.len() == 1).then(|| names[0].as_str());
        let name = NAMES.into_iter().find(|name| npz.contains(name)).or(only).unwrap_or(NAMES[0]);
        npz.array(name)?
    };
    if matrix.shape.len() != 2 || matrix.values.is_empty() || matrix.values.iter().any(|x| !x.is_finite()) {
        let message = format!(
            "holds an array of the shape {:?}; expected a regressor of finite numbers [joints, vertices]",
            matrix.shape
        );
        return Err(Error::file(path, message).into());
    }
    Ok(Regressor { path: path.to_owned(), matrix })
}

/// The joints of every frame of a parameter file.
pub fn read(path: &Path, body: &BodyModel, regressor: Option<&Regressor>) -> Result<Sequence> {
    let vertices = body.vertex_count();
    if let Some(Regressor { path, matrix }) = regressor
        && matrix.shape[1] != vertices
    {
        let message = format!(
            "is for a body of {} vertices, this one has {vertices}: give the body that it was made for with --body",
            matrix.shape[1]
        );
        return Err(Error::file(path, message).into());
    }
    let counts = Counts { vertices, joints: body.joint_count(), betas: body.beta_count() };
    let (parameters, left_away) = params::read_for_joints(path, &counts)?;
    for words in left_away {
        eprintln!("warning: {words}");
    }
    let skeleton = body.skeleton();
    let posed = |f: usize| -> Vec<Vector3> {
        let (pose, betas, trans) = (&parameters.poses[f], parameters.betas_of(f), parameters.trans[f]);
        match regressor {
            None => skeleton.posed_joints(pose, betas).into_iter().map(|joint| add(joint, trans)).collect(),
            Some(Regressor { matrix, .. }) => {
                let skin = body.pose_with_offsets(pose, betas, &parameters.offsets, trans).vertices;
                regress_joints(&matrix.values, &skin)
            }
        }
    };
    let frames = (0..parameters.frame_count()).into_par_iter().map(posed).collect();
    Ok(Sequence::new(path, frames))
}

#[cfg(test)]
mod tests {
    use super::*;
    use vitruvian_reference::body::mannequin;
    use vitruvian_reference::linalg::vector::distance;
    use vitruvian_runtime::file::npy::Values;
    use vitruvian_runtime::file::npz::{self, Named};

    #[test]
    fn a_regressor_of_vertices_is_applied_to_the_posed_skin() {
        let folder = tempfile::tempdir().expect("a temporary folder");
        let [regressor, parameters] = ["h36m.npy", "params.npz"].map(|name| folder.path().join(name));
        let body = mannequin();
        // Two "joints": a vertex, and the middle of two.
        let mut matrix = vec![0.0; 2 * body.vertex_count()];
        (matrix[7], matrix[body.vertex_count() + 1], matrix[body.vertex_count() + 2]) = (1.0, 0.5, 0.5);
        npy::write(&regressor, &[2, body.vertex_count()], Values::F64(&matrix)).expect("a writable folder");
        let pose: Vec<f64> = (0..72).map(|i| 0.3 * f64::from(i).sin()).collect();
        let array = |name, shape, values| Named { name, shape, values: Values::F64(values) };
        npz::write(&parameters, &[array("poses", &[72], &pose), array("trans", &[3], &[1.0, 2.0, 3.0])])
            .expect("a writable folder");
        let regressor = read_regressor(&regressor).expect("a regressor");
        let found = read(&parameters, &body, Some(&regressor)).expect("a frame");
        let skin = body.pose(&pose, &[], [1.0, 2.0, 3.0]).vertices;
        assert!(distance(found.frames[0][0], skin[7]) < 1e-12);
        let middle: Vector3 = std::array::from_fn(|a| 0.5 * (skin[1][a] + skin[2][a]));
        assert!(distance(found.frames[0][1], middle) < 1e-12);

        let other =
            Regressor { matrix: Array { shape: vec![1, 6890], values: vec![0.0; 6890] }, ..regressor };
        let refusal = read(&parameters, &body, Some(&other)).err().map(|failure| failure.to_string());
        assert!(refusal.is_some_and(|words| words.contains("h36m.npy: is for a body of 6890 vertices")));
    }
}
