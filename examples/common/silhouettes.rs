//! A person fitted to joints and masks, and how far that is from the truth.

use vitruvian::synthesis::Subject;
use vitruvian::synthesis::subject::{HEIGHT, WIDTH};
use vitruvian_reference::body::BodyModel;
use vitruvian_reference::camera::Pinhole;
use vitruvian_reference::fitting::multiview_smplify::MultiviewSmplify;
use vitruvian_reference::fitting::silhouette::{SilhouetteOptions, fit_silhouettes};
use vitruvian_reference::fitting::{Extrinsics, Options};
use vitruvian_reference::linalg::vector::{Vector3, distance};
use vitruvian_reference::metric::silhouette::mask_iou;
use vitruvian_reference::silhouette::Mask;
use vitruvian_reference::silhouette::raster::Raster;

/// How a fit ended up; `None` where the masks were refused.
#[derive(Clone, Copy, Debug)]
pub struct Outcome {
    /// Mean over the views of the overlap with the true masks.
    pub iou: f64,
    /// Mean distance of vertices from the true ones, millimetres.
    pub vertices_mm: f64,
    /// The same two for the fit to the joints, before the masks.
    pub joints_only: (f64, f64),
}

impl Outcome {
    /// Means over people.
    pub fn mean(all: &[Outcome]) -> Outcome {
        let mean = |of: fn(&Outcome) -> f64| all.iter().map(of).sum::<f64>() / all.len() as f64;
        Outcome {
            iou: mean(|o| o.iou),
            vertices_mm: mean(|o| o.vertices_mm),
            joints_only: (mean(|o| o.joints_only.0), mean(|o| o.joints_only.1)),
        }
    }

    /// The head of a table of [`Outcome::row`]s.
    pub fn head<const N: usize>(names: [&'static str; N]) -> Vec<&'static str> {
        let own = ["people", "IoU joints", "IoU masks", "vertices mm joints", "vertices mm masks"];
        names.into_iter().chain(own).collect()
    }

    /// A row of a table.
    pub fn row<const N: usize>(&self, names: [&str; N], people: usize) -> Vec<String> {
        let own = [
            people.to_string(),
            format!("{:.4}", self.joints_only.0),
            format!("{:.4}", self.iou),
            format!("{:.1}", self.joints_only.1),
            format!("{:.1}", self.vertices_mm),
        ];
        names.iter().map(|name| (*name).to_owned()).chain(own).collect()
    }
}

/// The true masks of a person.
pub fn masks(body: &BodyModel, subject: &Subject) -> Vec<Mask> {
    subject.cameras.iter().map(|camera| seen(&subject.posed.vertices, body, camera)).collect()
}

/// Fits joints with known cameras, then masks.
pub fn fit(
    body: &BodyModel,
    subject: &Subject,
    noise_px: f64,
    given: &[Mask],
    truth: &[Mask],
    options: &SilhouetteOptions,
) -> Outcome {
    let observation = subject.observation(noise_px, Extrinsics::Known);
    let joints = MultiviewSmplify::new(body)
        .and_then(|fitter| fitter.fit(&observation, &Options::default(), None))
        .expect("24 joints in every view can be fitted");
    let found = &joints.parameters;
    let before = body.pose(&found.pose, &found.betas, found.trans).vertices;
    let after = fit_silhouettes(body, found, given, Some(&observation), options)
        .expect("masks of the person that the joints are of");
    let (iou, vertices_mm) = score(body, subject, &after.vertices, truth);
    Outcome { iou, vertices_mm, joints_only: score(body, subject, &before, truth) }
}

/// The mean overlap with the true masks, and the mean distance from the true vertices in millimetres.
pub fn score(body: &BodyModel, subject: &Subject, vertices: &[Vector3], truth: &[Mask]) -> (f64, f64) {
    let overlap = |(camera, mask): (&Pinhole, &Mask)| {
        mask_iou(&seen(vertices, body, camera).inside, &mask.inside).unwrap_or(0.0)
    };
    let iou = subject.cameras.iter().zip(truth).map(overlap).sum::<f64>() / truth.len() as f64;
    let far: f64 = vertices.iter().zip(&subject.posed.vertices).map(|(&a, &b)| distance(a, b)).sum();
    (iou, 1000.0 * far / vertices.len() as f64)
}

fn seen(vertices: &[Vector3], body: &BodyModel, camera: &Pinhole) -> Mask {
    Raster::of(vertices, &body.faces, camera, WIDTH as usize, HEIGHT as usize).mask
}
