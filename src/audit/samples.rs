//! Reports made by hand, for the tests of their views.

use vitruvian_conformance::audit::report::{
    Audit, Coverage, Grade, GraphSummary, Hypothesis, NodeReport, OutputReport, Outside, SCHEMA, Source,
    Special, TensorReport, Unsupported, WorstElement,
};

/// A node of ordinary rounding that reads `t(index − 1)` and makes `t(index)`.
pub fn node(index: usize, op: &str) -> NodeReport {
    let name = format!("{op}_{index}");
    let input = if index == 0 { "x".to_owned() } else { format!("t{}", index - 1) };
    NodeReport {
        index,
        name,
        op: op.into(),
        verdict: Grade::G1,
        why: None,
        attributes: vec![("strides".into(), "[1, 1]".into())],
        inputs: vec![input],
        outputs: vec![format!("t{index}")],
        tensors: vec![tensor(&format!("t{index}"), Grade::G1)],
        source: Some(Source {
            file: "model.py".into(),
            line: 30 + index,
            code: "return self.layer(x)".into(),
            module: format!("net.{index}"),
        }),
        seconds: 0.001,
    }
}

/// A tensor of 4096 elements.
pub fn tensor(name: &str, verdict: Grade) -> TensorReport {
    let csu = if verdict == Grade::G3 { 8.4e5 } else { 2.1 };
    TensorReport {
        name: name.into(),
        element: "f32".into(),
        shape: vec![1, 16, 16, 16],
        verdict,
        elements: 4096,
        compared: 4096,
        sample: None,
        n_eff: 28.0,
        csu_max: Some(csu),
        csu_p999: Some(csu / 1.5),
        csu_rms: Some(csu / 5.0),
        abs_max: Some(1e-7 * csu),
        rel_max: Some(2e-7 * csu),
        ulp_max: Some(3.0 * csu),
        worst: Some(worst(name)),
        slope: Some(1e-8),
        slope_z: Some(0.3),
        mean_z: Some(-0.2),
        effective_bits: Some(22.3),
        histogram: vec![900, 40, 400, 1500, 1256, 0, 0, 0, 0, 0],
        special: Special::default(),
        undecidable: 0,
        cumulative: Some(2e-6),
        propagated: Some(1e-7),
        amplification: Some(0.9),
    }
}

fn worst(tensor: &str) -> WorstElement {
    WorstElement {
        tensor: tensor.into(),
        index: vec![0, 3, 0, 15],
        expected: Some(0.25),
        found: None,
        csu: None,
        receptive_field: vec!["x[0, 0:16, 0:2, 14:16]".into()],
    }
}

/// Three nodes of ordinary rounding.
pub fn clean() -> Audit {
    let nodes: Vec<NodeReport> =
        ["Conv", "Relu", "Conv"].iter().enumerate().map(|(at, op)| node(at, op)).collect();
    Audit {
        schema: SCHEMA.into(),
        verdict: Grade::G1,
        graph: GraphSummary {
            path: "net.onnx".into(),
            sha256: "ab".repeat(32),
            opset: 17,
            producer: "pytorch 2.9".into(),
            inputs: vec!["x".into()],
        },
        runtime: "npz:dump.npz".into(),
        inputs: "seed 0".into(),
        first_outside: None,
        coverage: Coverage {
            nodes: 3,
            compared: 3,
            elements: 12_288,
            elements_compared: 12_288,
            ..Default::default()
        },
        nodes,
        outputs: vec![OutputReport {
            name: "t2".into(),
            cumulative: Some(2e-6),
            cumulative_rms: Some(3e-7),
            noise_floor: Some(2e-7),
        }],
        shipped: None,
        notes: vec![],
        seconds: 0.5,
    }
}

/// The same with the last node outside, an unusual first and a second that was not compared.
pub fn planted() -> Audit {
    let mut audit = clean();
    audit.verdict = Grade::G3;
    audit.nodes[0].verdict = Grade::G2;
    audit.nodes[0].tensors[0].verdict = Grade::G2;
    audit.nodes[1].verdict = Grade::NotComparable;
    audit.nodes[1].why = Some("attribute \"mode\" is \"wild\"".into());
    audit.nodes[1].tensors.clear();
    audit.nodes[2].verdict = Grade::G3;
    audit.nodes[2].tensors = vec![tensor("t2", Grade::G3)];
    audit.coverage.compared = 2;
    audit.coverage.elements_compared = 8192;
    audit.coverage.unsupported =
        vec![Unsupported { op: "Relu".into(), why: "attribute \"mode\" is \"wild\"".into(), count: 1 }];
    audit.first_outside = Some(Outside {
        node: "Conv_2".into(),
        op: "Conv".into(),
        outputs: vec!["t2".into()],
        hypothesis: Some(Hypothesis {
            name: "padding".into(),
            detail: "pads are [1, 1, 1, 1] in the graph; reflected borders explain the numbers".into(),
            csu: 1.4,
        }),
        worst: vec![worst("t2")],
        reproduction: Some("repro/Conv_2".into()),
    });
    audit
}
