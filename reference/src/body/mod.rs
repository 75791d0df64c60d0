//! The parametric body: a rest mesh that shape moves linearly and pose moves by a skeleton.
//!
//! The six steps of the model, one file each, in the order in which [`BodyModel::pose`] takes them:
//!
//! 1. [`blend_shapes`]: v_shaped = v_template + Σ_l β_l · shapedirs_l, and rest joints J = J_regressor · v_shaped;
//! 2. [`blend_shapes`]: v_posed = v_shaped + posedirs · vec(R(θ) − I);
//! 3. [`kinematic_tree`]: global transforms G_j along the tree, and A_j = G_j with the rest joint removed;
//! 4. [`skinning`]: v_i = Σ_j w_ij A_j v_posed,i + trans.
//!
//! [`skeleton`] is the same body without its mesh: joints alone, for fits that see nothing else. [`joint_derivative`] says
//! how the joints move with pose and shape, [`hinge`] which way elbows and knees bend.
//! [`posed_body`] asks single vertices instead of all: where they are, how they move ([`vertex_derivative`]), and what point
//! of the rest pose would be where a point of the world is ([`unposing`]).
//!
//! [`mannequin()`] is a complete model made by arithmetic alone.
//!
//! # References
//! Loper, Mahmood, Romero, Pons-Moll, Black 2015, "SMPL: A Skinned Multi-Person Linear Model"; Li 2021, ch. 2 §2.

pub mod blend_shapes;
pub mod hinge;
pub mod joint_derivative;
pub mod kinematic_tree;
pub mod mannequin;
pub mod model;
pub mod posed_body;
pub mod skeleton;
pub mod skinning;
pub mod unposing;
pub mod vertex_derivative;

pub use hinge::Hinge;
pub use joint_derivative::JointDerivatives;
pub use mannequin::mannequin;
pub use model::{BodyModel, Posed};
pub use posed_body::PosedBody;
pub use skeleton::Skeleton;
pub use vertex_derivative::VertexDerivatives;
