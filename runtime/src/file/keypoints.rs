//! OpenPose's keypoint JSON: one person's 2-D joints in pixels with confidences.
//!
//! `{"people":[{"pose_keypoints_2d":[x, y, confidence, …]}]}`; the number of joints tells the set, or the key
//! `"joint_set"` beside `"people"` names it (needed for SMPL's 24).

use std::path::Path;

use serde_json::{Value, json};

use super::{atomic, read_text};
use crate::error::{Error, Result};

/// A crowd in full detail fits; anything larger is no keypoint file.
const MAX_BYTES: u64 = 16 << 20;

/// Which joints a list of keypoints holds, and in which order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum JointSet {
    /// OpenPose's 25.
    Body25,
    /// OpenPose's COCO model with the neck: 18.
    Coco18,
    /// COCO's own 17.
    Coco17,
    /// The 24 joints of SMPL's tree.
    Smpl24,
}

impl JointSet {
    /// The number of joints.
    pub fn len(self) -> usize {
        match self {
            JointSet::Body25 => 25,
            JointSet::Coco18 => 18,
            JointSet::Coco17 => 17,
            JointSet::Smpl24 => 24,
        }
    }

    /// Never: every set has joints.
    pub fn is_empty(self) -> bool {
        false
    }

    /// The name used in files.
    pub fn name(self) -> &'static str {
        match self {
            JointSet::Body25 => "body25",
            JointSet::Coco18 => "coco18",
            JointSet::Coco17 => "coco17",
            JointSet::Smpl24 => "smpl24",
        }
    }

    const ALL: [JointSet; 4] = [JointSet::Body25, JointSet::Coco18, JointSet::Coco17, JointSet::Smpl24];
}

/// The largest confidence that is read. Detectors give 0 to 1, or the height of a peak that is not normalized, some tens.
pub const MOST_CONFIDENCE: f64 = 1e3;

/// The 2-D joints of one person.
#[derive(Clone, Debug, PartialEq)]
pub struct Keypoints {
    /// Which joints, in which order.
    pub joint_set: JointSet,
    /// (u, v, confidence) for each joint of the set: pixels from the image's top-left corner, confidence from 0 to
    /// [`MOST_CONFIDENCE`], zero for a joint that was not found.
    pub points: Vec<[f64; 3]>,
}

/// Reads the person of `path`; `None` if nobody was detected (an empty "people").
///
/// Of several people the one with the largest sum of confidences is taken.
///
/// # Errors
/// The file cannot be read or is no keypoint JSON, or its number of joints fits no known set.
pub fn read(path: &Path) -> Result<Option<Keypoints>> {
    parse(&read_text(path, MAX_BYTES)?).map_err(|message| Error::file(path, message))
}

/// As [`read`], from text.
///
/// # Errors
/// One sentence with what was found and what was expected.
pub fn parse(text: &str) -> std::result::Result<Option<Keypoints>, String> {
    let root: Value = serde_json::from_str(text).map_err(|e| format!("not valid JSON: {e}"))?;
    let declared = match root.get("joint_set") {
        None => None,
        Some(value) => {
            let known = value.as_str().and_then(|s| JointSet::ALL.into_iter().find(|set| set.name() == s));
            Some(known.ok_or_else(|| {
                format!("its \"joint_set\" is {value}; expected one of \"body25\", \"coco18\", \"coco17\", \"smpl24\"")
            })?)
        }
    };
    let people = root.get("people").and_then(Value::as_array).ok_or(
        "holds no list \"people\"; expected {\"people\": [{\"pose_keypoints_2d\": [x, y, confidence, …]}]}",
    )?;
    let mut best: Option<(f64, Keypoints)> = None;
    for (i, person) in people.iter().enumerate() {
        let keypoints = read_person(person, declared).map_err(|message| format!("people[{i}]: {message}"))?;
        let sum = keypoints.points.iter().map(|p| p[2]).sum();
        if best.as_ref().is_none_or(|(most, _)| sum > *most) {
            best = Some((sum, keypoints));
        }
    }
    Ok(best.map(|(_, keypoints)| keypoints))
}

fn read_person(person: &Value, declared: Option<JointSet>) -> std::result::Result<Keypoints, String> {
    let list = person
        .get("pose_keypoints_2d")
        .and_then(Value::as_array)
        .ok_or("has no list \"pose_keypoints_2d\" of x, y, confidence")?;
    let count = list.len() / 3;
    let joint_set = match declared {
        Some(set) => set,
        None => [JointSet::Body25, JointSet::Coco18, JointSet::Coco17]
            .into_iter()
            .find(|set| list.len() == 3 * set.len())
            .ok_or_else(|| {
                format!(
                    "has {} numbers; expected 3 for each of 25, 18 or 17 joints, or a \"joint_set\" that names the set",
                    list.len()
                )
            })?,
    };
    if list.len() != 3 * joint_set.len() {
        return Err(format!(
            "has {} numbers; the joint set {} has {} joints of 3",
            list.len(),
            joint_set.name(),
            joint_set.len()
        ));
    }
    let mut points = Vec::with_capacity(count);
    for (j, triple) in list.chunks_exact(3).enumerate() {
        let wrong = || {
            format!(
                "joint {j} is {triple:?}; expected three finite numbers, the last from 0 to {MOST_CONFIDENCE}"
            )
        };
        let mut point = [0.0; 3];
        for (p, x) in point.iter_mut().zip(triple) {
            *p = x.as_f64().filter(|x| x.is_finite()).ok_or_else(wrong)?;
        }
        if !(0.0..=MOST_CONFIDENCE).contains(&point[2]) {
            return Err(wrong());
        }
        points.push(point);
    }
    Ok(Keypoints { joint_set, points })
}

/// Writes one person atomically, with the name of the joint set.
///
/// # Errors
/// As [`atomic::write`].
pub fn write(path: &Path, keypoints: &Keypoints) -> Result<()> {
    let flat: Vec<f64> = keypoints.points.iter().flatten().copied().collect();
    let root = json!({
        "version": 1.3,
        "joint_set": keypoints.joint_set.name(),
        "people": [{ "pose_keypoints_2d": flat }],
    });
    atomic::write(path, format!("{root}\n").as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn sample(joint_set: JointSet) -> Keypoints {
        let points = (0..joint_set.len()).map(|j| [j as f64 / 3.0, 100.0 - j as f64, 0.5]).collect();
        Keypoints { joint_set, points }
    }

    #[test]
    fn writing_then_reading_returns_the_same_bits_for_every_set() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("k.json");
        for set in JointSet::ALL {
            write(&path, &sample(set)).unwrap();
            assert_eq!(read(&path).unwrap(), Some(sample(set)));
        }
    }

    #[test]
    fn the_most_confident_person_is_taken_and_nobody_is_none() {
        let person = |c: f64| json!({ "pose_keypoints_2d": vec![c; 75] });
        let text = json!({ "people": [person(0.2), person(0.9), person(0.4)] }).to_string();
        let found = parse(&text).unwrap().unwrap();
        assert_eq!((found.joint_set, found.points[0][2]), (JointSet::Body25, 0.9));
        assert_eq!(parse("{\"people\": []}"), Ok(None));
    }

    #[test]
    fn a_count_that_fits_no_set_is_refused_with_the_count() {
        let text = json!({ "people": [{ "pose_keypoints_2d": vec![1.0; 72] }] }).to_string();
        assert!(parse(&text).unwrap_err().contains("has 72 numbers"));
        let text =
            json!({ "joint_set": "smpl24", "people": [{ "pose_keypoints_2d": vec![1.0; 75] }] }).to_string();
        assert!(parse(&text).unwrap_err().contains("smpl24 has 24 joints"));
        assert!(parse("{\"joint_set\": \"h36m\", \"people\": []}").unwrap_err().contains("h36m"));
    }

    #[test]
    fn a_confidence_below_zero_or_beyond_a_thousand_is_refused_with_the_joint() {
        let with = |confidence: f64| {
            let mut list = vec![1.0; 75];
            list[5] = confidence;
            parse(&json!({ "people": [{ "pose_keypoints_2d": list }] }).to_string())
        };
        for confidence in [-1.0, 1000.1, 1e200] {
            let refusal = with(confidence).unwrap_err();
            assert!(refusal.contains("joint 1") && refusal.contains("from 0 to 1000"), "{refusal}");
        }
        assert_eq!(with(1000.0).unwrap().unwrap().points[1][2], 1000.0);
    }

    proptest! {
        #[test]
        fn arbitrary_text_never_panics(text in ".{0,200}") {
            let _ = parse(&text);
        }
    }
}
