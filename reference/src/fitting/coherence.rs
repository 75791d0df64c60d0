//! Whether the errors of neighbouring marks are alike: what tells a wrong body from a noisy detector.
//!
//! A detector misses each joint on its own, so the errors that a right body leaves at an elbow and at its shoulder have
//! nothing to do with each other. A body that is wrong (other people in some views, wrong cameras, left and right exchanged)
//! is off by whole limbs: neighbours err alike. Their size alone does not tell the two apart, since with unknown cameras four
//! different people can be met to a few pixels.

use super::figure::Figure;
use super::keypoint_residuals::Detection;
use super::keypoint_set::BodyPoint;

/// Fewer pairs than this say nothing: the coherence of pure noise scatters by about 1/√(2·pairs).
const LEAST_PAIRS: usize = 10;
/// Longer errors are cut to this many medians, so that one outlier does not speak for all.
const LONGEST: f64 = 3.0;

/// c = Σ e_a·e_b / Σ ½(‖e_a‖² + ‖e_b‖²) over all pairs of a mark and its nearest marked ancestor in the same view; −1 … 1,
/// about 0 for noise. `None` with fewer than ten pairs or without any error.
///
/// `errors` are those of `detections`, pixels. Keypoints that are vertices have no place in the tree and are left out.
///
/// # Panics
/// If there are not as many errors as detections.
pub fn coherence(figure: &Figure, detections: &[Detection], errors: &[[f64; 2]]) -> Option<f64> {
    assert!(
        detections.len() == errors.len(),
        "coherence: {} detections, {} errors",
        detections.len(),
        errors.len()
    );
    let mut lengths: Vec<f64> = errors.iter().map(|e| e[0].hypot(e[1])).collect();
    lengths.sort_by(f64::total_cmp);
    let longest = LONGEST * lengths.get(lengths.len() / 2)?;
    let cut = |e: [f64; 2]| {
        let length = e[0].hypot(e[1]);
        if length > longest { e.map(|x| x * longest / length) } else { e }
    };

    let parents = &figure.skeleton().parents;
    let joint_of = |d: &Detection| match &figure.keypoints()[d.keypoint].as_ref()?.point {
        BodyPoint::Joints(joints) => Some(joints[0].0),
        BodyPoint::Vertex(_) => None,
    };
    let views = detections.iter().map(|d| d.view + 1).max()?;
    let mut at_joint = vec![vec![None; parents.len()]; views];
    for (d, e) in detections.iter().zip(errors) {
        if let Some(joint) = joint_of(d) {
            at_joint[d.view][joint] = Some(cut(*e));
        }
    }

    let (mut alike, mut size, mut pairs) = (0.0, 0.0, 0);
    for marked in &at_joint {
        for (joint, error) in marked.iter().enumerate() {
            let Some(a) = error else { continue };
            let mut ancestor = parents[joint];
            while let Some(j) = ancestor {
                if let Some(b) = marked[j] {
                    alike += a[0] * b[0] + a[1] * b[1];
                    size += 0.5 * (a[0] * a[0] + a[1] * a[1] + b[0] * b[0] + b[1] * b[1]);
                    pairs += 1;
                    break;
                }
                ancestor = parents[j];
            }
        }
    }
    (pairs >= LEAST_PAIRS && size > 0.0).then(|| alike / size)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fitting::KeypointSet;
    use crate::fitting::test_scene::body;
    use crate::surface::sampling::SplitMix64;

    fn coherence_of(error: impl Fn(usize, usize) -> [f64; 2]) -> Option<f64> {
        let body = body();
        let skeleton = body.skeleton();
        let figure = Figure::new(body, &skeleton, KeypointSet::Smpl24);
        let detections: Vec<Detection> = (0..4)
            .flat_map(|view| {
                (0..24).map(move |keypoint| Detection { view, keypoint, pixel_px: [0.0; 2], weight: 1.0 })
            })
            .collect();
        let errors: Vec<_> = detections.iter().map(|d| error(d.view, d.keypoint)).collect();
        coherence(&figure, &detections, &errors)
    }

    #[test]
    fn a_common_shift_is_coherent_and_alternating_errors_are_the_opposite() {
        let shift = coherence_of(|view, _| [1.0 + view as f64, -2.0]).expect("errors");
        assert!((shift - 1.0).abs() < 1e-12, "{shift}");
        // Left knee and ankle, and so on: each joint errs against its parent along the chains of both legs and arms.
        let depth = |k: usize| {
            let mut at = body().parents[k];
            let mut depth = 0;
            while let Some(j) = at {
                depth += 1;
                at = body().parents[j];
            }
            depth
        };
        let signs: Vec<f64> = (0..24).map(|k| if depth(k) % 2 == 0 { 1.0 } else { -1.0 }).collect();
        let against = coherence_of(|_, k| [3.0 * signs[k], 0.0]).expect("errors");
        assert!((against + 1.0).abs() < 1e-12, "{against}");
    }

    #[test]
    fn noise_is_incoherent_and_one_outlier_does_not_hide_a_shift() {
        let mut random = SplitMix64::new(5);
        let noise: Vec<[f64; 2]> =
            (0..96).map(|_| std::array::from_fn(|_| random.uniform() - random.uniform())).collect();
        let c = coherence_of(|view, k| noise[24 * view + k]).expect("errors");
        assert!(c.abs() < 0.25, "{c}");
        let outlier = coherence_of(|view, k| if (view, k) == (0, 20) { [-500.0, 0.0] } else { [1.0, 1.0] });
        assert!(outlier > Some(0.8), "{outlier:?}");
        assert_eq!(coherence_of(|_, _| [0.0; 2]), None, "no error at all");
    }
}
