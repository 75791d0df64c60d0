//! Choosing among overlapping boxes: the best first, then those that none of the chosen ones covers.

use super::Tensor;

/// How boxes are written and which are chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NonMaxSuppression {
    /// Whether a box is (x, y of its centre, width, height) rather than two opposite corners (y₁, x₁, y₂, x₂).
    pub center_point_box: bool,
    /// The most boxes chosen for one batch and class.
    pub max_output_boxes: usize,
    /// A box is dropped when it overlaps a chosen one by more than this share of their union.
    pub iou_threshold: f64,
    /// Boxes must score more than this; `None` takes all.
    pub score_threshold: Option<f64>,
}

/// The chosen boxes: boxes \[N, B, 4\] with scores \[N, C, B\] give \[chosen, 3\] of (batch, class, box), the best first in
/// each batch and class.
///
/// Greedily: the box of the highest score (the first of equals) is chosen, and all boxes dropped whose intersection over
/// union with it exceeds the threshold.
///
/// # Panics
/// If the shapes do not fit.
///
/// # References
/// ONNX operator NonMaxSuppression (version 11).
pub fn non_max_suppression(boxes: &Tensor, scores: &Tensor, params: &NonMaxSuppression) -> Tensor<usize> {
    let (&[batches, count, 4], &[scored, classes, candidates]) = (&boxes.shape[..], &scores.shape[..]) else {
        panic!("non_max_suppression: boxes {:?} and scores {:?} do not fit", boxes.shape, scores.shape)
    };
    assert!(
        batches == scored && count == candidates,
        "non_max_suppression: boxes {:?} and scores {:?} do not fit",
        boxes.shape,
        scores.shape
    );
    let mut chosen = Vec::new();
    for batch in 0..batches {
        let corners = |k: usize| {
            let first = (batch * count + k) * 4;
            corners([0, 1, 2, 3].map(|i| boxes.data[first + i]), params.center_point_box)
        };
        for class in 0..classes {
            let score = |k: usize| scores.data[(batch * classes + class) * count + k];
            let mut left: Vec<usize> =
                (0..count).filter(|&k| params.score_threshold.is_none_or(|least| score(k) > least)).collect();
            // A stable sort keeps the first of equals first.
            left.sort_by(|&a, &b| score(b).total_cmp(&score(a)));
            let mut kept: Vec<usize> = Vec::new();
            for k in left {
                if kept.len() == params.max_output_boxes {
                    break;
                }
                if kept.iter().all(|&other| overlap(corners(k), corners(other)) <= params.iou_threshold) {
                    kept.push(k);
                }
            }
            chosen.extend(kept.into_iter().flat_map(|k| [batch, class, k]));
        }
    }
    Tensor::new(&[chosen.len() / 3, 3], chosen)
}

/// (least y, least x, greatest y, greatest x) of a box, whichever corners it is given by.
fn corners([a, b, c, d]: [f64; 4], center_point_box: bool) -> [f64; 4] {
    if center_point_box {
        return [b - d / 2.0, a - c / 2.0, b + d / 2.0, a + c / 2.0];
    }
    [a.min(c), b.min(d), a.max(c), b.max(d)]
}

/// Intersection over union; 0 where the boxes do not meet in an area.
fn overlap(a: [f64; 4], b: [f64; 4]) -> f64 {
    let area = |[top, left, bottom, right]: [f64; 4]| (bottom - top).max(0.0) * (right - left).max(0.0);
    let shared = area([a[0].max(b[0]), a[1].max(b[1]), a[2].min(b[2]), a[3].min(b[3])]);
    if shared > 0.0 { shared / (area(a) + area(b) - shared) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: NonMaxSuppression = NonMaxSuppression {
        center_point_box: false,
        max_output_boxes: 10,
        iou_threshold: 0.5,
        score_threshold: None,
    };

    #[test]
    fn a_covered_box_is_dropped_and_the_best_comes_first() {
        // The second covers the first by 0.9/1.1 of their union; the third stands apart, its corners swapped.
        let boxes =
            Tensor::new(&[1, 3, 4], vec![0.0, 0.0, 1.0, 1.0, 0.0, 0.1, 1.0, 1.1, 1.0, 11.0, 0.0, 10.0]);
        let scores = Tensor::new(&[1, 1, 3], vec![0.8, 0.9, 0.3]);
        assert_eq!(non_max_suppression(&boxes, &scores, &ALL).data, [0, 0, 1, 0, 0, 2]);
        let lenient = NonMaxSuppression { iou_threshold: 0.9, ..ALL };
        assert_eq!(non_max_suppression(&boxes, &scores, &lenient).shape, [3, 3]);
        let good = NonMaxSuppression { score_threshold: Some(0.3), ..ALL };
        assert_eq!(non_max_suppression(&boxes, &scores, &good).data, [0, 0, 1], "0.3 is not more than 0.3");
        let one = NonMaxSuppression { max_output_boxes: 1, ..ALL };
        assert_eq!(non_max_suppression(&boxes, &scores, &one).shape, [1, 3]);
    }

    #[test]
    fn a_box_may_be_given_by_its_centre() {
        assert_eq!(corners([0.5, 2.0, 1.0, 4.0], true), [0.0, 0.0, 4.0, 1.0]);
        assert_eq!(overlap([0.0, 0.0, 2.0, 1.0], [1.0, 0.0, 3.0, 1.0]), 1.0 / 3.0);
        assert_eq!(overlap([0.0, 0.0, 1.0, 1.0], [1.0, 0.0, 2.0, 1.0]), 0.0, "touching is not covering");
    }
}
