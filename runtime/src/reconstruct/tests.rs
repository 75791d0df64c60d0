//! Networks small enough to know the answer: MF-PIFu that intersects silhouettes, VSR that blurs voxels.

use super::*;
use crate::capture::{Camera, look_at};
use crate::image_input::BodyRegion;
use crate::test_graph::{Attribute, Element, GraphBuilder, Side};
use image::{GrayImage, Luma, Rgb, RgbImage};

use Attribute::{Int, Text};
use Element::F32;
use Side::{Fixed, Free};

const SIZE: u64 = 64;
const VOXELS: u64 = 32;
const RADII: [f64; 3] = [0.3, 0.6, 0.2];
const CENTRE: [f64; 3] = [0.05, 0.9, -0.1];

fn kind(graph: GraphBuilder, kind: &str, keys: &[(&str, &str)]) -> GraphBuilder {
    let all = [("kind", kind), ("version", "1")].into_iter().chain(keys.iter().copied());
    all.fold(graph, |graph, (key, value)| graph.metadata(&format!("vitruvian.{key}"), value))
}

const OCCUPANCY: [(&str, &str); 3] = [("align_corners", "false"), ("inside", "1"), ("level", "0.5")];

/// features_1 = mean of red, green and blue: 1 on a white body, 0 on the background.
fn mf_pifu_encoder() -> GraphBuilder {
    let graph = GraphBuilder::default()
        .input("images", F32, &[Free("N"), Fixed(3), Fixed(SIZE), Fixed(SIZE)])
        .integers("colours", &[1])
        .node("ReduceMean", &["images", "colours"], &["features_1"], &[])
        .output("features_1", F32, &[Free("N"), Fixed(1), Fixed(SIZE), Fixed(SIZE)]);
    let keys = [("image_size", "64"), ("mean", "0.5,0.5,0.5"), ("std", "0.5,0.5,0.5"), ("background", "0")];
    kind(graph, "mf-pifu.encoder", &keys)
}

fn mf_pifu_inputs(channels: u64) -> GraphBuilder {
    GraphBuilder::default()
        .input("features_1", F32, &[Free("N"), Fixed(channels), Fixed(SIZE), Fixed(SIZE)])
        .input("uv", F32, &[Free("N"), Free("P"), Fixed(2)])
        .input("depth", F32, &[Free("N"), Free("P")])
        .output("occupancy", F32, &[Free("P")])
}

fn mf_pifu_query_keys(graph: GraphBuilder) -> GraphBuilder {
    let keys: Vec<_> = OCCUPANCY
        .into_iter()
        .chain([("depth_center", "body_center"), ("depth_scale", "crop_half_width")])
        .collect();
    kind(graph, "mf-pifu.query", &keys)
}

/// occupancy = the smallest of the views' values at uv: the intersection of the silhouettes.
fn mf_pifu_query() -> GraphBuilder {
    let graph = mf_pifu_inputs(1)
        .integers("after_points", &[2])
        .integers("views", &[0])
        .integers("single", &[0, 2])
        .node("Unsqueeze", &["uv", "after_points"], &["grid"], &[])
        .node(
            "GridSample",
            &["features_1", "grid"],
            &["sampled"],
            &[("mode", Text("linear")), ("padding_mode", Text("zeros")), ("align_corners", Int(0))],
        )
        .node("ReduceMin", &["sampled", "views"], &["least"], &[("keepdims", Int(0))])
        .node("Squeeze", &["least", "single"], &["occupancy"], &[]);
    mf_pifu_query_keys(graph)
}

/// occupancy = the mean depth over the views.
fn depth_query(channels: u64) -> GraphBuilder {
    let graph = mf_pifu_inputs(channels).integers("views", &[0]);
    mf_pifu_query_keys(graph.node("ReduceMean", &["depth", "views"], &["occupancy"], &[("keepdims", Int(0))]))
}

/// features_1 = the voxels.
fn vsr_encoder() -> GraphBuilder {
    let volume = [Fixed(1), Fixed(1), Fixed(VOXELS), Fixed(VOXELS), Fixed(VOXELS)];
    let graph = GraphBuilder::default()
        .input("voxels", F32, &volume)
        .node("Identity", &["voxels"], &["features_1"], &[])
        .output("features_1", F32, &volume);
    kind(graph, "vsr.encoder", &[("resolution", "32")])
}

/// occupancy = the voxels, interpolated.
fn vsr_query() -> GraphBuilder {
    let graph = GraphBuilder::default()
        .input("features_1", F32, &[Fixed(1), Fixed(1), Free("D"), Free("D"), Free("D")])
        .input("points", F32, &[Free("P"), Fixed(3)])
        .integers("as_volume", &[0, 2, 3])
        .integers("single", &[0, 1, 3, 4])
        .node("Unsqueeze", &["points", "as_volume"], &["grid"], &[])
        .node(
            "GridSample",
            &["features_1", "grid"],
            &["sampled"],
            &[("mode", Text("linear")), ("padding_mode", Text("border")), ("align_corners", Int(0))],
        )
        .node("Squeeze", &["sampled", "single"], &["occupancy"], &[])
        .output("occupancy", F32, &[Free("P")]);
    kind(graph, "vsr.query", &OCCUPANCY)
}

fn models(graphs: &[(&str, GraphBuilder)]) -> tempfile::TempDir {
    let folder = tempfile::tempdir().expect("a temporary folder");
    for (name, graph) in graphs {
        std::fs::write(folder.path().join(name), graph.to_bytes()).expect("a writable folder");
    }
    folder
}

fn all_models() -> tempfile::TempDir {
    models(&[
        ("mf_pifu_encoder.onnx", mf_pifu_encoder()),
        ("mf_pifu_query.onnx", mf_pifu_query()),
        ("vsr_encoder.onnx", vsr_encoder()),
        ("vsr_query.onnx", vsr_query()),
    ])
}

/// A white ellipsoid with semi-axes [`RADII`] about [`CENTRE`], seen from all around.
fn views(image: &crate::contract::ImageInput) -> Vec<NetworkView> {
    let eyes = [[0.0, 1.0, 4.0], [4.0, 0.5, 0.0], [0.0, 1.2, -4.0], [-4.0, 1.0, 0.3], [2.5, 3.5, 2.5]];
    let view = |(number, eye): (usize, [f64; 3])| {
        let camera = Camera {
            name: format!("camera {number}"),
            width: 240,
            height: 320,
            k: [[500.0, 0.0, 120.0], [0.0, 500.0, 160.0], [0.0, 0.0, 1.0]],
            extrinsics: look_at(eye, CENTRE),
            distortion: [0.0; 5],
        };
        let mask = GrayImage::from_fn(240, 320, |x, y| {
            let ray = camera.ray([f64::from(x) + 0.5, f64::from(y) + 0.5]).expect("a pinhole");
            // In units of the semi-axes the ellipsoid is the unit ball: its distance from the ray is ‖o × d‖/‖d‖.
            let o: [f64; 3] = std::array::from_fn(|a| (ray.origin[a] - CENTRE[a]) / RADII[a]);
            let d: [f64; 3] = std::array::from_fn(|a| ray.direction[a] / RADII[a]);
            let dot = |a: &[f64; 3], b: &[f64; 3]| a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
            let distance = dot(&o, &o) - dot(&o, &d).powi(2) / dot(&d, &d);
            Luma([if distance < 1.0 { 255 } else { 0 }])
        });
        let white = RgbImage::from_pixel(240, 320, Rgb([255; 3]));
        NetworkView::new(Path::new("capture"), &camera, &white, &mask, image.size, &image.normalization)
            .expect("a good view")
    };
    eyes.into_iter().enumerate().map(view).collect()
}

fn volume_and_bounds(mesh: &Mesh) -> (f64, [f64; 3], [f64; 3]) {
    let at = |index: u32| mesh.vertices[index as usize].map(f64::from);
    let six = mesh.faces.iter().map(|&[a, b, c]| {
        let ([ax, ay, az], [bx, by, bz], [cx, cy, cz]) = (at(a), at(b), at(c));
        ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
    });
    let (low, high) = mesh.bounds().expect("a surface");
    (six.sum::<f64>() / 6.0, low.map(f64::from), high.map(f64::from))
}

#[test]
fn silhouettes_of_an_ellipsoid_give_its_hull_and_vsr_keeps_it_in_place() {
    let folder = all_models();
    let mut networks =
        Reconstructor::load(folder.path(), true, &Settings::default()).unwrap_or_else(|e| panic!("{e}"));
    let views = views(&networks.mf_pifu.image());
    let region = BodyRegion::find(Path::new("capture"), &views).expect("a region");
    let options = Options { resolution: 72, mode: Mode::CoarseToFine };
    let mut stages = Vec::new();
    let found = networks
        .reconstruct(&views, &region, &options, &mut |stage, done, all| {
            assert!(done <= all, "{stage:?}: {done} of {all}");
            if stages.last() != Some(&stage) {
                stages.push(stage);
            }
        })
        .expect("a body");

    use Stage::*;
    let order = [EncodeViews, CoarseSurface, Voxelize, EncodeVoxels, RefinedSurface];
    assert_eq!(stages, order);
    assert_eq!(found.seconds.iter().map(|(stage, _)| *stage).collect::<Vec<_>>(), order);
    assert_eq!(found.open_columns, 0);

    let exact = 4.0 / 3.0 * std::f64::consts::PI * RADII.iter().product::<f64>();
    let refined = found.refined.expect("VSR is loaded");
    for (name, surface, slack) in [("coarse", &found.coarse, 0.03), ("refined", &refined, 0.05)] {
        let (volume, low, high) = volume_and_bounds(&surface.mesh);
        // A hull of five silhouettes holds the ellipsoid and little more.
        assert!(volume > 0.9 * exact && volume < 1.5 * exact, "{name}: volume {volume}, ellipsoid {exact}");
        for axis in 0..3 {
            let (lowest, highest) = (CENTRE[axis] - RADII[axis], CENTRE[axis] + RADII[axis]);
            assert!(
                (low[axis] - lowest).abs() < slack + 0.1 * RADII[axis],
                "{name}: low {low:?}, axis {axis}"
            );
            assert!(
                (high[axis] - highest).abs() < slack + 0.1 * RADII[axis],
                "{name}: high {high:?}, axis {axis}"
            );
        }
        assert!(surface.field.asked < surface.field.points, "{name}: {:?}", surface.field);
    }

    let dense = Options { mode: Mode::Dense, ..options };
    let again = networks.reconstruct(&views, &region, &dense, &mut |_, _, _| {}).expect("a body");
    assert_eq!(again.coarse.mesh, found.coarse.mesh, "dense and coarse-to-fine agree");
    assert_eq!(again.refined.expect("VSR is loaded").mesh, refined.mesh, "dense and coarse-to-fine agree");
}

#[test]
fn depth_is_counted_from_the_body_centre_in_half_crop_widths() {
    let folder =
        models(&[("mf_pifu_encoder.onnx", mf_pifu_encoder()), ("mf_pifu_query.onnx", depth_query(1))]);
    let mut network = MfPifu::load(folder.path(), &Settings::default()).unwrap_or_else(|e| panic!("{e}"));
    let view = &views(&network.image())[..1];
    let features = network.encode(view).expect("a view");
    let mut field = network.field(&features, view, CENTRE).expect("a centre before the camera");
    // One step towards where the camera looks is one step of depth.
    let forward = view[0].camera.extrinsics.expect("known").r[2];
    let step = 0.25;
    let beyond = std::array::from_fn(|axis| CENTRE[axis] + step * forward[axis]);
    let depth = field.values(&[CENTRE, beyond]).expect("two points");
    let (_, metres) = view[0].uv_depth(CENTRE).expect("before the camera");
    // The crop is 1.1 times the body's height of about 1.2 m.
    let half_width = view[0].crop_half_width(metres);
    assert!((half_width - 0.66).abs() < 0.03, "half the crop is {half_width} m");
    assert!(depth[0].abs() < 1e-6, "depth at the centre is {}", depth[0]);
    assert!((f64::from(depth[1]) - step / half_width).abs() < 1e-6, "depth {} beyond the centre", depth[1]);
}

#[test]
fn points_outside_a_crop_are_certainly_outside() {
    let folder = all_models();
    let mut network = MfPifu::load(folder.path(), &Settings::default()).unwrap_or_else(|e| panic!("{e}"));
    let views = views(&network.image());
    let features = network.encode(&views).expect("views");
    let field = network.field(&features, &views, CENTRE).expect("a centre before the cameras");
    assert!(!field.certainly_outside(CENTRE));
    assert!(field.certainly_outside([CENTRE[0] + 0.8, CENTRE[1], CENTRE[2]]), "beside the front view's crop");
    assert!(field.certainly_outside([0.0, 1.0, 9.0]), "behind the front camera");
}

#[test]
fn without_vsr_the_coarse_surface_is_the_answer() {
    let folder =
        models(&[("mf_pifu_encoder.onnx", mf_pifu_encoder()), ("mf_pifu_query.onnx", mf_pifu_query())]);
    let settings = Settings::default();
    let missing = Reconstructor::load(folder.path(), true, &settings).expect_err("no VSR");
    assert_eq!(missing.exit_status(), 3);
    assert!(missing.to_string().contains("vsr_encoder.onnx does not exist"), "{missing}");
    let mut networks = Reconstructor::load(folder.path(), false, &settings).unwrap_or_else(|e| panic!("{e}"));
    let views = views(&networks.mf_pifu.image());
    let region = BodyRegion::find(Path::new("capture"), &views).expect("a region");
    let options = Options { resolution: 16, mode: Mode::CoarseToFine };
    let found = networks.reconstruct(&views, &region, &options, &mut |_, _, _| {}).expect("a body");
    assert!(found.refined.is_none() && !found.coarse.mesh.faces.is_empty());

    let message =
        networks.reconstruct(&[], &region, &options, &mut |_, _, _| {}).expect_err("no views").to_string();
    assert!(message.contains("at least one view"), "{message}");
}

#[test]
fn an_encoder_and_a_query_of_different_exports_are_refused() {
    let folder =
        models(&[("mf_pifu_encoder.onnx", mf_pifu_encoder()), ("mf_pifu_query.onnx", depth_query(2))]);
    let message =
        Reconstructor::load(folder.path(), false, &Settings::default()).expect_err("no fit").to_string();
    assert!(message.contains("they have [2] channels"), "{message}");
    assert!(message.contains("mf_pifu_encoder.onnx gives [1]"), "{message}");
}

#[test]
fn a_chunk_is_a_power_of_two_that_fits_its_memory() {
    assert_eq!(points_at_once(1, &[16, 32, 64]), 16_384);
    let thesis = points_at_once(4, &[256; 4]);
    assert_eq!(thesis, 2048, "4 views of 1025 numbers a point, six at a time, are 98 kB a point");
    assert_eq!(points_at_once(1000, &[256; 4]), 256);
}
