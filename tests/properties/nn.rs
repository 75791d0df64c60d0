//! Laws of the operators and networks of the reference.

use proptest::prelude::*;
use vitruvian_reference::network::{Weights, mf_pifu};
use vitruvian_reference::nn::{
    AveragePool, Conv, ConvTranspose, GridSample, PaddingMode, Pool, Rounded, SampleMode, Tensor,
    UNIT_ROUNDOFF_F32, average_pool, batch_norm, concat, conv, conv_transpose, einsum, gamma, gather,
    grid_sample, group_norm, matmul, max_pool, replace, scatter_nd, transpose,
};

/// A tensor of this shape with elements in [−1, 1].
fn tensor(shape: Vec<usize>) -> impl Strategy<Value = Tensor> {
    let size = shape.iter().product::<usize>();
    prop::collection::vec(-1.0..1.0, size).prop_map(move |data| Tensor::new(&shape, data))
}

/// A convolution in one to three dimensions: two images of equal shape, a kernel, and how it moves.
fn convolution() -> impl Strategy<Value = (Tensor, Tensor, Tensor, Conv)> {
    let axis = (1..=3usize, 1..=3usize, 0..=2usize, 0..=2usize, 1..=2usize, 0..=4usize);
    (1..=2usize, 1..=2usize, 1..=2usize, prop::collection::vec(axis, 1..=3)).prop_flat_map(
        |(groups, channels, outputs, axes)| {
            let extent = |&(kernel, _, _, _, dilation, _): &(usize, usize, usize, usize, usize, usize)| {
                (kernel - 1) * dilation + 1
            };
            let image: Vec<usize> = axes.iter().map(|axis| extent(axis) + axis.5).collect();
            let params = Conv {
                stride: axes.iter().map(|axis| axis.1).collect(),
                padding: axes.iter().map(|axis| [axis.2, axis.3]).collect(),
                dilation: axes.iter().map(|axis| axis.4).collect(),
                groups,
            };
            let x = [vec![2, groups * channels], image].concat();
            let w = [vec![groups * outputs, channels], axes.iter().map(|axis| axis.0).collect()].concat();
            (tensor(x.clone()), tensor(x), tensor(w), Just(params))
        },
    )
}

fn inner_product(a: &Tensor, b: &Tensor) -> f64 {
    assert_eq!(a.shape, b.shape, "an inner product needs equal shapes");
    a.data.iter().zip(&b.data).map(|(a, b)| a * b).sum()
}

fn assert_close(a: &Tensor, b: &Tensor, tolerance: f64) {
    assert_eq!(a.shape, b.shape, "shapes");
    for (i, (a, b)) in a.data.iter().zip(&b.data).enumerate() {
        assert!((a - b).abs() <= tolerance, "element {i}: {a} and {b}");
    }
}

/// The convolution of f32 tensors summed in f32, the taps of each output taken last to first.
fn conv_in_f32(x: &Tensor, w: &Tensor, params: &Conv) -> Tensor {
    let shape = conv(x, w, None, params).shape;
    let group_outputs = w.shape[0] / params.groups;
    Tensor::from_fn(&shape, |y| {
        let mut products = Vec::new();
        Tensor::from_fn(&w.shape[1..], |k| {
            let pixel: Option<Vec<usize>> = (0..k.len() - 1)
                .map(|a| {
                    let i = y[a + 2] * params.stride[a] + k[a + 1] * params.dilation[a];
                    i.checked_sub(params.padding[a][0]).filter(|&i| i < x.shape[a + 2])
                })
                .collect();
            if let Some(pixel) = pixel {
                let channel = y[1] / group_outputs * w.shape[1] + k[0];
                let x = x.at(&[&[y[0], channel], &pixel[..]].concat()) as f32;
                products.push(x * w.at(&[&y[1..2], k].concat()) as f32);
            }
        });
        f64::from(products.iter().rev().sum::<f32>())
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    #[test]
    fn convolution_is_linear((x, y, w, params) in convolution(), a in -2.0..2.0f64) {
        let sum = Tensor::new(&x.shape, x.data.iter().zip(&y.data).map(|(x, y)| a * x + y).collect());
        let (of_x, of_y) = (conv(&x, &w, None, &params), conv(&y, &w, None, &params));
        let expected = Tensor::new(&of_x.shape, of_x.data.iter().zip(&of_y.data).map(|(x, y)| a * x + y).collect());
        assert_close(&conv(&sum, &w, None, &params), &expected, 1e-12);
    }

    #[test]
    fn transposed_convolution_is_the_adjoint_of_convolution((x, _, w, params) in convolution(), seed in 0.1..3.0f64) {
        // ⟨conv(x), y⟩ = ⟨x, conv_transpose(y)⟩; output_padding restores the pixels that the stride skipped.
        let forward = conv(&x, &w, None, &params);
        let mut angle = seed;
        let y = forward.map(|_| { angle += seed; angle.sin() });
        let output_padding = (0..params.stride.len())
            .map(|a| {
                let extent = (w.shape[a + 2] - 1) * params.dilation[a] + 1;
                let padding: usize = params.padding[a].iter().sum();
                (x.shape[a + 2] + padding - extent) % params.stride[a]
            })
            .collect();
        let back = conv_transpose(&y, &w, None, &ConvTranspose { conv: params, output_padding });
        prop_assert_eq!(&back.shape, &x.shape);
        prop_assert!((inner_product(&forward, &y) - inner_product(&x, &back)).abs() < 1e-11);
    }

    #[test]
    fn f32_convolution_stays_within_the_bound_and_the_bound_within_its_formula((x, _, w, params) in convolution()) {
        let single = |t: &Tensor| t.map(|v| f64::from(v as f32));
        let (x, w) = (single(&x), single(&w));
        let y = conv(&x.rounded(), &w.rounded(), None, &params);
        prop_assert_eq!(y.values(), conv(&x, &w, None, &params));
        let magnitude = conv(&x.map(f64::abs), &w.map(f64::abs), None, &params);
        let most = gamma(w.shape[1..].iter().product::<usize>() as f64, UNIT_ROUNDOFF_F32);
        let f32 = conv_in_f32(&x, &w, &params);
        for (i, bound) in y.bounds(UNIT_ROUNDOFF_F32).data.iter().enumerate() {
            prop_assert!((f32.data[i] - y.data[i].value).abs() <= *bound, "output {i}");
            prop_assert!(*bound <= most * magnitude.data[i], "output {i}: a bound above γ_K Σ|w||x|");
        }
    }

    #[test]
    fn pooling_is_monotone(x in tensor(vec![1, 2, 5, 6]), raise in tensor(vec![1, 2, 5, 6]), ceil_mode: bool) {
        let above = Tensor::new(&x.shape, x.data.iter().zip(&raise.data).map(|(x, r)| x + r.abs()).collect());
        let window = Pool { padding: vec![[1, 0], [0, 1]], stride: vec![2, 1], ceil_mode, ..Pool::new(2, 3) };
        let average = AveragePool { window: window.clone(), count_include_pad: false };
        for (low, high, mean) in [
            (max_pool(&x, &window), max_pool(&above, &window), average_pool(&x, &average)),
            (average_pool(&x, &average), average_pool(&above, &average), average_pool(&x, &average)),
        ] {
            prop_assert!(low.data.iter().zip(&high.data).all(|(low, high)| low <= &(high + 1e-15)));
            prop_assert!(mean.data.iter().zip(&low.data).all(|(mean, low)| mean <= &(low + 1e-15)), "a mean is no maximum");
        }
    }

    #[test]
    fn sampling_at_pixel_centres_returns_the_pixels(
        x in (1..=5usize, 1..=5usize, 1..=4usize).prop_flat_map(|(d, h, w)| tensor(vec![1, 2, d, h, w])),
        align_corners: bool,
        mode in 0..3usize,
    ) {
        let padding = [PaddingMode::Zeros, PaddingMode::Border, PaddingMode::Reflection][mode];
        let centre = |i: usize, n: usize| match (align_corners, n) {
            (true, 1) => 0.0,
            (true, _) => 2.0 * i as f64 / (n - 1) as f64 - 1.0,
            (false, _) => (2 * i + 1) as f64 / n as f64 - 1.0,
        };
        let size = x.shape[2..].to_vec();
        let grid = Tensor::from_fn(&[1, size[0], size[1], size[2], 3], |i| centre(i[3 - i[4]], size[2 - i[4]]));
        assert_close(&grid_sample(&x, &grid, GridSample { mode: SampleMode::Linear, padding, align_corners }), &x, 1e-13);
    }

    #[test]
    fn sampling_never_leaves_the_range_of_the_image(
        x in tensor(vec![1, 1, 3, 4]),
        grid in tensor(vec![1, 1, 6, 2]),
        zoom in 0.5..4.0f64,
        align_corners: bool,
    ) {
        let far = grid.map(|v| zoom * v);
        let (low, high) = x.data.iter().fold((0.0f64, 0.0f64), |(l, h), &v| (l.min(v), h.max(v)));
        for padding in [PaddingMode::Zeros, PaddingMode::Border, PaddingMode::Reflection] {
            let y = grid_sample(&x, &far, GridSample { mode: SampleMode::Linear, padding, align_corners });
            prop_assert!(y.data.iter().all(|v| (low - 1e-14..=high + 1e-14).contains(v)), "{padding:?}: {:?}", y.data);
        }
    }

    #[test]
    fn a_normalised_group_has_mean_zero_and_variance_one(x in tensor(vec![2, 6, 4, 5]), shift in -9.0..9.0f64) {
        let (ones, zeros) = (Tensor::filled(&[6], 1.0), Tensor::zeros(&[6]));
        let y = group_norm(&x.map(|v| v + shift), 2, &ones, &zeros, 0.0);
        for group in y.data.chunks(60) {
            let mean = group.iter().sum::<f64>() / 60.0;
            let variance = group.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / 60.0;
            prop_assert!(mean.abs() < 1e-12 && (variance - 1.0).abs() < 1e-11, "mean {mean}, variance {variance}");
        }
    }

    #[test]
    fn batch_norm_folds_into_the_convolution_before_it((x, _, w, params) in convolution(), scale in 0.2..2.0f64) {
        let outputs = w.shape[0];
        let per = |f: fn(f64) -> f64| Tensor::from_fn(&[outputs], |o| f(o[0] as f64 + scale));
        let (s, b, m, v) = (per(f64::sin), per(f64::cos), per(|o| o / 3.0), per(|o| o * o));
        let expected = batch_norm(&conv(&x, &w, None, &params), &s, &b, &m, &v, 1e-5);
        let factor = Tensor::from_fn(&[outputs], |o| s.data[o[0]] / (v.data[o[0]] + 1e-5).sqrt());
        let folded_w = Tensor::from_fn(&w.shape, |i| w.at(i) * factor.data[i[0]]);
        let folded_b = Tensor::from_fn(&[outputs], |o| b.data[o[0]] - m.data[o[0]] * factor.data[o[0]]);
        assert_close(&conv(&x, &folded_w, Some(&folded_b), &params), &expected, 1e-12);
    }

    #[test]
    fn what_was_scattered_is_gathered_again(x in tensor(vec![6, 3]), rows in tensor(vec![3, 3]), first in 0..4usize) {
        let places = vec![first, (first + 3) % 6, (first + 1) % 6];
        let y = scatter_nd(&x, &Tensor::new(&[3, 1], places.clone()), &rows, replace);
        prop_assert_eq!(gather(&y, &Tensor::new(&[3], places.clone()), 0), rows);
        let others: Vec<usize> = (0..6).filter(|row| !places.contains(row)).collect();
        let others = Tensor::new(&[3], others);
        prop_assert_eq!(gather(&y, &others, 0), gather(&x, &others, 0));
    }

    #[test]
    fn summing_over_a_name_is_a_product_of_matrices_in_every_order(a in tensor(vec![3, 4]), b in tensor(vec![2, 4])) {
        let product = matmul(&a, &transpose(&b, &[1, 0]));
        assert_close(&einsum("ik,jk->ij", &[&a, &b]), &product, 1e-15);
        assert_close(&einsum("jk,ik->ji", &[&b, &a]), &transpose(&product, &[1, 0]), 1e-15);
        let trace = einsum("ii->", &[&einsum("ik,jk->ij", &[&a, &a])]).data[0];
        prop_assert!((trace - inner_product(&a, &a)).abs() < 1e-14, "tr AAᵀ is the squared norm");
    }

    #[test]
    fn arithmetic_on_rounded_numbers_has_the_values_of_f64(a in -9.0..9.0f64, b in 0.5..9.0f64) {
        let (x, y) = (Rounded { value: a, magnitude: a.abs(), terms: 0.0 }, Rounded { value: b, magnitude: b, terms: 0.0 });
        for (rounded, value) in [(x + y, a + b), (x - y, a - b), (x * y, a * b), (x / y, a / b)] {
            prop_assert_eq!(rounded.value, value);
            // One correctly rounded operation: as f32 does it.
            prop_assert!((f64::from(value as f32) - value).abs() <= rounded.bound(UNIT_ROUNDOFF_F32));
        }
    }
}

/// Weights that look random: element i of tensor k is sin(12.9898 i + k)/√inputs, a norm's scale 1 more.
fn weights(shapes: Vec<(String, Vec<usize>)>) -> Vec<(String, Tensor)> {
    let fill = |(k, (name, shape)): (usize, (String, Vec<usize>))| {
        let inputs = shape[1..].iter().product::<usize>() as f64;
        let offset = f64::from(name.contains("norm.weight"));
        let data = (0..shape.iter().product())
            .map(|i: usize| offset + (12.9898 * i as f64 + k as f64).sin() / inputs.sqrt())
            .collect();
        (name, Tensor::new(&shape, data))
    };
    shapes.into_iter().enumerate().map(fill).collect()
}

/// A weight of a narrow network inside a wider one: old channel c goes where `rows` and `columns` say, the rest is zero.
fn widened(narrow: &Tensor, shape: &[usize], rows: &[usize], columns: &[usize]) -> Tensor {
    let mut wide = Tensor::zeros(shape);
    let per_column: usize = shape.iter().skip(2).product();
    let (wide_columns, narrow_columns) =
        (shape.get(1).copied().unwrap_or(1), narrow.shape.get(1).copied().unwrap_or(1));
    for (r, &row) in rows.iter().enumerate().take(narrow.shape[0]) {
        for (c, &column) in columns.iter().enumerate().take(narrow_columns) {
            for k in 0..per_column {
                wide.data[(row * wide_columns + column) * per_column + k] =
                    narrow.data[(r * narrow_columns + c) * per_column + k];
            }
        }
    }
    wide
}

#[test]
fn zero_padding_the_width_of_a_network_changes_nothing() {
    let narrow = mf_pifu::Size { stem: 4, inner: 4, out: 8, hidden: [6, 5, 4] };
    let wide = mf_pifu::Size { stem: 6, inner: 12, out: 24, hidden: [9, 5, 8] };

    // Encoder: every channel keeps its number.
    let same: Vec<usize> = (0..64).collect();
    let narrow_weights = weights(narrow.encoder_weights());
    let wide_weights: Weights = narrow_weights
        .iter()
        .zip(wide.encoder_weights())
        .map(|((_, tensor), (name, shape))| (name, widened(tensor, &shape, &same, &same)))
        .collect();
    let encoder = mf_pifu::Encoder::from_weights(narrow_weights.into_iter().collect());
    let wide_encoder = mf_pifu::Encoder::from_weights(wide_weights);
    let images =
        Tensor::from_fn(&[1, 3, 64, 64], |i| (i[1] as f64 + 0.3 * i[2] as f64 + 0.7 * i[3] as f64).sin());
    let (stages, wide_stages) = (encoder.forward(&images), wide_encoder.forward(&images));
    for (f, wide_f) in stages.features().into_iter().zip(wide_stages.features()) {
        let padding = Tensor::zeros(&[1, wide.out - narrow.out, f.shape[2], f.shape[3]]);
        assert_close(wide_f, &concat(&[f, &padding], 1), 1e-12);
    }

    // Query: the point's feature is four blocks of channels and the depth, behind the hidden channels from layer 2 on.
    let feature = |hidden: usize, size: mf_pifu::Size| -> Vec<usize> {
        let blocks =
            (0..4).flat_map(move |level| (0..narrow.out).map(move |c| hidden + level * size.out + c));
        blocks.chain([hidden + 4 * size.out]).collect()
    };
    let narrow_weights = weights(narrow.query_weights());
    let wide_weights: Weights = narrow_weights
        .iter()
        .zip(wide.query_weights())
        .enumerate()
        .map(|(k, ((_, tensor), (name, shape)))| {
            let hidden = [0, narrow.hidden[0], narrow.hidden[1], narrow.hidden[2]][k / 2];
            let wide_hidden = [0, wide.hidden[0], wide.hidden[1], wide.hidden[2]][k / 2];
            let columns: Vec<usize> = (0..hidden).chain(feature(wide_hidden, wide)).collect();
            (name, widened(tensor, &shape, &same, &columns))
        })
        .collect();
    let query = mf_pifu::Query::from_weights(narrow_weights.into_iter().collect());
    let wide_query = mf_pifu::Query::from_weights(wide_weights);
    let uv = Tensor::from_fn(&[1, 20, 2], |i| (i[1] as f64 * 1.7 + i[2] as f64).sin());
    let depth = Tensor::from_fn(&[1, 20], |i| (i[1] as f64).cos());
    let answer = query.forward(&stages.features(), &uv, &depth);
    let wide_answer = wide_query.forward(&wide_stages.features(), &uv, &depth);
    assert_close(answer.get("occupancy"), wide_answer.get("occupancy"), 1e-13);
    let spread =
        answer.get("occupancy").data.iter().fold((1.0f64, 0.0f64), |(l, h), &v| (l.min(v), h.max(v)));
    assert!(spread.1 - spread.0 > 1e-3, "the points are told apart: {spread:?}");
}
