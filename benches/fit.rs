//! What a fit costs, on one thread: chapter 2 with four views, cameras known and unknown; chapter 3 with four masks of
//! 320×240; chapter 4's collaborative fit of four views; posing a body.
//!
//! ```text
//! cargo bench --bench fit                               the mannequin
//! VITRUVIAN_BODY=BODY.npz cargo bench --bench fit       another body
//! ```
//! Twenty people; an iteration fits the next one, so the printed time is that of a typical person. Peers: the thesis gives
//! about two minutes for each chapter's fit (i5-6500).

use std::hint::black_box;
use std::path::PathBuf;
use std::time::Duration;

use criterion::{Criterion, criterion_group, criterion_main};
use vitruvian::body;
use vitruvian::synthesis::subject::{HEIGHT, WIDTH};
use vitruvian::synthesis::{Stance, Subject};
use vitruvian_reference::camera::Pinhole;
use vitruvian_reference::fitting::multiview_smplify::MultiviewSmplify;
use vitruvian_reference::fitting::silhouette::{PoseRefinement, SilhouetteOptions, fit_silhouettes};
use vitruvian_reference::fitting::{Extrinsics, KeypointSet, MvPreset, MvSmplify, Options, ViewStart};
use vitruvian_reference::linalg::matrix::mul;
use vitruvian_reference::linalg::vector::{add, scale, sub};
use vitruvian_reference::rotation::{logarithm, rodrigues};
use vitruvian_reference::silhouette::Mask;
use vitruvian_reference::silhouette::raster::Raster;

/// People of the benches; their noise is that of a good detector.
const PEOPLE: u64 = 20;
const SEED: u64 = 31;
const NOISE_PX: f64 = 2.0;

fn fits(criterion: &mut Criterion) {
    let path = std::env::var_os("VITRUVIAN_BODY").map(PathBuf::from);
    let body = body::load_to_pose(path.as_deref()).expect("VITRUVIAN_BODY is a body of 24 joints");
    let fitter = MultiviewSmplify::new(&body).expect("a body with SMPL's tree");
    let people: Vec<Subject> =
        (0..PEOPLE).map(|index| Subject::random(&body, Stance::Any, 4, SEED, index)).collect();
    for (name, extrinsics) in [("known", Extrinsics::Known), ("unknown", Extrinsics::Unknown)] {
        for (noise, noise_px) in [("exact", 0.0), ("2 px", NOISE_PX)] {
            let seen: Vec<_> = people.iter().map(|p| p.observation(noise_px, extrinsics)).collect();
            let mut next = seen.iter().cycle();
            criterion.bench_function(&format!("multiview-smplify, 4 views, {name} cameras, {noise}"), |b| {
                b.iter(|| {
                    let observation = next.next().expect("a cycle has no end");
                    black_box(fitter.fit(observation, &Options::default(), None))
                });
            });
        }
    }
    let masks = |person: &Subject| -> Vec<Mask> {
        let (width, height) = (WIDTH as usize, HEIGHT as usize);
        let seen = |camera| Raster::of(&person.posed.vertices, &body.faces, camera, width, height).mask;
        person.cameras.iter().map(seen).collect()
    };
    let given: Vec<_> = people
        .iter()
        .map(|person| {
            let observation = person.observation(NOISE_PX, Extrinsics::Known);
            let start = fitter.fit(&observation, &Options::default(), None).expect("24 joints in every view");
            (observation, start.parameters, masks(person))
        })
        .collect();
    let mut group = criterion.benchmark_group("silhouettes, 4 views");
    group.sample_size(20).measurement_time(Duration::from_secs(20));
    for (name, refine_pose) in [("pose fixed", None), ("pose refined", Some(PoseRefinement::default()))] {
        let options = SilhouetteOptions { refine_pose, ..SilhouetteOptions::default() };
        let mut next = given.iter().cycle();
        group.bench_function(name, |b| {
            b.iter(|| {
                let (observation, start, masks) = next.next().expect("a cycle has no end");
                black_box(fit_silhouettes(&body, start, masks, Some(observation), &options))
            });
        });
    }
    group.finish();

    let collaborative = MvSmplify::of_skeleton(body.skeleton(), KeypointSet::Smpl24).expect("SMPL's tree");
    let regressed: Vec<_> = people
        .iter()
        .map(|person| {
            let views = person.observation(NOISE_PX, Extrinsics::Unknown).views;
            (views, starts(person, &collaborative))
        })
        .collect();
    for preset in MvPreset::ALL {
        let (options, mut next) = (preset.options(), regressed.iter().cycle());
        criterion.bench_function(&format!("mv-smplify, 4 views, {}", preset.name()), |b| {
            b.iter(|| {
                let (views, starts) = next.next().expect("a cycle has no end");
                black_box(collaborative.fit(views, starts, &options))
            });
        });
    }

    let mut next = people.iter().cycle();
    criterion.bench_function("reference pose, one frame", |b| {
        b.iter(|| {
            let person = next.next().expect("a cycle has no end");
            black_box(body.pose(&person.pose, &person.betas, person.trans))
        });
    });
}

/// What a regressor may say of each view: joints about 0.2 rad, the root 0.15 rad and the distance 4 % off.
fn starts(person: &Subject, fitter: &MvSmplify) -> Vec<ViewStart> {
    let pelvis = fitter.skeleton().rest_joints(&person.betas)[0];
    let root = rodrigues([person.pose[0], person.pose[1], person.pose[2]]);
    let start = |(i, camera): (usize, &Pinhole)| {
        let off = |n: usize| (1.9 * (97 * i + n) as f64).sin();
        let turned = logarithm(&mul(&camera.rotation, &root));
        let translation = sub(camera.to_camera(add(pelvis, person.trans)), pelvis);
        ViewStart {
            root: add(turned, std::array::from_fn(|c| 0.12 * off(c))),
            translation: scale(translation, 1.0 + 0.04 * off(3)),
            body_pose: person.pose[3..].iter().enumerate().map(|(n, x)| x + 0.16 * off(n + 10)).collect(),
            betas: person.betas.clone(),
            side_px: None,
        }
    };
    person.cameras.iter().enumerate().map(start).collect()
}

criterion_group!(benches, fits);
criterion_main!(benches);
