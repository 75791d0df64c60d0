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
