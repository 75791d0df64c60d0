//! What a camera makes of light: exposure, white balance, noise.

use image::RgbImage;
use rand::Rng;

/// One camera's way with light.
#[derive(Clone, Copy, Debug)]
pub struct Sensor {
    /// Factors of red, green, blue.
    gain: [f32; 3],
    /// Standard deviation of the noise in levels of 255.
    noise: f32,
}

impl Sensor {
    /// Draws an exposure within ±30 %, a tint within ±10 % and noise of up to 8 levels, mostly little.
    pub fn random(rng: &mut impl Rng) -> Sensor {
        let exposure = rng.random_range(0.7..1.3f32);
        let gain = std::array::from_fn(|_| exposure * rng.random_range(0.9..1.1f32));
        Sensor { gain, noise: 8.0 * rng.random::<f32>().powi(2) }
    }

    /// Exposes a picture.
    pub fn expose(&self, image: &mut RgbImage, rng: &mut impl Rng) {
        // Four random bytes add up to something close to a normal number of mean 510 and this deviation.
        const DEVIATION: f32 = 147.8;
        let scale = self.noise / DEVIATION;
        for pixel in image.pixels_mut() {
            for (value, gain) in pixel.0.iter_mut().zip(self.gain) {
                let bytes: u32 = rng.random::<[u8; 4]>().map(u32::from).iter().sum();
                *value =
                    (f32::from(*value) * gain + scale * (bytes as f32 - 510.0) + 0.5).clamp(0.0, 255.0) as u8;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::Rgb;

    #[test]
    fn exposure_scales_and_noise_has_its_deviation() {
        let mut rng = crate::synthesis::scene_rng(2, 0);
        let mut image = RgbImage::from_pixel(100, 100, Rgb([100; 3]));
        Sensor { gain: [1.2, 1.0, 0.8], noise: 5.0 }.expose(&mut image, &mut rng);
        for (channel, expected) in [120.0, 100.0, 80.0].into_iter().enumerate() {
            let values: Vec<f64> = image.pixels().map(|p| f64::from(p.0[channel])).collect();
            let mean = values.iter().sum::<f64>() / values.len() as f64;
            let deviation =
                (values.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / values.len() as f64).sqrt();
            assert!((mean - expected).abs() < 0.25, "mean {mean} for {expected}: five standard errors");
            assert!((deviation - 5.0).abs() < 0.25, "deviation {deviation} for 5");
        }
    }
}
