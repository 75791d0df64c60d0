//! One capture through the networks: read, crop, find the body, reconstruct, and measure where the truth is known.

use std::path::Path;
use std::time::Instant;

use image::RgbImage;
use rayon::prelude::*;
use vitruvian_conformance::convert;
use vitruvian_reference::surface::mesh::Mesh;
use vitruvian_runtime::capture::{Capture, Needs};
use vitruvian_runtime::error::Error;
use vitruvian_runtime::file;
use vitruvian_runtime::image_input::{BodyRegion, NetworkView};
use vitruvian_runtime::reconstruct::{Options, Reconstruction, Reconstructor, Stage, Surface};

use crate::evaluate::surfaces::{self, Measures, Sampling};
use crate::failure::{Result, about};
use crate::progress::StageBars;

/// A capture that went through the networks.
pub struct BodyCapture {
    /// The photographs, one per view.
    pub images: Vec<RgbImage>,
    /// The views as MF-PIFu saw them.
    pub views: Vec<NetworkView>,
    /// Where the body was looked for.
    pub region: BodyRegion,
    /// The surfaces.
    pub found: Reconstruction,
    /// The true surface, if the capture holds it.
    pub truth: Option<Mesh>,
    /// Seconds to read the capture and to prepare the views.
    pub seconds_to_read: f64,
    /// Seconds to measure the surfaces.
    pub seconds_to_measure: f64,
    /// Coarse and refined against the truth.
    pub measures: [Option<Measures>; 2],
}

impl BodyCapture {
    /// Reads the capture in `path` and reconstructs its body.
    pub fn reconstruct(
        path: &Path,
        networks: &mut Reconstructor,
        options: &Options,
        bars: &mut StageBars,
    ) -> Result<BodyCapture> {
        let clock = Instant::now();
        bars.show("read", 0, 1);
        let capture = Capture::read(path, Needs::RECONSTRUCTION)?;
        let truth = capture.truth_mesh().map(|path| file::mesh::read(&path)).transpose()?;
        let (images, views) = prepare(&capture, networks)?;
        let region = BodyRegion::find(path, &views).map_err(about(path))?;
        let seconds_to_read = clock.elapsed().as_secs_f64();

        let mut show = |stage: Stage, done, all| bars.show(stage_name(stage), done, all);
        let found = networks.reconstruct(&views, &region, options, &mut show).map_err(about(path))?;

        let clock = Instant::now();
        let truth = truth.map(|mesh| convert::mesh_to_reference(&mesh));
        let mut measures = [None; 2];
        if let Some(truth) = &truth {
            bars.show("measure", 0, 1);
            for (measures, surface) in measures.iter_mut().zip([Some(&found.coarse), found.refined.as_ref()])
            {
                *measures = surface.and_then(|surface| measure(surface, truth));
            }
        }
        bars.clear();
        let seconds_to_measure = clock.elapsed().as_secs_f64();
        Ok(BodyCapture { images, views, region, found, truth, seconds_to_read, seconds_to_measure, measures })
    }

    /// The surfaces by name, in the order of their making.
    pub fn surfaces(&self) -> impl Iterator<Item = (&'static str, &Surface)> {
        [("coarse", Some(&self.found.coarse)), ("refined", self.found.refined.as_ref())]
            .into_iter()
            .filter_map(|(name, surface)| Some((name, surface?)))
    }
}

/// The name of a stage on bars and in tables.
pub fn stage_name(stage: Stage) -> &'static str {
    match stage {
        Stage::EncodeViews => "encode views",
        Stage::CoarseSurface => "coarse surface",
        Stage::Voxelize => "voxelise",
        Stage::EncodeVoxels => "encode voxels",
        Stage::RefinedSurface => "refined surface",
    }
}

fn prepare(capture: &Capture, networks: &Reconstructor) -> Result<(Vec<RgbImage>, Vec<NetworkView>)> {
    let input = networks.mf_pifu.image();
    let path = &capture.path;
    let views = capture.views.par_iter().map(|view| {
        let (Some(image), Some(mask)) = (&view.image, &view.mask) else {
            return Err(Error::camera(path, &view.camera.name, "its picture or its mask was not read"));
        };
        NetworkView::new(path, &view.camera, image, mask, input.size, &input.normalization)
    });
    let views = views.collect::<std::result::Result<Vec<_>, _>>()?;
    Ok((capture.views.iter().filter_map(|view| view.image.clone()).collect(), views))
}

fn measure(surface: &Surface, truth: &Mesh) -> Option<Measures> {
    surfaces::measure(&convert::mesh_to_reference(&surface.mesh), truth, &Sampling::default())
}
