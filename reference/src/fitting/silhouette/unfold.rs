//! Offsets that leave the surface a surface.
//!
//! Offsets are accepted only if no triangle turns its normal against the body without offsets, in the zero pose and in the
//! fitted one, and the volume stays. What violates this is damped. Around turned triangles offsets are averaged with their
//! neighbours; where that does not help (a crease of the posed skin, where the least change turns a triangle) they are scaled
//! down as well, in a region that grows until it does. If the volume is off, all offsets are scaled down.

use crate::linalg::vector::{Vector3, ZERO, add, add_scaled, cross, dot, norm, scale, sub};
use crate::surface::mesh::Mesh;

/// The largest relative change of the volume by offsets.
pub const VOLUME_TOLERANCE: f64 = 0.03;
/// The least cosine between a triangle's normals with and without offsets: a little more than none, so that rounding to
/// f32 in a file turns nothing.
pub const LEAST_COSINE: f64 = 0.05;
/// Rounds of averaging alone, and rounds of all repairs around triangles.
const SMOOTHING_ROUNDS: usize = 8;
const REPAIR_ROUNDS: usize = 40;
/// The factor on the offsets of a region in the rounds after averaging alone: the last rounds leave 10⁻⁵.
const REGION_FACTOR: f64 = 0.7;
/// The factor of each scaling of all offsets.
const BACKTRACKING: f64 = 0.9;

/// What had to be done to the offsets.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Damping {
    /// Rounds of repair around turned triangles.
    pub repair_rounds: usize,
    /// How many vertices the repaired regions have.
    pub repaired_vertices: usize,
    /// The factor on all offsets; 1 if none was needed, 0 if no other kept the surface.
    pub scale: f64,
}

impl Damping {
    /// Nothing was done.
    pub const NONE: Damping = Damping { repair_rounds: 0, repaired_vertices: 0, scale: 1.0 };

    /// Whether nothing was done.
    pub fn is_none(&self) -> bool {
        *self == Damping::NONE
    }
}

/// A body without offsets and how each vertex follows its own offset.
pub struct Surface<'a> {
    /// The triangles.
    pub faces: &'a [[u32; 3]],
    /// Zero pose, V×3.
    pub unposed: &'a [Vector3],
    /// The fitted pose, V×3.
    pub posed: &'a [Vector3],
    /// ∂(posed)/∂(offset), V.
    pub linear: &'a [crate::linalg::matrix::Matrix3],
}

impl Surface<'_> {
    fn moved(&self, offsets: &[Vector3]) -> [Vec<Vector3>; 2] {
        let posed = self.posed.iter().zip(self.linear).zip(offsets);
        [
            self.unposed.iter().zip(offsets).map(|(v, d)| add(*v, *d)).collect(),
            posed.map(|((v, m), d)| add(*v, crate::linalg::matrix::apply(m, *d))).collect(),
        ]
    }

    /// The triangles that offsets turn over.
    pub fn turned(&self, offsets: &[Vector3]) -> Vec<usize> {
        let normal = |vertices: &[Vector3], face: &[u32; 3]| {
            let [a, b, c] = face.map(|v| vertices[v as usize]);
            cross(sub(b, a), sub(c, a))
        };
        let moved = self.moved(offsets);
        (0..self.faces.len())
            .filter(|&f| {
                [self.unposed, self.posed].into_iter().zip(&moved).any(|(before, after)| {
                    let (before, after) = (normal(before, &self.faces[f]), normal(after, &self.faces[f]));
                    // A triangle that has no area without offsets has no normal to turn.
                    norm(before) > 0.0 && dot(before, after) <= LEAST_COSINE * norm(before) * norm(after)
                })
            })
            .collect()
    }

    /// The larger of the two relative changes of the volume, in the zero pose and in the fitted one.
    pub fn volume_change(&self, offsets: &[Vector3]) -> f64 {
        let volume = |vertices: &[Vector3]| {
            Mesh { vertices: vertices.to_vec(), faces: self.faces.to_vec() }.signed_volume()
        };
        let changes = [self.unposed, self.posed]
            .into_iter()
            .zip(self.moved(offsets))
            .map(|(before, after)| (volume(&after) / volume(before) - 1.0).abs());
        changes.fold(0.0, f64::max)
    }

    /// Offsets near those given that turn no triangle and keep the volume, and what it took.
    pub fn unfold(&self, offsets: &[Vector3]) -> (Vec<Vector3>, Damping) {
        let mut offsets = offsets.to_vec();
        let mut damping = Damping::NONE;
        let mut turned = self.turned(&offsets);
        let mut region = vec![false; offsets.len()];
        while !turned.is_empty() && damping.repair_rounds < REPAIR_ROUNDS {
            let around = self.grow(&mut region, &turned);
            if damping.repair_rounds >= SMOOTHING_ROUNDS {
                for (offset, _) in offsets.iter_mut().zip(&around).filter(|(_, turns)| **turns) {
                    *offset = scale(*offset, REGION_FACTOR);
                }
            }
            self.smooth(&region, &mut offsets);
            damping.repair_rounds += 1;
            turned = self.turned(&offsets);
        }
        damping.repaired_vertices = region.iter().filter(|inside| **inside).count();
        while !turned.is_empty() || self.volume_change(&offsets) > VOLUME_TOLERANCE {
            damping.scale = if damping.scale > 1e-3 { damping.scale * BACKTRACKING } else { 0.0 };
            if damping.scale == 0.0 {
                offsets.fill(ZERO);
                break;
            }
            offsets.iter_mut().for_each(|d| *d = scale(*d, BACKTRACKING));
            turned = self.turned(&offsets);
        }
        (offsets, damping)
    }

    /// Adds the corners of these triangles to the region, and the triangles around them; returns what was to be added.
    ///
    /// The region keeps what it had. Where it held the corners already it grows by a ring: its surroundings are the reason.
    fn grow(&self, region: &mut [bool], triangles: &[usize]) -> Vec<bool> {
        let mut core = vec![false; region.len()];
        for &triangle in triangles {
            self.faces[triangle].iter().for_each(|&v| core[v as usize] = true);
        }
        let stubborn = core.iter().zip(&*region).any(|(core, known)| *core && *known);
        let around = self.with_ring(&core);
        if stubborn {
            let ring = self.with_ring(region);
            region.copy_from_slice(&ring);
        }
        region.iter_mut().zip(&around).for_each(|(inside, added)| *inside |= added);
        around
    }

    /// A set of vertices with all vertices that share a triangle with it.
    fn with_ring(&self, set: &[bool]) -> Vec<bool> {
        let mut wider = set.to_vec();
        for face in self.faces.iter().filter(|face| face.iter().any(|&v| set[v as usize])) {
            face.iter().for_each(|&v| wider[v as usize] = true);
        }
        wider
    }

    /// Replaces the offsets of a region by the mean of their neighbours' (each counted once per common triangle).
    fn smooth(&self, region: &[bool], offsets: &mut [Vector3]) {
        let mut sums = vec![(ZERO, 0.0); offsets.len()];
        for face in self.faces.iter().filter(|face| face.iter().any(|&v| region[v as usize])) {
            for &to in face {
                for &from in face.iter().filter(|&&from| from != to) {
                    let (sum, count) = sums[to as usize];
                    sums[to as usize] = (add_scaled(sum, offsets[from as usize], 1.0), count + 1.0);
                }
            }
        }
        for (i, (sum, count)) in sums.into_iter().enumerate() {
            if region[i] && count > 0.0 {
                offsets[i] = scale(sum, 1.0 / count);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::matrix::{IDENTITY, Matrix3};
    use crate::surface::mesh::tests::cuboid;

    fn with_surface<R>(mesh: &Mesh, act: impl FnOnce(Surface) -> R) -> R {
        let linear: Vec<Matrix3> = vec![IDENTITY; mesh.vertices.len()];
        act(Surface { faces: &mesh.faces, unposed: &mesh.vertices, posed: &mesh.vertices, linear: &linear })
    }

    /// A tetrahedron with a lid that is divided at `apex`.
    fn divided(apex: Vector3) -> Mesh {
        let vertices = vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0], apex];
        Mesh::new(vertices, vec![[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 4], [2, 3, 4], [3, 1, 4]])
    }

    #[test]
    fn good_offsets_are_left_alone() {
        let mesh = cuboid([1.0; 3]);
        let offsets = vec![[0.004, -0.002, 0.001]; 8];
        with_surface(&mesh, |surface| assert_eq!(surface.unfold(&offsets), (offsets.clone(), Damping::NONE)));
    }

    #[test]
    fn swelling_is_scaled_down_to_the_tolerance() {
        let mesh = cuboid([1.0; 3]);
        // Every corner outwards by a tenth: the volume grows by 73 %.
        let offsets: Vec<Vector3> =
            mesh.vertices.iter().map(|v| v.map(|x| if x > 0.5 { 0.1 } else { -0.1 })).collect();
        with_surface(&mesh, |surface| {
            let (damped, damping) = surface.unfold(&offsets);
            assert!(
                surface.volume_change(&damped) <= VOLUME_TOLERANCE && damping.scale < 0.06,
                "{damping:?}"
            );
            assert!(surface.volume_change(&damped) > 0.8 * VOLUME_TOLERANCE);
        });
    }

    #[test]
    fn a_turned_triangle_is_smoothed_back() {
        let mesh = divided([0.33, 0.33, 0.34]);
        // The divided lid's middle is pulled across one of its sides.
        let mut offsets = vec![ZERO; 5];
        offsets[4] = [0.5, 0.4, -0.9];
        with_surface(&mesh, |surface| {
            assert!(!surface.turned(&offsets).is_empty());
            let (damped, damping) = surface.unfold(&offsets);
            assert!(surface.turned(&damped).is_empty() && damping.repair_rounds > 0, "{damping:?}");
        });
    }
}
