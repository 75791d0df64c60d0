//! Captures on disk: calibrated pictures of one body, with masks and keypoints.
//!
//! ```text
//! CAPTURE/
//!   cameras.json             or intri.yml (+ extri.yml)
//!   images/NAME.png|jpg|jpeg
//!   masks/NAME.png           ≥ 128 = body
//!   keypoints/NAME.json      OpenPose JSON
//!   mesh.obj, body.npz       optional ground truth
//! ```
//! A view whose camera has distortion is undistorted while it is read (picture, mask and keypoints), so that
//! everything downstream sees pinhole cameras only.

mod camera;
pub mod cameras_json;
pub(crate) mod geometry;
mod jpeg;
pub mod opencv_yaml;
pub mod picture;
mod undistort;
mod write;

use std::path::{Path, PathBuf};

use image::{GrayImage, RgbImage};

pub use camera::{Camera, Extrinsics, MAX_PIXELS, Ray, look_at};
pub use write::{BodyTruth, write};

use crate::error::{Error, Result};
use crate::file::keypoints::{self, Keypoints};

/// The pictures' file name extensions, in the order in which they are looked for.
const IMAGE_EXTENSIONS: [&str; 3] = ["png", "jpg", "jpeg"];

/// What one camera saw.
#[derive(Clone, Debug)]
pub struct View {
    /// A pinhole: distortion was removed on reading.
    pub camera: Camera,
    /// The picture, if it was asked for and is there.
    pub image: Option<RgbImage>,
    /// 255 on the body, 0 elsewhere; of the picture's size.
    pub mask: Option<GrayImage>,
    /// The body's 2-D joints, if asked for, there, and anybody was detected.
    pub keypoints: Option<Keypoints>,
}

/// One body seen by N calibrated views.
#[derive(Clone, Debug)]
pub struct Capture {
    /// The folder.
    pub path: PathBuf,
    /// In the order of the cameras file.
    pub views: Vec<View>,
}

/// Whether a part of a capture is read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Need {
    /// Not even looked for.
    Ignored,
    /// Read where it is there; damaged is still an error.
    Optional,
    /// Its absence is an error.
    Required,
}

/// Which parts of a capture are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Needs {
    /// `images/`
    pub images: Need,
    /// `masks/`
    pub masks: Need,
    /// `keypoints/`
    pub keypoints: Need,
}

impl Needs {
    /// Pictures and masks, as a reconstruction needs them.
    pub const RECONSTRUCTION: Needs =
        Needs { images: Need::Required, masks: Need::Required, keypoints: Need::Ignored };
}

impl Capture {
    /// Reads the capture in the folder `path`.
    ///
    /// # Errors
    /// There is no cameras file, a camera is unusable, a required file is missing, or a file is damaged or of another
    /// size than its camera says: one line that names the file and the camera, what was expected and found, and the fix.
    pub fn read(path: &Path, needs: Needs) -> Result<Capture> {
        let cameras = read_cameras(path)?;
        let views =
            cameras.into_iter().map(|camera| read_view(path, camera, needs)).collect::<Result<_>>()?;
        Ok(Capture { path: path.to_owned(), views })
    }

    /// The ground-truth surface's file, if there is one.
    pub fn truth_mesh(&self) -> Option<PathBuf> {
        Some(self.path.join("mesh.obj")).filter(|p| p.is_file())
    }

    /// The ground-truth body parameters' file, if there is one.
    pub fn truth_body(&self) -> Option<PathBuf> {
        Some(self.path.join("body.npz")).filter(|p| p.is_file())
    }
}

/// The checked cameras of the capture in the folder `path`: `cameras.json`, else `intri.yml` and `extri.yml`.
///
/// The YAML files hold no image size; it is taken from the pictures, or from the masks where there are none.
///
/// # Errors
/// As [`Capture::read`].
pub fn read_cameras(path: &Path) -> Result<Vec<Camera>> {
    let json = path.join("cameras.json");
    if json.is_file() {
        return cameras_json::read(&json);
    }
    let (intri, extri) = (path.join("intri.yml"), path.join("extri.yml"));
    if !intri.is_file() {
        let what = if path.is_dir() { "holds no" } else { "is no folder with" };
        return Err(Error::file(
            path,
            format!("{what} cameras.json (nor intri.yml and extri.yml); a capture needs one"),
        ));
    }
    let calibrated = opencv_yaml::read(&intri, extri.is_file().then_some(extri.as_path()))?;
    calibrated
        .into_iter()
        .map(|c| {
            let fail = |message: String| Error::camera(&intri, &c.name, message);
            camera::check_name(&c.name).map_err(fail)?;
            let picture = picture::find(&path.join("images"), &c.name, &IMAGE_EXTENSIONS)
                .or_else(|| picture::find(&path.join("masks"), &c.name, &["png"]));
            let picture = picture.ok_or_else(|| {
                fail(format!(
                    "no images/{0}.png, .jpg or .jpeg and no masks/{0}.png tells its image size",
                    c.name
                ))
            })?;
            let (width, height) = picture::dimensions(&picture)?;
            let camera = Camera {
                name: c.name.clone(),
                width,
                height,
                k: c.k,
                extrinsics: c.extrinsics,
                distortion: c.distortion,
            };
            camera.check().map_err(fail)?;
            Ok(camera)
        })
        .collect()
}

fn read_view(path: &Path, camera: Camera, needs: Needs) -> Result<View> {
    let size = Some((camera.width, camera.height));
    let locate = |need: Need, folder: &str, extensions: &[&str]| {
        if need == Need::Ignored {
            return Ok(None);
        }
        let found = picture::find(&path.join(folder), &camera.name, extensions);
        if found.is_none() && need == Need::Required {
            let names: Vec<String> =
                extensions.iter().map(|e| format!("{folder}/{}.{e}", camera.name)).collect();
            return Err(Error::camera(
                path,
                &camera.name,
                format!("{} is missing; add it or remove the camera", names.join(" or ")),
            ));
        }
        Ok(found)
    };
    let about_camera = |e: Error| match e {
        Error::File { path, message } => Error::Camera { path, camera: camera.name.clone(), message },
        other => other,
    };
    let image = locate(needs.images, "images", &IMAGE_EXTENSIONS)?
        .map(|p| picture::read_rgb(&p, size).map_err(about_camera))
        .transpose()?;
    let mask = locate(needs.masks, "masks", &["png"])?
        .map(|p| picture::read_mask(&p, size).map_err(about_camera))
        .transpose()?;
    let keypoints = locate(needs.keypoints, "keypoints", &["json"])?
        .map(|p| keypoints::read(&p).map_err(about_camera))
        .transpose()?
        .flatten();
    Ok(undistorted(View { camera, image, mask, keypoints }))
}

/// The view as a pinhole with the same K and size would have seen it.
///
/// Pictures are interpolated bilinearly, masks likewise and cut at ½; a joint beyond the radius where the lens
/// model folds over loses its confidence.
fn undistorted(view: View) -> View {
    if view.camera.is_pinhole() {
        return view;
    }
    let camera = &view.camera;
    let keypoints = view.keypoints.map(|mut k| {
        for p in &mut k.points {
            match camera.undistort([p[0], p[1]]) {
                Some([u, v]) => *p = [u, v, p[2]],
                None => p[2] = 0.0,
            }
        }
        k
    });
    View {
        image: view.image.map(|i| undistort::rgb(&i, camera)),
        mask: view.mask.map(|m| undistort::mask(&m, camera)),
        keypoints,
        camera: camera.pinhole(),
    }
}

#[cfg(test)]
mod tests {
    use super::camera::tests::camera;
    use super::*;
    use crate::file::keypoints::JointSet;
    use crate::mesh::tests::cube;
    use std::fs;

    fn view(name: &str, eye: [f64; 3]) -> View {
        let camera = Camera { name: name.into(), ..camera(eye) };
        let image = RgbImage::from_fn(320, 240, |x, y| image::Rgb([x as u8, y as u8, 9]));
        let mask =
            GrayImage::from_fn(320, 240, |x, y| image::Luma([if x > 100 && y < 200 { 255 } else { 0 }]));
        let points = (0..24).map(|j| [j as f64 / 3.0, 10.0, 1.0]).collect();
        View {
            camera,
            image: Some(image),
            mask: Some(mask),
            keypoints: Some(Keypoints { joint_set: JointSet::Smpl24, points }),
        }
    }

    const ALL: Needs = Needs { images: Need::Required, masks: Need::Required, keypoints: Need::Required };

    fn written() -> (tempfile::TempDir, Vec<View>) {
        let folder = tempfile::tempdir().unwrap();
        let views = vec![view("front", [0.0, 1.0, 3.0]), view("left", [3.0, 1.0, 0.1])];
        let body = BodyTruth {
            poses: &[0.1; 72],
            betas: &[0.2; 10],
            trans: [1.0, 2.0, 3.0],
            joints: &[[0.5; 3]; 24],
        };
        write(folder.path(), &views, Some(&cube()), Some(body)).unwrap();
        (folder, views)
    }

    fn error(folder: &Path) -> String {
        Capture::read(folder, ALL).expect_err("a fault was planted").to_string()
    }

    #[test]
    fn a_capture_is_read_back_as_it_was_written() {
        let (folder, views) = written();
        let capture = Capture::read(folder.path(), ALL).unwrap();
        for (found, expected) in capture.views.iter().zip(&views) {
            assert_eq!(found.camera, expected.camera);
            assert_eq!(found.image, expected.image);
            assert_eq!(found.mask, expected.mask);
            assert_eq!(found.keypoints, expected.keypoints);
        }
        assert_eq!(crate::file::obj::read(&capture.truth_mesh().unwrap()).unwrap(), cube());
        let mut body = crate::file::npz::Npz::open(&capture.truth_body().unwrap()).unwrap();
        assert_eq!(body.shaped::<f64>("poses", &[Some(72)]).unwrap().values, [0.1; 72]);
        assert_eq!(body.shaped::<f64>("joints", &[Some(24), Some(3)]).unwrap().values, [0.5; 72]);
        let ignored = Needs { images: Need::Ignored, masks: Need::Optional, keypoints: Need::Ignored };
        let capture = Capture::read(folder.path(), ignored).unwrap();
        assert!(capture.views[0].image.is_none() && capture.views[0].mask.is_some());
    }

    #[test]
    fn every_bad_input_names_the_file_the_camera_and_the_fix() {
        let (folder, _) = written();
        let path = folder.path();
        let mask = path.join("masks/left.png");
        let saved = fs::read(&mask).unwrap();
        fs::remove_file(&mask).unwrap();
        let message = error(path);
        assert!(message.contains("camera \"left\": masks/left.png is missing; add it"), "{message}");
        fs::write(&mask, "PNG?").unwrap();
        let message = error(path);
        assert!(
            message.contains("masks/left.png: camera \"left\": is neither a PNG nor a JPEG"),
            "{message}"
        );
        picture::write_gray(&mask, &GrayImage::new(10, 20)).unwrap();
        let message = error(path);
        assert!(
            message.contains("camera \"left\": is 10 × 20 pixels, but its camera says 320 × 240"),
            "{message}"
        );
        fs::write(&mask, &saved[..saved.len() / 2]).unwrap();
        assert!(error(path).contains("masks/left.png: camera \"left\": cannot be decoded"));
        fs::remove_file(path.join("cameras.json")).unwrap();
        assert!(error(path).contains("holds no cameras.json"));
        assert!(error(&path.join("none")).contains("is no folder with cameras.json"));
        assert!(!error(path).contains('\n'));
    }

    #[test]
    fn easymocap_files_take_the_image_size_from_the_pictures() {
        let (folder, views) = written();
        let path = folder.path();
        fs::remove_file(path.join("cameras.json")).unwrap();
        let matrix = |key: String, rows: usize, cols: usize, data: &[f64]| {
            format!("{key}: !!opencv-matrix\n  rows: {rows}\n  cols: {cols}\n  dt: d\n  data: {data:?}\n")
        };
        let mut intri = "%YAML:1.0\n---\nnames:\n  - \"front\"\n  - \"left\"\n".to_string();
        let mut extri = intri.clone();
        for v in &views {
            let (c, e) = (&v.camera, v.camera.extrinsics.unwrap());
            let mut k = c.k;
            k[0][2] -= 0.5;
            k[1][2] -= 0.5;
            intri += &matrix(format!("K_{}", c.name), 3, 3, k.as_flattened());
            extri += &matrix(format!("Rot_{}", c.name), 3, 3, e.r.as_flattened());
            extri += &matrix(format!("T_{}", c.name), 3, 1, &e.t);
        }
        fs::write(path.join("intri.yml"), intri).unwrap();
        fs::write(path.join("extri.yml"), extri).unwrap();
        let found = read_cameras(path).unwrap();
        assert_eq!(found, views.iter().map(|v| v.camera.clone()).collect::<Vec<_>>());
        fs::remove_file(path.join("images/left.png")).unwrap();
        fs::remove_file(path.join("masks/left.png")).unwrap();
        assert!(error(path).contains("camera \"left\": no images/left.png"));
    }

    #[test]
    fn a_distorted_view_is_read_as_a_pinhole_with_its_keypoints_moved() {
        let (folder, mut views) = written();
        views[0].camera.distortion = [-0.1, 0.01, 0.0, 0.0, 0.0];
        write(folder.path(), &views, None, None).unwrap();
        let capture = Capture::read(folder.path(), ALL).unwrap();
        assert!(capture.views[0].camera.is_pinhole());
        let (before, after) =
            (views[0].keypoints.as_ref().unwrap(), capture.views[0].keypoints.as_ref().unwrap());
        let expected = views[0].camera.undistort([before.points[3][0], before.points[3][1]]).unwrap();
        assert_eq!(after.points[3], [expected[0], expected[1], 1.0]);
        assert_ne!(capture.views[0].image, views[0].image);
        assert_eq!(capture.views[1].image, views[1].image);
    }
}
