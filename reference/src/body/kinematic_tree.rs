//! Rigid transforms along the tree of joints.

use crate::linalg::matrix::{Matrix3, apply, mul};
use crate::linalg::vector::{Vector3, add, sub};

/// A rigid transform x ↦ R x + t.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Rigid {
    /// R.
    pub rotation: Matrix3,
    /// t, metres.
    pub translation: Vector3,
}

impl Rigid {
    /// R x + t.
    pub fn apply(&self, x: Vector3) -> Vector3 {
        add(apply(&self.rotation, x), self.translation)
    }

    /// The transform that first applies `inner`, then `self`.
    pub fn after(&self, inner: &Rigid) -> Rigid {
        Rigid { rotation: mul(&self.rotation, &inner.rotation), translation: self.apply(inner.translation) }
    }
}

/// The global transform G_j of every joint: G_j = G_parent(j) · \[R_j | J_j − J_parent(j)\], and G_0 = \[R_0 | J_0\].
///
/// `rotations` and `rest_joints` have J entries. The translation of G_j is the posed joint.
///
/// # Panics
/// If the three lengths differ, or a parent does not come before its child.
pub fn global_transforms(
    rotations: &[Matrix3],
    rest_joints: &[Vector3],
    parents: &[Option<usize>],
) -> Vec<Rigid> {
    assert!(
        rotations.len() == parents.len() && rest_joints.len() == parents.len(),
        "global_transforms: {} rotations, {} joints, {} parents",
        rotations.len(),
        rest_joints.len(),
        parents.len()
    );
    let mut global: Vec<Rigid> = Vec::with_capacity(parents.len());
    for (j, parent) in parents.iter().enumerate() {
        let transform = match *parent {
            None => Rigid { rotation: rotations[j], translation: rest_joints[j] },
            Some(p) => {
                assert!(
                    p < j,
                    "global_transforms: joint {j} has parent {p}; parents come before their children"
                );
                let bone = sub(rest_joints[j], rest_joints[p]);
                global[p].after(&Rigid { rotation: rotations[j], translation: bone })
            }
        };
        global.push(transform);
    }
    global
}

/// A_j = G_j · T(−J_j): what joint j does to a point of the *rest* mesh.
///
/// The rotation is kept, the translation becomes t_j − R_j J_j, so that the identity pose gives the identity.
///
/// # Panics
/// If the lengths differ.
pub fn relative_transforms(global: &[Rigid], rest_joints: &[Vector3]) -> Vec<Rigid> {
    assert!(
        global.len() == rest_joints.len(),
        "relative_transforms: {} transforms, {} joints",
        global.len(),
        rest_joints.len()
    );
    let relative = |(g, &joint): (&Rigid, &Vector3)| Rigid {
        rotation: g.rotation,
        translation: sub(g.translation, apply(&g.rotation, joint)),
    };
    global.iter().zip(rest_joints).map(relative).collect()
}

/// Whether `joint` is `ancestor` or hangs below it.
pub fn is_in_subtree(joint: usize, ancestor: usize, parents: &[Option<usize>]) -> bool {
    let mut at = Some(joint);
    while let Some(j) = at {
        if j == ancestor {
            return true;
        }
        at = parents[j];
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::matrix::IDENTITY;
    use crate::linalg::vector::distance;
    use crate::rotation::rodrigues;
    use std::f64::consts::FRAC_PI_2;

    const CHAIN: [Option<usize>; 3] = [None, Some(0), Some(1)];
    const REST: [Vector3; 3] = [[0.0, 1.0, 0.0], [1.0, 1.0, 0.0], [2.0, 1.0, 0.0]];

    #[test]
    fn two_quarter_turns_fold_the_chain_back() {
        let turn = rodrigues([0.0, 0.0, FRAC_PI_2]);
        let global = global_transforms(&[turn, turn, IDENTITY], &REST, &CHAIN);
        // The root turns about its own joint: it stays, the next goes up, the last comes back over it.
        for (g, expected) in global.iter().zip([[0.0, 1.0, 0.0], [0.0, 2.0, 0.0], [-1.0, 2.0, 0.0]]) {
            assert!(distance(g.translation, expected) < 1e-15, "{:?}", g.translation);
        }
    }

    #[test]
    fn relative_transform_takes_rest_joint_to_posed_joint() {
        let rotations: Vec<_> = (0..3).map(|j| rodrigues([0.2, -0.5, 0.3 * f64::from(j)])).collect();
        let global = global_transforms(&rotations, &REST, &CHAIN);
        for ((a, g), joint) in relative_transforms(&global, &REST).iter().zip(&global).zip(REST) {
            assert!(distance(a.apply(joint), g.translation) < 1e-15);
        }
    }

    #[test]
    fn subtree_follows_parents() {
        assert!(is_in_subtree(2, 0, &CHAIN));
        assert!(is_in_subtree(1, 1, &CHAIN));
        assert!(!is_in_subtree(0, 1, &CHAIN));
    }
}
