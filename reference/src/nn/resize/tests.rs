use super::super::goldens::{self, check, pattern};
use super::super::{UNIT_ROUNDOFF_F32, resize};
use super::*;

/// An axis by a scale that is given.
fn by(axis: usize, length: usize, scale: f64) -> ResizedAxis {
    ResizedAxis {
        axis,
        output: (length as f64 * scale).floor() as usize,
        scale: [scale, 1.0],
        roi: [0.0, 1.0],
    }
}

/// An axis to a length that is given.
fn to(axis: usize, length: usize, output: usize) -> ResizedAxis {
    ResizedAxis { axis, output, scale: [output as f64, length as f64], roi: [0.0, 1.0] }
}

fn params(
    axes: Vec<ResizedAxis>,
    transformation: CoordinateTransformation,
    interpolation: Interpolation,
) -> Resize {
    Resize { axes, transformation, interpolation, exclude_outside: false, extrapolation_value: 0.0 }
}

const LINEAR: Interpolation = Interpolation::Linear { antialias: false };
const CUBIC: Interpolation = Interpolation::Cubic { a: -0.75, antialias: false };

fn row(values: &[f64]) -> Tensor {
    Tensor::new(&[values.len()], values.to_vec())
}

#[test]
fn doubling_reads_quarters_of_pixels_or_corners_or_halves() {
    use CoordinateTransformation::{AlignCorners, Asymmetric, HalfPixel};
    let x = row(&[0.0, 4.0]);
    let doubled = |transformation| resize(&x, &params(vec![by(0, 2, 2.0)], transformation, LINEAR)).data;
    assert_eq!(doubled(HalfPixel), [0.0, 1.0, 3.0, 4.0]);
    assert_eq!(doubled(Asymmetric), [0.0, 2.0, 4.0, 4.0]);
    for (found, third) in doubled(AlignCorners).into_iter().zip([0.0, 4.0 / 3.0, 8.0 / 3.0, 4.0]) {
        assert!((found - third).abs() < 1e-15);
    }
}

#[test]
fn half_way_the_nearest_pixel_is_the_one_preferred() {
    let x = row(&[10.0, 20.0, 30.0, 40.0]);
    let halved = |mode| {
        let nearest = Interpolation::Nearest(mode);
        resize(&x, &params(vec![by(0, 4, 0.5)], CoordinateTransformation::HalfPixel, nearest)).data
    };
    assert_eq!(halved(NearestMode::RoundPreferFloor), [10.0, 30.0]);
    assert_eq!(halved(NearestMode::RoundPreferCeil), [20.0, 40.0]);
    assert_eq!(halved(NearestMode::Floor), [10.0, 30.0]);
    assert_eq!(halved(NearestMode::Ceil), [20.0, 40.0]);
}

#[test]
fn agrees_with_pytorch_in_one_two_and_three_dimensions() {
    use CoordinateTransformation::{AlignCorners, HalfPixel};
    let x = pattern(&[1, 2, 5, 4], 1);
    let sizes = |height, width| vec![to(2, 5, height), to(3, 4, width)];
    for (k, transformation) in [HalfPixel, AlignCorners].into_iter().enumerate() {
        let with = |axes, interpolation| resize(&x, &params(axes, transformation, interpolation));
        check(&with(sizes(8, 7), LINEAR), &goldens::RESIZE_LINEAR_2D[k]);
        check(&with(sizes(8, 7), CUBIC), &goldens::RESIZE_CUBIC_2D[k]);
        check(&with(sizes(3, 2), CUBIC), &goldens::RESIZE_CUBIC_2D_SMALLER[k]);
        let volume = pattern(&[1, 1, 3, 4, 2], 2);
        let axes = vec![to(2, 3, 5), to(3, 4, 3), to(4, 2, 4)];
        check(&resize(&volume, &params(axes, transformation, LINEAR)), &goldens::RESIZE_LINEAR_3D[k]);
        let line = pattern(&[2, 1, 6], 3);
        check(
            &resize(&line, &params(vec![to(2, 6, 9)], transformation, LINEAR)),
            &goldens::RESIZE_LINEAR_1D[k],
        );
    }
}

#[test]
fn agrees_with_pytorchs_antialiasing_where_outside_is_left_out() {
    let x = pattern(&[1, 1, 9, 7], 4);
    let axes = vec![to(2, 9, 4), to(3, 7, 3)];
    for (interpolation, golden) in [
        (Interpolation::Linear { antialias: true }, &goldens::RESIZE_ANTIALIASED_LINEAR),
        (Interpolation::Cubic { a: -0.5, antialias: true }, &goldens::RESIZE_ANTIALIASED_CUBIC),
    ] {
        let params = Resize {
            exclude_outside: true,
            ..params(axes.clone(), CoordinateTransformation::HalfPixel, interpolation)
        };
        check(&resize(&x, &params), golden);
    }
}

#[test]
fn a_scale_that_gives_no_whole_length_is_used_as_it_is() {
    // 4 × 0.6 = 2.4: two pixels, at (j + ½)/0.6 − ½ = 1/3 and 2, and not at ½ and 2½.
    let x = row(&[0.0, 3.0, 6.0, 9.0]);
    let shrunk = |transformation| resize(&x, &params(vec![by(0, 4, 0.6)], transformation, LINEAR)).data;
    let close = |found: Vec<f64>, expected: [f64; 2]| {
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-14, "{found} for {expected}");
        }
    };
    close(shrunk(CoordinateTransformation::HalfPixel), [1.0, 6.0]);
    // ONNX's node tests: j·3/(2.4 − 1).
    close(shrunk(CoordinateTransformation::AlignCorners), [0.0, 3.0 * 3.0 / 1.4]);
    // Half a pixel of the 0.4 that were cut off is given back to either side: (4/2)(1 − 2/2.4) = 1/3.
    close(shrunk(CoordinateTransformation::HalfPixelSymmetric), [2.0, 7.0]);
}

#[test]
fn a_crop_reads_its_part_and_the_extrapolation_value_beyond_the_image() {
    let x = row(&[0.0, 1.0, 2.0, 3.0, 4.0]);
    let crop = |roi, output| {
        let axis = ResizedAxis { axis: 0, output, scale: [output as f64, 5.0], roi };
        let params = Resize {
            extrapolation_value: -7.0,
            ..params(vec![axis], CoordinateTransformation::TfCropAndResize, LINEAR)
        };
        resize(&x, &params).data
    };
    assert_eq!(crop([0.25, 0.75], 3), [1.0, 2.0, 3.0]);
    assert_eq!(crop([0.5, 1.5], 3), [2.0, 4.0, -7.0]);
    assert_eq!(crop([0.5, 1.0], 1), [3.0], "a single pixel is the middle of the part");
}

#[test]
fn a_constant_image_stays_constant_in_every_mode() {
    let x = Tensor::filled(&[1, 1, 5, 6], 2.5);
    for transformation in [
        CoordinateTransformation::HalfPixel,
        CoordinateTransformation::HalfPixelSymmetric,
        CoordinateTransformation::PytorchHalfPixel,
        CoordinateTransformation::AlignCorners,
        CoordinateTransformation::Asymmetric,
        CoordinateTransformation::TfHalfPixelForNn,
        CoordinateTransformation::TfCropAndResize,
    ] {
        for interpolation in [
            Interpolation::Nearest(NearestMode::Ceil),
            LINEAR,
            CUBIC,
            Interpolation::Linear { antialias: true },
            Interpolation::Cubic { a: -0.5, antialias: true },
        ] {
            for exclude_outside in [false, true] {
                let params = Resize {
                    exclude_outside,
                    ..params(vec![to(2, 5, 9), to(3, 6, 2)], transformation, interpolation)
                };
                let y = resize(&x, &params);
                assert_eq!(y.shape, [1, 1, 9, 2]);
                assert!(y.data.iter().all(|y| (y - 2.5).abs() < 1e-13), "{params:?}: {y:?}");
            }
        }
    }
}

#[test]
fn a_power_of_two_has_no_coordinate_error_and_other_scales_do() {
    let x = pattern(&[64], 1).rounded();
    let at =
        |scale: f64| resize(&x, &params(vec![by(0, 64, scale)], CoordinateTransformation::HalfPixel, LINEAR));
    assert!(at(2.0).data.iter().all(|y| y.magnitude <= 1.0 + 1e-12), "Σ w·|v| alone");
    assert!(at(3.0).data.iter().any(|y| y.magnitude > 10.0), "64 pixels times the slope");
}

#[test]
fn a_tie_within_rounding_has_both_neighbours_and_an_exact_one_has_not() {
    let x = row(&[1.0, 2.0, 3.0]).rounded();
    let nearest = Interpolation::Nearest(NearestMode::Floor);
    // j/s = 3·⅓ = 1 lies on the edge between pixels 0 and 1 of the kind that rounding decides.
    let third = params(vec![to(0, 3, 9)], CoordinateTransformation::Asymmetric, nearest);
    assert_eq!(resize(&x, &third).values().data[3], 2.0);
    let others: Vec<f64> =
        resize_alternatives(&x, &third, UNIT_ROUNDOFF_F32).iter().map(|y| y.data[3].value).collect();
    assert_eq!(others, [1.0, 2.0]);
    let double = params(vec![to(0, 3, 6)], CoordinateTransformation::Asymmetric, nearest);
    assert!(resize_alternatives(&x, &double, UNIT_ROUNDOFF_F32).is_empty(), "halves are exact");
    let linear = Resize { interpolation: LINEAR, ..third };
    assert!(
        resize_alternatives(&x, &linear, UNIT_ROUNDOFF_F32).is_empty(),
        "a continuous function has no ties"
    );
}

#[test]
#[should_panic(expected = "axis 2 does not lie in shape [3, 4]")]
fn an_axis_must_exist() {
    resize(
        &Tensor::<f64>::zeros(&[3, 4]),
        &params(vec![to(2, 3, 5)], CoordinateTransformation::HalfPixel, LINEAR),
    );
}
