//! What is looked at: photographs with the person's box and the intrinsic matrix, from files or from a capture.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use image::RgbImage;
use rayon::prelude::*;
use vitruvian_reference::linalg::vector::Vector3;
use vitruvian_runtime::capture::{self, Capture, MAX_PIXELS, Need, Needs, View, picture};
use vitruvian_runtime::error::Error;
use vitruvian_runtime::file::npz::Npz;
use vitruvian_runtime::person_crop::PersonBox;
use vitruvian_runtime::regress::JOINTS;
use vitruvian_runtime::regress::camera::assumed_intrinsics;

use crate::failure::{Failure, Result};

/// Photographs that are in memory together, as many as go through the network together; fewer where they are large.
const PORTION: usize = 8;

/// Where the results of one folder come from.
pub enum Source {
    /// Files.
    Photographs(Vec<Listed>),
    /// A capture's folder, and how many cameras it has.
    Capture(PathBuf, usize),
}

/// A photograph as the command line names it.
#[derive(Clone, Debug)]
pub struct Listed {
    path: PathBuf,
    name: String,
    size: (u32, u32),
    person: Person,
    focal_px: Option<f64>,
}

/// How the person of a photograph is found.
#[derive(Clone, Debug)]
enum Person {
    Box([f64; 4]),
    Mask(PathBuf),
    Whole,
}

/// A photograph, ready to be cropped.
pub struct Photograph {
    /// Names its results.
    pub name: String,
    /// What messages call it.
    pub place: String,
    /// The pixels.
    pub image: RgbImage,
    /// Where the person is.
    pub person: PersonBox,
    /// What said so: `box`, `mask` or `whole`.
    pub person_from: &'static str,
    /// The intrinsic matrix, pixels.
    pub k: [[f64; 3]; 3],
    /// What said so: `capture`, `focal-px` or `diagonal`.
    pub k_from: &'static str,
    /// The true joints in the camera's axes (metres), where a capture knows them.
    pub truth: Option<Vec<Vector3>>,
}

/// Photographs that are read and looked at together.
pub enum Portion<'a> {
    Listed(&'a [Listed]),
    Capture(&'a Path),
}

impl Source {
    /// A capture; its cameras are read to count them.
    pub fn capture(path: PathBuf) -> Result<Source> {
        let count = capture::read_cameras(&path)?.len();
        Ok(Source::Capture(path, count))
    }

    /// How many photographs there are.
    pub fn count(&self) -> usize {
        match self {
            Source::Photographs(listed) => listed.len(),
            Source::Capture(_, count) => *count,
        }
    }

    /// Consecutive photographs: at most [`PORTION`], and no more pixels together than the largest picture may have alone. A
    /// capture's views are read together, as every command reads them.
    pub fn portions(&self) -> Result<Vec<Portion<'_>>> {
        let listed = match self {
            Source::Capture(path, _) => return Ok(vec![Portion::Capture(path)]),
            Source::Photographs(listed) => listed,
        };
        let pixels = |one: &Listed| u64::from(one.size.0) * u64::from(one.size.1);
        let (mut portions, mut rest) = (Vec::new(), listed.as_slice());
        while !rest.is_empty() {
            let mut sum = 0;
            let fits = rest.iter().take(PORTION).take_while(|one| {
                sum += pixels(one);
                sum <= MAX_PIXELS
            });
            let (portion, others) = rest.split_at(fits.count().max(1));
            portions.push(Portion::Listed(portion));
            rest = others;
        }
        Ok(portions)
    }
}

/// The photographs of the command line, each with its box or mask, if there are any; checked as far as that needs no pixels.
pub fn listed(
    paths: &[PathBuf],
    boxes: &[String],
    masks: &[PathBuf],
    focal_px: Option<f64>,
) -> Result<Vec<Listed>> {
    if let Some(focal) = focal_px.filter(|focal| !(focal.is_finite() && *focal > 0.0)) {
        return Err(Failure::Usage(format!("--focal-px {focal}: expected a positive number of pixels")));
    }
    for (option, count) in [("--box", boxes.len()), ("--mask", masks.len())] {
        if count > 0 && count != paths.len() {
            return Err(Failure::Usage(format!(
                "{option} is given {count} times for {} photographs: give it once for each, in their order",
                paths.len()
            )));
        }
    }
    let mut seen: BTreeMap<String, &Path> = BTreeMap::new();
    let mut listed = Vec::with_capacity(paths.len());
    for (i, path) in paths.iter().enumerate() {
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        if let Some(other) = seen.insert(name.clone(), path) {
            return Err(Failure::Usage(format!(
                "{} and {} would both have the results \"{name}\": rename one, or give them apart",
                other.display(),
                path.display()
            )));
        }
        let size = picture::dimensions(path)?;
        let person = match (boxes.get(i), masks.get(i)) {
            (Some(text), _) => Person::Box(parse_box(text, path, size)?),
            (None, Some(mask)) => Person::Mask(mask.clone()),
            (None, None) => Person::Whole,
        };
        listed.push(Listed { path: path.clone(), name, size, person, focal_px });
    }
    Ok(listed)
}

/// x,y,width,height.
fn parse_box(text: &str, path: &Path, (width, height): (u32, u32)) -> Result<[f64; 4]> {
    let refuse = |message: String| Err(Failure::Usage(format!("--box {text}: {message}")));
    let numbers: Option<Vec<f64>> =
        text.split(',').map(|part| part.trim().parse().ok().filter(|x: &f64| x.is_finite())).collect();
    let Some(Ok([x, y, w, h])) = numbers.map(<[f64; 4]>::try_from) else {
        return refuse("expected four numbers x,y,width,height in pixels".to_owned());
    };
    if w <= 0.0 || h <= 0.0 {
        return refuse(format!("it has no area: width and height must be positive, they are {w} and {h}"));
    }
    if x >= f64::from(width) || y >= f64::from(height) || x + w <= 0.0 || y + h <= 0.0 {
        return refuse(format!("it lies outside {}, which is {width} × {height} pixels", path.display()));
    }
    Ok([x, y, w, h])
}

impl Portion<'_> {
    /// Reads the pixels and finds the people.
    pub fn read(&self) -> Result<Vec<Photograph>> {
        match self {
            Portion::Listed(listed) => listed.par_iter().map(Listed::read).collect(),
            Portion::Capture(path) => read_capture(path),
        }
    }
}

impl Listed {
    fn read(&self) -> Result<Photograph> {
        let image = picture::read_rgb(&self.path, None)?;
        let (width, height) = image.dimensions();
        let (person, person_from) = match &self.person {
            Person::Box([x, y, w, h]) => (PersonBox::around([*x, *y], [x + w, y + h]), "box"),
            Person::Mask(path) => (self.masked(path)?, "mask"),
            Person::Whole => (PersonBox::whole(width, height), "whole"),
        };
        Ok(Photograph {
            name: self.name.clone(),
            place: self.path.display().to_string(),
            person,
            person_from,
            k: assumed_intrinsics(width, height, self.focal_px),
            k_from: if self.focal_px.is_some() { "focal-px" } else { "diagonal" },
            truth: None,
            image,
        })
    }

    fn masked(&self, mask: &Path) -> Result<PersonBox> {
        let (found, wanted) = (picture::dimensions(mask)?, self.size);
        if found != wanted {
            let message = format!(
                "is {} × {} pixels, but its photograph {} is {} × {}: give the mask of this photograph",
                found.0,
                found.1,
                self.path.display(),
                wanted.0,
                wanted.1
            );
            return Err(Error::file(mask, message).into());
        }
        let pixels = picture::read_mask(mask, None)?;
        let person = PersonBox::of_mask(&pixels);
        Ok(person.ok_or_else(|| Error::file(mask, "the mask is empty: no pixel has 128 or more"))?)
    }
}

/// Every view of a capture; where it has a mask, that is the person.
fn read_capture(path: &Path) -> Result<Vec<Photograph>> {
    let needs = Needs { images: Need::Required, masks: Need::Optional, keypoints: Need::Ignored };
    let capture = Capture::read(path, needs)?;
    let truth = capture.truth_body().map(|path| true_joints(&path)).transpose()?.flatten();
    let photograph = |view: View| -> Result<Photograph> {
        let View { camera, image, mask, .. } = view;
        let fail = |message: &str| Error::camera(path, &camera.name, message);
        let image = image.ok_or_else(|| fail("its picture was not read"))?;
        let (person, person_from) = match mask {
            None => (PersonBox::whole(image.width(), image.height()), "whole"),
            Some(mask) => {
                let person = PersonBox::of_mask(&mask);
                (person.ok_or_else(|| fail("its mask is empty: leave the camera or its mask out"))?, "mask")
            }
        };
        let seen = |joints: &Vec<Vector3>| {
            let extrinsics = camera.extrinsics?;
            Some(joints.iter().map(|&joint| extrinsics.to_camera(joint)).collect())
        };
        Ok(Photograph {
            place: format!("{}: camera \"{}\"", path.display(), camera.name),
            image,
            person,
            person_from,
            k: camera.k,
            k_from: "capture",
            truth: truth.as_ref().and_then(seen),
            name: camera.name,
        })
    };
    capture.views.into_iter().map(photograph).collect()
}

/// The 24 true joints, world frame, if the file has them.
fn true_joints(path: &Path) -> Result<Option<Vec<Vector3>>> {
    let mut npz = Npz::open(path)?;
    if !npz.contains("joints") {
        return Ok(None);
    }
    let array = npz.shaped::<f64>("joints", &[None, Some(3)])?;
    let joints: Vec<Vector3> = array.values.chunks_exact(3).map(|x| [x[0], x[1], x[2]]).collect();
    let is_usable = joints.len() == JOINTS && array.values.iter().all(|x| x.is_finite());
    Ok(is_usable.then_some(joints))
}
