//! The people that were found: parameters, cameras, bodies, and how far they are from the truth where it is known.

use vitruvian_reference::metric::joints::{mpjpe, pa_mpjpe};
use vitruvian_runtime::error::Error;
use vitruvian_runtime::person_crop::{Crop, PersonBox, crop};
use vitruvian_runtime::regress::full_image_translation;
use vitruvian_runtime::skinning::{Frame, Posed};

use super::Setting;
use super::photograph::Photograph;
use crate::failure::{Result, about};

/// One photograph's person.
pub struct Found {
    /// The photograph's name.
    pub name: String,
    /// What messages call the photograph.
    pub place: String,
    /// Where the person was looked for, and what said so.
    pub person: (PersonBox, &'static str),
    /// The intrinsic matrix, and what said so.
    pub k: ([[f64; 3]; 3], &'static str),
    /// Corner and side of the square that was cut, in photograph pixels.
    pub crop: [f64; 3],
    /// 72 numbers, radians; the root in camera axes.
    pub pose: Vec<f64>,
    /// B numbers.
    pub betas: Vec<f64>,
    /// (s, t_x, t_y) of the crop.
    pub camera: [f64; 3],
    /// X_c = body + trans, metres.
    pub trans: [f64; 3],
    /// 24 joints, camera axes, metres.
    pub joints: Vec<[f64; 3]>,
    /// Joint errors in millimetres where the truth is known.
    pub errors: Option<Errors>,
}

/// Means over the joints, millimetres.
#[derive(Clone, Copy, Debug)]
pub struct Errors {
    /// Both relative to the pelvis.
    pub mpjpe_mm: f64,
    /// After the best similarity.
    pub pa_mpjpe_mm: f64,
}

/// All people of one source; the bodies of the last portion.
#[derive(Default)]
pub struct People {
    /// In the order of the photographs.
    pub found: Vec<Found>,
    /// V vertices each, camera axes, metres: of the last portion that was looked at.
    pub bodies: Vec<Posed>,
}

impl People {
    /// How many were found.
    pub fn count(&self) -> usize {
        self.found.len()
    }

    /// Looks at further photographs.
    pub fn look(&mut self, photographs: &[Photograph], setting: &mut Setting) -> Result<()> {
        let size = setting.regressor.image_size();
        let crops = photographs.iter().map(|one| {
            crop(&one.image, &one.person, size)
                .map_err(|error| Error::file(one.place.as_ref(), error.to_string()))
        });
        let crops = crops.collect::<std::result::Result<Vec<Crop>, _>>()?;
        let named: Vec<(&str, &Crop)> =
            photographs.iter().map(|one| one.place.as_str()).zip(&crops).collect();
        let regressed = setting.regressor.regress_named(&named)?;
        let first = self.count();
        for ((one, crop), found) in photographs.iter().zip(&crops).zip(&regressed) {
            self.found.push(Found {
                name: one.name.clone(),
                place: one.place.clone(),
                person: (one.person, one.person_from),
                k: (one.k, one.k_from),
                crop: [crop.origin_px[0] as f64, crop.origin_px[1] as f64, f64::from(crop.side_px)],
                pose: found.pose(),
                betas: found.betas.clone(),
                camera: found.camera,
                trans: full_image_translation(found.camera, crop, &one.k),
                joints: Vec::new(),
                errors: None,
            });
        }
        let new = &mut self.found[first..];
        let frames: Vec<Frame<'_>> = new
            .iter()
            .map(|one| Frame { pose: &one.pose, betas: &one.betas, trans: one.trans, offsets: &[] })
            .collect();
        let path = photographs.first().map(|one| one.place.clone()).unwrap_or_default();
        self.bodies = setting.skinner.pose(&frames).map_err(about(path.as_ref()))?;
        for ((one, body), photograph) in new.iter_mut().zip(&self.bodies).zip(photographs) {
            one.joints.clone_from(&body.joints);
            one.errors = photograph.truth.as_ref().map(|truth| Errors {
                mpjpe_mm: 1000.0 * mpjpe(&one.joints, truth, 0),
                pa_mpjpe_mm: 1000.0 * pa_mpjpe(&one.joints, truth),
            });
        }
        Ok(())
    }

    /// The mean errors over the photographs whose truth is known.
    pub fn mean_errors(&self) -> Option<Errors> {
        let known: Vec<Errors> = self.found.iter().filter_map(|one| one.errors).collect();
        let mean = |of: fn(&Errors) -> f64| known.iter().map(of).sum::<f64>() / known.len() as f64;
        (!known.is_empty())
            .then(|| Errors { mpjpe_mm: mean(|e| e.mpjpe_mm), pa_mpjpe_mm: mean(|e| e.pa_mpjpe_mm) })
    }

    /// One line for the terminal.
    pub fn words(&self) -> String {
        let count = self.count();
        let mut words = if count == 1 { "1 body".to_owned() } else { format!("{count} bodies") };
        if let Some(errors) = self.mean_errors() {
            words += &format!(
                ", {:.1} mm from the true joints (MPJPE), {:.1} mm aligned (PA)",
                errors.mpjpe_mm, errors.pa_mpjpe_mm
            );
        }
        let whole = self.found.iter().filter(|one| one.person.1 == "whole").count();
        if whole > 0 {
            let which = if whole == count { String::new() } else { format!(" of {whole}") };
            words += &format!(
                "; no box and no mask: the whole photograph{which} was taken for the person's square"
            );
        }
        if self.found.iter().any(|one| one.k.1 == "diagonal") {
            words += "; the focal length is assumed to be the photograph's diagonal (--focal-px gives it)";
        }
        words
    }
}
