//! A drawing of a graph in layers, from top to bottom: where each node stands and which way each arc takes.
//!
//! After Sugiyama, Tagawa and Toda 1981: nodes get ranks, arcs that pass a rank get a place in it, the places of a rank are ordered by
//! the mean of their neighbours' places, and last come coordinates: each place wants to stand below (above) the mean of its
//! neighbours, and the closest arrangement that keeps the order and the gaps is a monotone regression, which pooling adjacent violators
//! solves exactly.

use std::collections::HashMap;

use serde::Serialize;
use vitruvian_conformance::audit::report::NodeReport;

/// Width and height of a node's box.
pub const BOX: [f64; 2] = [168.0, 40.0];

/// From one rank to the next.
const RANK: f64 = 68.0;

/// Between neighbours of a rank.
const GAP: f64 = 22.0;

/// Width that an arc takes in a rank that it passes.
const LANE: f64 = 10.0;

/// Sweeps that order the ranks, and sweeps that place them: more change little.
const SWEEPS: usize = 12;

/// Most nodes that are drawn: beyond, neither an eye nor a browser follows.
pub const LARGEST: usize = 5000;

/// Most places that arcs take in ranks that they pass; beyond, arcs go straight.
const LANES: usize = 60_000;

/// A graph on paper.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Drawing {
    /// Width and height.
    pub size: [f64; 2],
    /// Size of every box.
    pub size_of_box: [f64; 2],
    /// Centre of each node's box, and its rank.
    pub nodes: Vec<(f64, f64, usize)>,
    /// From, to, and the points between (x, y, x, y, …).
    pub arcs: Vec<(usize, usize, Vec<f64>)>,
}

/// A place in a rank: a node, or an arc that passes.
struct Place {
    rank: usize,
    width: f64,
    above: Vec<usize>,
    below: Vec<usize>,
    x: f64,
    is_node: bool,
}

/// Draws the nodes, which stand in topological order, of a graph with these inputs; `None` if there are more than [`LARGEST`].
pub fn draw(nodes: &[NodeReport], inputs: &[String]) -> Option<Drawing> {
    if nodes.len() > LARGEST {
        return None;
    }
    let arcs = arcs(nodes);
    let ranks = ranks(nodes, inputs, &arcs);
    let (mut places, ways) = places(&ranks, &arcs);
    let mut layers = layers(&places);
    order(&mut layers, &places);
    arrange(&layers, &mut places);
    let left = places.iter().map(|place| place.x - place.width / 2.0).fold(f64::INFINITY, f64::min);
    let right = places.iter().map(|place| place.x + place.width / 2.0).fold(f64::NEG_INFINITY, f64::max);
    let x = |place: &Place| tenth(place.x - left + GAP);
    let y = |rank: usize| rank as f64 * RANK + BOX[1] / 2.0 + GAP;
    Some(Drawing {
        size: if nodes.is_empty() {
            [2.0 * GAP; 2]
        } else {
            [tenth(right - left + 2.0 * GAP), y(layers.len() - 1) + BOX[1] / 2.0 + GAP]
        },
        size_of_box: BOX,
        nodes: places[..nodes.len()].iter().map(|place| (x(place), y(place.rank), place.rank)).collect(),
        arcs: arcs
            .iter()
            .zip(ways)
            .map(|(&(from, to), way)| {
                (from, to, way.iter().flat_map(|&lane| [x(&places[lane]), y(places[lane].rank)]).collect())
            })
            .collect(),
    })
}

/// A tenth of a unit is finer than a screen.
fn tenth(x: f64) -> f64 {
    (10.0 * x).round() / 10.0
}

/// Which node's output which node reads, each pair once. Arcs that would go back are none: the order is topological.
fn arcs(nodes: &[NodeReport]) -> Vec<(usize, usize)> {
    let mut makers: HashMap<&str, usize> = HashMap::new();
    let mut arcs = Vec::new();
    for (to, node) in nodes.iter().enumerate() {
        let mut from: Vec<usize> =
            node.inputs.iter().filter_map(|name| makers.get(name.as_str()).copied()).collect();
        from.sort_unstable();
        from.dedup();
        arcs.extend(from.into_iter().map(|from| (from, to)));
        makers.extend(node.outputs.iter().filter(|name| !name.is_empty()).map(|name| (name.as_str(), to)));
    }
    arcs
}

/// The longest path from the graph's inputs; what hangs on constants alone stands right above its first reader.
fn ranks(nodes: &[NodeReport], inputs: &[String], arcs: &[(usize, usize)]) -> Vec<usize> {
    let count = nodes.len();
    let mut makers = vec![Vec::new(); count];
    let mut readers = vec![Vec::new(); count];
    for &(from, to) in arcs {
        makers[to].push(from);
        readers[from].push(to);
    }
    let mut is_constant = vec![false; count];
    for node in 0..count {
        let reads_an_input = nodes[node].inputs.iter().any(|name| inputs.contains(name));
        is_constant[node] = !reads_an_input && makers[node].iter().all(|&maker| is_constant[maker]);
    }
    let mut ranks = vec![0_usize; count];
    for node in 0..count {
        ranks[node] = makers[node].iter().map(|&maker| ranks[maker] + 1).max().unwrap_or(0);
    }
    for node in (0..count).rev().filter(|&node| is_constant[node]) {
        let first = readers[node].iter().map(|&reader| ranks[reader]).min();
        ranks[node] = first.map_or(ranks[node], |first| first.saturating_sub(1).max(ranks[node]));
    }
    ranks
}

/// A place for each node, then one for each arc in each rank that it passes; and the places that each arc passes.
fn places(ranks: &[usize], arcs: &[(usize, usize)]) -> (Vec<Place>, Vec<Vec<usize>>) {
    let place =
        |rank, width, is_node| Place { rank, width, above: Vec::new(), below: Vec::new(), x: 0.0, is_node };
    let mut places: Vec<Place> = ranks.iter().map(|&rank| place(rank, BOX[0], true)).collect();
    let mut ways = Vec::with_capacity(arcs.len());
    let mut lanes = 0;
    for &(from, to) in arcs {
        let passed = ranks[to] - ranks[from] - 1;
        let mut way = Vec::new();
        if lanes + passed <= LANES {
            lanes += passed;
            for rank in ranks[from] + 1..ranks[to] {
                way.push(places.len());
                places.push(place(rank, LANE, false));
            }
            let chain: Vec<usize> = [from].into_iter().chain(way.iter().copied()).chain([to]).collect();
            for pair in chain.windows(2) {
                places[pair[0]].below.push(pair[1]);
                places[pair[1]].above.push(pair[0]);
            }
        }
        ways.push(way);
    }
    (places, ways)
}

fn layers(places: &[Place]) -> Vec<Vec<usize>> {
    let mut layers = vec![Vec::new(); places.iter().map(|place| place.rank + 1).max().unwrap_or(0)];
    for (number, place) in places.iter().enumerate() {
        layers[place.rank].push(number);
    }
    layers
}

/// Orders every rank by the mean place of the neighbours above, then below, by turns.
fn order(layers: &mut [Vec<usize>], places: &[Place]) {
    let mut position = vec![0.0; places.len()];
    let number = |layer: &[usize], position: &mut [f64]| {
        // Relative to the rank's middle, so that ranks of different length are comparable.
        let middle = layer.len() as f64 / 2.0;
        layer.iter().enumerate().for_each(|(at, &place)| position[place] = at as f64 - middle);
    };
    layers.iter().for_each(|layer| number(layer, &mut position));
    for sweep in 0..SWEEPS {
        let downwards = sweep % 2 == 0;
        let mut sort = |layer: &mut Vec<usize>| {
            let wanted = |&place: &usize| {
                let neighbours = if downwards { &places[place].above } else { &places[place].below };
                let sum: f64 = neighbours.iter().map(|&neighbour| position[neighbour]).sum();
                if neighbours.is_empty() { position[place] } else { sum / neighbours.len() as f64 }
            };
            let mut keyed: Vec<(f64, usize)> = layer.iter().map(|place| (wanted(place), *place)).collect();
            keyed.sort_by(|a, b| a.0.total_cmp(&b.0));
            *layer = keyed.into_iter().map(|(_, place)| place).collect();
            number(layer, &mut position);
        };
        match downwards {
            true => layers.iter_mut().for_each(&mut sort),
            false => layers.iter_mut().rev().for_each(&mut sort),
        }
    }
}

/// Gives every place its x.
fn arrange(layers: &[Vec<usize>], places: &mut [Place]) {
    for layer in layers {
        let wanted = vec![(0.0, 1.0); layer.len()];
        set(layer, &wanted, places);
    }
    for sweep in 0..SWEEPS {
        let downwards = sweep % 2 == 0;
        let mut step = |layer: &Vec<usize>| {
            let wanted: Vec<(f64, f64)> = layer.iter().map(|&place| wish(place, downwards, places)).collect();
            set(layer, &wanted, places);
        };
        match downwards {
            true => layers.iter().for_each(&mut step),
            false => layers.iter().rev().for_each(&mut step),
        }
    }
}

/// Where a place wants to stand, and how much: the mean of its neighbours on one side; long arcs want to be straight most.
fn wish(place: usize, downwards: bool, places: &[Place]) -> (f64, f64) {
    let own = &places[place];
    let neighbours = if downwards { &own.above } else { &own.below };
    let weight = |neighbour: usize| match (own.is_node, places[neighbour].is_node) {
        (true, true) => 1.0,
        (false, false) => 8.0,
        _ => 2.0,
    };
    let all: f64 = neighbours.iter().map(|&neighbour| weight(neighbour)).sum();
    let sum: f64 = neighbours.iter().map(|&neighbour| weight(neighbour) * places[neighbour].x).sum();
    if all > 0.0 { (sum / all, all) } else { (own.x, 0.1) }
}

/// The closest to the wishes, by weighted squares, that keeps the order and the gaps.
fn set(layer: &[usize], wanted: &[(f64, f64)], places: &mut [Place]) {
    let mut offsets = Vec::with_capacity(layer.len());
    let mut offset = 0.0;
    for (at, &place) in layer.iter().enumerate() {
        if at > 0 {
            offset += (places[layer[at - 1]].width + places[place].width) / 2.0 + GAP;
        }
        offsets.push(offset);
    }
    let shifted: Vec<(f64, f64)> =
        wanted.iter().zip(&offsets).map(|(&(x, weight), offset)| (x - offset, weight)).collect();
    for ((&place, x), offset) in layer.iter().zip(monotone(&shifted)).zip(&offsets) {
        places[place].x = x + offset;
    }
}

/// The non-decreasing sequence closest to (value, weight) by weighted squares: adjacent violators are pooled.
fn monotone(wanted: &[(f64, f64)]) -> Vec<f64> {
    let mut pools: Vec<(f64, f64, usize)> = Vec::new();
    for &(value, weight) in wanted {
        let mut pool = (value, weight, 1);
        while let Some(&(before, its_weight, length)) = pools.last().filter(|last| last.0 > pool.0) {
            pools.pop();
            let both = its_weight + pool.1;
            pool = ((before * its_weight + pool.0 * pool.1) / both, both, length + pool.2);
        }
        pools.push(pool);
    }
    pools.iter().flat_map(|&(value, _, length)| std::iter::repeat_n(value, length)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::audit::samples::node;

    /// Nodes that read the outputs of others, by number; what reads nothing reads the graph's input.
    fn graph(readers: &[&[usize]]) -> Vec<NodeReport> {
        let name = |number: &usize| format!("t{number}");
        let nodes = readers.iter().enumerate().map(|(number, reads)| {
            let inputs: Vec<String> =
                if reads.is_empty() { vec!["x".into()] } else { reads.iter().map(name).collect() };
            let mut node = node(number, "Add");
            (node.inputs, node.outputs) = (inputs, vec![name(&number)]);
            node
        });
        nodes.collect()
    }

    fn is_free_of_overlaps(drawing: &Drawing) {
        let mut ranks: HashMap<usize, Vec<f64>> = HashMap::new();
        drawing.nodes.iter().for_each(|&(x, _, rank)| ranks.entry(rank).or_default().push(x));
        for xs in ranks.values_mut() {
            xs.sort_by(f64::total_cmp);
            assert!(xs.windows(2).all(|pair| pair[1] - pair[0] >= BOX[0]), "boxes of a rank overlap: {xs:?}");
            assert!(xs.iter().all(|x| (BOX[0] / 2.0..=drawing.size[0] - BOX[0] / 2.0).contains(x)), "inside");
        }
    }

    #[test]
    fn a_chain_is_a_straight_line() {
        let drawing = draw(&graph(&[&[], &[0], &[1], &[2]]), &["x".into()]).expect("few nodes");
        assert!(drawing.nodes.windows(2).all(|pair| pair[0].0 == pair[1].0 && pair[1].1 - pair[0].1 == RANK));
        assert_eq!(
            drawing.arcs.iter().map(|arc| (arc.0, arc.1)).collect::<Vec<_>>(),
            [(0, 1), (1, 2), (2, 3)]
        );
    }

    #[test]
    fn arcs_go_down_and_those_that_skip_a_rank_pass_beside_its_boxes() {
        let drawing = draw(&graph(&[&[], &[0], &[1], &[0, 2]]), &["x".into()]).expect("few nodes");
        is_free_of_overlaps(&drawing);
        let (_, _, way) = drawing.arcs.iter().find(|arc| (arc.0, arc.1) == (0, 3)).expect("the skip");
        assert_eq!(way.len(), 4, "two ranks are passed");
        for (point, node) in way.chunks(2).zip([1, 2]) {
            assert!((point[0] - drawing.nodes[node].0).abs() >= BOX[0] / 2.0, "the arc runs through a box");
        }
    }

    #[test]
    fn wide_and_tangled_graphs_have_no_overlaps() {
        let reads: Vec<Vec<usize>> = (0..200_usize)
            .map(|n| (1..4).filter_map(|k| n.checked_sub(k * k * 3 + n % 5)).collect())
            .collect();
        let reads: Vec<&[usize]> = reads.iter().map(Vec::as_slice).collect();
        is_free_of_overlaps(&draw(&graph(&reads), &["x".into()]).expect("few nodes"));
    }

    #[test]
    fn constants_stand_above_their_first_reader() {
        let mut nodes = graph(&[&[], &[0], &[1], &[0], &[2, 3]]);
        nodes[3].inputs.clear();
        let drawing = draw(&nodes, &["x".into()]).expect("few nodes");
        assert_eq!(drawing.nodes[3].2, drawing.nodes[4].2 - 1);
    }

    #[test]
    fn nothing_is_drawn_of_no_nodes_or_too_many() {
        assert_eq!(draw(&[], &[]).expect("no nodes").nodes, []);
        let many: Vec<NodeReport> = (0..=LARGEST).map(|number| node(number, "Add")).collect();
        assert_eq!(draw(&many, &[]), None);
    }

    #[test]
    fn violators_are_pooled_into_their_weighted_mean() {
        assert_eq!(monotone(&[(1.0, 1.0), (4.0, 1.0), (0.0, 3.0), (5.0, 1.0)]), [1.0, 1.0, 1.0, 5.0]);
    }
}
