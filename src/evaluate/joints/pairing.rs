//! Which joints of two files are compared, and what they are relative to.

use vitruvian_reference::linalg::vector::Vector3;
use vitruvian_reference::metric::joint_set::{JointSet, Root};
use vitruvian_runtime::error::Error;

use super::arguments::{Choices, RootChoice, word};
use super::array::Sequence;
use crate::failure::{Failure, Result};

/// Fewer joints have no shape to align.
const LEAST_JOINTS: usize = 3;

/// The same joints of the same frames, twice.
pub struct Pair {
    /// As they stand: predicted and true.
    pub raw: [Vec<Vec<Vector3>>; 2],
    /// Seen from the root of each.
    pub relative: [Vec<Vec<Vector3>>; 2],
    /// In words.
    pub description: Description,
}

/// What was compared.
#[derive(Clone, Debug, PartialEq)]
pub struct Description {
    /// The joints' names.
    pub names: Vec<String>,
    /// The orders of the two sides, or of one number of joints.
    pub sets: String,
    /// What they are relative to.
    pub root: &'static str,
}

impl Pair {
    /// Finds the joints that both have.
    pub fn new(found: &Sequence, expected: &Sequence, choices: &Choices) -> Result<Pair> {
        let (f, tf) = (found.frames.len(), expected.frames.len());
        if f != tf {
            let message = format!("holds {f} frames, but {} holds {tf}", expected.path.display());
            return Err(Error::file(&found.path, message).into());
        }
        let (joints, names, sets) = match (found.set, expected.set) {
            (Some(a), Some(b)) => named(found, a, expected, b, choices.wanted)?,
            _ => unnamed(found, expected, choices.wanted)?,
        };
        let there: Vec<usize> = (0..joints.len())
            .filter(|&i| found.is_there[joints[i].0] && expected.is_there[joints[i].1])
            .collect();
        let left_out: Vec<&str> =
            (0..joints.len()).filter(|i| !there.contains(i)).map(|i| names[i].as_str()).collect();
        if !left_out.is_empty() {
            eprintln!("left out, without confidence in some frame: {}", left_out.join(", "));
        }
        if there.len() < LEAST_JOINTS {
            let message = format!(
                "has {} joints in common with {}; {LEAST_JOINTS} is the least",
                there.len(),
                expected.path.display()
            );
            return Err(Error::file(&found.path, message).into());
        }
        let (roots, root) = roots(found, expected, choices.root)?;
        let chosen = [0, 1].map(|side| -> Vec<usize> {
            there.iter().map(|&i| if side == 0 { joints[i].0 } else { joints[i].1 }).collect()
        });
        let seen = |side: usize, root: Root| -> Vec<Vec<Vector3>> {
            let frames = if side == 0 { &found.frames } else { &expected.frames };
            frames.iter().map(|joints| root.relative(joints, &chosen[side])).collect()
        };
        Ok(Pair {
            raw: [0, 1].map(|side| seen(side, Root::Origin)),
            relative: [0, 1].map(|side| seen(side, roots[side])),
            description: Description { names: there.iter().map(|&i| names[i].clone()).collect(), sets, root },
        })
    }
}

type Joints = (Vec<(usize, usize)>, Vec<String>, String);

fn named(
    found: &Sequence,
    a: JointSet,
    expected: &Sequence,
    b: JointSet,
    wanted: Option<JointSet>,
) -> Result<Joints> {
    let joints = match wanted {
        None => a.shared(b),
        Some(wanted) => {
            let of = |sequence: &Sequence, set: JointSet| {
                set.indices_of(wanted).ok_or_else(|| {
                    let message =
                        format!("holds the joints {}, which lack some of {}", word(set), word(wanted));
                    Failure::from(Error::file(&sequence.path, message))
                })
            };
            of(found, a)?.into_iter().zip(of(expected, b)?).collect()
        }
    };
    let names = joints.iter().map(|&(i, _)| a.joint_names()[i].to_owned()).collect();
    let sets = match wanted {
        Some(wanted) => word(wanted).to_owned(),
        None if a == b => word(a).to_owned(),
        None => format!("{} and {}", word(a), word(b)),
    };
    Ok((joints, names, sets))
}

/// Joints in an order that has no name: the same on both sides.
fn unnamed(found: &Sequence, expected: &Sequence, wanted: Option<JointSet>) -> Result<Joints> {
    let (j, tj) = (found.joint_count(), expected.joint_count());
    if j != tj {
        let message = format!(
            "holds {j} joints, but {} holds {tj}; --predicted-joints and --truth-joints name orders that are known",
            expected.path.display()
        );
        return Err(Error::file(&found.path, message).into());
    }
    if let Some(wanted) = wanted {
        let message =
            format!("holds {j} joints in no known order, so that {} cannot be chosen", word(wanted));
        return Err(Error::file(&found.path, message).into());
    }
    Ok(((0..j).map(|k| (k, k)).collect(), (0..j).map(|k| format!("joint {k}")).collect(), "the same".into()))
}

/// The root of each side, and what it is called.
fn roots(
    found: &Sequence,
    expected: &Sequence,
    choice: Option<RootChoice>,
) -> Result<([Root; 2], &'static str)> {
    let sides = [found, expected];
    let usable = |sequence: &Sequence, root: Option<Root>| {
        root.filter(|root| match *root {
            Root::Joint(j) => sequence.is_there[j],
            Root::Middle(a, b) => sequence.is_there[a] && sequence.is_there[b],
            Root::Origin => true,
        })
    };
    let pelvis =
        |sequence: &Sequence| usable(sequence, sequence.set.map_or(Some(Root::Joint(0)), JointSet::pelvis));
    let mid_hip = |sequence: &Sequence| usable(sequence, sequence.set.map(JointSet::mid_hip));
    let both = |of: &dyn Fn(&Sequence) -> Option<Root>| Some([of(sides[0])?, of(sides[1])?]);
    let is_smpl = |sequence: &Sequence| matches!(sequence.set, Some(JointSet::Smpl24 | JointSet::Smpl22));
    let words = if found.set.is_none() { "joint 0" } else { "the pelvis" };
    let with_pelvis = both(&pelvis).map(|roots| (roots, words));
    let with_hips = both(&mid_hip).map(|roots| (roots, "the middle of the hips"));
    let roots = match choice {
        Some(RootChoice::Origin) => Some(([Root::Origin; 2], "the origin of each file")),
        Some(RootChoice::Pelvis) => with_pelvis,
        Some(RootChoice::MidHip) => with_hips,
        // SMPL's pelvis lies above its hips, that of the others between theirs.
        None if is_smpl(found) != is_smpl(expected) => with_hips.or(with_pelvis),
        None => with_pelvis.or(with_hips),
    };
    roots.ok_or_else(|| {
        let wanted = if choice == Some(RootChoice::Pelvis) { "a pelvis" } else { "such a root" };
        let message = format!(
            "and {} do not both have {wanted}: give --root mid-hip or --root origin",
            expected.path.display()
        );
        Error::file(&found.path, message).into()
    })
}
