//! The energy of one shape stage, as a least-squares problem.
//!
//! ```text
//! E(β, D) = Σ_P ρ(v_sp,i × n′ − m′) + Σ_Q ρ((Π(v_i(β, D)) − u) z_i/f) + ω_L² ‖κ L D‖² + ω_B² ‖κ D‖² + ω_β² ‖β − β₀‖²
//! ```
//!
//! with v_sp,i = t̄_i + B_S(β)_i + D_i, the vertex in the zero pose, (n′, m′) its ray there, v_i the posed vertex, u the
//! outline point. ρ is Geman and McClure's, per component, everywhere in metres: pixels are multiplied by z_i/f (erratum E12).
//!
//! # Conventions
//! Eq. 3.8 writes V × r′_n − r′_m with the boundary point as V and the ray through the model: here the vertex moves and the
//! ray of the boundary point stays (erratum E9). E_L = Σ ‖L(t_i) − δ_i‖² with δ_i = L(t_i(β, 0)) and t_i(β, D) − t_i(β, 0) = D_i
//! is ‖L D‖², since L is linear; L and the multipliers κ are the [regulariser](super::regulariser) of the body without offsets
//! at the stage's start.

use super::rays::unposed;
use super::regulariser::Regulariser;
use super::shape_jacobian::{Preconditioner, Rows, ShapeJacobian};
use crate::body::BodyModel;
use crate::body::posed_body::PosedBody;
use crate::camera::Pinhole;
use crate::least_squares::Problem;
use crate::linalg::matrix::{Matrix3, apply, apply_transposed};
use crate::linalg::vector::{Vector3, ZERO, add, sub};
use crate::plucker::Line;
use crate::robust_loss;

/// Weights of one stage; see the module.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Weights {
    /// ω_L.
    pub laplacian: f64,
    /// ω_B.
    pub model: f64,
    /// ω_β.
    pub shape: f64,
    /// σ, metres.
    pub sigma_m: f64,
}

/// A matched vertex: affine in β and D_i at the fixed pose.
#[derive(Clone, Debug)]
struct Point {
    vertex: usize,
    /// v_sp and v at the stage's β₀ and D₀.
    unposed: Vector3,
    posed: Vector3,
    /// ∂v/∂D_i.
    linear: Matrix3,
    /// ∂v_sp/∂β and ∂v/∂β, 3×B.
    unposed_by_betas: Vec<f64>,
    posed_by_betas: Vec<f64>,
}

/// A vertex and its ray in the zero pose.
#[derive(Clone, Copy, Debug)]
struct RayTerm {
    point: usize,
    line: Line,
}

/// A vertex and its outline point in a view.
#[derive(Clone, Copy, Debug)]
struct PixelTerm {
    point: usize,
    view: usize,
    pixel_px: [f64; 2],
    /// z_i/f at the stage's start.
    metres_per_px: [f64; 2],
}

/// A vertex and the ray that it belongs to, in a view.
#[derive(Clone, Copy, Debug)]
pub struct Pair {
    /// The vertex.
    pub vertex: u32,
    /// The view.
    pub view: usize,
    /// The ray through the outline point, in the posed world.
    pub line: Line,
    /// The outline point.
    pub pixel_px: [f64; 2],
}

/// One stage's problem. The unknowns are β (B numbers) and, if offsets are free, D (3V numbers, vertex by vertex).
#[derive(Debug)]
pub struct ShapeProblem<'a> {
    cameras: &'a [Pinhole],
    points: Vec<Point>,
    rays: Vec<RayTerm>,
    pixels: Vec<PixelTerm>,
    /// β₀ and D₀.
    start_betas: Vec<f64>,
    start_offsets: &'a [Vector3],
    /// β of the whole fit's start.
    prior_betas: &'a [f64],
    /// None: D is not free.
    regulariser: Option<&'a Regulariser>,
    weights: Weights,
    preconditioner: Option<Preconditioner>,
}

impl<'a> ShapeProblem<'a> {
    /// The problem of `pairs` around `posed`, the body `body` with the betas `betas` and the offsets `offsets` (V×3).
    ///
    /// `betas` are the stage's start, as many as the model has, `prior_betas` those to stay near; with a
    /// `regulariser` the offsets are free. Pairs whose ray has no inverse image in the zero pose are left out.
    ///
    /// # Panics
    /// If there are not as many betas as the body has, or the lengths do not fit.
    pub fn new(
        body: &BodyModel,
        posed: &PosedBody,
        cameras: &'a [Pinhole],
        pairs: &[Pair],
        with_pixels: bool,
        betas: &[f64],
        prior_betas: &'a [f64],
        offsets: &'a [Vector3],
        regulariser: Option<&'a Regulariser>,
        weights: Weights,
    ) -> ShapeProblem<'a> {
        let (v, b) = (offsets.len(), betas.len());
        assert!(
            b == body.beta_count() && prior_betas.len() == b,
            "ShapeProblem: {b} betas near {}, the body has {}",
            prior_betas.len(),
            body.beta_count()
        );
        assert!(
            regulariser.is_none_or(|r| r.vertex_count() == v),
            "ShapeProblem: {v} offsets and a Laplacian of another size"
        );
        let mut slot = vec![usize::MAX; v];
        let (mut points, mut rays, mut pixels) = (Vec::new(), Vec::new(), Vec::new());
        for pair in pairs {
            let vertex = pair.vertex as usize;
            let Some(line) = unposed(&pair.line, posed, vertex) else { continue };
            if slot[vertex] == usize::MAX {
                slot[vertex] = points.len();
                let mut posed_by_betas = vec![0.0; 3 * b];
                posed.by_betas(vertex, &mut posed_by_betas);
                points.push(Point {
                    vertex,
                    unposed: posed.shaped(vertex),
                    posed: posed.position(vertex),
                    linear: posed.by_offset(vertex),
                    unposed_by_betas: body.shapedirs[3 * b * vertex..3 * b * (vertex + 1)].to_vec(),
                    posed_by_betas,
                });
            }
            let point = slot[vertex];
            rays.push(RayTerm { point, line });
            let camera = &cameras[pair.view];
            let depth = camera.to_camera(points[point].posed)[2];
            if with_pixels && depth > 0.0 {
                let metres_per_px = camera.focal_px.map(|f| depth / f);
                pixels.push(PixelTerm { point, view: pair.view, pixel_px: pair.pixel_px, metres_per_px });
            }
        }
        let mut problem = ShapeProblem {
            cameras,
            points,
            rays,
            pixels,
            start_betas: betas.to_vec(),
            start_offsets: offsets,
            prior_betas,
            regulariser,
            weights,
            preconditioner: None,
        };
        let rows = problem.rows(&problem.start());
        problem.preconditioner =
            regulariser.map(|regulariser| Preconditioner::new(regulariser, &weights, &rows));
        problem
    }

    /// The unknowns at the stage's start.
    pub fn start(&self) -> Vec<f64> {
        let free = if self.regulariser.is_some() { self.start_offsets } else { &[] };
        self.start_betas.iter().copied().chain(free.iter().flatten().copied()).collect()
    }

    /// β and D of an x.
    pub fn split(&self, x: &[f64]) -> (Vec<f64>, Vec<Vector3>) {
        let (betas, free) = x.split_at(self.start_betas.len());
        let offsets = match self.regulariser {
            Some(_) => free.chunks_exact(3).map(|d| [d[0], d[1], d[2]]).collect(),
            None => self.start_offsets.to_vec(),
        };
        (betas.to_vec(), offsets)
    }

    /// How many pairs count.
    pub fn pair_count(&self) -> usize {
        self.rays.len()
    }

    /// D_i − D₀,i.
    fn offset_change(&self, x: &[f64], vertex: usize) -> Vector3 {
        if self.regulariser.is_none() {
            return ZERO;
        }
        let at = self.start_betas.len() + 3 * vertex;
        sub([x[at], x[at + 1], x[at + 2]], self.start_offsets[vertex])
    }

    /// The matched vertices at x: in the zero pose and posed.
    fn places(&self, x: &[f64]) -> Vec<(Vector3, Vector3)> {
        let b = self.start_betas.len();
        let change: Vec<f64> = x.iter().zip(&self.start_betas).map(|(x, start)| x - start).collect();
        let along = |by_betas: &[f64]| -> Vector3 {
            std::array::from_fn(|axis| {
                by_betas[axis * b..(axis + 1) * b].iter().zip(&change).map(|(d, c)| d * c).sum()
            })
        };
        self.points
            .iter()
            .map(|point| {
                let moved = self.offset_change(x, point.vertex);
                let rest = add(point.unposed, add(along(&point.unposed_by_betas), moved));
                let posed = add(point.posed, add(along(&point.posed_by_betas), apply(&point.linear, moved)));
                (rest, posed)
            })
            .collect()
    }

    /// The derivatives of the robust rows at x, in the order of the residuals.
    fn rows(&self, x: &[f64]) -> Rows {
        let b = self.start_betas.len();
        let sigma = self.weights.sigma_m;
        let places = self.places(x);
        let mut rows = Rows::default();
        rows.by_betas.reserve(b * (3 * self.rays.len() + 2 * self.pixels.len()));
        let mut push =
            |point: &Point, slope: f64, direction: Vector3, linear: Option<&Matrix3>, by_betas: &[f64]| {
                let direction = direction.map(|d| slope * d);
                let by_offset = linear.map_or(direction, |m| apply_transposed(m, direction));
                rows.by_offset.push((point.vertex, by_offset));
                rows.by_betas.extend(
                    (0..b).map(|l| (0..3).map(|axis| direction[axis] * by_betas[axis * b + l]).sum::<f64>()),
                );
            };
        for term in &self.rays {
            let point = &self.points[term.point];
            let residual = term.line.residual(places[term.point].0);
            let derivative = term.line.residual_derivative();
            for c in 0..3 {
                let slope = robust_loss::residual_derivative(residual[c], sigma);
                push(point, slope, derivative[c], None, &point.unposed_by_betas);
            }
        }
        for term in &self.pixels {
            let point = &self.points[term.point];
            let camera = &self.cameras[term.view];
            let posed = places[term.point].1;
            let (pixel, derivative) = (camera.project(posed), camera.project_derivative(posed));
            for c in 0..2 {
                let (Some(pixel), Some(derivative)) = (pixel, derivative) else {
                    push(point, 0.0, ZERO, Some(&point.linear), &point.posed_by_betas);
                    continue;
                };
                let residual = (pixel[c] - term.pixel_px[c]) * term.metres_per_px[c];
                let slope = robust_loss::residual_derivative(residual, sigma) * term.metres_per_px[c];
                push(point, slope, derivative.point[c], Some(&point.linear), &point.posed_by_betas);
            }
        }
        rows
    }
}

impl Problem for ShapeProblem<'_> {
    type Jacobian = ShapeJacobian;

    fn residuals(&self, x: &[f64]) -> Option<Vec<f64>> {
        let sigma = self.weights.sigma_m;
        let places = self.places(x);
        let mut r = Vec::with_capacity(3 * self.rays.len() + 2 * self.pixels.len() + 2 * x.len());
        for term in &self.rays {
            let residual = term.line.residual(places[term.point].0);
            r.extend(residual.map(|e| robust_loss::residual(e, sigma)));
        }
        for term in &self.pixels {
            let pixel = self.cameras[term.view].project(places[term.point].1)?;
            r.extend((0..2).map(|c| {
                robust_loss::residual((pixel[c] - term.pixel_px[c]) * term.metres_per_px[c], sigma)
            }));
        }
        let (betas, offsets) = x.split_at(self.start_betas.len());
        if let Some(regulariser) = self.regulariser {
            r.extend(regulariser.apply(&self.weights, offsets));
        }
        r.extend(betas.iter().zip(self.prior_betas).map(|(beta, prior)| self.weights.shape * (beta - prior)));
        Some(r)
    }

    fn jacobian(&self, x: &[f64]) -> ShapeJacobian {
        ShapeJacobian::new(
            self.start_betas.len(),
            self.rows(x),
            self.regulariser.cloned(),
            self.weights,
            self.preconditioner.clone(),
        )
    }
}
