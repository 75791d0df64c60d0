//! MF-PIFu: features of every view, and the occupancy of world points from them.

use std::path::Path;

use ndarray::{Array2, Array3, Array4};

use super::{check_channels, load_graph, points_at_once};
use crate::contract::{Contract, DepthCenter, DepthScale, Graph, ImageInput, Kind, Occupancy};
use crate::error::{Error, Result};
use crate::image_input::NetworkView;
use crate::implicit_field::ImplicitField;
use crate::session::{Input, Settings, Value};

/// The two graphs of MF-PIFu.
#[derive(Debug)]
pub struct MfPifu {
    encoder: Graph,
    query: Graph,
    image: ImageInput,
    channels: Vec<usize>,
    align_corners: bool,
    occupancy: Occupancy,
    depth_center: DepthCenter,
    depth_scale: DepthScale,
}

impl MfPifu {
    /// Loads `mf_pifu_encoder.onnx` and `mf_pifu_query.onnx` from a folder.
    ///
    /// # Errors
    /// As [`super::Reconstructor::load`].
    pub fn load(models: &Path, settings: &Settings) -> Result<MfPifu> {
        let encoder = load_graph(models, "mf_pifu_encoder.onnx", Kind::MfPifuEncoder, settings)?;
        let query = load_graph(models, "mf_pifu_query.onnx", Kind::MfPifuQuery, settings)?;
        match (encoder.contract.clone(), query.contract.clone()) {
            (
                Contract::MfPifuEncoder { image, channels: given },
                Contract::MfPifuQuery { channels, align_corners, occupancy, depth_center, depth_scale },
            ) => {
                check_channels(&encoder, &given, &query, &channels)?;
                Ok(MfPifu {
                    encoder,
                    query,
                    image,
                    channels,
                    align_corners,
                    occupancy,
                    depth_center,
                    depth_scale,
                })
            }
            (encoder, query) => Err(Error::Unanswerable(format!(
                "{:?} and {:?} were loaded as MF-PIFu",
                encoder.kind(),
                query.kind()
            ))),
        }
    }

    /// How views must be made: [`NetworkView::new`] takes the size and the colours.
    pub fn image(&self) -> ImageInput {
        self.image
    }

    /// The occupancy of the surface, 1 being inside.
    pub fn level(&self) -> f32 {
        self.occupancy.surface_level()
    }

    /// The features of N views, features_1..K \[N, C_k, H_k, W_k\].
    ///
    /// # Errors
    /// [`Error::Unanswerable`] when there is no view or one has another size than the graph takes; and whatever the graph
    /// gives.
    pub fn encode(&mut self, views: &[NetworkView]) -> Result<Vec<Value>> {
        let size = self.image.size;
        if views.is_empty() {
            return Err(Error::Unanswerable("a reconstruction needs at least one view".to_string()));
        }
        if let Some(view) =
            views.iter().find(|view| view.size != size || view.pixels.len() != 3 * size * size)
        {
            return Err(Error::Unanswerable(format!(
                "the view of camera {:?} is {} pixels wide, but {} takes {size}",
                view.camera.name,
                view.size,
                self.encoder.session.path().display()
            )));
        }
        let pixels = views.iter().flat_map(|view| view.pixels.iter().copied()).collect();
        let images = Array4::from_shape_vec((views.len(), 3, size, size), pixels)
            .map_err(|error| Error::Unanswerable(format!("the views do not stack: {error}")))?;
        let names = feature_names(self.channels.len());
        let wanted: Vec<&str> = names.iter().map(String::as_str).collect();
        self.encoder.session.run(&[("images", (&images).into())], &wanted)
    }

    /// The occupancy of world points in these views.
    ///
    /// `centre` is the body's estimated centre, from which depth is counted where the graph says so.
    ///
    /// # Errors
    /// [`Error::Unanswerable`] naming a camera that does not have the centre before it.
    pub fn field<'a>(
        &'a mut self,
        features: &'a [Value],
        views: &'a [NetworkView],
        centre: [f64; 3],
    ) -> Result<MfPifuField<'a>> {
        let depths = views.iter().map(|view| self.depth_measure(view, centre)).collect::<Result<_>>()?;
        Ok(MfPifuField { network: self, features, views, depths })
    }

    /// Where depth is 0 and how many metres are 1, in one view.
    fn depth_measure(&self, view: &NetworkView, centre: [f64; 3]) -> Result<(f64, f64)> {
        let (_, centre_depth) = view.uv_depth(centre).ok_or_else(|| {
            Error::Unanswerable(format!(
                "the body's centre {centre:?} is not before camera {:?}: check its R and t",
                view.camera.name
            ))
        })?;
        let zero = match self.depth_center {
            DepthCenter::BodyCenter => centre_depth,
            DepthCenter::Metres(metres) => metres,
        };
        let one = match self.depth_scale {
            DepthScale::CropHalfWidth => view.crop_half_width(centre_depth),
            DepthScale::Metres(metres) => metres,
        };
        Ok((zero, one))
    }

    /// A crop coordinate −1..1 from edge to edge, as the graph counts: from pixel centre to pixel centre if it aligns corners.
    fn grid_coordinate(&self, edge_to_edge: f64) -> f64 {
        if self.align_corners {
            let pixel = 0.5 * (edge_to_edge + 1.0) * self.image.size as f64;
            2.0 * (pixel - 0.5) / (self.image.size as f64 - 1.0) - 1.0
        } else {
            edge_to_edge
        }
    }
}

/// The names features_1, …, features_K.
pub(super) fn feature_names(count: usize) -> Vec<String> {
    (1..=count).map(|k| format!("features_{k}")).collect()
}

/// MF-PIFu's occupancy over world points, inside being larger.
///
/// A point that projects beside the silhouette in some view is outside the body, and the network is not asked: PIFu's
/// in-image product with the mask as the image, taken over all views.
#[derive(Debug)]
pub struct MfPifuField<'a> {
    network: &'a mut MfPifu,
    features: &'a [Value],
    views: &'a [NetworkView],
    depths: Vec<(f64, f64)>,
}

impl ImplicitField for MfPifuField<'_> {
    fn values(&mut self, points: &[[f64; 3]]) -> Result<Vec<f32>> {
        let (n, p) = (self.views.len(), points.len());
        let mut uv = Array3::<f32>::zeros((n, p, 2));
        let mut depth = Array2::<f32>::zeros((n, p));
        for (at, (view, (zero, one))) in self.views.iter().zip(&self.depths).enumerate() {
            for (number, &point) in points.iter().enumerate() {
                // Far outside the crop, where all features are zero, for a point behind the camera.
                let (position, metres) = view.uv_depth(point).unwrap_or(([3.0; 2], *zero));
                for axis in 0..2 {
                    uv[[at, number, axis]] = self.network.grid_coordinate(position[axis]) as f32;
                }
                depth[[at, number]] = ((metres - zero) / one) as f32;
            }
        }
        let names = feature_names(self.features.len());
        let mut inputs: Vec<(&str, Input)> =
            names.iter().map(String::as_str).zip(self.features.iter().map(Input::from)).collect();
        inputs.push(("uv", (&uv).into()));
        inputs.push(("depth", (&depth).into()));
        let outputs = self.network.query.session.run(&inputs, &["occupancy"])?;
        let occupancy = self.network.occupancy;
        Ok(outputs[0].f32()?.iter().map(|&raw| occupancy.value(raw)).collect())
    }

    fn coarse_cells(&self) -> usize {
        super::COARSE_CELLS
    }

    fn certainly_outside(&self, point: [f64; 3]) -> bool {
        !self.views.iter().all(|view| view.sees(point))
    }

    fn chunk(&self) -> usize {
        points_at_once(self.views.len(), &self.network.channels)
    }
}
