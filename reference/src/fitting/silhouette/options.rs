//! How the silhouette fit is run: the schedule of Table 3.1 and the choices that the thesis leaves open.

/// One step of the schedule: weights on *residuals*, so they enter the energy squared, as in the code that the numbers of
/// the thesis come from.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ShapeStage {
    /// ω_L, on how much the offsets differ from their neighbours'.
    pub laplacian_weight: f64,
    /// ω_B, on the offsets themselves.
    pub model_weight: f64,
    /// σ of the Geman–McClure loss, metres, for rays and for pixels (erratum E12).
    pub sigma_m: f64,
}

/// The schedules of Li 2021, Table 3.1.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Schedule {
    /// σ = 0.05, 0.03, 0.01 m.
    #[default]
    Synthetic,
    /// σ = 0.08, 0.04, 0.03 m.
    Real,
}

impl Schedule {
    /// The three steps.
    pub fn stages(self) -> [ShapeStage; 3] {
        let sigmas = match self {
            Schedule::Synthetic => [0.05, 0.03, 0.01],
            Schedule::Real => [0.08, 0.04, 0.03],
        };
        let weights = [(6.5, 0.9), (5.25, 0.75), (4.0, 0.6)];
        std::array::from_fn(|k| ShapeStage {
            laplacian_weight: weights[k].0,
            model_weight: weights[k].1,
            sigma_m: sigmas[k],
        })
    }
}

/// What "shape" means in chapter 3 (erratum E11).
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Unknowns {
    /// β alone, as in the thesis' Algorithm 1; the Laplacian and the model term are then zero.
    Betas,
    /// β and an offset for every vertex, as in the thesis' equations and in Alldieck et al. 2018.
    #[default]
    BetasAndOffsets,
}

/// Which of the two sums of eq. 3.8 are in the energy; figure 3.10 compares them.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Terms {
    /// Vertices to un-posed rays, in space.
    Rays,
    /// Both.
    #[default]
    RaysAndPixels,
}

/// How the silhouette fit is run.
#[derive(Clone, Debug, PartialEq)]
pub struct SilhouetteOptions {
    /// The steps, in order; correspondences are found anew before each.
    pub stages: Vec<ShapeStage>,
    /// β, or β and D.
    pub unknowns: Unknowns,
    /// Rays, or rays and pixels.
    pub terms: Terms,
    /// A ray's nearest vertex is its partner if it is nearer than this, metres (erratum E14d).
    pub ray_reach_m: f64,
    /// A vertex' nearest ray is its partner if it is nearer than this, metres (erratum E14d).
    pub vertex_reach_m: f64,
    /// ω_β, on β − β of the start, metres per standard deviation: what keeps β where the masks say little (erratum E11).
    pub shape_weight: f64,
    /// Accepted steps of the dogleg per stage at most.
    pub max_iterations: usize,
    /// A stage ends when its energy falls by less than this fraction (the dogleg's e_3).
    pub improvement_tolerance: f64,
    /// Whether pose, shape and translation are first fitted to outlines and keypoints together: our extension. None leaves the
    /// pose as it is, as in the thesis.
    pub refine_pose: Option<PoseRefinement>,
}

impl Default for SilhouetteOptions {
    /// Table 3.1's synthetic schedule; β and D; rays and pixels; the pose stays.
    fn default() -> SilhouetteOptions {
        SilhouetteOptions {
            stages: Schedule::default().stages().to_vec(),
            unknowns: Unknowns::default(),
            terms: Terms::default(),
            ray_reach_m: 0.12,
            vertex_reach_m: 0.03,
            // A standard deviation of β weighs as much as one ray missed by 3 cm; thousands of rays outvote it.
            shape_weight: 0.03,
            max_iterations: 15,
            improvement_tolerance: 1e-3,
            refine_pose: None,
        }
    }
}

/// The fit of pose, shape and translation to outlines: standard deviations of what is trusted how much.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseRefinement {
    /// Rounds: outline and correspondences are found anew in each.
    pub rounds: usize,
    /// Of a keypoint's coordinate, pixels.
    pub keypoint_sigma_px: f64,
    /// Of a contour point along its normal, pixels: 0.3 of quantisation, the rest for what the model cannot bend to and because
    /// neighbours are not independent.
    pub contour_sigma_px: f64,
    /// A contour point's partner lies within this distance in the first round and in the last, metres at the body's depth;
    /// geometric in between, and never less than two pixels.
    pub reach_m: [f64; 2],
    /// Of a joint angle's change from the start, radians.
    pub pose_sigma_rad: f64,
    /// Of how much too large the masks are all round, pixels; 0 takes them as they are.
    pub mask_bias_sigma_px: f64,
}

impl Default for PoseRefinement {
    /// Chosen on scenes with 2 px of noise on the keypoints; the optimum is flat: halving or doubling any of the numbers changes
    /// the mean error of vertices by a tenth or two.
    fn default() -> PoseRefinement {
        PoseRefinement {
            rounds: 10,
            keypoint_sigma_px: 2.0,
            contour_sigma_px: 1.0,
            reach_m: [0.1, 0.02],
            pose_sigma_rad: 0.2,
            mask_bias_sigma_px: 0.5,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn schedules_are_those_of_table_3_1() {
        let of =
            |schedule: Schedule| schedule.stages().map(|s| (s.laplacian_weight, s.model_weight, s.sigma_m));
        assert_eq!(of(Schedule::Synthetic), [(6.5, 0.9, 0.05), (5.25, 0.75, 0.03), (4.0, 0.6, 0.01)]);
        assert_eq!(of(Schedule::Real), [(6.5, 0.9, 0.08), (5.25, 0.75, 0.04), (4.0, 0.6, 0.03)]);
    }
}
