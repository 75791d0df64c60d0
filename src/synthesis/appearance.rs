//! Random colours of skin, hair and garments, and random light.

use rand::Rng;
use vitruvian_reference::linalg::vector::Vector3;

use super::clothing::Garment;
use super::normal;

/// Red, green, blue in 0..1.
pub type Colour = [f32; 3];

/// Draws one colour per vertex: a skin tone, hair on the upper head, and a colour with stripes or mottling per garment.
///
/// `rest` are the V rest vertices in metres, `head` the V weights of the head joint.
pub fn random_colours(
    rng: &mut impl Rng,
    rest: &[Vector3],
    head: &[f64],
    wardrobe: &[Garment],
) -> Vec<Colour> {
    let tone: f32 = rng.random();
    let skin = mix([0.30, 0.19, 0.13], [0.93, 0.76, 0.65], tone);
    let hair = mix([0.08, 0.06, 0.05], [0.75, 0.6, 0.4], rng.random::<f32>().powi(2));
    let top = rest.iter().map(|v| v[1]).fold(f64::NEG_INFINITY, f64::max);
    let hairline = top - rng.random_range(0.03..0.10);
    let mut colours: Vec<Colour> = rest
        .iter()
        .zip(head)
        .map(|(v, &weight)| if weight > 0.5 && v[1] - 0.35 * v[2].max(0.0) > hairline { hair } else { skin })
        .collect();
    for garment in wardrobe {
        let pattern = Pattern::random(rng);
        for ((colour, &v), &cover) in colours.iter_mut().zip(rest).zip(&garment.cover) {
            *colour = mix(*colour, pattern.at(v), if cover > 0.3 { 1.0 } else { 0.0 });
        }
    }
    colours
}

/// Cloth: two colours that alternate along a direction, hard (stripes) or soft (shading).
struct Pattern {
    colours: [Colour; 2],
    wave: Vector3,
    phase: f64,
    hard: bool,
}

impl Pattern {
    fn random(rng: &mut impl Rng) -> Self {
        let base: Colour = std::array::from_fn(|_| rng.random_range(0.08..0.95));
        let contrast = if rng.random_bool(0.4) { 0.35 } else { 0.06 };
        let other = base.map(|c| (c + contrast * normal(rng, 2.0) as f32).clamp(0.03, 0.97));
        Self {
            colours: [base, other],
            wave: std::array::from_fn(|_| 40.0 * normal(rng, 2.0)),
            phase: rng.random_range(0.0..std::f64::consts::TAU),
            hard: rng.random(),
        }
    }

    fn at(&self, v: Vector3) -> Colour {
        let s = (self.wave[0] * v[0] + self.wave[1] * v[1] + self.wave[2] * v[2] + self.phase).sin();
        let t = if self.hard { f64::from(s > 0.0) } else { 0.5 + 0.5 * s };
        mix(self.colours[0], self.colours[1], t as f32)
    }
}

fn mix(a: Colour, b: Colour, t: f32) -> Colour {
    std::array::from_fn(|k| a[k] + t * (b[k] - a[k]))
}
