//! The judge of a regressor's surroundings is judged: faults planted in the subject must be seen.

use vitruvian_runtime::rotation::{from_six_d, logarithm, nearest, rodrigues};

use super::{RUNTIME, Subject};
use vitruvian_runtime::regress::full_image_translation;

/// A subject with a fault that others have had.
#[derive(Clone, Copy)]
pub struct Fault {
    /// What is wrong.
    pub name: &'static str,
    /// The runtime with it.
    pub subject: Subject,
}

/// Every fault that must be seen.
pub const FAULTS: &[Fault] = &[
    Fault {
        name: "six numbers as two columns one after the other",
        subject: Subject { from_six_d: |x| from_six_d([x[0], x[3], x[1], x[4], x[2], x[5]]), ..RUNTIME },
    },
    Fault {
        name: "six numbers as rows of the rotation",
        subject: Subject { from_six_d: |x| from_six_d(x).map(transposed), ..RUNTIME },
    },
    Fault {
        name: "the second column first",
        subject: Subject { from_six_d: |x| from_six_d([x[1], x[0], x[3], x[2], x[5], x[4]]), ..RUNTIME },
    },
    Fault { name: "matrices left as they are", subject: Subject { nearest: |m| Some(*m), ..RUNTIME } },
    Fault {
        name: "matrices by columns",
        subject: Subject { nearest: |m| nearest(&transposed(*m)), ..RUNTIME },
    },
    Fault {
        name: "the angle's other direction",
        subject: Subject { rodrigues: |v| rodrigues(v.map(|x| -x)), ..RUNTIME },
    },
    Fault {
        name: "a logarithm that ends before half a turn",
        subject: Subject { logarithm: |r| logarithm(r).map(|x| x * (1.0 - 1e-11)), ..RUNTIME },
    },
    Fault {
        name: "depth from the photograph's side instead of the crop's",
        subject: Subject {
            full_image_translation: |camera, crop, k| {
                let [x, y, z] = full_image_translation(camera, crop, k);
                [x, y, z * f64::from(crop.side_px) / (2.0 * k[0][2] + 1.0)]
            },
            ..RUNTIME
        },
    },
    Fault {
        name: "the crop's place forgotten",
        subject: Subject {
            full_image_translation: |camera, crop, k| {
                let [_, _, z] = full_image_translation(camera, crop, k);
                [camera[1], camera[2], z]
            },
            ..RUNTIME
        },
    },
    Fault {
        name: "one focal length for both axes",
        subject: Subject {
            full_image_translation: |camera, crop, k| {
                let mut square = *k;
                square[1][1] = 1.01 * k[0][0];
                full_image_translation(camera, crop, &square)
            },
            ..RUNTIME
        },
    },
    Fault {
        name: "pixels counted from the first one's centre",
        subject: Subject {
            full_image_translation: |camera, crop, k| {
                let mut shifted = *k;
                shifted[0][2] -= 0.5;
                shifted[1][2] -= 0.5;
                full_image_translation(camera, crop, &shifted)
            },
            ..RUNTIME
        },
    },
];

fn transposed(m: [[f64; 3]; 3]) -> [[f64; 3]; 3] {
    std::array::from_fn(|r| std::array::from_fn(|c| m[c][r]))
}
