//! Masks: the share of their union that two silhouettes have in common.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde_json::json;
use vitruvian_reference::metric::silhouette::mask_iou;
use vitruvian_runtime::capture::picture;
use vitruvian_runtime::error::Error;

use super::{Findings, sides};
use crate::failure::{Failure, Result};
use crate::table;

/// Compares two mask files: pixels of 128 and more are body.
pub fn evaluate(predicted: &Path, truth: &Path) -> Result<Findings> {
    let iou = iou(predicted, truth)?;
    let json = json!({ "files": sides(predicted, truth), "iou": iou });
    Ok(Findings { iou: Some(iou), ..Findings::new(format!("IoU {iou:.4}"), json) })
}

/// Whether a folder holds PNG files itself.
pub fn is_folder_of_masks(path: &Path) -> bool {
    !path.join("refined.ply").exists() && pictures(path).is_ok_and(|found| !found.is_empty())
}

/// Compares the masks of one name in two folders; the mean is over views (Li 2021, table 3.2).
pub fn evaluate_folders(predicted: &Path, truth: &Path) -> Result<Findings> {
    let (found, expected) = (pictures(predicted)?, pictures(truth)?);
    let mut rows = Vec::new();
    let mut views = serde_json::Map::new();
    let mut sum = 0.0;
    for (name, path) in &found {
        let other = expected.get(name).ok_or_else(|| {
            Failure::Usage(format!(
                "{}: there is no {name} to compare it with in {}",
                path.display(),
                truth.display()
            ))
        })?;
        let iou = iou(path, other)?;
        sum += iou;
        rows.push(vec![name.clone(), format!("{iou:.4}")]);
        views.insert(name.clone(), json!(iou));
    }
    let mean = sum / found.len() as f64;
    rows.push(vec!["mean".into(), format!("{mean:.4}")]);
    let json = json!({ "files": sides(predicted, truth), "views": views, "iou": mean });
    Ok(Findings { iou: Some(mean), ..Findings::new(table::aligned(&["mask", "IoU"], &rows), json) })
}

fn pictures(folder: &Path) -> Result<BTreeMap<String, PathBuf>> {
    let entries = std::fs::read_dir(folder).map_err(|e| Error::io(folder, e))?;
    Ok(entries
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.is_file() && path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")))
        .filter_map(|path| Some((path.file_name()?.to_string_lossy().into_owned(), path)))
        .collect())
}

fn iou(predicted: &Path, truth: &Path) -> Result<f64> {
    let expected = picture::read_mask(truth, None)?;
    let found = picture::read_mask(predicted, None)?;
    if found.dimensions() != expected.dimensions() {
        let ((w, h), (tw, th)) = (found.dimensions(), expected.dimensions());
        let message =
            format!("is {w} × {h} pixels, but {} is {tw} × {th}: resize one of them", truth.display());
        return Err(Error::file(predicted, message).into());
    }
    let bits = |mask: &image::GrayImage| mask.pixels().map(|p| p.0[0] >= 128).collect::<Vec<bool>>();
    mask_iou(&bits(&found), &bits(&expected)).ok_or_else(|| {
        let message = format!("and {} are both empty, so there is no IoU", truth.display());
        Error::file(predicted, message).into()
    })
}
