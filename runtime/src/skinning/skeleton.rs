//! The joints, in f64: where they rest for a shape, how they turn, and what they do to the skin.

use crate::file::body::BodyArrays;
use crate::rotation::Matrix3;

/// The joints of a body without its skin.
pub struct Skeleton {
    /// J rest joints at β = 0.
    template: Vec<[f64; 3]>,
    /// \[J,3,B\]: how each beta moves them.
    shapedirs: Vec<f64>,
    parents: Vec<Option<usize>>,
}

/// What a joint does to a point of the rest mesh, x ↦ R x + t, and where it is itself.
#[derive(Clone, Copy)]
pub struct Turned {
    /// R, from the rest frame to the world.
    pub rotation: Matrix3,
    /// t.
    pub translation: [f64; 3],
    /// The posed joint.
    pub position: [f64; 3],
}

impl Skeleton {
    /// Takes the rest joints and their motion with the betas from the regressor, once.
    pub fn new(body: &BodyArrays) -> Skeleton {
        let (v, b) = (body.vertex_count(), body.beta_count());
        let mut template = Vec::with_capacity(body.joint_count());
        let mut shapedirs = vec![0.0; body.joint_count() * 3 * b];
        for (j, row) in body.j_regressor.chunks_exact(v).enumerate() {
            let mut joint = [0.0; 3];
            for (i, &w) in row.iter().enumerate().filter(|(_, w)| **w != 0.0) {
                for axis in 0..3 {
                    joint[axis] += w * body.v_template[i][axis];
                }
                let to = &mut shapedirs[j * 3 * b..(j + 1) * 3 * b];
                let from = &body.shapedirs[i * 3 * b..(i + 1) * 3 * b];
                to.iter_mut().zip(from).for_each(|(to, from)| *to += w * from);
            }
            template.push(joint);
        }
        Skeleton { template, shapedirs, parents: body.parents.clone() }
    }

    /// J.
    pub fn joint_count(&self) -> usize {
        self.parents.len()
    }

    /// The rest joints of a shape.
    pub fn rest_joints(&self, betas: &[f64]) -> Vec<[f64; 3]> {
        let mut joints = self.template.clone();
        if betas.is_empty() {
            return joints;
        }
        let b = self.shapedirs.len() / (3 * self.template.len());
        for (x, row) in joints.as_flattened_mut().iter_mut().zip(self.shapedirs.chunks_exact(b)) {
            *x += betas.iter().zip(row).map(|(beta, d)| beta * d).sum::<f64>();
        }
        joints
    }

    /// Every joint's transform; `turns` are the matrices R_j − I relative to the parents, `rest` the rest joints.
    pub fn turn(&self, turns: &[Matrix3], rest: &[[f64; 3]]) -> Vec<Turned> {
        let mut turned: Vec<Turned> = Vec::with_capacity(turns.len());
        for (j, parent) in self.parents.iter().enumerate() {
            let local: Matrix3 = std::array::from_fn(|r| {
                std::array::from_fn(|c| turns[j][r][c] + f64::from(u8::from(r == c)))
            });
            let (rotation, position) = match *parent {
                None => (local, rest[j]),
                Some(p) => {
                    let bone = std::array::from_fn(|axis| rest[j][axis] - rest[p][axis]);
                    let arm = apply(&turned[p].rotation, bone);
                    let position = std::array::from_fn(|axis| turned[p].position[axis] + arm[axis]);
                    (multiply(&turned[p].rotation, &local), position)
                }
            };
            let at_rest = apply(&rotation, rest[j]);
            let translation = std::array::from_fn(|axis| position[axis] - at_rest[axis]);
            turned.push(Turned { rotation, translation, position });
        }
        turned
    }
}

fn apply(m: &Matrix3, x: [f64; 3]) -> [f64; 3] {
    m.map(|row| row[0] * x[0] + row[1] * x[1] + row[2] * x[2])
}

fn multiply(a: &Matrix3, b: &Matrix3) -> Matrix3 {
    std::array::from_fn(|r| std::array::from_fn(|c| (0..3).map(|k| a[r][k] * b[k][c]).sum()))
}
