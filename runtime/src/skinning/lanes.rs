//! Eight frames in the lanes of a vector: correctives, blending, and back to f64.

use super::skeleton::Skeleton;
use super::{Frame, Person, Skinner};
use crate::rotation::rotation_minus_identity;

/// Frames that are skinned together: one AVX register, or two of SSE, for each number of a vertex.
pub const LANES: usize = 8;

type Lanes = [f32; LANES];

/// Up to [`LANES`] frames; lanes without a frame stay zero.
pub struct Block<'a> {
    /// For every joint but the root, the nine numbers of R − I.
    features: Vec<[Lanes; 9]>,
    /// For every joint, the twelve numbers of \[R | t\] relative to the pelvis.
    transforms: Vec<[Lanes; 12]>,
    people: Vec<&'a Person>,
    /// For every frame, where the pelvis ends up: the weights of a vertex say how much of it they carry.
    trans: Vec<[f64; 3]>,
    /// For every frame, the posed joints.
    pub joints: Vec<Vec<[f64; 3]>>,
}

impl<'a> Block<'a> {
    /// Turns the joints of every frame; `persons` says which of the `people` each frame poses.
    pub fn new(
        skeleton: &Skeleton,
        frames: &[Frame<'_>],
        persons: &[usize],
        people: &'a [Person],
    ) -> Block<'a> {
        let joint_count = skeleton.joint_count();
        let mut block = Block {
            features: vec![[[0.0; LANES]; 9]; joint_count - 1],
            transforms: vec![[[0.0; LANES]; 12]; joint_count],
            people: persons.iter().map(|&p| &people[p]).collect(),
            trans: frames.iter().map(|frame| frame.trans).collect(),
            joints: Vec::with_capacity(frames.len()),
        };
        for (lane, (frame, &person)) in frames.iter().zip(persons).enumerate() {
            let person = &people[person];
            let turns: Vec<_> =
                frame.pose.chunks_exact(3).map(|v| rotation_minus_identity([v[0], v[1], v[2]])).collect();
            for (feature, turn) in block.features.iter_mut().zip(&turns[1..]) {
                for (entry, &x) in feature.iter_mut().zip(turn.as_flattened()) {
                    entry[lane] = x as f32;
                }
            }
            let turned = skeleton.turn(&turns, &person.joints);
            for (transform, joint) in block.transforms.iter_mut().zip(&turned) {
                for axis in 0..3 {
                    for column in 0..3 {
                        transform[4 * axis + column][lane] = joint.rotation[axis][column] as f32;
                    }
                    transform[4 * axis + 3][lane] = joint.translation[axis] as f32;
                }
            }
            let place = |x: [f64; 3]| std::array::from_fn(|a| x[a] + person.pelvis[a] + frame.trans[a]);
            block.joints.push(turned.iter().map(|joint| place(joint.position)).collect());
        }
        block
    }

    /// Writes the vertices from `first` on; `out` has a slice for every frame, all of one length.
    pub fn skin(&self, body: &Skinner, first: usize, out: &mut [&mut [[f64; 3]]]) {
        for i in 0..out.first().map_or(0, |frame| frame.len()) {
            let vertex = first + i;
            let mut x = [[0.0; LANES]; 3];
            for (lane, person) in self.people.iter().enumerate() {
                for axis in 0..3 {
                    x[axis][lane] = person.vertices[vertex][axis];
                }
            }
            for (joint, directions) in body.correctives.row(vertex) {
                add_corrective(&mut x, directions, &self.features[*joint]);
            }
            let mut y = [[0.0; LANES]; 3];
            for (joint, weight) in body.weights.row(vertex) {
                add_weighted(&mut y, *weight, &self.transforms[*joint], &x);
            }
            let sum = body.weight_sums[vertex];
            for (lane, frame) in out.iter_mut().enumerate() {
                let (pelvis, trans) = (self.people[lane].pelvis, self.trans[lane]);
                // Σ w (A x + pelvis) + trans: weights that do not sum to 1 carry as much of the pelvis as of the rest.
                frame[i] = std::array::from_fn(|a| f64::from(y[a][lane]) + sum * pelvis[a] + trans[a]);
            }
        }
    }
}

/// x += Σ directions · (R − I), in every lane.
#[inline]
fn add_corrective(x: &mut [Lanes; 3], directions: &[f32; 27], feature: &[Lanes; 9]) {
    for (entry, direction) in feature.iter().zip(directions.chunks_exact(3)) {
        for axis in 0..3 {
            for lane in 0..LANES {
                x[axis][lane] += direction[axis] * entry[lane];
            }
        }
    }
}

/// y += weight · (R x + t), in every lane.
#[inline]
fn add_weighted(y: &mut [Lanes; 3], weight: f32, transform: &[Lanes; 12], x: &[Lanes; 3]) {
    for axis in 0..3 {
        let row = &transform[4 * axis..4 * axis + 4];
        for lane in 0..LANES {
            y[axis][lane] += weight
                * (row[0][lane] * x[0][lane]
                    + row[1][lane] * x[1][lane]
                    + row[2][lane] * x[2][lane]
                    + row[3][lane]);
        }
    }
}
