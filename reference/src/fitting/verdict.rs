//! Can the answer be used? A descent always ends somewhere; whether that is a person is asked here.

use super::coherence::coherence;
use super::figure::Figure;
use super::keypoint_residuals::Detection;
use super::result::{Parameters, Verdict, ViewResidual};
use crate::body::Hinge;
use crate::least_squares::Termination;
use crate::linalg::vector::{add, norm};

/// A view disagrees if half of its marks are farther from the body than this fraction of the body's size in the picture, or a
/// quarter of them farther than the other. Detectors miss by one to three hundredths, the thesis' strongest noise (5 px on a
/// person of 170 px) by three to five.
const FAR: f64 = 0.07;
const FAR_FOR_A_QUARTER: f64 = 0.09;
/// A picture of a body smaller than this says nothing, pixels.
const LEAST_SIZE_PX: f64 = 4.0;
/// Errors that neighbours share are not a detector's (see [`coherence`]); then this much is too far already.
/// Detectors and skeletons may disagree by a hundredth on where a joint is.
const FAR_TOGETHER: f64 = 0.01;
const FAR_TOGETHER_FOR_A_QUARTER: f64 = 0.05;
/// Noise reaches 0.1 in a hundred fits; bodies of other people 0.7 and more.
const TOGETHER: f64 = 0.5;
/// A keypoint that lies this far from the body in all views that show it, two at least, was not met by any; as a fraction of
/// the body's size. Single wrong marks happen to detectors, the same one in all views does not.
const FAR_EVERYWHERE: f64 = 0.08;
/// Marks nearer than this are met exactly, pixels.
const EXACT_PX: f64 = 0.02;
/// No body of a model's training set is this many standard deviations from the mean.
const MOST_DEVIATIONS: f64 = 5.0;
/// Elbows and knees do not bend backwards by more than this, radians (70°); short of it the marks are believed.
const MOST_BACKWARD_RAD: f64 = 1.2;
/// No joint but the root turns farther than this, radians (160°); those of the trunk less (125°).
const MOST_TURN_RAD: f64 = 2.8;
const MOST_TURN_OF_TRUNK_RAD: f64 = 2.2;

/// The distances between marks and body in each of the N views, pixels, from the errors of all marks.
pub fn view_residuals(detections: &[Detection], errors: &[[f64; 2]], views: usize) -> Vec<ViewResidual> {
    let mut distances = vec![Vec::new(); views];
    for (d, e) in detections.iter().zip(errors) {
        distances[d.view].push(e[0].hypot(e[1]));
    }
    distances
        .into_iter()
        .map(|mut distances| {
            distances.sort_by(f64::total_cmp);
            let count = distances.len();
            if count == 0 {
                return ViewResidual::default();
            }
            let mean = |f: fn(&f64) -> f64| distances.iter().map(f).sum::<f64>() / count as f64;
            ViewResidual {
                count,
                mean_px: mean(|d| *d),
                median_px: 0.5 * (distances[(count - 1) / 2] + distances[count / 2]),
                upper_quartile_px: distances[3 * (count - 1) / 4],
                rms_px: mean(|d| d * d).sqrt(),
                max_px: distances[count - 1],
            }
        })
        .collect()
}

/// The size of the body in each picture: the diagonal of the box around its keypoints, pixels; 0 for a view that does not see
/// them.
pub fn sizes_px(figure: &Figure, parameters: &Parameters) -> Vec<f64> {
    let points = figure.points(&parameters.pose, &parameters.betas);
    parameters
        .cameras
        .iter()
        .map(|camera| {
            let mut low = [f64::INFINITY; 2];
            let mut high = [f64::NEG_INFINITY; 2];
            for (point, _) in points.iter().zip(figure.keypoints()).filter(|(_, k)| k.is_some()) {
                if let Some(pixel) = camera.project(add(*point, parameters.trans)) {
                    for i in 0..2 {
                        low[i] = low[i].min(pixel[i]);
                        high[i] = high[i].max(pixel[i]);
                    }
                }
            }
            (high[0] - low[0]).hypot(high[1] - low[1]).max(0.0)
        })
        .collect()
}

/// The views, two at least, that all show one keypoint far from the body: a limb that the robust loss gave up.
pub fn given_up(detections: &[Detection], errors: &[[f64; 2]], sizes_px: &[f64]) -> Vec<usize> {
    let keypoints = detections.iter().map(|d| d.keypoint + 1).max().unwrap_or(0);
    let mut views = Vec::new();
    for keypoint in 0..keypoints {
        let marks = detections.iter().zip(errors).filter(|(d, _)| d.keypoint == keypoint);
        let (seen, far): (Vec<usize>, Vec<bool>) =
            marks.map(|(d, e)| (d.view, e[0].hypot(e[1]) > FAR_EVERYWHERE * sizes_px[d.view])).unzip();
        if seen.len() > 1 && far.iter().all(|&far| far) {
            views.extend(seen);
        }
    }
    views.sort_unstable();
    views.dedup();
    views
}

/// The verdict on an answer; the first of disagreement, implausible shape, implausible pose, no convergence that holds.
pub fn verdict(
    figure: &Figure,
    hinges: &[Hinge],
    parameters: &Parameters,
    detections: &[Detection],
    errors: &[[f64; 2]],
    views: &[ViewResidual],
    termination: Termination,
) -> Verdict {
    let sizes_px = sizes_px(figure, parameters);
    let together = coherence(figure, detections, errors) > Some(TOGETHER);
    let half = if together { FAR_TOGETHER } else { FAR };
    let quarter = if together { FAR_TOGETHER_FOR_A_QUARTER } else { FAR_FOR_A_QUARTER };
    let mut far: Vec<usize> = views
        .iter()
        .zip(&sizes_px)
        .enumerate()
        .filter(|(_, (view, size))| {
            let near = **size >= LEAST_SIZE_PX
                && view.median_px <= half * *size
                && view.upper_quartile_px <= quarter * *size;
            view.count > 0 && !near
        })
        .map(|(i, _)| i)
        .collect();
    far.extend(given_up(detections, errors, &sizes_px));
    far.sort_unstable();
    far.dedup();
    if !far.is_empty() {
        return Verdict::ViewsDisagree { views: far };
    }
    let largest = parameters.betas.iter().copied().enumerate().max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
    if let Some((beta, value)) = largest.filter(|(_, value)| value.abs() > MOST_DEVIATIONS) {
        return Verdict::ImplausibleBody { beta, value };
    }
    for hinge in hinges {
        let angle_rad = hinge.flexion_rad(&parameters.pose);
        if angle_rad < -MOST_BACKWARD_RAD {
            return Verdict::ImplausiblePose { joint: hinge.joint, angle_rad };
        }
    }
    for (joint, theta) in parameters.pose.chunks_exact(3).enumerate().skip(1) {
        let angle_rad = norm([theta[0], theta[1], theta[2]]);
        let most = if super::polish::TRUNK.contains(&joint) { MOST_TURN_OF_TRUNK_RAD } else { MOST_TURN_RAD };
        if angle_rad > most {
            return Verdict::ImplausiblePose { joint, angle_rad };
        }
    }
    // Directions that exact marks leave open may take long to settle; the marks are met all the same.
    let met = views.iter().all(|view| view.rms_px < EXACT_PX);
    if met || termination.was_successful() { Verdict::Success } else { Verdict::NotConverged }
}
