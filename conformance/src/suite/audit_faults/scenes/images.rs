//! Images, maps and volumes: convolutions, sampling, pooling.

use super::{Builder, Scene, drawn};
use crate::onnx::builder::{float, int, ints, text};

/// A convolutional encoder: convolutions with groups and dilations, both normalisations, pooling, resampling.
pub fn images() -> Scene {
    Builder::new(21)
        .input("image", &[3, 3, 12, 14])
        .weight("w1", &[8, 3, 3, 3])
        .list("b1", 8, |x| x)
        .list("scale", 8, |x| 1.0 + 0.3 * x)
        .list("shift", 8, |x| 0.5 * x)
        .list("mean", 8, |x| 0.1 + 0.3 * x.abs())
        .list("variance", 8, |x| 0.2 + 0.1 * x.abs())
        .weight("w2", &[8, 4, 3, 3])
        .list("b2", 8, |x| x)
        .list("gamma", 8, |x| 1.0 + 0.3 * x)
        .list("beta", 8, |x| 0.5 * x)
        .weight("w3", &[8, 8, 3, 3])
        .with(|graph| {
            graph
                .constant("twice", &[4], &[1.0, 1.0, 2.0, 2.0])
                .node("Conv", &["image", "w1", "b1"], &["c1"], vec![ints("pads", &[1, 1, 1, 1])])
                .node("BatchNormalization", &["c1", "scale", "shift", "mean", "variance"], &["n1"], vec![])
                .node("LeakyRelu", &["n1"], &["a1"], vec![float("alpha", 0.1)])
                .node(
                    "Conv",
                    &["a1", "w2", "b2"],
                    &["c2"],
                    vec![ints("pads", &[2, 2, 2, 2]), ints("dilations", &[2, 2]), int("group", 2)],
                )
                .node("GroupNormalization", &["c2", "gamma", "beta"], &["n2"], vec![int("num_groups", 4)])
                .node("Relu", &["n2"], &["a2"], vec![])
                .node(
                    "AveragePool",
                    &["a2"],
                    &["p"],
                    vec![
                        ints("kernel_shape", &[3, 3]),
                        ints("strides", &[2, 2]),
                        ints("pads", &[1, 1, 1, 1]),
                    ],
                )
                .node(
                    "Resize",
                    &["p", "", "twice"],
                    &["r"],
                    vec![text("mode", "linear"), text("coordinate_transformation_mode", "half_pixel")],
                )
                .node("Add", &["r", "a2"], &["s"], vec![])
                .node(
                    "Conv",
                    &["s", "w3"],
                    &["c3"],
                    vec![ints("pads", &[0, 1, 2, 1]), ints("strides", &[2, 2])],
                )
                .node("Sigmoid", &["c3"], &["y"], vec![])
        })
        .output("y")
        .scene("images")
}

/// Maps that are sampled: cubic and nearest resizing, grids, paddings, largest elements.
pub fn maps() -> Scene {
    let coordinates = drawn("grid", &[2, 5, 6, 2]).into_iter().map(|x| 0.7 * x).collect();
    Builder::new(20)
        .input("x", &[2, 4, 9, 9])
        .given("grid", &[2, 5, 6, 2], coordinates)
        .weight("w", &[4, 4, 3, 3])
        .weight("even", &[4, 4, 2, 2])
        .with(|graph| {
            graph
                .constant("half", &[4], &[1.0, 1.0, 0.5, 0.5])
                .constant("more", &[4], &[1.0, 1.0, 1.5, 2.0])
                .integers("pads", &[8], &[0, 0, 1, 2, 0, 0, 2, 1])
                .node(
                    "Conv",
                    &["x", "even"],
                    &["f"],
                    vec![text("auto_pad", "SAME_UPPER"), ints("strides", &[2, 2])],
                )
                .node("Conv", &["x", "w"], &["g"], vec![ints("pads", &[1, 1, 1, 1])])
                .node(
                    "Resize",
                    &["g", "", "more"],
                    &["cubic"],
                    vec![text("mode", "cubic"), float("cubic_coeff_a", -0.75)],
                )
                .node("Resize", &["g", "", "half"], &["smaller"], vec![text("mode", "linear")])
                .node(
                    "Resize",
                    &["g", "", "more"],
                    &["nearest"],
                    vec![
                        text("mode", "nearest"),
                        text("coordinate_transformation_mode", "asymmetric"),
                        text("nearest_mode", "floor"),
                    ],
                )
                .node("Pad", &["g", "pads"], &["padded"], vec![text("mode", "reflect")])
                .node(
                    "GridSample",
                    &["g", "grid"],
                    &["sampled"],
                    vec![text("mode", "linear"), text("padding_mode", "zeros"), int("align_corners", 1)],
                )
                .node(
                    "MaxPool",
                    &["g"],
                    &["largest"],
                    vec![
                        ints("kernel_shape", &[3, 3]),
                        ints("strides", &[2, 2]),
                        ints("pads", &[1, 1, 1, 1]),
                    ],
                )
                .node(
                    "MaxPool",
                    &["g"],
                    &["coarse"],
                    vec![ints("kernel_shape", &[2, 2]), ints("strides", &[2, 2])],
                )
                .node("Relu", &["sampled"], &["kept"], vec![])
                .node("Transpose", &["padded"], &["turned"], vec![ints("perm", &[0, 2, 3, 1])])
        })
        .output("kept")
        .output("turned")
        .scene("maps")
}

/// A network of voxels: three-dimensional convolutions, their transposes, grids of x, y, z.
pub fn volumes() -> Scene {
    let coordinates = drawn("points", &[1, 7, 5, 1, 3]).into_iter().map(|x| 0.6 * x).collect();
    Builder::new(20)
        .input("voxels", &[1, 4, 6, 6, 6])
        .given("points", &[1, 7, 5, 1, 3], coordinates)
        .weight("w1", &[4, 4, 3, 3, 3])
        .list("b1", 4, |x| x)
        .list("scale", 4, |x| 1.0 + 0.3 * x)
        .list("shift", 4, |x| 0.5 * x)
        .weight("w2", &[4, 4, 3, 3, 3])
        .list("b2", 4, |x| x)
        .with(|graph| {
            graph
                .node("Conv", &["voxels", "w1", "b1"], &["c"], vec![ints("pads", &[1; 6])])
                .node("InstanceNormalization", &["c", "scale", "shift"], &["n"], vec![])
                .node("Relu", &["n"], &["a"], vec![])
                .node(
                    "ConvTranspose",
                    &["a", "w2", "b2"],
                    &["up"],
                    vec![
                        ints("strides", &[2, 2, 2]),
                        ints("pads", &[1; 6]),
                        ints("output_padding", &[1, 1, 1]),
                    ],
                )
                .node(
                    "GridSample",
                    &["a", "points"],
                    &["at"],
                    vec![text("mode", "linear"), text("padding_mode", "border"), int("align_corners", 0)],
                )
                .node("Tanh", &["up"], &["y"], vec![])
                .node("Abs", &["at"], &["z"], vec![])
        })
        .output("y")
        .output("z")
        .scene("volumes")
}

/// Nodes that are large enough for meanings to be tried on a part of them.
pub fn wide() -> Scene {
    Builder::new(20)
        .input("x", &[1, 16, 44, 41])
        .input("rows", &[190, 160])
        .weight("w1", &[24, 16, 3, 3])
        .list("b1", 24, |x| x)
        .weight("w2", &[24, 12, 4, 4])
        .weight("w3", &[160, 160])
        .with(|graph| {
            graph
                .node("Conv", &["x", "w1", "b1"], &["c"], vec![ints("pads", &[1, 0, 1, 2])])
                .node("Relu", &["c"], &["a"], vec![])
                .node(
                    "ConvTranspose",
                    &["a", "w2"],
                    &["up"],
                    vec![ints("strides", &[2, 2]), ints("pads", &[1, 1, 1, 1])],
                )
                .node("MatMul", &["rows", "w3"], &["m"], vec![])
        })
        .output("up")
        .output("m")
        .scene("wide")
}
