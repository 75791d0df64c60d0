//! Expectations that were computed in another way than their operator is defined, so that rounding cannot explain them.
//!
//! A case stands here with its reason, and the table prints the difference that is measured on every run. A line whose case
//! is met within its bound is a mistake of this list, and fails the tests.

/// Why a case's stored outputs differ from what its operator means, or `None` where rounding must explain them.
pub fn reason(case: &str) -> Option<&'static str> {
    REASONS.iter().find(|(cases, _)| cases.contains(&case)).map(|(_, reason)| *reason)
}

/// Why an engine's answer to a case differs from what its operator means, where that is known.
pub fn departure(case: &str, engine: &str) -> Option<&'static str> {
    let known = |(cases, whose, _): &&(&[&str], &str, &str)| cases.contains(&case) && *whose == engine;
    DEPARTURES.iter().find(known).map(|(_, _, why)| *why)
}

/// The cases that stand in the list of expectations.
pub fn cases() -> impl Iterator<Item = &'static str> {
    REASONS.iter().flat_map(|(cases, _)| cases.iter().copied())
}

const REASONS: &[(&[&str], &str)] = &[
    (&["test_averagepool_2d_ceil_last_window_starts_on_pad"], "written by hand, to four decimals"),
    (&["test_roialign_aligned_false", "test_roialign_aligned_true"], "written by hand, to four decimals"),
    (&["test_roialign_mode_max"], "written by hand, to eight decimals, as another kernel gave them"),
    (
        &["test_dynamicquantizelinear_expanded"],
        "a tie: −2.5/(5/255) is −127.5 in numbers, but not with 5/255 in f32, and the graph is evaluated without rounding",
    ),
];

const DEPARTURES: &[(&[&str], &str, &str)] = &[
    (
        &[
            "test_attention_4d_with_past_and_present_qk_matmul_bias_3d_mask_causal",
            "test_attention_4d_with_past_and_present_qk_matmul_bias_4d_mask_causal",
        ],
        "ONNX Runtime",
        "the masked scores that it hands out are −3.4·10³⁸ instead of −∞",
    ),
    (
        &["test_maxunpool_export_with_output_shape"],
        "ONNX Runtime",
        "it reads the indices in the shape that is asked for instead of the one that was pooled",
    ),
    (
        &["test_dynamicquantizelinear_expanded"],
        "ONNX Runtime",
        "a tie, see above: the stored expectation decides it in the same way",
    ),
    (
        &[
            "test_resize_downsample_scales_cubic_align_corners",
            "test_resize_downsample_scales_linear_align_corners",
        ],
        "ONNX Runtime",
        "with align_corners it takes the length of the output for a whole number before it is rounded down; known upstream",
    ),
    (&["test_div", "test_div_bcast"], "tract", "a quotient that is not correctly rounded, as by x·(1/y)"),
    (
        &[
            "test_SELU",
            "test_erf",
            "test_gelu_default_2",
            "test_gelu_default_2_expanded",
            "test_mish",
            "test_mish_expanded",
            "test_operator_selu",
            "test_selu_default",
        ],
        "tract",
        "an approximation that is coarser than f32",
    ),
    (
        &[
            "test_mod_fmod_0_signed_zero_float16",
            "test_mod_fmod_0_signed_zero_float32",
            "test_mod_fmod_0_signed_zero_float64",
        ],
        "tract",
        "a remainder of zero has the other sign, which was open before opset 28",
    ),
];
