//! Random pictures to stand behind a person: walls and floors, skies and ground, clutter, texture.
//!
//! None looks like a place. Together they hold what a network must learn to pass over: edges in every direction,
//! gradients, stripes, colours like skin's and cloth's, and noise at every scale.

use image::{Rgb, RgbImage};
use rand::Rng;

use super::appearance::Colour;
use super::normal;

/// Draws a picture of `width` × `height` pixels.
pub fn random_backdrop(rng: &mut impl Rng, width: u32, height: u32) -> RgbImage {
    let mut canvas = Canvas::new(width, height);
    canvas.lay_ground(rng);
    for _ in 0..rng.random_range(0..14) {
        canvas.add_shape(rng);
    }
    canvas.add_texture(rng);
    canvas.develop(rng.random_range(0..4))
}

/// A grey of any brightness with some colour: most are dull, some are loud.
pub fn random_colour(rng: &mut impl Rng) -> Colour {
    let grey: f32 = rng.random_range(0.03..0.97);
    let chroma = if rng.random_bool(0.25) { 0.35 } else { 0.08 };
    std::array::from_fn(|_| (grey + chroma * normal(rng, 2.0) as f32).clamp(0.0, 1.0))
}

/// A picture in the making: linear positions in pixels, colours 0..1.
struct Canvas {
    width: usize,
    height: usize,
    pixels: Vec<Colour>,
}

impl Canvas {
    fn new(width: u32, height: u32) -> Canvas {
        let (width, height) = (width as usize, height as usize);
        Canvas { width, height, pixels: vec![[0.0; 3]; width * height] }
    }

    /// Sets every pixel to `colour` of its centre, both coordinates 0..1 across the picture.
    fn paint(&mut self, colour: impl Fn([f32; 2], Colour) -> Colour) {
        for (row, line) in self.pixels.chunks_exact_mut(self.width).enumerate() {
            let v = (row as f32 + 0.5) / self.height as f32;
            for (column, pixel) in line.iter_mut().enumerate() {
                *pixel = colour([(column as f32 + 0.5) / self.width as f32, v], *pixel);
            }
        }
    }

    /// A gradient in any direction, or two gradients that meet in a horizon, the lower perhaps planked or tiled.
    fn lay_ground(&mut self, rng: &mut impl Rng) {
        let [a, b, c, d]: [Colour; 4] = std::array::from_fn(|_| random_colour(rng));
        let (x, y) = direction(rng);
        if rng.random_bool(0.35) {
            return self.paint(|[u, v], _| mix(a, b, 0.5 + (u - 0.5) * x + (v - 0.5) * y));
        }
        let horizon = rng.random_range(0.35..0.9f32);
        let lean = 0.06 * normal(rng, 2.0) as f32;
        let soft = 0.3 * rng.random::<f32>();
        let tiles = rng.random_bool(0.4).then(|| (rng.random_range(2.0..12.0f32), rng.random_bool(0.5)));
        self.paint(|[u, v], _| {
            let below = v - horizon - lean * (u - 0.5);
            if below < 0.0 {
                return mix(a, mix(a, b, soft), 0.5 + (u - 0.5) * x + (v - 0.5) * y);
            }
            let depth = 0.3 / (below + 0.08);
            let Some((count, checked)) = tiles else { return mix(c, mix(c, d, soft), below) };
            let across = ((u - 0.5) * depth * count).floor() as i32;
            let along = if checked { (depth * count).floor() as i32 } else { 0 };
            if (across + along).rem_euclid(2) == 0 { c } else { mix(c, d, soft) }
        });
    }

    /// A rectangle, an ellipse or a bar, anywhere and at any angle, plain, shaded or striped.
    fn add_shape(&mut self, rng: &mut impl Rng) {
        let [a, b]: [Colour; 2] = std::array::from_fn(|_| random_colour(rng));
        let centre = [rng.random_range(-0.1..1.1f32), rng.random_range(-0.1..1.1f32)];
        let angle =
            if rng.random_bool(0.6) { 0.03 * normal(rng, 2.0) as f32 } else { rng.random_range(-1.6..1.6) };
        let (sine, cosine) = angle.sin_cos();
        let round = rng.random_bool(0.3);
        let bar = !round && rng.random_bool(0.3);
        let half: [f32; 2] = match bar {
            true => [rng.random_range(0.004..0.03), rng.random_range(0.2..1.0)],
            false => [rng.random_range(0.02..0.28), rng.random_range(0.02..0.28)],
        };
        let stripes = rng.random_bool(0.25).then(|| rng.random_range(2.0..10.0f32));
        let shade: f32 = rng.random_range(0.0..0.6);
        self.paint(|[u, v], below| {
            let (x, y) = (u - centre[0], v - centre[1]);
            let local = [(cosine * x + sine * y) / half[0], (cosine * y - sine * x) / half[1]];
            let inside = match round {
                true => local[0] * local[0] + local[1] * local[1] < 1.0,
                false => local[0].abs() < 1.0 && local[1].abs() < 1.0,
            };
            match stripes {
                _ if !inside => below,
                Some(count) if (local[1] * count).floor() as i32 % 2 != 0 => b,
                Some(_) => a,
                None => mix(a, b, shade * (0.5 + 0.5 * local[1])),
            }
        });
    }

    /// Noise between neighbouring lattice points at several scales, coarse to fine, of one random strength.
    fn add_texture(&mut self, rng: &mut impl Rng) {
        let strength = 0.22 * rng.random::<f32>().powi(2);
        let roughness = rng.random_range(0.4..1.0f32);
        let coloured = if rng.random_bool(0.3) { 0.7 } else { 0.1 };
        let mut amplitude = strength;
        for cell in [96usize, 40, 16, 7, 3] {
            let columns = self.width / cell + 2;
            let lattice: Vec<Colour> = (0..columns * (self.height / cell + 2))
                .map(|_| {
                    let grey = rng.random_range(-1.0..1.0f32);
                    std::array::from_fn(|_| grey + coloured * (rng.random_range(-1.0..1.0f32) - grey))
                })
                .collect();
            for row in 0..self.height {
                let (i, t) = (row / cell, (row % cell) as f32 / cell as f32);
                for column in 0..self.width {
                    let (j, s) = (column / cell, (column % cell) as f32 / cell as f32);
                    let at = |i: usize, j: usize| lattice[i * columns + j];
                    let value =
                        mix(mix(at(i, j), at(i, j + 1), s), mix(at(i + 1, j), at(i + 1, j + 1), s), t);
                    let pixel = &mut self.pixels[row * self.width + column];
                    *pixel = std::array::from_fn(|k| pixel[k] + amplitude * value[k]);
                }
            }
            amplitude *= roughness;
        }
    }

    /// The picture, out of focus by a mean over squares of 2·`blur` + 1 pixels.
    fn develop(self, blur: usize) -> RgbImage {
        let rows = blurred(&self.pixels, self.width, blur);
        let columns = blurred(&transposed(&rows, self.width), self.height, blur);
        let pixels = transposed(&columns, self.height);
        RgbImage::from_fn(self.width as u32, self.height as u32, |column, row| {
            let colour = pixels[row as usize * self.width + column as usize];
            Rgb(colour.map(|c| (c.clamp(0.0, 1.0) * 255.0 + 0.5) as u8))
        })
    }
}

/// The mean over 2·`reach` + 1 neighbours in each row, fewer at its ends.
fn blurred(pixels: &[Colour], width: usize, reach: usize) -> Vec<Colour> {
    let mut means = Vec::with_capacity(pixels.len());
    for line in pixels.chunks_exact(width) {
        for column in 0..width {
            let near = &line[column.saturating_sub(reach)..(column + reach + 1).min(width)];
            means.push(std::array::from_fn(|k| near.iter().map(|c| c[k]).sum::<f32>() / near.len() as f32));
        }
    }
    means
}

fn transposed(pixels: &[Colour], width: usize) -> Vec<Colour> {
    let height = pixels.len() / width;
    (0..pixels.len()).map(|k| pixels[(k % height) * width + k / height]).collect()
}

fn direction(rng: &mut impl Rng) -> (f32, f32) {
    rng.random_range(0.0..std::f32::consts::TAU).sin_cos()
}

/// From `a` at t ≤ 0 to `b` at t ≥ 1.
fn mix(a: Colour, b: Colour, t: f32) -> Colour {
    let t = t.clamp(0.0, 1.0);
    std::array::from_fn(|k| a[k] + t * (b[k] - a[k]))
}
