//! The bodies that laws are tried on, and poses that reach the corners.

use proptest::prelude::*;
use std::f64::consts::{PI, TAU};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use vitruvian_conformance::convert::body_to_reference;
use vitruvian_reference::body::{BodyModel, Skeleton, mannequin};
use vitruvian_reference::linalg::vector::{Vector3, norm, scale};

pub struct Named {
    pub name: String,
    pub body: BodyModel,
    pub skeleton: Skeleton,
}

/// The mannequin, and a real human body where one is at hand: `../shared/bodies/mh24.npz`, or VITRUVIAN_BODY.
///
/// The file is no part of this repository; where it is missing a word is said and the mannequin stands alone.
pub fn bodies() -> &'static [Named] {
    static BODIES: OnceLock<Vec<Named>> = OnceLock::new();
    BODIES.get_or_init(|| {
        let mut bodies = vec![("mannequin".to_owned(), mannequin())];
        let beside = Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/bodies/mh24.npz");
        let path = std::env::var_os("VITRUVIAN_BODY").map_or(beside, PathBuf::from);
        if path.is_file() {
            let arrays = vitruvian_runtime::file::body::read(&path).expect("a body model");
            let name = path.file_stem().map_or_else(String::new, |n| n.to_string_lossy().into_owned());
            bodies.push((name, body_to_reference(arrays)));
        } else {
            eprintln!(
                "laws tried on the mannequin alone: {} is missing; name a body in VITRUVIAN_BODY",
                path.display()
            );
        }
        let named = |(name, body): (_, BodyModel)| Named { name, skeleton: body.skeleton(), body };
        bodies.into_iter().map(named).collect()
    })
}

/// Axis–angle vectors at rest, so small that closed forms cancel, ordinary, near a half turn, and beyond a whole one.
pub fn turn() -> impl Strategy<Value = Vector3> {
    let angle = prop_oneof![
        1 => Just(0.0),
        1 => Just(1e-4),
        3 => 0.0..1.5f64,
        1 => PI - 1e-3..PI + 1e-3,
        1 => PI..TAU + 1.0,
    ];
    let axis = prop::array::uniform3(-1.0..1.0f64).prop_filter("an axis", |a| norm(*a) > 0.1);
    (axis, angle).prop_map(|(axis, angle)| scale(axis, angle / norm(axis)))
}

/// Poses of 24 joints.
pub fn pose() -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(turn(), 24).prop_map(|turns| turns.concat())
}

pub fn betas() -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(-2.5..2.5f64, 10)
}
