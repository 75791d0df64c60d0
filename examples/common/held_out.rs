//! People that no training has seen, for chapter 4: photographed from four sides, marked with noise, regressed.

use std::error::Error;
use std::path::PathBuf;

use rayon::prelude::*;
use vitruvian::body;
use vitruvian::synthesis::surroundings::Wanted;
use vitruvian::synthesis::{Scene, Settings, Surroundings, normal, scene_rng};
use vitruvian_reference::body::{BodyModel, Skeleton};
use vitruvian_reference::camera::Pinhole;
use vitruvian_reference::fitting::mv_smplify::ViewStart;
use vitruvian_reference::fitting::{Keypoint, View};
use vitruvian_reference::linalg::vector::Vector3;
use vitruvian_reference::metric::joint_errors::JointErrors;
use vitruvian_reference::metric::joints::root_relative;
use vitruvian_reference::metric::pck::PCK_THRESHOLD_M;
use vitruvian_runtime::capture::Extrinsics;
use vitruvian_runtime::person_crop::{Crop, PersonBox, crop};
use vitruvian_runtime::regress::{Regressor, full_image_translation};

/// Side of the pictures in pixels. A person then fills a box of about 224, at which chapter 4 counts pixels.
const PICTURE_PX: u32 = 256;

/// Views of a person.
const VIEWS: usize = 4;

/// What stands around the people of the harder half: what the training scenes have.
const AMONG_THINGS: Wanted = Wanted { backgrounds: 1.0, occlusion: 0.3 };

/// Sets the marks' random numbers apart from the scene's.
const MARKS: u64 = 0x6d61_726b_7321;

/// What the experiments of chapter 4 are called with.
#[derive(Clone, clap::Args)]
pub struct Arguments {
    /// Body (.npz in SMPL's arrays); the built-in mannequin without it
    #[arg(long)]
    pub body: Option<PathBuf>,
    /// People, each in four views
    #[arg(long, default_value_t = 200)]
    pub count: u64,
    /// Seed of the people; training uses small ones
    #[arg(long, default_value_t = 1000)]
    pub seed: u64,
    /// Standard deviation of the marks on both coordinates, pixels
    #[arg(long, default_value_t = 2.0)]
    pub noise_px: f64,
}

impl Arguments {
    /// The body, and its name.
    pub fn body(&self) -> Result<(String, BodyModel), Box<dyn Error>> {
        let name = self.body.as_ref().and_then(|path| path.file_stem());
        let name = name.map_or("mannequin".into(), |stem| stem.to_string_lossy().into_owned());
        Ok((name, body::load_to_pose(self.body.as_deref())?))
    }

    /// The people, drawn and photographed in parallel: before a plain background, then among things.
    pub fn people(&self, body: &BodyModel, size: u32) -> Result<[Before; 2], Box<dyn Error>> {
        let of = |wanted: &Wanted| -> Result<Vec<Person>, Box<dyn Error>> {
            let bar = vitruvian::progress::bar("people", self.count);
            let people = (0..self.count).into_par_iter().map(|index| {
                let person = Person::random(body, self, wanted, size, index);
                bar.inc(1);
                person
            });
            Ok(people.collect::<Result<_, vitruvian_runtime::error::Error>>()?)
        };
        Ok([("plain", of(&Wanted::default())?), ("among things", of(&AMONG_THINGS)?)])
    }
}

/// What people stand before, and the people.
pub type Before = (&'static str, Vec<Person>);

/// A person, and what each camera knows of it.
pub struct Person {
    /// θ \[72\].
    pub pose: Vec<f64>,
    /// β.
    pub betas: Vec<f64>,
    /// Metres.
    pub trans: Vector3,
    pub views: Vec<Seen>,
}

/// One view of a person.
pub struct Seen {
    /// What the regressor is shown.
    pub crop: Crop,
    /// The camera's intrinsics and the marks; its place is not told.
    pub view: View,
    pub extrinsics: Extrinsics,
    /// The true joints, camera frame.
    pub joints: Vec<Vector3>,
    k: [[f64; 3]; 3],
}

impl Person {
    fn random(
        body: &BodyModel,
        arguments: &Arguments,
        wanted: &Wanted,
        size: u32,
        index: u64,
    ) -> Result<Person, vitruvian_runtime::error::Error> {
        let settings = Settings { seed: arguments.seed, views: VIEWS, size_px: PICTURE_PX };
        let scene = Scene::random(body, &settings, index);
        let shots = Surroundings::random(&scene, &settings, wanted, index).photograph(&scene);
        let mut rng = scene_rng(arguments.seed ^ MARKS, index);
        let mut views = Vec::with_capacity(VIEWS);
        for (camera, shot) in scene.cameras.iter().zip(shots) {
            // As in the training scenes the box is the whole person's, what is before it notwithstanding.
            let person = PersonBox::of_mask(&shot.whole_mask).expect("the rig looks at the person");
            let extrinsics = camera.extrinsics.expect("the rig knows where its cameras stand");
            let keypoints = scene.joints.iter().zip(&shot.joint_hidden).map(|(&joint, &hidden)| {
                let noise = [(); 2].map(|()| arguments.noise_px * normal(&mut rng, 4.0));
                let ([u, v], _) = camera.project(joint).expect("the rig stands outside the person");
                Keypoint {
                    pixel_px: [u + noise[0], v + noise[1]],
                    confidence: if hidden { 0.0 } else { 1.0 },
                }
            });
            let k = camera.k;
            let intrinsics =
                Pinhole { focal_px: [k[0][0], k[1][1]], ..Pinhole::ideal(k[0][0], [k[0][2], k[1][2]]) };
            views.push(Seen {
                crop: crop(&shot.image, &person, size)?,
                view: View { camera: intrinsics, keypoints: keypoints.collect() },
                joints: scene.joints.iter().map(|&joint| extrinsics.to_camera(joint)).collect(),
                extrinsics,
                k,
            });
        }
        Ok(Person { pose: scene.pose, betas: scene.betas, trans: scene.trans, views })
    }
}

/// What a regressor makes of every view of every person, as a fit starts from it.
pub fn regress(
    regressor: &mut Regressor,
    people: &[Person],
) -> Result<Vec<Vec<ViewStart>>, vitruvian_runtime::error::Error> {
    let bar = vitruvian::progress::bar("regressor", people.len() as u64);
    let starts = people.iter().map(|person| {
        bar.inc(1);
        let crops: Vec<Crop> = person.views.iter().map(|seen| seen.crop.clone()).collect();
        let found = regressor.regress(&crops)?;
        let views = found.iter().zip(&person.views).map(|(found, seen)| {
            let pose = found.pose();
            ViewStart {
                root: [pose[0], pose[1], pose[2]],
                translation: full_image_translation(found.camera, &seen.crop, &seen.k),
                body_pose: pose[3..].to_vec(),
                betas: found.betas.clone(),
                side_px: Some(f64::from(seen.crop.side_px)),
            }
        });
        Ok(views.collect())
    });
    starts.collect()
}

/// The errors of joints over images, relative to the pelvis and after Procrustes, per image in its camera's frame.
pub struct Errors {
    pub root_relative: JointErrors,
    pub aligned: JointErrors,
}

impl Errors {
    /// Between the joints of each image and the true ones.
    pub fn of(estimates: &[Vec<Vector3>], people: &[Person]) -> Errors {
        let from_pelvis =
            |all: &[Vec<Vector3>]| all.iter().map(|joints| root_relative(joints, 0)).collect::<Vec<_>>();
        let truth: Vec<Vec<Vector3>> =
            people.iter().flat_map(|person| &person.views).map(|seen| seen.joints.clone()).collect();
        let (estimates, truth) = (from_pelvis(estimates), from_pelvis(&truth));
        Errors {
            root_relative: JointErrors::between(&estimates, &truth),
            aligned: JointErrors::aligned(&estimates, &truth),
        }
    }

    /// PCK@150, AUC, MPJPE; PCK@150, AUC, MPJPE after alignment: the columns of [`HEAD`].
    pub fn cells(&self) -> Vec<String> {
        let of = |errors: &JointErrors| {
            [
                format!("{:.1}", errors.pck(PCK_THRESHOLD_M)),
                format!("{:.1}", errors.auc()),
                format!("{:.1}", 1000.0 * errors.mean()),
            ]
        };
        [of(&self.root_relative), of(&self.aligned)].concat()
    }
}

/// The head of [`Errors::cells`].
pub const HEAD: [&str; 6] = ["PCK@150", "AUC", "MPJPE mm", "PA-PCK@150", "PA-AUC", "PA-MPJPE mm"];

/// The joints of every view's estimate, camera frame, without translations.
pub fn joints(skeleton: &Skeleton, starts: &[Vec<ViewStart>]) -> Vec<Vec<Vector3>> {
    let of = |start: &ViewStart| skeleton.posed_joints(&pose(start), &start.betas);
    starts.par_iter().flatten_iter().map(of).collect()
}

/// θ \[72\].
pub fn pose(start: &ViewStart) -> Vec<f64> {
    [&start.root[..], &start.body_pose[..]].concat()
}
