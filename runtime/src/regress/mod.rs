//! From a person's crop to pose, shape and camera, by a graph of the kind `regressor`.
//!
//! ```text
//! photograph ─ person_crop ─ S×S ─ (x/255 − mean)/std ─ graph ─┬ pose ─── 24 rotations (output)
//!                                                              ├ betas
//!                                                              └ camera ─ translation under the photograph's K (camera)
//! ```
//!
//! Whatever form the graph writes its pose in ([`PoseForm`]), rotations come out: matrices lose their rounding to the
//! nearest rotation, six numbers go through Gram–Schmidt, axis–angle vectors through Rodrigues' formula. Numbers that mean no
//! rotation, are not finite, or put the person behind the camera are refused with the graph's and the image's name.
//!
//! # References
//! Li 2021, section 4.3.2; Kanazawa et al. 2018 (HMR); Kolotouros et al. 2019 (SPIN).

pub mod camera;
mod output;

use std::path::Path;

use ndarray::Array4;

use crate::contract::{Contract, Graph, ImageInput, Kind, PoseForm};
use crate::error::{Error, Result};
use crate::image_input::Normalization;
use crate::person_crop::Crop;
use crate::rotation::{Matrix3, logarithm};
use crate::session::Settings;

pub use camera::full_image_translation;

/// The joints that a regressor poses: SMPL's.
pub const JOINTS: usize = 24;

/// The focal length of HMR's and SPIN's cameras at 224 pixels; at S pixels the same field of view has 5000·S/224.
const FOCAL_AT_224_PX: f64 = 5000.0;

/// Images that go through the graph together. ResNet-50 at 224 pixels holds about 20 MB of activations for each, and eight
/// keep the processor as busy as eighty.
const BATCH: usize = 8;

/// What the regressor says about one person.
#[derive(Clone, Debug, PartialEq)]
pub struct Regression {
    /// 24 rotations: the root's in camera axes (y down, so that an upright person is turned by about half a turn about x),
    /// the others' relative to their parents.
    pub rotations: Vec<Matrix3>,
    /// B shape parameters.
    pub betas: Vec<f64>,
    /// The weak-perspective camera (s, t_x, t_y) of the crop: (x, y) of the body, in metres and camera axes, is at
    /// s·(x + t_x), s·(y + t_y) from the crop's middle, in halves of its side; s > 0.
    pub camera: [f64; 3],
}

impl Regression {
    /// The 72 numbers of the pose as axis–angle vectors (radians).
    pub fn pose(&self) -> Vec<f64> {
        self.rotations.iter().flat_map(logarithm).collect()
    }
}

/// A loaded regressor.
#[derive(Debug)]
pub struct Regressor {
    graph: Graph,
    image: ImageInput,
    form: PoseForm,
    betas: Option<usize>,
    focal_length_px: f64,
    /// N, where the graph fixes it.
    batch: Option<usize>,
}

impl Regressor {
    /// Loads a graph and checks that it keeps the contract of a regressor.
    ///
    /// ```no_run
    /// use vitruvian_runtime::capture::picture;
    /// use vitruvian_runtime::person_crop::{PersonBox, crop};
    /// use vitruvian_runtime::regress::{Regressor, camera::assumed_intrinsics, full_image_translation};
    /// use vitruvian_runtime::session::Settings;
    ///
    /// let mut regressor = Regressor::load("models/exported/regressor.onnx", &Settings::default())?;
    /// let photograph = picture::read_rgb("person.jpg".as_ref(), None)?;
    /// let person = PersonBox::around([200.0, 40.0], [300.0, 440.0]);
    /// let crop = crop(&photograph, &person, regressor.image_size())?;
    /// let found = regressor.regress(std::slice::from_ref(&crop))?.remove(0);
    /// let k = assumed_intrinsics(photograph.width(), photograph.height(), None);
    /// println!("{:?} at {:?} m", found.pose(), full_image_translation(found.camera, &crop, &k));
    /// # Ok::<(), vitruvian_runtime::error::Error>(())
    /// ```
    ///
    /// # Errors
    /// As [`Graph::load`]; [`Error::Missing`] when there is no such file.
    pub fn load(path: impl AsRef<Path>, settings: &Settings) -> Result<Regressor> {
        let path = path.as_ref();
        if !path.exists() {
            return Err(Error::Missing {
                component: "the regressor",
                message: format!(
                    "{} does not exist; export it with models/export.py, or name a graph of your own",
                    path.display()
                ),
            });
        }
        Regressor::of(Graph::load(path, Kind::Regressor, settings)?)
    }

    fn of(graph: Graph) -> Result<Regressor> {
        let Contract::Regressor { image, pose, betas, focal_length_px } = graph.contract else {
            return Err(Error::Graph {
                path: graph.session.path().to_path_buf(),
                item: "contract".to_string(),
                message: format!("expected a regressor, found {:?}", graph.contract.kind()),
            });
        };
        let first = graph.session.inputs().iter().find(|info| info.name == "image");
        let batch = first.and_then(|info| info.shape.first()?.fixed()).filter(|&n| n > 0);
        let focal_length_px = focal_length_px.unwrap_or(FOCAL_AT_224_PX * image.size as f64 / 224.0);
        Ok(Regressor { graph, image, form: pose, betas, focal_length_px, batch })
    }

    /// S: crops are S × S pixels.
    pub fn image_size(&self) -> u32 {
        // The contract bounds it by 8192.
        self.image.size as u32
    }

    /// B, where the graph fixes it.
    pub fn beta_count(&self) -> Option<usize> {
        self.betas
    }

    /// How the graph writes its pose.
    pub fn pose_form(&self) -> PoseForm {
        self.form
    }

    /// f of the pinhole, in pixels of the crop, that the weak-perspective camera stands for: what the graph declares, or
    /// HMR's 5000·S/224.
    pub fn focal_length_px(&self) -> f64 {
        self.focal_length_px
    }

    /// What the regressor says about each crop, in their order.
    ///
    /// Images go through the graph in portions of at most eight, whatever their number, so that memory is bounded and the
    /// same list gives the same numbers.
    ///
    /// # Errors
    /// As [`Regressor::regress_named`], with images named by their numbers from 0.
    pub fn regress(&mut self, crops: &[Crop]) -> Result<Vec<Regression>> {
        let crops: Vec<_> = crops.iter().enumerate().map(|(i, crop)| (format!("image {i}"), crop)).collect();
        let named: Vec<_> = crops.iter().map(|(name, crop)| (name.as_str(), *crop)).collect();
        self.regress_named(&named)
    }

    /// As [`Regressor::regress`], with the names that messages give the images.
    ///
    /// # Errors
    /// [`Error::Unanswerable`] when a crop has another size than the graph takes; [`Error::Graph`] naming output and image
    /// when a number is not finite, means no rotation, or the scale of a camera is not positive, or when an output has
    /// another shape than the graph declared; and whatever ONNX Runtime says.
    pub fn regress_named(&mut self, crops: &[(&str, &Crop)]) -> Result<Vec<Regression>> {
        let size = self.image_size();
        for (name, crop) in crops {
            let found = crop.image.dimensions();
            if found != (size, size) {
                let message =
                    format!("the crop is {} × {} pixels, the graph takes {size} × {size}", found.0, found.1);
                return Err(Error::Unanswerable(format!("{name}: {message}")));
            }
        }
        let mut found = Vec::with_capacity(crops.len());
        for portion in crops.chunks(self.batch.unwrap_or(BATCH)) {
            found.extend(self.run(portion)?);
        }
        Ok(found)
    }

    fn run(&mut self, crops: &[(&str, &Crop)]) -> Result<Vec<Regression>> {
        // A graph of a fixed number of images gets black ones where there are fewer.
        let count = self.batch.unwrap_or(crops.len());
        let size = self.image.size;
        let mut images = Array4::zeros((count, 3, size, size));
        for ((_, crop), mut image) in crops.iter().zip(images.outer_iter_mut()) {
            image.assign(&normalised(crop, &self.image.normalization));
        }
        let inputs = [("image", (&images).into())];
        let values = self.graph.session.run(&inputs, &["pose", "betas", "camera"])?;
        let names: Vec<&str> = crops.iter().map(|(name, _)| *name).collect();
        output::read(self.graph.session.path(), self.form, self.betas, &values, &names, count)
    }
}

/// A crop as the graph takes it: \[3,S,S\], red first, (x/255 − mean)/std in f32 as PyTorch's `to_tensor` and `normalize`
/// compute it, operation for operation.
pub fn normalised(crop: &Crop, colours: &Normalization) -> ndarray::Array3<f32> {
    let (width, height) = crop.image.dimensions();
    ndarray::Array3::from_shape_fn((3, height as usize, width as usize), |(c, v, u)| {
        (f32::from(crop.image.get_pixel(u as u32, v as u32).0[c]) / 255.0 - colours.mean[c]) / colours.std[c]
    })
}

#[cfg(test)]
mod tests;
