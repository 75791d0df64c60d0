//! The regressor: pose, shape and camera of one person from one image (Li 2021, chapter 4 §3.2).
//!
//! | stage | operators | thesis size |
//! |---|---|---|
//! | `stem` … `feature` | [ResNet-50](super::resnet), mean over the pixels | 2048 |
//! | the mean person x₀ | pose (six numbers per rotation), betas, camera, stored with the weights | 144 + 10 + 3 |
//! | `hidden_k` | h = fc2(fc1(\[feature, x_{k−1}\])) | 2205 → 1024 → 1024 |
//! | `pose_k`, `betas_k`, `camera_k` | x_k = x_{k−1} + \[decpose(h), decshape(h), deccam(h)\], k = 1, 2, 3, same weights | 144 + 10 + 3 |
//! | `pose`, `betas`, `camera` | x₃ | 144 + 10 + 3 |
//!
//! The thesis counts 85 numbers (72 + 10 + 3); the network that it builds on writes each of 24 rotations as six
//! (erratum E50): [`rotations`] reads them. The camera (s, t_x, t_y) is
//! [weak-perspective](crate::camera::WeakPerspective); the root's rotation is in the camera's axes (y down), so that an
//! upright person is about half a turn about x.
//!
//! # Is the head iterative?
//! Only in its writing. Between fc1, fc2 and the outputs there is no nonlinearity, and the dropout that stands there in
//! training does nothing at inference, so with f the feature one step is affine,
//!
//! x_k = (I + A) x_{k−1} + B f + c,  hence x₃ = (I + A)³ x₀ + (I + (I + A) + (I + A)²)(B f + c):
//!
//! the whole head is one affine map of f, whatever its three layers and three rounds suggest. An activation put between
//! the layers by an exporter, or a fourth round, changes every number; the tests plant both.
//!
//! # References
//! Li 2021, §3.2 of chapter 4; Kanazawa, Black, Jacobs, Malik, HMR, CVPR 2018; Kolotouros, Pavlakos, Black, Daniilidis,
//! SPIN, ICCV 2019, whose names the weights have.

use super::layer::{Linear, pair};
use super::resnet::{self, EXPANSION, ResNet};
use super::{Stages, Weights};
use crate::linalg::matrix::Matrix3;
use crate::nn::{self, Scalar, Tensor};
use crate::rotation::from_six_d;

/// Joints whose rotations are regressed.
pub const JOINTS: usize = 24;

/// Numbers of the weak-perspective camera.
const CAMERA: usize = 3;

/// Corrections of the mean person.
const ITERATIONS: usize = 3;

/// The widths of one regressor.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Size {
    /// Planes of the four layers of the ResNet.
    pub planes: [usize; 4],
    /// Width of fc1 and fc2.
    pub hidden: usize,
    /// Number of betas.
    pub betas: usize,
}

/// The size that trains on a desk.
pub const SMALL: Size = Size { planes: [16, 32, 64, 128], hidden: 256, betas: 10 };

/// The size of Li 2021.
pub const THESIS: Size = Size { planes: [64, 128, 256, 512], hidden: 1024, betas: 10 };

impl Size {
    /// Length of the image's feature.
    pub fn feature(&self) -> usize {
        EXPANSION * self.planes[3]
    }

    /// Name and shape of every weight.
    pub fn weights(&self) -> Vec<(String, Vec<usize>)> {
        let &Size { planes, hidden, betas } = self;
        let outputs = [
            ("decpose", "init_pose", 6 * JOINTS),
            ("decshape", "init_shape", betas),
            ("deccam", "init_cam", CAMERA),
        ];
        let state: usize = outputs.iter().map(|output| output.2).sum();
        let mut list = resnet::weights(planes);
        list.extend(pair("fc1", &[hidden, self.feature() + state], hidden));
        list.extend(pair("fc2", &[hidden, hidden], hidden));
        for (head, mean, count) in outputs {
            list.extend(pair(head, &[count, hidden], count));
            list.push((mean.to_owned(), vec![1, count]));
        }
        list
    }
}

/// One of pose, betas and camera: where it starts and what corrects it.
#[derive(Clone, Debug)]
struct Output {
    name: &'static str,
    mean: Tensor,
    correction: Linear,
}

/// An image of a person to pose, betas and camera.
#[derive(Clone, Debug)]
pub struct Regressor {
    trunk: ResNet,
    fc1: Linear,
    fc2: Linear,
    outputs: [Output; 3],
}

impl Regressor {
    /// The regressor with these weights, whose shapes give the widths.
    ///
    /// # Panics
    /// If a weight is missing, has a shape that does not fit its neighbours, or is left over.
    pub fn from_weights(mut weights: Weights) -> Regressor {
        let trunk = ResNet::take(&mut weights);
        let betas = weights.shape("decshape.bias").first().copied().unwrap_or(0);
        let fc1 = Linear::take(&mut weights, "fc1", trunk.features() + 6 * JOINTS + betas + CAMERA);
        let fc2 = Linear::take(&mut weights, "fc2", fc1.outputs());
        let mut output = |name, layer, mean, count| {
            let correction = Linear::take(&mut weights, layer, fc2.outputs());
            let found = correction.outputs();
            assert!(found == count, "regressor: {layer} gives {found} numbers, {count} are needed");
            Output { name, mean: weights.take(mean, &[1, count]), correction }
        };
        let outputs = [
            output("pose", "decpose", "init_pose", 6 * JOINTS),
            output("betas", "decshape", "init_shape", betas),
            output("camera", "deccam", "init_cam", CAMERA),
        ];
        weights.finish();
        Regressor { trunk, fc1, fc2, outputs }
    }

    /// Images \[N,3,S,S\] → the stages of the table above; `pose` \[N,144\], `betas` \[N,B\], `camera` \[N,3\].
    ///
    /// The images are crops around the person, RGB in 0…1 less ImageNet's mean (0.485, 0.456, 0.406), over its deviation
    /// (0.229, 0.224, 0.225).
    ///
    /// # Panics
    /// If the images are not \[N,3,H,W\].
    pub fn forward<T: Scalar>(&self, images: &Tensor<T>) -> Stages<T> {
        let mut stages = self.trunk.forward(images);
        let feature = stages.get("feature").clone();
        self.correct(&feature, &mut stages);
        stages
    }

    /// Features \[N,C\] → the stages of the head alone.
    ///
    /// # Panics
    /// If the features are not \[N,C\] with the C of the ResNet.
    pub fn head<T: Scalar>(&self, feature: &Tensor<T>) -> Stages<T> {
        let mut stages = Stages::default();
        self.correct(feature, &mut stages);
        stages
    }

    fn correct<T: Scalar>(&self, feature: &Tensor<T>, stages: &mut Stages<T>) {
        assert!(
            feature.rank() == 2 && feature.shape[1] == self.trunk.features(),
            "regressor: features must be [N,{}], found shape {:?}",
            self.trunk.features(),
            feature.shape
        );
        let images = feature.shape[0];
        let mut state = self.outputs.each_ref().map(|output| repeated(&output.mean, images));
        for k in 1..=ITERATIONS {
            let [pose, betas, camera] = &state;
            let x = nn::concat(&[feature, pose, betas, camera], 1);
            let hidden = stages.record(format!("hidden_{k}"), self.fc2.apply(&self.fc1.apply(&x))).clone();
            for (output, value) in self.outputs.iter().zip(&mut state) {
                *value = nn::add(value, &output.correction.apply(&hidden));
                stages.record(format!("{}_{k}", output.name), value.clone());
            }
        }
        for (output, value) in self.outputs.iter().zip(state) {
            stages.record(output.name, value);
        }
    }
}

/// [1,C] → [N,C], one row for each image.
fn repeated<T: Scalar>(mean: &Tensor, images: usize) -> Tensor<T> {
    let row = mean.map(T::exact);
    nn::concat(&vec![&row; images], 0)
}

/// The rotation matrices of one image, from its row of the stage `pose`, or `None` where six numbers mean no rotation.
///
/// # Panics
/// If the row has not 144 numbers.
///
/// ```
/// use vitruvian_reference::network::regressor::rotations;
/// let rest = [1.0, 0.0, 0.0, 1.0, 0.0, 0.0].repeat(24);
/// assert_eq!(rotations(&rest).expect("rotations")[23], [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]);
/// ```
pub fn rotations(pose: &[f64]) -> Option<Vec<Matrix3>> {
    assert!(pose.len() == 6 * JOINTS, "rotations: {} numbers, {} are six a joint", pose.len(), 6 * JOINTS);
    pose.as_chunks().0.iter().map(from_six_d).collect()
}

#[cfg(test)]
mod tests {
    use super::super::goldens;
    use super::*;
    use crate::nn::goldens::{check, pattern};
    use crate::nn::slice;

    const TINY: Size = Size { planes: [2, 3, 4, 5], hidden: 7, betas: 10 };

    fn tiny() -> Regressor {
        Regressor::from_weights(Weights::pattern(TINY.weights()))
    }

    #[test]
    fn agrees_with_pytorch() {
        let stages = tiny().forward(&pattern(&[2, 3, 64, 64], 1));
        let every = |x: &Tensor, axis, step| slice(x, axis, 0, x.shape[axis], step);
        for (name, golden) in
            ["layer1", "layer2", "layer3", "layer4"].into_iter().zip(&goldens::REGRESSOR_LAYERS)
        {
            check(&every(&every(&every(stages.get(name), 1, 3), 2, 3), 3, 2), golden);
        }
        check(stages.get("feature"), &goldens::REGRESSOR_FEATURE);
        for (name, golden) in ["pose", "betas", "camera"].into_iter().zip(&goldens::REGRESSOR_OUTPUTS) {
            check(stages.get(name), golden);
        }
    }

    #[test]
    fn the_head_is_one_affine_map_of_the_feature() {
        let (net, a, b) = (tiny(), pattern(&[1, 20], 1), pattern(&[1, 20], 2));
        let answer = |f: &Tensor| net.head(f).get("pose").clone();
        let origin = answer(&Tensor::zeros(&[1, 20]));
        let sum = nn::sub(&nn::add(&answer(&a), &answer(&b)), &origin);
        let of_sum = answer(&nn::add(&a, &b));
        let largest = of_sum.data.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        for (found, expected) in of_sum.data.iter().zip(&sum.data) {
            assert!((found - expected).abs() < 1e-13 * largest, "{found} for {expected}");
        }
    }

    #[test]
    fn three_rounds_are_the_closed_form_of_their_recurrence() {
        // In the state x = [pose, betas, camera] a round is x ↦ (I + A) x + d: d and A column by column from single rounds.
        let (net, feature) = (tiny(), pattern(&[1, 20], 3));
        let round = |x: &[f64]| -> Vec<f64> {
            let mut moved = net.clone();
            let mut rest = x;
            for output in &mut moved.outputs {
                let (own, others) = rest.split_at(output.mean.data.len());
                output.mean.data.copy_from_slice(own);
                rest = others;
            }
            let stages = moved.head(&feature);
            ["pose_1", "betas_1", "camera_1"].iter().flat_map(|name| stages.get(name).data.clone()).collect()
        };
        let count = 6 * JOINTS + TINY.betas + CAMERA;
        let unit = |i: usize| -> Vec<f64> { (0..count).map(|k| f64::from(u8::from(k == i))).collect() };
        let d = round(&vec![0.0; count]);
        let columns: Vec<Vec<f64>> =
            (0..count).map(|i| round(&unit(i)).iter().zip(&d).map(|(y, d)| y - d).collect()).collect();
        let apply = |x: &[f64]| -> Vec<f64> {
            (0..count).map(|r| (0..count).map(|c| columns[c][r] * x[c]).sum()).collect()
        };
        let plus = |x: Vec<f64>, y: &[f64]| -> Vec<f64> { x.iter().zip(y).map(|(x, y)| x + y).collect() };
        let start: Vec<f64> = net.outputs.iter().flat_map(|output| output.mean.data.clone()).collect();
        // M³x₀ + (I + M + M²)d with M = I + A.
        let powers = apply(&apply(&apply(&start)));
        let expected = plus(plus(plus(powers, &d), &apply(&d)), &apply(&apply(&d)));
        let stages = net.head(&feature);
        let found: Vec<f64> =
            ["pose", "betas", "camera"].iter().flat_map(|name| stages.get(name).data.clone()).collect();
        let largest = found.iter().fold(0.0, |m: f64, v| m.max(v.abs()));
        for (k, (found, expected)) in found.iter().zip(&expected).enumerate() {
            assert!((found - expected).abs() < 1e-12 * largest, "number {k}: {found} for {expected}");
        }
    }

    #[test]
    fn images_of_a_batch_do_not_see_each_other() {
        let (net, images) = (tiny(), pattern(&[2, 3, 32, 32], 4));
        let both = net.forward(&images);
        for n in 0..2 {
            let alone = net.forward(&slice(&images, 0, n, n + 1, 1));
            assert_eq!(*alone.get("camera"), slice(both.get("camera"), 0, n, n + 1, 1), "image {n}");
        }
    }

    #[test]
    fn the_thesis_size_has_the_parameters_of_its_layer_table() {
        let count = |list: &[(String, Vec<usize>)], prefix: &str| -> usize {
            let own = list.iter().filter(|(name, _)| name.starts_with(prefix));
            own.map(|(_, shape)| shape.iter().product::<usize>()).sum()
        };
        let list = THESIS.weights();
        assert_eq!(THESIS.feature(), 2048);
        assert_eq!(
            (count(&list, "fc1"), count(&list, "fc2"), count(&list, "dec")),
            (2_258_944, 1_049_600, 160_925)
        );
        // ResNet-50 without its classifier has 23 508 032 parameters; a batch norm stores as many statistics again.
        let trunk = resnet::weights(THESIS.planes);
        let statistics = count(&trunk, "") - 23_508_032;
        let running: usize = trunk.iter().filter(|w| w.0.contains("running")).map(|w| w.1[0]).sum();
        assert_eq!(statistics, running);
    }

    #[test]
    fn tracking_the_rounding_changes_no_value() {
        let (net, feature) = (tiny(), pattern(&[1, 20], 5));
        let tracked = net.head(&feature.rounded());
        assert_eq!(tracked.get("pose").values(), *net.head(&feature).get("pose"));
        // Every round adds the same three layers to the longest path.
        let terms = |name: &str| tracked.get(name).data[0].terms;
        assert!(terms("pose_1") < terms("pose_2") && terms("pose_2") < terms("pose_3"));
    }

    #[test]
    #[should_panic(expected = "images must be [N,3,H,W], found shape [1, 4, 32, 32]")]
    fn images_have_three_channels() {
        tiny().forward(&Tensor::<f64>::zeros(&[1, 4, 32, 32]));
    }

    #[test]
    #[should_panic(expected = "no use for [\"fc3.weight\"]")]
    fn a_weight_that_the_network_does_not_know_is_refused() {
        let mut list = TINY.weights();
        list.push(("fc3.weight".into(), vec![2, 2]));
        Regressor::from_weights(Weights::pattern(list));
    }

    #[test]
    fn rotations_come_six_numbers_a_joint() {
        let mut pose = [2.0, 0.0, 0.0, 0.0, 0.0, 3.0].repeat(JOINTS);
        let read = rotations(&pose).expect("rotations");
        assert_eq!((read.len(), read[0]), (JOINTS, [[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]]));
        pose[6] = 0.0;
        assert_eq!(rotations(&pose), None, "joint 1 has no first column");
    }
}
