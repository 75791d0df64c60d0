//! The regressor: the committed graph, thesis-size graphs where they were exported, and faults in a graph built here.

use std::path::{Path, PathBuf};

use vitruvian_conformance::array::Array;
use vitruvian_conformance::engine::{OPTIMIZATIONS, Optimization};
use vitruvian_conformance::onnx::model::Model;
use vitruvian_conformance::problem::values::Values;
use vitruvian_conformance::suite::networks::{Reference, StageVerdict, judge_nodes, judge_stages, unjudged};
use vitruvian_conformance::suite::regressor::{FAULTS, Fault, graph, stages};
use vitruvian_conformance::tolerance::{Kind, Size, whole_graph};
use vitruvian_reference::network::regressor;

/// Where the exported graphs lie: `models/exported`, unless `VITRUVIAN_MODELS` says otherwise.
fn exported() -> PathBuf {
    std::env::var_os("VITRUVIAN_MODELS")
        .map_or_else(|| Path::new(env!("CARGO_MANIFEST_DIR")).join("../models/exported"), PathBuf::from)
}

/// An exported regressor, if there is one; a folder whose manifest lists it must have it.
fn read(folder: &Path, command: &str) -> Option<Model> {
    let path = folder.join("regressor.onnx");
    if !path.is_file() {
        let manifest = std::fs::read_to_string(folder.join("manifest.toml")).unwrap_or_default();
        assert!(!manifest.contains("\"regressor.onnx\""), "{} is listed and missing", path.display());
        eprintln!("not judged: there is no {}; {command} exports it", path.display());
        return None;
    }
    Some(Model::read(&path).unwrap_or_else(|error| panic!("{error}")))
}

/// Images of something with a smooth inside before nothing, normalised as photographs are.
fn images(count: usize, side: usize) -> Array {
    let mut images = Values::ordinary(1).fill(&[count, 3, side, side]);
    let half = side as f32 / 2.0;
    for (place, pixel) in images.values.iter_mut().enumerate() {
        let (i, j) = ((place / side % side) as f32, (place % side) as f32);
        let inside = (i - half).hypot(1.5 * (j - 0.9 * half)) < 0.8 * half;
        *pixel = if inside { 1.5 * ((i + 2.0 * j) / 11.0).sin() + 0.3 * *pixel } else { -2.0 };
    }
    images
}

fn first_wrong(verdicts: &[StageVerdict]) -> Option<&str> {
    // The outputs stand first, and the stages in the order of their computation after them.
    let inner = verdicts.iter().skip(3).chain(&verdicts[..3]);
    inner.filter(|verdict| !verdict.comparison.within_bounds()).map(|verdict| &*verdict.stage).next()
}

fn assert_stages(model: &Model, size: Size, images: &Array) {
    let inputs = [("image", images)];
    let reference = Reference::of(model, &inputs).expect("stages");
    for optimization in OPTIMIZATIONS {
        let tolerance = whole_graph(Kind::Regressor, size);
        let (verdicts, _) =
            judge_stages(model, &reference, &inputs, optimization, &tolerance).expect("a verdict");
        for verdict in &verdicts {
            println!(
                "{} {optimization:?} {}: {:.2} of the noise floor",
                model.name(),
                verdict.stage,
                verdict.noise
            );
        }
        for verdict in &verdicts {
            let agrees = verdict.comparison.within_bounds();
            assert!(agrees, "{optimization:?}, stage {}: {}", verdict.stage, verdict.comparison);
        }
    }
}

fn assert_nodes(model: &Model, images: &Array) {
    let unjudged = unjudged(model);
    assert!(unjudged.is_empty(), "add {unjudged:?} to conformance/src/suite/operators.rs");
    let verdicts = judge_nodes(model, &[("image", images)]).expect("verdicts");
    let share = verdicts.iter().filter_map(|v| v.comparison.report()).fold(0.0_f64, |a, r| a.max(r.share));
    println!("{}: {} nodes, at most {share:.3} of their bounds", model.name(), verdicts.len());
    for verdict in &verdicts {
        let (operator, tensor) = (&verdict.operator, &verdict.tensor);
        assert!(verdict.comparison.agrees(), "{operator} → {tensor}: {}", verdict.comparison);
    }
}

const TINY: regressor::Size = regressor::Size { planes: [4, 6, 8, 12], hidden: 24, betas: 10 };

#[test]
fn a_graph_built_from_the_table_is_the_network_of_the_reference() {
    let model = graph(&TINY, 64, 2, 7, None);
    assert_nodes(&model, &images(2, 64));
    assert_stages(&model, Size::Small, &images(2, 64));
}

#[test]
fn every_planted_fault_is_seen_at_the_stage_where_it_is() {
    let images = images(1, 64);
    let inputs = [("image", &images)];
    let reference = Reference::of(&graph(&TINY, 64, 1, 7, None), &inputs).expect("stages");
    let tolerance = whole_graph(Kind::Regressor, Size::Small);
    for fault in FAULTS {
        let faulty = graph(&TINY, 64, 1, 7, Some(fault));
        let verdicts = judge_stages(&faulty, &reference, &inputs, Optimization::Disabled, &tolerance);
        match fault.stage() {
            Some(stage) => {
                let (verdicts, _) = verdicts.unwrap_or_else(|error| panic!("{fault:?}: {error}"));
                let noise = verdicts.iter().find(|v| v.stage == stage).map(|v| v.noise);
                println!("{fault:?}: {stage} is {noise:.0?} of the noise floor");
                assert_eq!(first_wrong(&verdicts), Some(stage), "{fault:?}");
            }
            None => assert!(verdicts.is_err(), "{fault:?}: a graph with other stages is refused"),
        }
    }
}

#[test]
fn a_fourth_round_is_seen_in_the_outputs_alone() {
    let images = images(1, 64);
    let inputs = [("image", &images)];
    let reference = Reference::of(&graph(&TINY, 64, 1, 7, None), &inputs).expect("stages");
    let faulty = graph(&TINY, 64, 1, 7, Some(Fault::FourthRound));
    let found = vitruvian_conformance::engine::run("faulty", faulty.bytes(), Optimization::All, &inputs);
    for (stage, found) in ["pose", "betas", "camera"].into_iter().zip(found.expect("outputs")) {
        let answer = reference.stages.get(stage);
        let difference = answer.data.iter().zip(&found.values).map(|(y, x)| (y - f64::from(*x)).abs());
        let floors = difference.fold(0.0, f64::max) / reference.noise_floor(stage);
        assert!(floors > 1000.0, "{stage} is {floors} noise floors away");
    }
}

#[test]
fn a_graph_without_the_additions_of_a_resnet_is_refused_by_name() {
    let other = vitruvian_conformance::onnx::builder::GraphBuilder::new(21)
        .input("image", &[1, 3, 8, 8])
        .node("GlobalAveragePool", &["image"], &["pose"], vec![])
        .output("pose");
    let error =
        stages(&Model::from_bytes("other.onnx", other.to_bytes()).expect("a model")).expect_err("refused");
    assert!(error.to_string().contains("other.onnx") && error.to_string().contains("0 additions"), "{error}");
}

#[test]
fn the_small_regressor_is_the_network_of_the_reference() {
    if let Some(model) = read(&exported(), "`make models`") {
        assert_nodes(&model, &images(1, 128));
        assert_stages(&model, Size::Small, &images(2, 128));
    }
}

#[test]
fn the_thesis_size_regressor_is_the_network_of_the_reference() {
    for filling in ["random", "widened"] {
        if let Some(model) = read(&exported().join("thesis").join(filling), "`make thesis`") {
            let side = model.property("vitruvian.image_size").and_then(|side| side.parse().ok());
            let side = side.expect("vitruvian.image_size, which every exported regressor declares");
            assert_stages(&model, Size::Thesis, &images(1, side));
        }
    }
}
