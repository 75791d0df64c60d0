//! Mistakes planted in an engine: every one is found at its node, and named.

use vitruvian_conformance::audit::report::Grade;
use vitruvian_conformance::suite::audit_faults::scenes::{SCENES, SEED};
use vitruvian_conformance::suite::audit_faults::{clean, faults};

/// The share of mistakes that must be named.
const NAMED: f64 = 0.8;

#[test]
fn every_planted_mistake_is_found_at_its_node_and_most_are_named() {
    println!("seed {SEED}\n| mistake | verdict | node | named | csu | sentence |\n|---|---|---|---|---|---|");
    let mut lost = Vec::new();
    let mut named = 0;
    let planted = faults::all().count();
    for fault in faults::all() {
        let audit = fault.audit().unwrap_or_else(|error| panic!("{}: {error}", fault.name));
        let Some(outside) = &audit.first_outside else {
            lost.push(format!("{}: not seen", fault.name));
            continue;
        };
        if outside.node != fault.node() {
            lost.push(format!("{}: found at {}, made in {}", fault.name, outside.node, fault.node()));
        }
        let hypothesis = outside.hypothesis.as_ref();
        let right = hypothesis.is_some_and(|hypothesis| hypothesis.name == fault.hypothesis);
        named += usize::from(right);
        println!(
            "| {} | {} | {} | {}{} | {:.2} | {} |",
            fault.name,
            audit.verdict,
            outside.node,
            hypothesis.map_or("", |h| &h.name),
            if right { String::new() } else { format!(" (for {})", fault.hypothesis) },
            hypothesis.map_or(f64::NAN, |h| h.csu),
            hypothesis.map_or("", |h| &h.detail),
        );
    }
    println!("{named} of {} named, {} lost", planted, lost.len());
    assert!(lost.is_empty(), "{}", lost.join("\n"));
    assert!(named as f64 >= NAMED * planted as f64, "{named} of {} are named", planted);
}

#[test]
fn an_engine_without_mistakes_is_within_rounding() {
    for (name, scene) in SCENES {
        let audit = clean(&scene()).unwrap_or_else(|error| panic!("{name}: {error}"));
        let outside: Vec<_> = audit.nodes.iter().filter(|node| node.verdict > Grade::G1).collect();
        assert!(outside.is_empty(), "{name}: {outside:?}");
        assert!(audit.first_outside.is_none(), "{name}");
    }
}
