//! The judge of skinning is judged: faults planted in what the runtime is given must be seen.

use vitruvian_reference::body::BodyModel;
use vitruvian_reference::linalg::matrix::apply;
use vitruvian_reference::linalg::vector::{add, sub};
use vitruvian_reference::rotation::rodrigues;

use super::{Parameters, Skinning};

/// A fault to plant in what the runtime is given.
#[derive(Clone, Copy)]
pub struct Fault {
    /// What is wrong.
    pub name: &'static str,
    /// Makes a healthy problem faulty.
    pub plant: fn(&mut Skinning),
}

/// Every fault that must be seen on the ground of [`ordinary`](super::problems::ordinary) problems.
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
