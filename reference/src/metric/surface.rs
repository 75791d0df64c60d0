//! Distances between surfaces, and overlap of the volumes that they enclose.

use crate::linalg::vector::{Vector3, dot};
use crate::surface::aabb_tree::AabbTree;
use crate::surface::inside::Inside;
use crate::surface::mesh::Mesh;
use crate::surface::sampling::{SplitMix64, sample_surface};

/// Means over the two directions between a predicted surface S and the true surface T.
///
/// Points p are drawn area-uniformly from one surface; d is the distance to the nearest point of the
/// *triangles* of the other, not to samples of it, so that identical surfaces are at distance 0 (to rounding)
/// whatever the number of samples.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceDistance {
    /// P2S: mean d from S to T, metres. Li 2021 prints it in cm.
    pub p2s: f64,
    /// Mean d from T to S, metres: large where the prediction misses a limb, which P2S does not see.
    pub completeness: f64,
    /// Chamfer-L2: ½·mean d²(S → T) + ½·mean d²(T → S), *square* metres.
    ///
    /// Li 2021 says centimetres, which no squared distance has, and which its own P2S rules out: the mean of d²
    /// is at least the square of the mean, so Chamfer-L2 ≥ ½·P2S². Read as 10⁻² m² every row of its tables
    /// agrees with that bound (erratum E15); print 100 times this number to compare with them.
    pub chamfer_l2: f64,
    /// Mean |n·n'| of the unit normals at a sample and at its nearest point, over both directions: 1 for equal
    /// surfaces.
    pub normal_consistency: f64,
}

impl SurfaceDistance {
    /// Compares two surfaces with `samples` points from each; the same seed gives the same points.
    ///
    /// None if either has no area, or one that is not finite: then there is nothing to measure from or to.
    ///
    /// # Panics
    ///
    /// If `samples` is 0.
    ///
    /// # References
    ///
    /// Li 2021, ch. 5 and 6; Saito et al. 2019 (PIFu) for P2S; Chibane et al. 2020 (IF-Net) for Chamfer-L2 and
    /// normal consistency, there from samples to samples.
    pub fn between(predicted: &Mesh, truth: &Mesh, samples: usize, seed: u64) -> Option<SurfaceDistance> {
        assert!(samples > 0, "surface distance: a mean over 0 samples");
        let mut random = SplitMix64::new(seed);
        let forth = OneWay::between(predicted, truth, samples, &mut random)?;
        let back = OneWay::between(truth, predicted, samples, &mut random)?;
        Some(SurfaceDistance {
            p2s: forth.distance,
            completeness: back.distance,
            chamfer_l2: 0.5 * (forth.distance_squared + back.distance_squared),
            normal_consistency: 0.5 * (forth.normal_agreement + back.normal_agreement),
        })
    }
}

/// Means over the samples of one surface.
struct OneWay {
    distance: f64,
    distance_squared: f64,
    normal_agreement: f64,
}

impl OneWay {
    fn between(from: &Mesh, to: &Mesh, samples: usize, random: &mut SplitMix64) -> Option<OneWay> {
        let tree = AabbTree::new(to)?;
        let [normals_from, normals_to] = [from.face_normals(), to.face_normals()];
        let mut sums = OneWay { distance: 0.0, distance_squared: 0.0, normal_agreement: 0.0 };
        for sample in sample_surface(from, samples, random)? {
            let nearest = tree.closest(sample.point);
            sums.distance += nearest.distance();
            sums.distance_squared += nearest.closest.distance_squared;
            sums.normal_agreement += dot(normals_from[sample.face], normals_to[nearest.face]).abs();
        }
        let mean = |sum: f64| sum / samples as f64;
        Some(OneWay {
            distance: mean(sums.distance),
            distance_squared: mean(sums.distance_squared),
            normal_agreement: mean(sums.normal_agreement),
        })
    }
}

/// How much wider than both meshes the box of [`volume_iou`] is, on each side, as a fraction of its extent.
///
/// The padding cancels in the ratio; it is there so that a shape that fills its bounding box is still seen from
/// outside.
const IOU_PADDING: f64 = 0.05;

/// Intersection over union |A ∩ B| / |A ∪ B| of the volumes inside two closed meshes, in 0 … 1: a fraction,
/// although Li 2021 says "measured as cm" (erratum E16).
///
/// Estimated from `points` uniform points of the box around both, padded by 5 %. With n of them in the union
/// the standard error is √(IoU·(1 − IoU)/n): a body fills about a tenth of its box, so 10⁶ points give ±0.002
/// or better. None if no point is inside either mesh.
///
/// # References
///
/// Chibane et al. 2020 (IF-Net), with 10⁶ points; Li 2021, ch. 5 and 6.
pub fn volume_iou(a: &Mesh, b: &Mesh, points: usize, seed: u64) -> Option<f64> {
    let boxes = [a.bounding_box(), b.bounding_box()];
    let bounds = boxes.into_iter().flatten().reduce(|a, b| a.union(&b))?.padded(IOU_PADDING);
    let [inside_a, inside_b] = [Inside::new(a), Inside::new(b)];
    let mut random = SplitMix64::new(seed);
    let (mut both, mut either) = (0_usize, 0_usize);
    for _ in 0..points {
        let point: Vector3 = random.point_in(&bounds);
        let (in_a, in_b) = (inside_a.contains(point), inside_b.contains(point));
        both += usize::from(in_a && in_b);
        either += usize::from(in_a || in_b);
    }
    (either > 0).then(|| both as f64 / either as f64)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::matrix;
    use crate::surface::mesh::tests::cuboid;

    const SAMPLES: usize = 2000;

    fn shifted(mesh: &Mesh, by: Vector3) -> Mesh {
        mesh.affine(&matrix::IDENTITY, by)
    }

    #[test]
    fn identical_surfaces_are_at_distance_zero() {
        let mesh = cuboid([1.0, 2.0, 3.0]);
        let found = SurfaceDistance::between(&mesh, &mesh, SAMPLES, 1).unwrap();
        assert!(found.p2s < 1e-15 && found.completeness < 1e-15 && found.chamfer_l2 < 1e-30);
        assert!((found.normal_consistency - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_missing_half_shows_in_completeness_only() {
        // The prediction is the bottom of the box alone.
        let whole = cuboid([1.0, 1.0, 1.0]);
        let bottom = Mesh { faces: whole.faces[8..10].to_vec(), ..whole.clone() };
        let found = SurfaceDistance::between(&bottom, &whole, SAMPLES, 2).unwrap();
        assert!(found.p2s < 1e-15);
        // Mean height: ½ over the four sides, 1 on the lid, 0 on the bottom; its variance over the box is below
        // ¼.
        assert!((found.completeness - 0.5).abs() < 5.0 * 0.5 / (SAMPLES as f64).sqrt());
    }

    #[test]
    fn sheets_a_tenth_apart_have_their_distance_everywhere() {
        let square = Mesh { faces: cuboid([1.0; 3]).faces[8..10].to_vec(), ..cuboid([1.0; 3]) };
        let found =
            SurfaceDistance::between(&shifted(&square, [0.0, 0.0, 0.1]), &square, SAMPLES, 3).unwrap();
        assert!((found.p2s - 0.1).abs() < 1e-12 && (found.completeness - 0.1).abs() < 1e-12);
        assert!((found.chamfer_l2 - 0.01).abs() < 1e-12);
    }

    #[test]
    fn half_a_box_over_is_a_third() {
        let mesh = cuboid([1.0, 1.0, 1.0]);
        let points = 40_000;
        let found = volume_iou(&mesh, &shifted(&mesh, [0.5, 0.0, 0.0]), points, 4).unwrap();
        // The union fills 1.1⁻³ of the padded box; five standard errors.
        let in_union = points as f64 / 1.1_f64.powi(3);
        assert!((found - 1.0 / 3.0).abs() < 5.0 * (2.0 / 9.0 / in_union).sqrt(), "{found}");
    }

    #[test]
    fn distant_volumes_do_not_overlap_and_equal_ones_do_wholly() {
        let mesh = cuboid([1.0, 1.0, 1.0]);
        assert_eq!(volume_iou(&mesh, &shifted(&mesh, [3.0, 0.0, 0.0]), 1000, 5), Some(0.0));
        assert_eq!(volume_iou(&mesh, &mesh, 1000, 5), Some(1.0));
        assert_eq!(volume_iou(&mesh, &Mesh::default(), 1000, 5), Some(0.0));
    }

    #[test]
    fn nothing_has_no_distance_and_no_overlap() {
        let mesh = cuboid([1.0, 1.0, 1.0]);
        let nothing = Mesh::default();
        assert_eq!(SurfaceDistance::between(&nothing, &mesh, 10, 0), None);
        assert_eq!(SurfaceDistance::between(&mesh, &nothing, 10, 0), None);
        assert_eq!(volume_iou(&nothing, &nothing, 10, 0), None);
    }
}
