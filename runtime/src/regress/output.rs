//! The graph's three outputs as rotations, betas and cameras, or what is wrong with them and in which image.

use std::path::Path;

use ndarray::{ArrayView1, ArrayView2};

use super::{JOINTS, Regression};
use crate::contract::PoseForm;
use crate::error::{Error, Result};
use crate::rotation::{LARGEST_DEFECT, Matrix3, from_six_d, nearest, rodrigues};
use crate::session::Value;

/// Reads `pose`, `betas` and `camera` of the first images of a run, which have these names; the others were filled up.
pub fn read(
    path: &Path,
    form: PoseForm,
    betas: Option<usize>,
    values: &[Value],
    names: &[&str],
    count: usize,
) -> Result<Vec<Regression>> {
    let graph = Outputs { path, count };
    let [pose, shape, camera] = values else { return Ok(Vec::new()) };
    let pose = graph.rows("pose", pose, Some(JOINTS * form.width()))?;
    let shape = graph.rows("betas", shape, betas)?;
    let camera = graph.rows("camera", camera, Some(3))?;
    let rows = pose.outer_iter().zip(shape.outer_iter()).zip(camera.outer_iter());
    let read = |(((pose, shape), camera), name): (((ArrayView1<f64>, _), _), &&str)| {
        let fault = |output: &'static str| move |message| graph.fault(output, format!("{name}: {message}"));
        Ok(Regression {
            rotations: rotations(form, pose).map_err(fault("pose"))?,
            betas: finite(shape).map_err(fault("betas"))?,
            camera: weak_perspective(camera).map_err(fault("camera"))?,
        })
    };
    rows.zip(names).map(read).collect()
}

/// What is said of all outputs of a run.
#[derive(Clone, Copy)]
struct Outputs<'a> {
    path: &'a Path,
    /// N.
    count: usize,
}

impl Outputs<'_> {
    fn fault(&self, output: &str, message: String) -> Error {
        Error::Graph { path: self.path.to_path_buf(), item: format!("output \"{output}\""), message }
    }

    /// One row for each image; a graph may leave sides free and then answer with something else.
    fn rows(&self, output: &str, value: &Value, width: Option<usize>) -> Result<ndarray::Array2<f64>> {
        let array = value.f32()?;
        let shape = array.shape().to_vec();
        let found = shape.iter().skip(1).product();
        let rows = (shape.first() == Some(&self.count) && width.is_none_or(|width| width == found))
            .then(|| ArrayView2::from_shape((self.count, found), array.as_slice()?).ok())
            .flatten();
        rows.map(|rows| rows.mapv(f64::from)).ok_or_else(|| {
            let expected = width.map_or("any number of".to_string(), |width| width.to_string());
            self.fault(
                output,
                format!("it gave {shape:?} for {} images, expected {expected} numbers for each", self.count),
            )
        })
    }
}

type Reading<T> = std::result::Result<T, String>;

fn finite(row: ArrayView1<f64>) -> Reading<Vec<f64>> {
    match row.iter().position(|x| !x.is_finite()) {
        None => Ok(row.to_vec()),
        Some(i) => Err(format!("number {i} is {}, expected a finite one", row[i])),
    }
}

fn weak_perspective(row: ArrayView1<f64>) -> Reading<[f64; 3]> {
    let camera = finite(row)?;
    if camera[0] <= 0.0 {
        return Err(format!(
            "its scale is {}, expected a positive one: the network sees nobody in front of the camera; check the person's box",
            camera[0]
        ));
    }
    Ok([camera[0], camera[1], camera[2]])
}

fn rotations(form: PoseForm, row: ArrayView1<f64>) -> Reading<Vec<Matrix3>> {
    let numbers = finite(row)?;
    let joints = numbers.chunks_exact(form.width()).enumerate();
    joints.map(|(j, x)| rotation(form, x).ok_or_else(|| refusal(form, j, x))).collect()
}

fn rotation(form: PoseForm, x: &[f64]) -> Option<Matrix3> {
    match form {
        PoseForm::Matrices => nearest(&std::array::from_fn(|r| std::array::from_fn(|c| x[3 * r + c]))),
        PoseForm::SixD => from_six_d(std::array::from_fn(|i| x[i])),
        PoseForm::AxisAngle => Some(rodrigues([x[0], x[1], x[2]])),
    }
}

fn refusal(form: PoseForm, joint: usize, x: &[f64]) -> String {
    let why = match form {
        PoseForm::Matrices => format!(
            "no rotation matrix to within {LARGEST_DEFECT}: apply the head's own last step in the graph"
        ),
        _ => "two parallel columns, which mean no rotation".to_string(),
    };
    format!("joint {joint} is {x:?}, {why}")
}
