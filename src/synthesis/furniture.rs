//! Simple things that stand or hang before a person: crates, tables, chairs, poles, boards, balls.

use rand::Rng;
use vitruvian_runtime::mesh::Mesh;

use super::appearance::Colour;
use super::backdrop::random_colour;

/// Coloured surfaces with a normal at every vertex; edges are sharp because faces share no vertices across them.
#[derive(Clone, Debug, Default)]
pub struct Furniture {
    /// Surfaces in metres.
    pub mesh: Mesh,
    /// Unit outward normal of each vertex.
    pub normals: Vec<[f32; 3]>,
    /// Colour of each vertex.
    pub colours: Vec<Colour>,
}

/// Number of sides of a pole, and of meridians of a ball.
const SIDES: usize = 20;

impl Furniture {
    /// Draws one piece around the vertical axis through the origin, standing on y = 0 or held above it.
    pub fn random(rng: &mut impl Rng) -> Furniture {
        let mut piece = Furniture::default();
        let [a, b]: [Colour; 2] = std::array::from_fn(|_| random_colour(rng));
        match rng.random_range(0..6) {
            0 => {
                let [w, h, d] =
                    [rng.random_range(0.3..1.0), rng.random_range(0.3..1.1), rng.random_range(0.2..0.5)];
                piece.add_box([-w / 2.0, 0.0, -d / 2.0], [w / 2.0, h, d / 2.0], a);
                piece.add_box([-w / 2.0, h, -d / 2.0], [w / 2.0, h + 0.03, d / 2.0], b);
            }
            1 => {
                let [w, h, d] =
                    [rng.random_range(0.5..1.4), rng.random_range(0.5..1.0), rng.random_range(0.25..0.5)];
                piece.add_legs([w, h, d], 0.05, a);
                piece.add_box([-w / 2.0, h, -d / 2.0], [w / 2.0, h + 0.06, d / 2.0], b);
            }
            2 => {
                let [w, h] = [rng.random_range(0.38..0.5f32), rng.random_range(0.4..0.5f32)];
                let back = h + rng.random_range(0.35..0.6);
                piece.add_legs([w, h, w], 0.035, a);
                piece.add_box([-w / 2.0, h, -w / 2.0], [w / 2.0, h + 0.05, w / 2.0], b);
                piece.add_box([-w / 2.0, h, -w / 2.0], [w / 2.0, back, 0.04 - w / 2.0], b);
            }
            3 => piece.add_pole(rng.random_range(0.025..0.11), rng.random_range(1.2..3.0), a),
            4 => {
                let [w, h] = [rng.random_range(0.25..0.8f32), rng.random_range(0.2..0.7f32)];
                let low = rng.random_range(0.2..1.4);
                piece.add_pole(0.02, low, a);
                piece.add_box([-w / 2.0, low, -0.02], [w / 2.0, low + h, 0.02], b);
            }
            _ => piece.add_ball([0.0, rng.random_range(0.2..1.7), 0.0], rng.random_range(0.1..0.26), [a, b]),
        }
        piece
    }

    /// Adds all of another piece.
    pub fn extend(&mut self, other: &Furniture) {
        let first = self.mesh.vertices.len() as u32;
        self.mesh.vertices.extend(&other.mesh.vertices);
        self.mesh.faces.extend(other.mesh.faces.iter().map(|face| face.map(|i| first + i)));
        self.normals.extend(&other.normals);
        self.colours.extend(&other.colours);
    }

    /// The piece turned by `heading` (radians) about the vertical axis and then moved.
    pub fn placed(mut self, heading: f32, to: [f32; 3]) -> Furniture {
        let (sine, cosine) = heading.sin_cos();
        let turn = |[x, y, z]: [f32; 3]| [cosine * x + sine * z, y, cosine * z - sine * x];
        for vertex in &mut self.mesh.vertices {
            let turned = turn(*vertex);
            *vertex = std::array::from_fn(|k| turned[k] + to[k]);
        }
        self.normals.iter_mut().for_each(|n| *n = turn(*n));
        self
    }

    /// The largest distance of a vertex from the vertical axis through the origin.
    pub fn radius(&self) -> f32 {
        self.mesh.vertices.iter().map(|v| v[0].hypot(v[2])).fold(0.0, f32::max)
    }

    fn add_box(&mut self, low: [f32; 3], high: [f32; 3], colour: Colour) {
        for axis in 0..3 {
            let (next, last) = ((axis + 1) % 3, (axis + 2) % 3);
            for (side, sign) in [(low, -1.0), (high, 1.0)] {
                let mut normal = [0.0; 3];
                normal[axis] = sign;
                let mut corners =
                    [(false, false), (true, false), (true, true), (false, true)].map(|(n, l)| {
                        let mut corner = side;
                        corner[next] = if n { high[next] } else { low[next] };
                        corner[last] = if l { high[last] } else { low[last] };
                        corner
                    });
                if sign < 0.0 {
                    corners.reverse();
                }
                self.add_strip(&corners, &[normal; 4], colour);
            }
        }
    }

    /// Four legs under a top of width, height and depth `size`.
    fn add_legs(&mut self, size: [f32; 3], thickness: f32, colour: Colour) {
        for x in [-size[0] / 2.0, size[0] / 2.0 - thickness] {
            for z in [-size[2] / 2.0, size[2] / 2.0 - thickness] {
                self.add_box([x, 0.0, z], [x + thickness, size[1], z + thickness], colour);
            }
        }
    }

    fn add_pole(&mut self, radius: f32, height: f32, colour: Colour) {
        for k in 0..SIDES {
            let [a, b] = [k, k + 1].map(|k| around(k).map(|x| radius * x));
            let [n, m] = [k, k + 1].map(|k| [around(k)[0], 0.0, around(k)[1]]);
            let corners = [[a[0], 0.0, a[1]], [b[0], 0.0, b[1]], [b[0], height, b[1]], [a[0], height, a[1]]];
            self.add_strip(&corners, &[n, m, m, n], colour);
        }
    }

    /// A ball in two colours, one for every other meridian.
    fn add_ball(&mut self, centre: [f32; 3], radius: f32, colours: [Colour; 2]) {
        let at = |i: usize, k: usize| {
            let (out, up) = (std::f32::consts::PI * i as f32 / (SIDES / 2) as f32).sin_cos();
            let [x, z] = around(k);
            [out * x, up, out * z]
        };
        for i in 0..SIDES / 2 {
            for k in 0..SIDES {
                let normals = [at(i, k), at(i + 1, k), at(i + 1, k + 1), at(i, k + 1)];
                let corners = normals.map(|n| std::array::from_fn(|a| centre[a] + radius * n[a]));
                self.add_strip(&corners, &normals, colours[k / 2 % 2]);
            }
        }
    }

    /// A quadrilateral, counter-clockwise seen from outside.
    fn add_strip(&mut self, corners: &[[f32; 3]; 4], normals: &[[f32; 3]; 4], colour: Colour) {
        let first = self.mesh.vertices.len() as u32;
        self.mesh.vertices.extend(corners);
        self.normals.extend(normals);
        self.colours.extend([colour; 4]);
        self.mesh.faces.extend([[first, first + 1, first + 2], [first, first + 2, first + 3]]);
    }
}

/// Point `k` of [`SIDES`] on the unit circle.
fn around(k: usize) -> [f32; 2] {
    let (sine, cosine) = (std::f32::consts::TAU * (k % SIDES) as f32 / SIDES as f32).sin_cos();
    [sine, cosine]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faces_wind_counter_clockwise_around_their_normals() {
        let mut rng = crate::synthesis::scene_rng(1, 0);
        for _ in 0..60 {
            let piece = Furniture::random(&mut rng).placed(0.7, [1.0, 0.0, -2.0]);
            assert_eq!(
                (piece.normals.len(), piece.colours.len()),
                (piece.mesh.vertices.len(), piece.normals.len())
            );
            for face in &piece.mesh.faces {
                let [a, b, c] = face.map(|i| piece.mesh.vertices[i as usize]);
                let [e, f]: [[f32; 3]; 2] = [b, c].map(|p| std::array::from_fn(|k| p[k] - a[k]));
                let n = [e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2], e[0] * f[1] - e[1] * f[0]];
                let dot = |m: [f32; 3]| (0..3).map(|k| n[k] * m[k]).sum::<f32>();
                // At the poles of a ball one of the two triangles has no area.
                let area = dot(n).sqrt();
                assert!(area < 1e-6 || face.iter().all(|&i| dot(piece.normals[i as usize]) > 0.5 * area));
            }
            for n in &piece.normals {
                assert!((n.iter().map(|x| x * x).sum::<f32>() - 1.0).abs() < 1e-5, "{n:?}");
            }
        }
    }
}
