//! Bodies: the runtime's skinning against the reference's [`BodyModel`].
//!
//! # Which difference can be rounding?
//! The runtime blends in f32, u = 2⁻²⁴, relative to the pelvis. For one coordinate let X = |x| + Σ|D||R − I| be the sum of the
//! absolute values that make the corrected rest vertex (n of them D·(R − I) with a factor that is not zero), and
//! Y = Σ|w|(|R| X + |t|) the sum of those that make the posed one (m weights that are not zero). Every number is rounded once on
//! the way into f32, every product and every sum once more. A corrective is an input, an input, a product and at most n + 1
//! sums; a blended term is an input, an input, two products and at most 3 + m sums. So the difference is at most
//! γ_{n+4+m+8}(u)·Y, whatever the order of the sums.
//!
//! What is f64 on both sides differs in the order of operations alone: at most V terms in a regressed joint, a chain of J bones, and
//! angles whose own rounding turns with them, Σ|θ| rad in all. γ_{V+64J+8Σ|θ|}(2⁻⁵³) of the sizes that enter (shaped mesh and
//! rest joints, J times along a chain; |trans| a few times) bounds it.

pub mod faults;
pub mod problems;

use vitruvian_reference::body::BodyModel;
use vitruvian_reference::body::blend_shapes::{pose_feature, shape_blend};
use vitruvian_reference::body::kinematic_tree::{global_transforms, relative_transforms};
use vitruvian_reference::linalg::matrix::{Matrix3, apply};
use vitruvian_reference::linalg::vector::{Vector3, add, sub};
use vitruvian_reference::nn::{UNIT_ROUNDOFF_F32, gamma};
use vitruvian_reference::rotation::rodrigues;
use vitruvian_runtime::skinning::{Frame, Skinner};

use crate::convert;

const UNIT_ROUNDOFF_F64: f64 = f64::EPSILON / 2.0;

/// The parameters of one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameters {
    /// 3J radians.
    pub pose: Vec<f64>,
    /// At most B.
    pub betas: Vec<f64>,
    /// Metres.
    pub trans: Vector3,
    /// V, or none.
    pub offsets: Vec<Vector3>,
}

impl Parameters {
    /// For the runtime.
    pub fn frame(&self) -> Frame<'_> {
        Frame { pose: &self.pose, betas: &self.betas, trans: self.trans, offsets: &self.offsets }
    }
}

/// A body and frames to pose it in.
#[derive(Clone, Debug)]
pub struct Skinning {
    /// The body.
    pub body: BodyModel,
    /// The frames.
    pub frames: Vec<Parameters>,
}

/// What a comparison found.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Agreement {
    /// Coordinates compared.
    pub coordinates: usize,
    /// The largest difference of a vertex in metres.
    pub worst_m: f64,
    /// The largest part of its bound that a difference took.
    pub worst_of_bound: f64,
}

impl Skinning {
    /// Poses every frame on both sides.
    ///
    /// # Errors
    /// The first difference that cannot be rounding.
    pub fn judge(&self) -> Result<Agreement, String> {
        self.judge_against(self)
    }

    /// As [`Skinning::judge`], with the runtime given the body and frames of `subject`, which may be faulty.
    ///
    /// # Errors
    /// The first difference that cannot be rounding.
    pub fn judge_against(&self, subject: &Skinning) -> Result<Agreement, String> {
        let skinner =
            Skinner::new(&convert::body_to_runtime(&subject.body)).map_err(|why| why.to_string())?;
        let frames: Vec<Frame<'_>> = subject.frames.iter().map(Parameters::frame).collect();
        let found = skinner.pose(&frames).map_err(|why| why.to_string())?;
        let mut agreement = Agreement::default();
        for (f, (parameters, found)) in self.frames.iter().zip(&found).enumerate() {
            let Parameters { pose, betas, trans, offsets } = parameters;
            let expected = self.body.pose_with_offsets(pose, betas, offsets, *trans);
            let bounds = Bounds::of(&self.body, parameters);
            let joints = found.joints.iter().zip(&expected.joints).map(|pair| (pair, [bounds.exact_part; 3]));
            let vertices = found.vertices.iter().zip(&expected.vertices).zip(bounds.vertices);
            for (i, ((found, expected), bound)) in joints.chain(vertices).enumerate() {
                for axis in 0..3 {
                    let error = (found[axis] - expected[axis]).abs();
                    if error.is_nan() || error > bound[axis] {
                        let what = match i.checked_sub(self.body.joint_count()) {
                            None => format!("joint {i}"),
                            Some(vertex) => format!("vertex {vertex}"),
                        };
                        return Err(format!(
                            "frame {f}: {what} is at {found:?}, expected {expected:?} ± {bound:?}"
                        ));
                    }
                    agreement.coordinates += 1;
                    if i >= self.body.joint_count() {
                        agreement.worst_m = agreement.worst_m.max(error);
                        agreement.worst_of_bound = agreement.worst_of_bound.max(error / bound[axis]);
                    }
                }
            }
        }
        Ok(agreement)
    }
}

/// How far the coordinates of a frame may be off by rounding.
struct Bounds {
    vertices: Vec<Vector3>,
    /// What f64 contributes; all that a joint may be off.
    exact_part: f64,
}

impl Bounds {
    fn of(body: &BodyModel, parameters: &Parameters) -> Bounds {
        let (v, j) = (body.vertex_count(), body.joint_count());
        let rest_joints = body.rest_joints(&parameters.betas);
        let pelvis = rest_joints[0];
        let mut shaped = shape_blend(&body.v_template, &body.shapedirs, &parameters.betas);
        for (x, offset) in shaped.iter_mut().zip(&parameters.offsets) {
            *x = add(*x, *offset);
        }
        let rotations: Vec<Matrix3> =
            parameters.pose.chunks_exact(3).map(|a| rodrigues([a[0], a[1], a[2]])).collect();
        let feature = pose_feature(&rotations);
        let relative =
            relative_transforms(&global_transforms(&rotations, &rest_joints, &body.parents), &rest_joints);

        let exact_part = {
            let absolute = |values: &[f64]| values.iter().map(|x| x.abs()).collect::<Vec<f64>>();
            let template: Vec<Vector3> = body.v_template.iter().map(|x| x.map(f64::abs)).collect();
            let sizes = shape_blend(&template, &absolute(&body.shapedirs), &absolute(&parameters.betas));
            let largest =
                |points: &[Vector3]| points.as_flattened().iter().fold(0.0_f64, |a, x| a.max(x.abs()));
            let rows = body.j_regressor.chunks_exact(v);
            let regressor = rows.fold(1.0_f64, |a, row| a.max(row.iter().map(|w| w.abs()).sum()));
            let size = (1.0 + regressor) * (largest(&sizes) + largest(&parameters.offsets));
            let trans = largest(&[parameters.trans]);
            let angles: f64 = parameters.pose.iter().map(|x| x.abs()).sum();
            gamma((v + 64 * j) as f64 + 8.0 * angles, UNIT_ROUNDOFF_F64) * 4.0 * j as f64 * size
                + gamma(8.0, UNIT_ROUNDOFF_F64) * trans
        };
        let p = feature.len();
        let vertices = (0..v).map(|i| {
            let x = sub(shaped[i], pelvis);
            let mut correctives = 0;
            let sizes: Vector3 = std::array::from_fn(|axis| {
                let row = &body.posedirs[(3 * i + axis) * p..(3 * i + axis + 1) * p];
                let products = row.iter().zip(&feature).map(|(d, r)| (d * r).abs());
                correctives = correctives.max(row.iter().filter(|d| **d != 0.0).count());
                x[axis].abs() + products.sum::<f64>()
            });
            let weights = &body.lbs_weights[i * j..(i + 1) * j];
            let mut size = [0.0; 3];
            let mut blended = 0;
            for (w, joint) in weights.iter().zip(&relative).filter(|(w, _)| **w != 0.0) {
                blended += 1;
                // The transform as the runtime has it: from the pelvis' frame to the pelvis' frame.
                let translation = sub(add(joint.translation, apply(&joint.rotation, pelvis)), pelvis);
                let absolute = joint.rotation.map(|row| row.map(f64::abs));
                let moved = add(apply(&absolute, sizes), translation.map(f64::abs));
                size = std::array::from_fn(|axis| size[axis] + w.abs() * moved[axis]);
            }
            let terms = (correctives + 4 + blended + 8) as f64;
            size.map(|size| gamma(terms, UNIT_ROUNDOFF_F32) * size + exact_part)
        });
        Bounds { vertices: vertices.collect(), exact_part }
    }
}
