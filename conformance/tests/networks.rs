//! The exported graphs: complete, right node by node, and the networks of the thesis stage by stage.
//!
//! The small graphs are committed; a missing one fails. The thesis-size graphs are exported by one command and judged
//! where they are.

use std::path::{Path, PathBuf};

use vitruvian_conformance::array::Array;
use vitruvian_conformance::compare::Found;
use vitruvian_conformance::engine::{self, OPTIMIZATIONS, Optimization};
use vitruvian_conformance::onnx::model::Model;
use vitruvian_conformance::problem::values::{Pattern, Values};
use vitruvian_conformance::suite::networks::{Reference, judge_nodes, judge_stages, unjudged};
use vitruvian_conformance::tolerance::{Kind, Size, whole_graph, widened};

const GRAPHS: [&str; 4] = ["mf_pifu_encoder", "mf_pifu_query", "vsr_encoder", "vsr_query"];

/// Where the exported graphs lie: `models/exported`, unless `VITRUVIAN_MODELS` says otherwise.
fn exported() -> PathBuf {
    std::env::var_os("VITRUVIAN_MODELS")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/exported"), PathBuf::from)
}

fn graph(folder: &Path, name: &str) -> Model {
    let path = folder.join(name).with_extension("onnx");
    Model::read(&path).unwrap_or_else(|error| {
        panic!("{error}\nthe small graphs are committed; `make models` makes them anew")
    })
}

/// A thesis-size filling, if it has been exported.
fn thesis(filling: &str) -> Option<PathBuf> {
    let folder = exported().join("thesis").join(filling);
    if GRAPHS.iter().all(|name| folder.join(name).with_extension("onnx").is_file()) {
        return Some(folder);
    }
    eprintln!("not judged: no thesis-size graphs in {}; `make thesis` exports them", folder.display());
    None
}

/// Inputs of the two encoders, and of the queries beside the features: a disc in each of `views` images on a background
/// of zeros, a ball of voxels, points around both.
struct Scene {
    images: Array,
    uv: Array,
    depth: Array,
    voxels: Array,
    points: Array,
}

impl Scene {
    fn new(views: usize, resolution: usize, count: usize) -> Self {
        let random = |seed, shape: &[usize]| Values { pattern: Pattern::Even, decade: 0, seed }.fill(shape);
        let side = 256;
        let mut images = random(1, &[views, 3, side, side]);
        for (place, pixel) in images.values.iter_mut().enumerate() {
            let (i, j) = (place / side % side, place % side);
            let radius = (i as f32 - 128.0).hypot(j as f32 - 120.0);
            // Smooth inside, with some noise, as photographs are; a masked background is exactly 0.
            *pixel = if radius < 90.0 { 0.7 * (radius / 17.0).sin() + 0.2 * *pixel } else { 0.0 };
        }
        let centre = resolution as f32 / 2.0;
        let voxels = (0..resolution.pow(3)).map(|place| {
            let index =
                [place / resolution / resolution, place / resolution % resolution, place % resolution];
            let squared: f32 = index.iter().map(|&i| (i as f32 + 0.5 - centre).powi(2)).sum();
            f32::from(u8::from(squared.sqrt() < 0.35 * resolution as f32))
        });
        Self {
            images,
            uv: random(2, &[views, count, 2]).map(|x| 1.1 * x),
            depth: random(3, &[views, count]),
            voxels: Array::new(&[1, 1, resolution, resolution, resolution], voxels.collect()),
            points: random(4, &[count, 3]).map(|x| 1.05 * x),
        }
    }

    fn encoder_inputs(&self, kind: Kind) -> Vec<(&'static str, &Array)> {
        match kind {
            Kind::MfPifuEncoder => vec![("images", &self.images)],
            _ => vec![("voxels", &self.voxels)],
        }
    }

    /// The inputs of a query: its features, and where to ask.
    fn query_inputs<'a>(&'a self, kind: Kind, features: &'a [(String, Array)]) -> Vec<(&'a str, &'a Array)> {
        let mut inputs: Vec<(&str, &Array)> =
            features.iter().map(|(name, array)| (name.as_str(), array)).collect();
        match kind {
            Kind::MfPifuQuery => inputs.extend([("uv", &self.uv), ("depth", &self.depth)]),
            _ => inputs.push(("points", &self.points)),
        }
        inputs
    }
}

fn named(outputs: Vec<Found>) -> Vec<(String, Array)> {
    let name =
        |(k, found): (usize, Found)| (format!("features_{}", k + 1), Array::new(&found.shape, found.values));
    outputs.into_iter().enumerate().map(name).collect()
}

/// Judges encoder and query of both networks stage by stage, optimised and not.
fn judge_networks(folder: &Path, size: Size, scene: &Scene) {
    for [encoder, query] in [["mf_pifu_encoder", "mf_pifu_query"], ["vsr_encoder", "vsr_query"]] {
        let (encoder, query) = (graph(folder, encoder), graph(folder, query));
        let (kind, asked) = (Kind::of(&encoder).expect("a kind"), Kind::of(&query).expect("a kind"));
        let inputs = scene.encoder_inputs(kind);
        let reference = Reference::of(&encoder, &inputs).expect("stages");
        for optimization in OPTIMIZATIONS {
            let (mut verdicts, features) =
                judge_stages(&encoder, &reference, &inputs, optimization, &whole_graph(kind, size))
                    .expect("a verdict");
            // The query is judged on the features that the runtime made.
            let features = named(features);
            let inputs = scene.query_inputs(asked, &features);
            let reference = Reference::of(&query, &inputs).expect("stages");
            let answer = judge_stages(&query, &reference, &inputs, optimization, &whole_graph(asked, size));
            verdicts.extend(answer.expect("a verdict").0);
            for verdict in verdicts {
                println!(
                    "{kind:?} {size:?} {optimization:?} {}: {:.2} of the noise floor",
                    verdict.stage, verdict.noise
                );
                assert!(
                    verdict.comparison.within_bounds(),
                    "{}, optimization {optimization:?}, stage {}: {}",
                    encoder.name(),
                    verdict.stage,
                    verdict.comparison
                );
            }
        }
    }
}

/// Judges each node of these graphs from its own operands.
fn judge_all_nodes(folder: &Path, names: &[[&str; 2]], scene: &Scene) {
    for [encoder, query] in names {
        let (encoder, query) = (graph(folder, encoder), graph(folder, query));
        let encoder_inputs = scene.encoder_inputs(Kind::of(&encoder).expect("a kind"));
        let features = engine::run(encoder.name(), encoder.bytes(), Optimization::Disabled, &encoder_inputs);
        let features = named(features.expect("features"));
        let query_inputs = scene.query_inputs(Kind::of(&query).expect("a kind"), &features);
        for (model, inputs) in [(&encoder, &encoder_inputs), (&query, &query_inputs)] {
            let verdicts = judge_nodes(model, inputs).expect("verdicts");
            let nodes =
                model.nodes().iter().filter(|node| node.op_type.as_deref() != Some("Constant")).count();
            assert_eq!(verdicts.len(), nodes, "{}: every node is judged", model.name());
            for verdict in &verdicts {
                assert!(
                    verdict.comparison.agrees(),
                    "{}: {} → {}: {}",
                    model.name(),
                    verdict.operator,
                    verdict.tensor,
                    verdict.comparison
                );
            }
            let share =
                verdicts.iter().filter_map(|v| v.comparison.report()).fold(0.0_f64, |a, r| a.max(r.share));
            println!("{}: {nodes} nodes, at most {share:.3} of their bounds", model.name());
        }
    }
}

#[test]
fn every_operator_of_the_exported_graphs_is_judged() {
    for name in GRAPHS {
        let model = graph(&exported(), name);
        let unjudged = unjudged(&model);
        assert!(unjudged.is_empty(), "{name}: add {unjudged:?} to conformance/src/suite/operators.rs");
    }
}

#[test]
fn every_node_of_the_small_graphs_is_within_rounding() {
    let networks = [["mf_pifu_encoder", "mf_pifu_query"], ["vsr_encoder", "vsr_query"]];
    judge_all_nodes(&exported(), &networks, &Scene::new(1, 32, 500));
}

#[test]
fn the_small_graphs_are_the_networks_of_the_reference() {
    judge_networks(&exported(), Size::Small, &Scene::new(2, 32, 1000));
}

#[test]
fn the_thesis_size_graphs_are_the_networks_of_the_reference() {
    for filling in ["random", "widened"] {
        if let Some(folder) = thesis(filling) {
            judge_networks(&folder, Size::Thesis, &Scene::new(1, 32, 200));
            judge_all_nodes(&folder, &[["vsr_encoder", "vsr_query"]], &Scene::new(1, 16, 200));
        }
    }
}

#[test]
fn the_widened_graphs_compute_what_the_small_ones_compute() {
    let Some(folder) = thesis("widened") else { return };
    let (scene, tolerance) = (Scene::new(1, 32, 1000), widened());
    for [encoder, query] in [["mf_pifu_encoder", "mf_pifu_query"], ["vsr_encoder", "vsr_query"]] {
        let answer = |folder: &Path| {
            let (encoder, query) = (graph(folder, encoder), graph(folder, query));
            let inputs = scene.encoder_inputs(Kind::of(&encoder).expect("a kind"));
            let features = engine::run(encoder.name(), encoder.bytes(), Optimization::All, &inputs);
            let features = named(features.expect("features"));
            let inputs = scene.query_inputs(Kind::of(&query).expect("a kind"), &features);
            let outputs = engine::run(query.name(), query.bytes(), Optimization::All, &inputs);
            let floor = Reference::of(&query, &inputs).expect("stages").noise_floor("occupancy");
            (outputs.expect("occupancy").swap_remove(0), floor)
        };
        let ((small, floor), (wide, _)) = (answer(&exported()), answer(&folder));
        let differences = small.values.iter().zip(&wide.values).map(|(a, b)| f64::from((a - b).abs()));
        let largest = differences.fold(0.0, f64::max) / floor;
        println!("{query}: widened and small differ by {largest:.2} of the noise floor {floor:.1e}");
        assert_eq!(small.shape, wide.shape, "{query}");
        assert!(
            largest <= tolerance.allowed,
            "{query}: {largest} of the floor, {} is allowed",
            tolerance.allowed
        );
    }
}
