use image::{GrayImage, Luma, Rgb, RgbImage};

use super::goldens::{GOLDENS, HEIGHT, WIDTH};
use super::{Crop, PersonBox, crop};
use crate::error::Error;

/// The goldens' photograph: smooth in its upper half, and below it noise that every language makes alike.
pub(crate) fn photograph() -> RgbImage {
    RgbImage::from_fn(WIDTH, HEIGHT, |u, v| {
        Rgb([0, 1, 2].map(|c| {
            let smooth = 2 * u + 3 * v + 20 * c;
            let noise = 7 * u * u + 13 * v * v + 5 * u * v + 31 * c * (u + 2 * v);
            ((if 2 * v < HEIGHT { smooth } else { noise }) % 256) as u8
        }))
    })
}

fn square(center_px: [f64; 2], side_px: f64) -> PersonBox {
    PersonBox { center_px, side_px }
}

#[test]
fn crops_are_pillows_within_one_level() {
    let photograph = photograph();
    for golden in &GOLDENS {
        let Crop { image, origin_px, side_px } =
            crop(&photograph, &square(golden.center_px, golden.side_px), golden.size).unwrap();
        assert_eq!((origin_px, side_px), (golden.origin_px, golden.cut_px), "{golden:?}");
        for (k, (found, expected)) in image.as_raw().iter().zip(golden.pixels).enumerate() {
            let name = golden.name;
            assert!(
                found.abs_diff(*expected) <= 1,
                "{name}: byte {k}: found {found}, Pillow gave {expected}; regenerate with \
                 python runtime/goldens/person_crop.py"
            );
        }
        assert_eq!(image.as_raw().len(), golden.pixels.len());
    }
}

#[test]
fn crop_at_the_photographs_own_scale_copies_it_and_pads_with_black() {
    let photograph = photograph();
    let found = crop(&photograph, &square([3.0, 5.0], 20.0), 20).unwrap();
    assert_eq!(found.origin_px, [-7, -5]);
    for (x, y, &pixel) in found.image.enumerate_pixels() {
        let expected = if x < 7 || y < 5 { Rgb([0; 3]) } else { *photograph.get_pixel(x - 7, y - 5) };
        assert_eq!(pixel, expected, "({x}, {y})");
    }
}

#[test]
fn box_of_a_mask_is_the_one_around_its_body_pixels() {
    let mut mask = GrayImage::new(50, 40);
    assert_eq!(PersonBox::of_mask(&mask), None);
    mask.put_pixel(0, 0, Luma([127]));
    mask.put_pixel(10, 5, Luma([128]));
    mask.put_pixel(19, 34, Luma([255]));
    let found = PersonBox::of_mask(&mask).unwrap();
    assert_eq!(found, PersonBox::around([10.0, 5.0], [20.0, 35.0]));
    assert_eq!(found, square([15.0, 20.0], 36.0));
}

#[test]
fn whole_photograph_loses_nothing() {
    let found = crop(&photograph(), &PersonBox::whole(WIDTH, HEIGHT), 16).unwrap();
    assert_eq!(found.side_px, WIDTH.max(HEIGHT));
}

#[test]
fn corners_are_truncated_towards_zero() {
    let found = crop(&photograph(), &square([5.0, 30.0], 21.0), 8).unwrap();
    assert_eq!((found.origin_px, found.side_px), ([-5, 19], 21), "from −5.5 and 19.5 to 15.5 and 40.5");
}

#[test]
fn boxes_that_show_nobody_are_refused_with_their_numbers() {
    let photograph = photograph();
    for (person, said) in [
        (square([20.0, 20.0], 0.0), "less than the 8 pixels"),
        (square([20.0, 20.0], -30.0), "less than the 8 pixels"),
        // It covers one pixel of the photograph.
        (square([20.0, 20.0], 1e-9), "less than the 8 pixels"),
        (square([20.0, 20.0], 7.99), "7.99 pixels around (20.0, 20.0): its side is less than the 8 pixels"),
        (square([f64::NAN, 20.0], 30.0), "finite"),
        (square([20.0, 20.0], f64::INFINITY), "finite"),
        (square([20.0, 20.0], 1e9), "more than 16384"),
        (square([1e300, 20.0], 30.0), "around (1e300, 20.0): it lies outside"),
        (square([-100.0, 20.0], 30.0), "outside the photograph of 96 × 64"),
        (square([20.0, 90.0], 30.0), "outside the photograph"),
    ] {
        let error = crop(&photograph, &person, 16).unwrap_err();
        assert!(matches!(error, Error::PersonBox { .. }) && error.to_string().contains(said), "{error}");
    }
    assert_eq!(crop(&photograph, &square([20.0, 20.0], 8.0), 16).unwrap().side_px, 8);
    assert!(crop(&photograph, &square([20.0, 20.0], 9.0), 0).is_err());
    assert!(crop(&photograph, &square([20.0, 20.0], 9.0), 1 << 20).is_err());
    assert!(crop(&RgbImage::new(0, 0), &PersonBox::whole(0, 0), 16).is_err());
}

#[test]
fn largest_box_is_cut_without_the_memory_it_would_fill() {
    let found = crop(&photograph(), &square([48.0, 32.0], 16_384.0), 4).unwrap();
    assert_eq!(found.side_px, 16_384);
}
