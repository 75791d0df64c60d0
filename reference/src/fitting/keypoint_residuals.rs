//! The data term E_J: how far the body's points, projected, are from the marks.
//!
//! For keypoint k in view i with weight w, marked at y: e = Π_i(p_k(θ, β) + trans) − y, and two residuals w·f(e), where
//! f is the signed root of Geman–McClure's ρ of each coordinate (eq. 2.3, 2.4; errata E2, E3). By the chain rule
//!
//! ```text
//! ∂e = Π′ R_i (∂p/∂θ dθ + ∂p/∂β dβ + d trans) + Π′ (J_l(r_i) dr_i × R_i p) + Π′ dt_i.
//! ```

use super::figure::Figure;
use super::layout::Layout;
use super::presets::LossForm;
use super::result::Parameters;
use crate::camera::{Matrix2x3, Pinhole, PixelDerivative};
use crate::linalg::dense::Dense;
use crate::linalg::matrix::Matrix3;
use crate::linalg::vector::{Vector3, add};
use crate::robust_loss::{radial, residual, residual_derivative};
use crate::rotation::left_jacobian;

/// A mark that counts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// The view.
    pub view: usize,
    /// The keypoint of the set.
    pub keypoint: usize,
    /// Where it is marked, pixels.
    pub pixel_px: [f64; 2],
    /// w > 0: base weight times confidence.
    pub weight: f64,
}

/// The residuals of all marks.
#[derive(Clone, Copy, Debug)]
pub struct KeypointResiduals<'a> {
    /// The body's points.
    pub figure: &'a Figure<'a>,
    /// The marks.
    pub detections: &'a [Detection],
    /// σ of the loss, pixels.
    pub sigma_px: f64,
    /// How the loss takes a 2-D error.
    pub loss: LossForm,
}

impl KeypointResiduals<'_> {
    /// The number of residuals: two for each mark.
    pub fn count(&self) -> usize {
        2 * self.detections.len()
    }

    /// e of every mark, pixels; `None` if one of the points is not in front of its camera.
    pub fn errors(&self, parameters: &Parameters) -> Option<Vec<[f64; 2]>> {
        let points = self.figure.points(&parameters.pose, &parameters.betas);
        self.detections
            .iter()
            .map(|d| {
                let point = add(points[d.keypoint], parameters.trans);
                let [u, v] = parameters.cameras[d.view].project(point)?;
                Some([u - d.pixel_px[0], v - d.pixel_px[1]])
            })
            .collect()
    }

    /// The residuals, appended to `out`; `None` if a point is not in front of its camera.
    pub fn residuals(&self, parameters: &Parameters, out: &mut Vec<f64>) -> Option<()> {
        for (d, e) in self.detections.iter().zip(self.errors(parameters)?) {
            let f = match self.loss {
                LossForm::PerCoordinate => e.map(|x| residual(x, self.sigma_px)),
                LossForm::Radial => radial(e, self.sigma_px).0,
            };
            out.extend(f.map(|f| d.weight * f));
        }
        Some(())
    }

    /// Adds the derivative of the residuals by x, at `x` and the `parameters` that it stands for, to the rows of `jacobian`
    /// from `first_row` on; rows of points that are not in front of their camera stay as they are.
    ///
    /// # Panics
    /// If the rows or columns are not there.
    pub fn write_jacobian(
        &self,
        x: &[f64],
        parameters: &Parameters,
        layout: &Layout,
        jacobian: &mut Dense,
        first_row: usize,
    ) {
        let moving = self.figure.moving_points(&parameters.pose, &parameters.betas);
        let turns: Vec<Option<Matrix3>> = layout
            .cameras
            .iter()
            .map(|columns| columns.rotation.map(|at| left_jacobian([x[at], x[at + 1], x[at + 2]])))
            .collect();
        for (n, d) in self.detections.iter().enumerate() {
            let point = add(moving.points[d.keypoint], parameters.trans);
            let Some(slope) = self.weighted_slope(d, &parameters.cameras[d.view], point) else { continue };
            let columns = layout.cameras[d.view];
            for axis in 0..2 {
                let row = jacobian.row_mut(first_row + 2 * n + axis);
                for c in 0..3 {
                    let by_point = slope.point[axis][c];
                    add_scaled_row(
                        &mut row[layout.pose.clone()],
                        moving.by_pose.row(3 * d.keypoint + c),
                        by_point,
                    );
                    add_scaled_row(
                        &mut row[layout.betas.clone()],
                        moving.by_betas.row(3 * d.keypoint + c),
                        by_point,
                    );
                    if let Some(trans) = layout.trans {
                        row[trans + c] = by_point;
                    }
                    if let Some(translation) = columns.translation {
                        row[translation + c] = slope.translation[axis][c];
                    }
                }
                if let (Some(rotation), Some(turn)) = (columns.rotation, &turns[d.view]) {
                    for c in 0..3 {
                        row[rotation + c] = (0..3).map(|m| slope.rotation[axis][m] * turn[m][c]).sum();
                    }
                }
            }
        }
    }

    /// The derivative of a mark's two residuals by point, rotation and translation of the camera.
    fn weighted_slope(&self, d: &Detection, camera: &Pinhole, point: Vector3) -> Option<PixelDerivative> {
        let [u, v] = camera.project(point)?;
        let e = [u - d.pixel_px[0], v - d.pixel_px[1]];
        let loss: [[f64; 2]; 2] = match self.loss {
            LossForm::PerCoordinate => [
                [residual_derivative(e[0], self.sigma_px), 0.0],
                [0.0, residual_derivative(e[1], self.sigma_px)],
            ],
            LossForm::Radial => radial(e, self.sigma_px).1,
        };
        let times = |by: &Matrix2x3| -> Matrix2x3 {
            std::array::from_fn(|i| {
                std::array::from_fn(|c| d.weight * (loss[i][0] * by[0][c] + loss[i][1] * by[1][c]))
            })
        };
        let mut slope = camera.project_derivative(point)?;
        slope.point = times(&slope.point);
        slope.rotation = times(&slope.rotation);
        slope.translation = times(&slope.translation);
        Some(slope)
    }
}

/// row += s · terms.
fn add_scaled_row(row: &mut [f64], terms: &[f64], s: f64) {
    for (sum, term) in row.iter_mut().zip(terms) {
        *sum += s * term;
    }
}

#[cfg(test)]
mod tests {
    use super::super::keypoint_set::KeypointSet;
    use super::super::test_scene::{body, body_of_smpl_size, person, ring};
    use super::super::{Extrinsics, Translations};
    use super::*;
    use crate::linalg::complete_orthogonal::CompleteOrthogonal;

    /// Every keypoint of the set marked 10 to 60 px off in two views.
    fn detections(set: KeypointSet, figure: &Figure, at: &Parameters) -> Vec<Detection> {
        let points = figure.points(&at.pose, &at.betas);
        (0..set.count())
            .filter(|&k| figure.keypoints()[k].is_some())
            .flat_map(|k| {
                let pixel = |view: usize| {
                    let [u, v] = at.cameras[view].project(add(points[k], at.trans)).expect("in front");
                    let (a, b) = ((3 * k + view) as f64, (5 * k + 2 * view) as f64);
                    [u + 60.0 * a.sin(), v + 60.0 * b.cos()]
                };
                (0..at.cameras.len())
                    .map(|view| Detection {
                        view,
                        keypoint: k,
                        pixel_px: pixel(view),
                        weight: 0.3 + 0.02 * k as f64,
                    })
                    .collect::<Vec<_>>()
            })
            .collect()
    }

    #[test]
    fn jacobian_is_its_central_difference() {
        const STEP: f64 = 1e-5;
        let small = body_of_smpl_size();
        let mut cameras = ring(3);
        cameras[1].distortion = [-0.1, 0.02, 0.002, -0.001, 0.01];
        let person = person(3);
        let at = Parameters { pose: person.pose, betas: person.betas, trans: person.trans, cameras };
        for (body, set) in
            [(body(), KeypointSet::Smpl24), (&small, KeypointSet::Body25), (&small, KeypointSet::Coco18)]
        {
            let skeleton = body.skeleton();
            let figure = Figure::new(body, &skeleton, set);
            let detections = detections(set, &figure, &at);
            for (extrinsics, loss) in
                [(Extrinsics::Known, LossForm::Radial), (Extrinsics::Unknown, LossForm::PerCoordinate)]
            {
                let layout = Layout::new(24, 10, 3, extrinsics, Translations::Free);
                let block =
                    KeypointResiduals { figure: &figure, detections: &detections, sigma_px: 50.0, loss };
                let x = layout.pack(&at);
                let mut jacobian = Dense::zeros(block.count() + 1, layout.len);
                block.write_jacobian(&x, &at, &layout, &mut jacobian, 1);
                for c in 0..layout.len {
                    let moved = |step: f64| {
                        let mut x = x.clone();
                        x[c] += step;
                        let mut r = Vec::new();
                        block.residuals(&layout.unpack(&x, &at), &mut r).expect("in front");
                        r
                    };
                    for (row, (above, below)) in moved(STEP).iter().zip(moved(-STEP)).enumerate() {
                        let numeric = (above - below) / (2.0 * STEP);
                        let error = (jacobian[(row + 1, c)] - numeric).abs();
                        assert!(error < 1e-5, "{set:?} {extrinsics:?}: row {row}, column {c}: {error}");
                    }
                }
            }
        }
    }

    #[test]
    fn joints_leave_thirty_two_directions_open() {
        // Five leaves move no joint (15). Seventeen joints with one bone below can turn about it while the next joint turns
        // back: of 85 unknowns the 24 joints of four known views determine 53.
        let skeleton = body().skeleton();
        let figure = Figure::new(body(), &skeleton, KeypointSet::Smpl24);
        let person = person(1);
        let at = Parameters { pose: person.pose, betas: person.betas, trans: person.trans, cameras: ring(4) };
        let detections = detections(KeypointSet::Smpl24, &figure, &at);
        let layout = Layout::new(24, 10, 4, Extrinsics::Known, Translations::Free);
        let block = KeypointResiduals {
            figure: &figure,
            detections: &detections,
            sigma_px: 1e3,
            loss: LossForm::PerCoordinate,
        };
        let mut jacobian = Dense::zeros(block.count(), layout.len);
        block.write_jacobian(&layout.pack(&at), &at, &layout, &mut jacobian, 0);
        assert_eq!((layout.len, CompleteOrthogonal::factor(&jacobian).rank()), (85, 53));
    }

    #[test]
    fn a_point_behind_its_camera_has_no_residual() {
        let skeleton = body().skeleton();
        let figure = Figure::new(body(), &skeleton, KeypointSet::Smpl24);
        let detections = [Detection { view: 0, keypoint: 3, pixel_px: [0.0; 2], weight: 1.0 }];
        let block = KeypointResiduals {
            figure: &figure,
            detections: &detections,
            sigma_px: 50.0,
            loss: LossForm::Radial,
        };
        let mut cameras = ring(1);
        cameras[0].translation = [0.0, 0.0, -4.0];
        let at = Parameters { pose: vec![0.0; 72], betas: vec![0.0; 10], trans: [0.0; 3], cameras };
        assert_eq!(block.residuals(&at, &mut Vec::new()), None);
    }
}
