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

use proptest::prelude::*;
use rand::{Rng as _, SeedableRng as _};
use rand_chacha::ChaCha8Rng;
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

/// Random bodies of up to 40 vertices, 12 joints in a random tree and 4 betas, in up to 20 frames.
pub fn skinning() -> impl Strategy<Value = Skinning> {
    let sizes = (1..=40_usize, 1..=12_usize, 0..=4_usize, 1..=20_usize);
    (sizes, any::<u64>()).prop_map(|((v, j, b, frames), seed)| {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let body = random_body(v, j, b, &mut rng);
        let frames = (0..frames).map(|_| random_frame(&body, &mut rng)).collect();
        Skinning { body, frames }
    })
}

fn random_body(v: usize, j: usize, b: usize, rng: &mut ChaCha8Rng) -> BodyModel {
    let size = 10_f64.powi(rng.random_range(-1..=1));
    let center: Vector3 = std::array::from_fn(|_| rng.random_range(-3.0..3.0) * size);
    let mut numbers = |n: usize, scale: f64, kept: f64| -> Vec<f64> {
        let number = |rng: &mut ChaCha8Rng| {
            scale * rng.random_range(-1.0..1.0) * f64::from(u8::from(rng.random_bool(kept)))
        };
        (0..n).map(|_| number(rng)).collect()
    };
    let template = numbers(3 * v, size, 1.0);
    let shapedirs = numbers(3 * v * b, 0.1 * size, 1.0);
    let mut posedirs = numbers(3 * v * 9 * (j - 1), 0.1 * size, 0.9);
    // Whole joints without any effect on a vertex, as in bodies whose correctives are local.
    for block in posedirs.chunks_exact_mut(9) {
        if rng.random_bool(0.3) {
            block.fill(0.0);
        }
    }
    // Weights as in files: few of them, summing to 1 but for their rounding to f32.
    let rows = |count: usize, columns: usize, rounded: bool, rng: &mut ChaCha8Rng| -> Vec<f64> {
        let mut table = vec![0.0; count * columns];
        for row in table.chunks_exact_mut(columns) {
            for _ in 0..4 {
                row[rng.random_range(0..columns)] += rng.random_range(0.05..1.0);
            }
            let sum: f64 = row.iter().sum();
            let round = |x: f64| if rounded { f64::from(x as f32) } else { x };
            row.iter_mut().for_each(|w| *w = round(*w / sum));
        }
        table
    };
    BodyModel {
        v_template: template.chunks_exact(3).map(|x| add([x[0], x[1], x[2]], center)).collect(),
        faces: Vec::new(),
        shapedirs,
        posedirs,
        j_regressor: rows(j, v, false, rng),
        lbs_weights: rows(v, j, true, rng),
        parents: (0..j).map(|k| (k > 0).then(|| rng.random_range(0..k))).collect(),
    }
}

/// Rest, turns of 10⁻⁴, ordinary ones, a root near π, and many turns about; near and far; with offsets and without.
fn random_frame(body: &BodyModel, rng: &mut ChaCha8Rng) -> Parameters {
    let kind = rng.random_range(0..5);
    let size = [0.0, 1e-4, 1.0, 1.0, 1000.0][kind];
    let mut pose: Vec<f64> =
        (0..3 * body.joint_count()).map(|_| size * rng.random_range(-1.0..1.0)).collect();
    if kind == 3 {
        pose[..3].copy_from_slice(&[0.0, std::f64::consts::PI + rng.random_range(-1e-9..1e-9), 0.0]);
    }
    let far = [0.0, 1.0, 1e4][rng.random_range(0..3)];
    let betas = rng.random_range(0..=body.beta_count());
    let offsets = if rng.random_bool(0.3) { body.vertex_count() } else { 0 };
    Parameters {
        pose,
        betas: (0..betas).map(|_| rng.random_range(-3.0..3.0)).collect(),
        trans: std::array::from_fn(|_| far * rng.random_range(-1.0..1.0)),
        offsets: (0..offsets).map(|_| std::array::from_fn(|_| rng.random_range(-0.1..0.1))).collect(),
    }
}

/// The mannequin, or another body of human size, in frames that SMPL's users meet and in some that they should not.
pub fn human_frames(body: &BodyModel, count: usize) -> Vec<Parameters> {
    let mut rng = ChaCha8Rng::seed_from_u64(24);
    (0..count)
        .map(|_| random_frame(body, &mut rng))
        .map(|frame| Parameters { offsets: Vec::new(), ..frame })
        .collect()
}

/// A fault to plant in what the runtime is given.
#[derive(Clone, Copy)]
pub struct Fault {
    /// What is wrong.
    pub name: &'static str,
    /// Makes a healthy problem faulty.
    pub plant: fn(&mut Skinning),
}

/// Every fault that must be seen on the ground of [`ordinary`] problems.
pub const FAULTS: &[Fault] = &[
    Fault {
        name: "a joint with the wrong parent",
        plant: |problem| {
            let parents = &mut problem.body.parents;
            let child = parents.len() - 1;
            parents[child] = parents[child].map(|p| (p + 1) % child);
        },
    },
    Fault {
        name: "transposed rotations",
        plant: |problem| each(problem, |_, frame| frame.pose.iter_mut().for_each(|x| *x = -*x)),
    },
    Fault {
        name: "the next joint's rotation",
        plant: |problem| each(problem, |_, frame| frame.pose.rotate_left(3)),
    },
    Fault { name: "no pose blend shapes", plant: |problem| problem.body.posedirs.fill(0.0) },
    Fault {
        name: "the pose feature column by column",
        plant: |problem| {
            for block in problem.body.posedirs.chunks_exact_mut(9) {
                let by_rows: [f64; 9] = std::array::from_fn(|n| block[n]);
                (0..9).for_each(|n| block[n] = by_rows[3 * (n % 3) + n / 3]);
            }
        },
    },
    Fault {
        name: "the pose blend shapes of the joint before",
        plant: |problem| {
            let width = 9 * (problem.body.joint_count() - 1);
            problem.body.posedirs.chunks_exact_mut(width).for_each(|row| row.rotate_right(9));
        },
    },
    Fault { name: "swapped betas", plant: |problem| each(problem, |_, frame| frame.betas.swap(0, 1)) },
    Fault { name: "no betas", plant: |problem| each(problem, |_, frame| frame.betas.clear()) },
    Fault {
        name: "the betas of the first frame in all",
        plant: |problem| {
            let first = problem.frames[0].betas.clone();
            each(problem, |_, frame| frame.betas.clone_from(&first));
        },
    },
    Fault {
        name: "the weights of the next vertex",
        plant: |problem| {
            let joints = problem.body.joint_count();
            problem.body.lbs_weights.rotate_left(joints);
        },
    },
    Fault {
        name: "the root turned about the origin",
        plant: |problem| {
            each(problem, |body, frame| {
                let pelvis = body.rest_joints(&frame.betas)[0];
                let root = rodrigues([frame.pose[0], frame.pose[1], frame.pose[2]]);
                frame.trans = add(frame.trans, sub(apply(&root, pelvis), pelvis));
            });
        },
    },
    Fault { name: "no translation", plant: |problem| each(problem, |_, frame| frame.trans = [0.0; 3]) },
    Fault {
        name: "a translation rounded to f32, ten kilometres away",
        plant: |problem| each(problem, |_, frame| frame.trans = frame.trans.map(|x| f64::from(x as f32))),
    },
    Fault {
        name: "a small turn lost",
        plant: |problem| each(problem, |_, frame| frame.pose[..3].copy_from_slice(&[0.0; 3])),
    },
    Fault {
        name: "angles of 1000 rad rounded to f32",
        plant: |problem| {
            each(problem, |_, frame| {
                frame.pose.iter_mut().for_each(|x| *x = f64::from(*x as f32));
            });
        },
    },
    Fault { name: "no offsets", plant: |problem| each(problem, |_, frame| frame.offsets.clear()) },
];

fn each(problem: &mut Skinning, change: impl Fn(&BodyModel, &mut Parameters)) {
    let Skinning { body, frames } = problem;
    frames.iter_mut().for_each(|frame| change(body, frame));
}

/// Problems in which every part of the model matters, so that none of the [`FAULTS`] can hide: bodies of about a metre with 6
/// joints and 3 betas; a root turned by 10⁻³, the joints by 1000 rad; ten kilometres away; with offsets.
pub fn ordinary() -> impl Strategy<Value = Skinning> {
    any::<u64>().prop_map(|seed| {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut body = random_body(30, 6, 3, &mut rng);
        while body.v_template.as_flattened().iter().fold(0.0_f64, |a, x| a.max(x.abs())) > 6.0 {
            body = random_body(30, 6, 3, &mut rng);
        }
        let frames = (0..3).map(|_| {
            let mut pose: Vec<f64> = (0..18).map(|_| rng.random_range(0.3..1.5)).collect();
            pose[..3].copy_from_slice(&[1e-3, -1e-3, 1e-3]);
            pose[3..].iter_mut().skip(2).step_by(3).for_each(|z| *z += 1000.0);
            Parameters {
                pose,
                betas: (0..3).map(|l| f64::from(l) + rng.random_range(0.2..0.9)).collect(),
                trans: std::array::from_fn(|_| 1e4 * rng.random_range(0.5..1.0)),
                offsets: (0..30).map(|_| std::array::from_fn(|_| rng.random_range(0.01..0.1))).collect(),
            }
        });
        let frames = frames.collect();
        Skinning { body, frames }
    })
}
