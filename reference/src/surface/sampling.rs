//! Random points: uniform in a box, area-uniform on a surface.

use super::bounding_box::BoundingBox;
use super::mesh::Mesh;
use crate::linalg::vector::{Vector3, add_scaled, norm, sub};

/// SplitMix64: a small generator whose every seed is good, so that a result can be repeated from one number.
///
/// State s is a counter with the odd step ⌊2⁶⁴/φ⌋; the output is a bijective mix of it. Period 2⁶⁴. Not for
/// cryptography.
///
/// # References
///
/// Steele, Lea and Flood 2014, "Fast splittable pseudorandom number generators"; constants of Vigna's
/// public-domain `splitmix64.c`.
#[derive(Debug, Clone)]
pub struct SplitMix64 {
    state: u64,
}

impl SplitMix64 {
    /// A generator that always gives the same numbers for the same seed.
    pub fn new(seed: u64) -> SplitMix64 {
        SplitMix64 { state: seed }
    }

    /// The next 64 random bits.
    pub fn next_u64(&mut self) -> u64 {
        self.state = self.state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.state;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// A uniform number in [0, 1): the upper 53 bits, as many as an f64 holds.
    pub fn uniform(&mut self) -> f64 {
        (self.next_u64() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// A uniform point of a box.
    pub fn point_in(&mut self, bounds: &BoundingBox) -> Vector3 {
        let extent = bounds.extent();
        [0, 1, 2].map(|axis| bounds.min[axis] + self.uniform() * extent[axis])
    }
}

/// A random point of a surface.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfaceSample {
    /// Where it is.
    pub point: Vector3,
    /// The face that it was drawn from.
    pub face: usize,
}

/// `count` independent points of a mesh, uniform with respect to area.
///
/// A face is drawn with probability proportional to its area, then a point of it: with r₁, r₂ uniform in [0, 1),
///
/// ```text
/// p = (1 − √r₁)·a + √r₁(1 − r₂)·b + √r₁·r₂·c.
/// ```
///
/// The root makes it uniform: √r₁ is the relative size of the triangle cut off at corner a, whose area goes
/// with its square. None if the mesh has no area (or one that is not finite): then there is nothing to draw
/// from.
///
/// # References
///
/// Osada et al. 2002, "Shape distributions". Li 2021, ch. 5 and 6, draws its training points on surfaces
/// so (erratum E25).
pub fn sample_surface(mesh: &Mesh, count: usize, random: &mut SplitMix64) -> Option<Vec<SurfaceSample>> {
    let mut total = 0.0;
    let mut area_up_to = Vec::with_capacity(mesh.faces.len());
    for area_vector in mesh.area_vectors() {
        total += norm(area_vector);
        area_up_to.push(total);
    }
    if !(total > 0.0 && total.is_finite()) {
        return None;
    }
    let draw = |_| {
        let target = random.uniform() * total;
        // The first face whose running total exceeds the target: never one without area.
        let face = area_up_to.partition_point(|&area| area <= target).min(mesh.faces.len() - 1);
        let [a, b, c] = mesh.corners(face);
        let (root, r2) = (random.uniform().sqrt(), random.uniform());
        let point = add_scaled(add_scaled(a, sub(b, a), root * (1.0 - r2)), sub(c, a), root * r2);
        SurfaceSample { point, face }
    };
    Some((0..count).map(draw).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::mesh::tests::cuboid;

    #[test]
    fn the_generator_gives_its_published_numbers() {
        // The first outputs of splitmix64.c for seed 1234567.
        let mut random = SplitMix64::new(1_234_567);
        let expected = [6_457_827_717_110_365_317, 3_203_168_211_198_807_973, 9_817_491_932_198_370_423];
        assert_eq!([(); 3].map(|()| random.next_u64()), expected);
    }

    #[test]
    fn uniform_numbers_stay_below_one() {
        let mut random = SplitMix64::new(7);
        let numbers: Vec<f64> = (0..10_000).map(|_| random.uniform()).collect();
        assert!(numbers.iter().all(|r| (0.0..1.0).contains(r)));
        // Mean of n uniform numbers: ½ with standard deviation 1/√(12n); 5 of them.
        let mean = numbers.iter().sum::<f64>() / 10_000.0;
        assert!((mean - 0.5).abs() < 5.0 / (120_000.0_f64).sqrt());
    }

    #[test]
    fn samples_lie_on_the_face_they_name() {
        let mesh = cuboid([1.0, 2.0, 3.0]);
        let normals = mesh.face_normals();
        for sample in sample_surface(&mesh, 500, &mut SplitMix64::new(1)).unwrap() {
            let corner = mesh.corners(sample.face)[0];
            let height = crate::linalg::vector::dot(sub(sample.point, corner), normals[sample.face]);
            assert!(height.abs() < 1e-15);
            assert!(mesh.bounding_box().unwrap().contains(sample.point));
        }
    }

    #[test]
    fn a_face_without_area_is_never_drawn() {
        let vertices = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]];
        let mesh = Mesh::new(vertices, vec![[0, 0, 1], [0, 1, 2], [1, 1, 1]]);
        let samples = sample_surface(&mesh, 1000, &mut SplitMix64::new(3)).unwrap();
        assert!(samples.iter().all(|sample| sample.face == 1));
    }

    #[test]
    fn nothing_can_be_drawn_from_no_area() {
        assert_eq!(sample_surface(&Mesh::default(), 10, &mut SplitMix64::new(0)), None);
    }
}
