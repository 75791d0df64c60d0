//! Linear blend skinning of many frames at once.
//!
//! v_i = Σ_j w_ij A_j(θ, J(β)) \[t̄_i + B_S(β)_i + d_i + B_P(θ)_i\] + trans, as in Loper et al. 2015.
//!
//! # What is f64 and what is f32?
//! What there is once per person or per joint is f64: the shaped rest mesh, the rest joints, Rodrigues' formula (so that
//! a turn by 10⁻⁴ or by 1000 rad loses nothing) and the chain of joints. What there is per vertex and frame, nearly all of the
//! work, is f32: correctives and blending. It is done relative to the pelvis, where the numbers are no larger than the body;
//! pelvis and translation are added in f64, so that a body far from the origin is as exact as one at it.
//!
//! # How is it fast?
//! Weights and correctives keep their non-zeros alone. Eight frames go through a vertex at once, one in each SIMD lane; the
//! vertices are shared out over the processors in chunks whose correctives stay in the cache for all frames.

mod lanes;
mod rows;
mod skeleton;

use rayon::prelude::*;

use crate::error::{Error, Result};
use crate::file::body::BodyArrays;
use lanes::{Block, LANES};
use rows::Rows;
use skeleton::Skeleton;

/// Vertices that go together: their correctives (2.5 kB a vertex where they are dense) fit a second-level cache.
const CHUNK: usize = 128;

/// Larger numbers are refused, so that no sum can leave the range of f32.
const LARGEST: f64 = 1e30;

/// The parameters of one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Frame<'a> {
    /// 3J numbers: axis–angle vectors relative to the parent joint, radians.
    pub pose: &'a [f64],
    /// At most B numbers; the others are zero.
    pub betas: &'a [f64],
    /// Metres.
    pub trans: [f64; 3],
    /// V displacements of the shaped rest mesh in metres, which do not move the joints; or none.
    pub offsets: &'a [[f64; 3]],
}

/// A posed body, metres.
#[derive(Clone, Debug, PartialEq)]
pub struct Posed {
    /// V vertices.
    pub vertices: Vec<[f64; 3]>,
    /// J joints.
    pub joints: Vec<[f64; 3]>,
}

/// A body made ready for posing.
pub struct Skinner {
    v_template: Vec<[f64; 3]>,
    /// \[V,3,B\], row-major.
    shapedirs: Vec<f64>,
    skeleton: Skeleton,
    /// For each vertex the joints whose turning displaces it, and by how much: `[3 · entry of R − I + axis]`.
    correctives: Rows<[f32; 27]>,
    weights: Rows<f32>,
    /// The sum of every vertex' weights: 1 but for the rounding of the body's file.
    weight_sums: Vec<f64>,
}

/// A person at rest: shaped, seen from the pelvis.
struct Person {
    pelvis: [f64; 3],
    /// J, relative to the pelvis.
    joints: Vec<[f64; 3]>,
    /// V, relative to the pelvis.
    vertices: Vec<[f32; 3]>,
}

impl Skinner {
    /// Makes a body ready.
    ///
    /// # Errors
    /// An array does not fit the others, or holds a number beyond ±10³⁰ or none at all; [`read`](crate::file::body::read)
    /// returns no body of the first kind.
    pub fn new(body: &BodyArrays) -> Result<Skinner> {
        let (v, j) = (body.vertex_count(), body.joint_count());
        let expect = |name: &str, values: &[f64], wanted: usize| {
            if values.len() != wanted {
                let found = values.len();
                return Err(Error::Unanswerable(format!(
                    "the body's {name} has {found} numbers; {v} vertices and {j} joints ask for {wanted}"
                )));
            }
            match values.iter().find(|x| x.is_nan() || x.abs() > LARGEST) {
                Some(x) => Err(Error::Unanswerable(format!("the body's {name} holds {x}"))),
                None => Ok(()),
            }
        };
        if v == 0 || j == 0 {
            return Err(Error::Unanswerable(format!("the body has {v} vertices and {j} joints")));
        }
        let entries = 9 * (j - 1);
        expect("v_template", body.v_template.as_flattened(), 3 * v)?;
        expect("shapedirs", &body.shapedirs, 3 * v * body.beta_count())?;
        expect("posedirs", &body.posedirs, 3 * v * entries)?;
        expect("j_regressor", &body.j_regressor, j * v)?;
        expect("weights", &body.lbs_weights, v * j)?;
        for (child, parent) in body.parents.iter().enumerate() {
            let fits = if child == 0 { parent.is_none() } else { parent.is_some_and(|p| p < child) };
            if !fits {
                return Err(Error::Unanswerable(format!(
                    "the body's joint {child} has the parent {parent:?}; parents come before their children"
                )));
            }
        }
        let corrective = |vertex: usize, joint: usize| -> [f32; 27] {
            std::array::from_fn(|n| body.posedirs[(3 * vertex + n % 3) * entries + 9 * joint + n / 3] as f32)
        };
        let weight = |vertex: usize, joint: usize| body.lbs_weights[vertex * j + joint] as f32;
        Ok(Skinner {
            skeleton: Skeleton::new(body),
            correctives: Rows::new(v, j - 1, corrective, |d| d.iter().any(|&x| x != 0.0)),
            weights: Rows::new(v, j, weight, |&w| w != 0.0),
            weight_sums: body.lbs_weights.chunks_exact(j).map(|row| row.iter().sum()).collect(),
            v_template: body.v_template.clone(),
            shapedirs: body.shapedirs.clone(),
        })
    }

    /// V.
    pub fn vertex_count(&self) -> usize {
        self.v_template.len()
    }

    /// J.
    pub fn joint_count(&self) -> usize {
        self.skeleton.joint_count()
    }

    /// B.
    pub fn beta_count(&self) -> usize {
        self.shapedirs.len() / (3 * self.v_template.len())
    }

    /// Poses every frame. Frames after each other with the same betas and offsets are shaped once.
    ///
    /// Bodies of human size differ from f64 by less than 10⁻⁶ m (measured and derived in `vitruvian-conformance`, `suite::body`).
    ///
    /// # Errors
    /// A frame's numbers do not fit the body, are not finite, or give a rest mesh beyond ±10³⁰ m.
    pub fn pose(&self, frames: &[Frame<'_>]) -> Result<Vec<Posed>> {
        for (f, frame) in frames.iter().enumerate() {
            self.check(frame).map_err(|message| Error::Unanswerable(format!("frame {f}: {message}")))?;
        }
        let mut first_of: Vec<usize> = Vec::new();
        let mut person_of: Vec<usize> = Vec::with_capacity(frames.len());
        for (f, frame) in frames.iter().enumerate() {
            let same = |g: usize| frames[g].betas == frame.betas && frames[g].offsets == frame.offsets;
            if !first_of.last().is_some_and(|&g| same(g)) {
                first_of.push(f);
            }
            person_of.push(first_of.len() - 1);
        }
        let people: Vec<Person> =
            first_of.par_iter().map(|&f| self.shape(&frames[f])).collect::<Result<_>>()?;

        let blocks: Vec<Block<'_>> = frames
            .par_chunks(LANES)
            .zip(person_of.par_chunks(LANES))
            .map(|(frames, persons)| Block::new(&self.skeleton, frames, persons, &people))
            .collect();
        let mut posed: Vec<Posed> = frames
            .iter()
            .zip(blocks.iter().flat_map(|block| &block.joints))
            .map(|(_, joints)| Posed {
                vertices: vec![[0.0; 3]; self.vertex_count()],
                joints: joints.clone(),
            })
            .collect();
        // Every task has its chunk of the vertices in all frames.
        let mut chunks: Vec<Vec<&mut [[f64; 3]]>> = Vec::new();
        chunks.resize_with(self.vertex_count().div_ceil(CHUNK), || Vec::with_capacity(frames.len()));
        for frame in &mut posed {
            for (task, chunk) in chunks.iter_mut().zip(frame.vertices.chunks_mut(CHUNK)) {
                task.push(chunk);
            }
        }
        chunks.into_par_iter().enumerate().for_each(|(c, mut out)| {
            for (block, out) in blocks.iter().zip(out.chunks_mut(LANES)) {
                block.skin(self, c * CHUNK, out);
            }
        });
        Ok(posed)
    }

    fn check(&self, frame: &Frame<'_>) -> std::result::Result<(), String> {
        let (width, b, v) = (3 * self.joint_count(), self.beta_count(), self.vertex_count());
        if frame.pose.len() != width {
            return Err(format!("the pose has {} numbers; the body takes {width}", frame.pose.len()));
        }
        if frame.betas.len() > b {
            return Err(format!("there are {} betas; the body has {b}", frame.betas.len()));
        }
        if !frame.offsets.is_empty() && frame.offsets.len() != v {
            return Err(format!("there are {} offsets; the body has {v} vertices", frame.offsets.len()));
        }
        let mut numbers = frame.pose.iter().chain(frame.betas).chain(&frame.trans);
        if !numbers.all(|x| x.is_finite()) || !frame.offsets.as_flattened().iter().all(|x| x.is_finite()) {
            return Err("a number is not finite".into());
        }
        Ok(())
    }

    fn shape(&self, frame: &Frame<'_>) -> Result<Person> {
        let b = self.beta_count();
        let joints = self.skeleton.rest_joints(frame.betas);
        let pelvis = joints[0];
        let mut vertices = Vec::with_capacity(self.vertex_count());
        for (i, template) in self.v_template.iter().enumerate() {
            let mut x = *template;
            if !frame.betas.is_empty() {
                let rows = self.shapedirs[3 * i * b..3 * (i + 1) * b].chunks_exact(b);
                for (x, row) in x.iter_mut().zip(rows) {
                    *x += frame.betas.iter().zip(row).map(|(beta, d)| beta * d).sum::<f64>();
                }
            }
            if let Some(offset) = frame.offsets.get(i) {
                x = std::array::from_fn(|axis| x[axis] + offset[axis]);
            }
            let x: [f64; 3] = std::array::from_fn(|axis| x[axis] - pelvis[axis]);
            if !x.iter().all(|x| x.abs() <= LARGEST) {
                return Err(Error::Unanswerable(format!(
                    "these betas put vertex {i} at {x:?} m from the pelvis, beyond what f32 can hold"
                )));
            }
            vertices.push(x.map(|x| x as f32));
        }
        let relative = |joint: [f64; 3]| std::array::from_fn(|axis| joint[axis] - pelvis[axis]);
        Ok(Person { pelvis, joints: joints.into_iter().map(relative).collect(), vertices })
    }
}

#[cfg(test)]
mod tests;
