//! Coarse points, seeds between them, and the surface followed from the seeds.

use std::collections::HashSet;

use super::sampler::{Asker, Samples};
use super::{ImplicitField, Mode, check_both_sides};
use crate::error::Result;
use crate::marching_cubes::Lattice as _;

/// The surface cells that were found, sorted x-major, and the values at all their corners.
pub(super) struct Followed {
    pub(super) values: Samples,
    pub(super) cells: Vec<[i32; 3]>,
}

/// Finds the surface cells, with a coarse point at every `step`-th lattice point and at the last.
pub(super) fn follow<F: ImplicitField>(asker: &mut Asker<F>, step: usize, level: f32) -> Result<Followed> {
    let resolution = asker.lattice.resolution as i32;
    let mut stations: Vec<i32> = (0..resolution).step_by(step).collect();
    stations.push(resolution);

    let mut values = Samples::new(resolution);
    let coarse = stations.iter().flat_map(|&i| {
        stations.iter().flat_map(move |&j| (0..=resolution).step_by(step).map(move |k| [i, j, k]))
    });
    asker.complete(&mut values, coarse)?;
    // The last station along z, where the step does not divide the resolution.
    let last = stations.iter().flat_map(|&i| stations.iter().map(move |&j| [i, j, resolution]));
    asker.complete(&mut values, last)?;
    check_both_sides(asker.range, level, Mode::CoarseToFine)?;

    let edges = crossed_coarse_edges(&values, &stations, level);
    asker.complete(&mut values, edges.iter().flat_map(CoarseEdge::points))?;
    let seeds = edges.iter().flat_map(|edge| edge.seeds(&values, level));

    let mut found: HashSet<[i32; 3]> = HashSet::new();
    let mut frontier: Vec<[i32; 3]> = seeds.filter(|&cell| found.insert(cell)).collect();
    while !frontier.is_empty() {
        asker.complete(&mut values, frontier.iter().flat_map(corners))?;
        let mut next = Vec::new();
        for cell in &frontier {
            for neighbour in neighbours_over_crossed_faces(cell, &values, level) {
                if found.insert(neighbour) {
                    next.push(neighbour);
                }
            }
        }
        frontier = next;
    }
    let mut cells: Vec<[i32; 3]> = found.into_iter().collect();
    cells.sort_unstable();
    Ok(Followed { values, cells })
}

/// A lattice point moved along an axis.
fn moved(point: [i32; 3], axis: usize, by: i32) -> [i32; 3] {
    let mut there = point;
    there[axis] += by;
    there
}

/// Whether a point is inside; beyond the lattice nothing is.
fn inside(values: &Samples, point: [i32; 3], level: f32) -> bool {
    values.value(point).is_some_and(|value| value > level)
}

/// Two neighbouring coarse points: `from`, and `length` fine steps along `axis`.
struct CoarseEdge {
    from: [i32; 3],
    axis: usize,
    length: i32,
}

impl CoarseEdge {
    /// The fine points on it, ends included.
    fn points(&self) -> impl Iterator<Item = [i32; 3]> + use<> {
        let CoarseEdge { from, axis, length } = *self;
        (0..=length).map(move |by| moved(from, axis, by))
    }

    /// The four cells around each of its fine edges whose ends differ.
    fn seeds<'a>(&'a self, values: &'a Samples, level: f32) -> impl Iterator<Item = [i32; 3]> + 'a {
        let fine_edges = (0..self.length).map(|by| moved(self.from, self.axis, by));
        let crossed = fine_edges.filter(move |&low| {
            inside(values, low, level) != inside(values, moved(low, self.axis, 1), level)
        });
        let (u, v) = ((self.axis + 1) % 3, (self.axis + 2) % 3);
        crossed
            .flat_map(move |low| (0..4).map(move |side| moved(moved(low, u, -(side & 1)), v, -(side >> 1))))
    }
}

/// The coarse edges whose ends lie on different sides, those that leave the lattice included.
fn crossed_coarse_edges(values: &Samples, stations: &[i32], level: f32) -> Vec<CoarseEdge> {
    // One step beyond either end of the lattice, everything is outside.
    let mut along = vec![-1];
    along.extend(stations);
    along.push(stations[stations.len() - 1] + 1);
    let mut edges = Vec::new();
    for axis in 0..3 {
        for &a in stations {
            for &b in stations {
                for pair in along.windows(2) {
                    let mut from = [a; 3];
                    from[(axis + 1) % 3] = b;
                    from[axis] = pair[0];
                    let edge = CoarseEdge { from, axis, length: pair[1] - pair[0] };
                    if inside(values, from, level) != inside(values, moved(from, axis, edge.length), level) {
                        edges.push(edge);
                    }
                }
            }
        }
    }
    edges
}

/// The eight corners of a cell.
fn corners(cell: &[i32; 3]) -> impl Iterator<Item = [i32; 3]> + use<> {
    let cell = *cell;
    (0..8).map(move |c| std::array::from_fn(|axis| cell[axis] + (c >> axis & 1)))
}

/// The neighbours of a cell across those of its faces whose four corners do not all lie on one side.
fn neighbours_over_crossed_faces<'a>(
    cell: &'a [i32; 3],
    values: &'a Samples,
    level: f32,
) -> impl Iterator<Item = [i32; 3]> + 'a {
    (0..6).filter_map(move |face| {
        let (axis, side) = (face / 2, face as i32 % 2);
        let on_face = corners(cell).filter(|corner| corner[axis] == cell[axis] + side);
        let count = on_face.filter(|&corner| inside(values, corner, level)).count();
        (count % 4 != 0).then(|| moved(*cell, axis, 2 * side - 1))
    })
}
