//! Numbers as colours: viridis, whose lightness grows evenly with the value, and its scale to read it by.

use image::{Rgb, RgbImage};

use super::text;

/// Red, green and blue as polynomials of degree six in the value, constant first.
///
/// A least-squares fit to matplotlib's table by M. Zucker (public domain); off by less than 2 % of full range.
const VIRIDIS: [[f64; 3]; 7] = [
    [0.2777273272234177, 0.005407344544966578, 0.3340998053353061],
    [0.1050930431085774, 1.404613529898575, 1.384590162594685],
    [-0.3308618287255563, 0.214847559468213, 0.09509516302823659],
    [-4.634230498983486, -5.799100973351585, -19.33244095627987],
    [6.228269936347081, 14.17993336680509, 56.69055260068105],
    [4.776384997670288, -13.74514537774601, -65.35303263337234],
    [-5.435455855934631, 4.645852612178535, 26.3124352495832],
];

/// The colour (0..1) of a value from 0 (dark violet) to 1 (yellow); values beyond are limited, NaN is grey.
pub fn viridis(value: f32) -> [f32; 3] {
    if value.is_nan() {
        return [0.5; 3];
    }
    let x = f64::from(value.clamp(0.0, 1.0));
    std::array::from_fn(|c| VIRIDIS.iter().rev().fold(0.0, |sum, k| sum * x + k[c]).clamp(0.0, 1.0) as f32)
}

/// One colour per value, 0 to `greatest` over the whole map; an unusable `greatest` counts as the largest value.
pub fn heat(values: &[f32], greatest: f32) -> Vec<[f32; 3]> {
    let largest = values.iter().copied().filter(|v| v.is_finite()).fold(0.0f32, f32::max);
    let scale =
        if greatest.is_finite() && greatest > 0.0 { greatest } else { largest.max(f32::MIN_POSITIVE) };
    values.iter().map(|v| viridis(v / scale)).collect()
}

/// An upright scale from 0 (bottom) to `greatest` (top) with five numbers and the unit beside it, on white.
pub fn color_bar(width: u32, height: u32, greatest: f32, unit: &str) -> RgbImage {
    let mut image = RgbImage::from_pixel(width, height, Rgb([255; 3]));
    let margin = 2 * text::HEIGHT;
    let (top, bottom) = (2 * margin, height.saturating_sub(margin));
    if bottom <= top + 1 {
        return image;
    }
    let bar = (width / 4).clamp(1, 24);
    for row in top..bottom {
        let value = (bottom - 1 - row) as f32 / (bottom - 1 - top) as f32;
        let color = viridis(value).map(|c| (255.0 * c + 0.5) as u8);
        text::fill(&mut image, margin / 2, row, bar, 1, color);
    }
    text::draw(&mut image, margin / 2, margin / 2, unit, 1, [0; 3]);
    for tick in 0..5 {
        let row = bottom - 1 - (bottom - 1 - top) * tick / 4;
        let left = margin / 2 + bar;
        text::fill(&mut image, left, row, 4, 1, [0; 3]);
        let number = format!("{:.3}", greatest * tick as f32 / 4.0);
        let number = number.trim_end_matches('0').trim_end_matches('.');
        text::draw(&mut image, left + 6, row.saturating_sub(text::HEIGHT / 2), number, 1, [0; 3]);
    }
    image
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lightness_grows_with_the_value_between_the_known_ends() {
        let near =
            |a: [f32; 3], b: [u8; 3]| a.iter().zip(b).all(|(a, b)| (a - f32::from(b) / 255.0).abs() < 0.03);
        // matplotlib's viridis at 0, 1/2 and 1.
        assert!(near(viridis(0.0), [68, 1, 84]), "{:?}", viridis(0.0));
        assert!(near(viridis(0.5), [33, 145, 140]), "{:?}", viridis(0.5));
        assert!(near(viridis(1.0), [253, 231, 37]), "{:?}", viridis(1.0));
        let lightness = |v: f32| {
            let [r, g, b] = viridis(v);
            0.2126 * r.powf(2.2) + 0.7152 * g.powf(2.2) + 0.0722 * b.powf(2.2)
        };
        assert!((0..100).all(|i| lightness(i as f32 / 100.0) < lightness((i + 1) as f32 / 100.0)));
    }

    #[test]
    fn values_beyond_the_scale_and_no_numbers_have_colours_too() {
        assert_eq!(viridis(-3.0), viridis(0.0));
        assert_eq!(viridis(f32::INFINITY), viridis(1.0));
        assert_eq!(heat(&[0.0, 2.0, f32::NAN], f32::NAN), [viridis(0.0), viridis(1.0), [0.5; 3]]);
        assert_eq!(heat(&[1.0], 2.0), [viridis(0.5)]);
    }

    #[test]
    fn the_bar_runs_from_dark_below_to_light_above() {
        let bar = color_bar(80, 200, 2.5, "cm");
        let sum = |y: u32| bar.get_pixel(10, y).0.iter().map(|&c| u32::from(c)).sum::<u32>();
        assert!(sum(30) > sum(180));
        color_bar(0, 0, 1.0, "");
        color_bar(3, 40, f32::NAN, "cm");
    }
}
