//! Minimum degree: an order of elimination with little fill.
//!
//! Eliminating unknown p from a symmetric system joins all its neighbours to each other; the new non-zeros are fill. The
//! rule of thumb is to eliminate an unknown with the fewest neighbours next. Two ideas make it cheap.
//!
//! *Quotient graph.* The neighbours of p after its elimination are a clique. It is kept as one *element* with the list of
//! its members, instead of as edges: the neighbours of an unknown are its remaining plain neighbours and the members of its
//! elements. Elements that p had are swallowed by the new one, so that the memory never grows.
//!
//! *Approximate degrees.* The exact degree of i is the size of a union of elements. For the new element p and every other
//! element e, |e \ p| is found for all e at once by counting; Σ_e |e \ p| + |p \ i| + plain neighbours is an upper bound
//! of the degree, and exact while i has at most two elements.
//!
//! Unknowns with the same neighbours stay so until one is eliminated, and then the others are eliminated with no further
//! fill: they are merged and go together.
//!
//! # References
//! Amestoy, Davis, Duff 1996, "An approximate minimum degree ordering algorithm". George, Liu 1989, "The evolution of the
//! minimum degree ordering algorithm".

use super::sparse::Sparse;
use std::collections::BTreeSet;

/// The order in which to eliminate the unknowns of a symmetric n×n matrix: `order[k]` is the k-th.
///
/// Only the pattern is read, and only above and below the diagonal; it must be symmetric.
///
/// # Panics
/// If the matrix is not square.
pub fn minimum_degree(pattern: &Sparse) -> Vec<usize> {
    let n = pattern.rows();
    assert!(pattern.columns() == n, "minimum_degree: the matrix is {n}×{}", pattern.columns());
    let mut graph = QuotientGraph::new(pattern);
    let mut queue: BTreeSet<(usize, usize)> = (0..n).map(|i| (graph.degree[i], i)).collect();
    let mut order = Vec::with_capacity(n);
    while let Some((_, pivot)) = queue.pop_first() {
        graph.eliminate(pivot, &mut queue);
        graph.list_with_merged(pivot, &mut order);
    }
    order
}

/// The graph of what is not yet eliminated. An index names an unknown until it is eliminated, and then its element.
struct QuotientGraph {
    /// Of an unknown, its plain neighbours.
    plain: Vec<Vec<usize>>,
    /// Of an unknown, its elements.
    elements: Vec<Vec<usize>>,
    /// Of an element, its unknowns.
    members: Vec<Vec<usize>>,
    /// How many unknowns this one stands for; 0 once it is merged into another or eliminated.
    weight: Vec<usize>,
    /// The unknowns that were merged into this one.
    merged: Vec<Vec<usize>>,
    /// The bound of the degree, in unknowns outside of this one.
    degree: Vec<usize>,
    /// |e| of an element, in unknowns. It stays: mergers keep the sum of the weights, and once a member is eliminated its
    /// elements are swallowed.
    size: Vec<usize>,
    /// |e \ p| for the elements e that touch the current p, where `stamp[e]` = p.
    outside: Vec<usize>,
    stamp: Vec<usize>,
    /// `in_pivot[i]` = p if i is a member of the current p.
    in_pivot: Vec<usize>,
}

impl QuotientGraph {
    fn new(pattern: &Sparse) -> QuotientGraph {
        let n = pattern.rows();
        let plain: Vec<Vec<usize>> =
            (0..n).map(|i| pattern.row(i).0.iter().copied().filter(|&j| j != i).collect()).collect();
        QuotientGraph {
            degree: plain.iter().map(Vec::len).collect(),
            plain,
            elements: vec![Vec::new(); n],
            members: vec![Vec::new(); n],
            weight: vec![1; n],
            merged: vec![Vec::new(); n],
            size: vec![0; n],
            outside: vec![0; n],
            stamp: vec![usize::MAX; n],
            in_pivot: vec![usize::MAX; n],
        }
    }

    /// Turns unknown `p` into an element and updates the degrees of its neighbours.
    fn eliminate(&mut self, p: usize, queue: &mut BTreeSet<(usize, usize)>) {
        let members = self.neighbours(p);
        self.weight[p] = 0;
        let size: usize = members.iter().map(|&i| self.weight[i]).sum();

        // |e \ p|, counted down from |e| by each member that p and e share.
        for &i in &members {
            // Those that p swallowed are empty.
            let members = &self.members;
            self.elements[i].retain(|&e| !members[e].is_empty());
            for &e in &self.elements[i] {
                if self.stamp[e] != p {
                    self.stamp[e] = p;
                    self.outside[e] = self.size[e];
                }
                self.outside[e] -= self.weight[i];
            }
        }
        for &i in &members {
            queue.remove(&(self.degree[i], i));
            let (weight, in_pivot, outside) = (&self.weight, &self.in_pivot, &self.outside);
            // An element inside of p says nothing that p does not.
            self.elements[i].retain(|&e| outside[e] > 0);
            self.plain[i].retain(|&j| weight[j] > 0 && in_pivot[j] != p);
            let elsewhere: usize = self.elements[i].iter().map(|&e| outside[e]).sum();
            let plain: usize = self.plain[i].iter().map(|&j| weight[j]).sum();
            self.degree[i] = (size - weight[i] + elsewhere + plain).min(self.degree[i] + size - weight[i]);
            self.elements[i].push(p);
        }
        self.size[p] = size;
        self.members[p] = self.merge(members);
        for &i in &self.members[p] {
            queue.insert((self.degree[i], i));
        }
    }

    /// The unknowns next to p, marked; its elements are swallowed.
    fn neighbours(&mut self, p: usize) -> Vec<usize> {
        let mut members = Vec::new();
        self.in_pivot[p] = p;
        let elements = std::mem::take(&mut self.elements[p]);
        let cliques = elements.iter().map(|&e| std::mem::take(&mut self.members[e]));
        for i in std::iter::once(std::mem::take(&mut self.plain[p])).chain(cliques).flatten() {
            if self.weight[i] > 0 && self.in_pivot[i] != p {
                self.in_pivot[i] = p;
                members.push(i);
            }
        }
        members
    }

    /// Merges the unknowns that have the same neighbours; returns those that are left.
    fn merge(&mut self, members: Vec<usize>) -> Vec<usize> {
        let mut hashed: Vec<(usize, usize)> = Vec::with_capacity(members.len());
        for i in members {
            self.plain[i].sort_unstable();
            self.elements[i].sort_unstable();
            let neighbours = self.plain[i].iter().chain(&self.elements[i]);
            hashed.push((neighbours.fold(0usize, |sum, &j| sum.wrapping_add(j)), i));
        }
        hashed.sort_unstable();
        let mut kept: Vec<(usize, usize)> = Vec::with_capacity(hashed.len());
        for (hash, i) in hashed {
            let alike = kept.iter().rev().take_while(|&&(other, _)| other == hash);
            let twin = alike
                .map(|&(_, j)| j)
                .find(|&j| self.elements[i] == self.elements[j] && self.plain[i] == self.plain[j]);
            match twin {
                Some(j) => {
                    let weight = std::mem::take(&mut self.weight[i]);
                    self.weight[j] += weight;
                    self.degree[j] -= weight;
                    self.merged[j].push(i);
                }
                None => kept.push((hash, i)),
            }
        }
        kept.into_iter().map(|(_, i)| i).collect()
    }

    /// Lists p and all that was merged into it.
    fn list_with_merged(&self, p: usize, order: &mut Vec<usize>) {
        let mut unlisted = vec![p];
        while let Some(i) = unlisted.pop() {
            order.push(i);
            unlisted.extend(&self.merged[i]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::linalg::sparse_cholesky::SymbolicCholesky;

    fn symmetric(n: usize, edges: impl IntoIterator<Item = (usize, usize)>) -> Sparse {
        let mut triplets: Vec<_> = (0..n).map(|i| (i, i, 1.0)).collect();
        triplets.extend(edges.into_iter().flat_map(|(i, j)| [(i, j, 1.0), (j, i, 1.0)]));
        Sparse::from_triplets(n, n, &triplets)
    }

    fn grid(side: usize) -> Sparse {
        let rows = (0..side * side).filter(move |i| i % side + 1 < side).map(|i| (i, i + 1));
        let columns = (0..side * (side - 1)).map(move |i| (i, i + side));
        symmetric(side * side, rows.chain(columns))
    }

    /// Non-zeros of L that are none of A.
    fn fill(a: &Sparse) -> usize {
        SymbolicCholesky::analyze(a).stored() - (a.stored() + a.rows()) / 2
    }

    #[test]
    fn every_unknown_is_eliminated_once() {
        for a in [grid(1), grid(9), symmetric(0, []), symmetric(5, []), symmetric(6, [(0, 5), (1, 2)])] {
            let mut order = minimum_degree(&a);
            order.sort_unstable();
            assert_eq!(order, (0..a.rows()).collect::<Vec<_>>());
        }
    }

    #[test]
    fn trees_and_cliques_fill_nothing() {
        assert_eq!(fill(&symmetric(50, (1..50).map(|i| (0, i)))), 0, "a star, centre first");
        assert_eq!(fill(&symmetric(50, (1..50).map(|i| (i - 1, i)))), 0, "a path");
        assert_eq!(fill(&symmetric(63, (1..63).map(|i| ((i - 1) / 2, i)))), 0, "a binary tree, root first");
        assert_eq!(fill(&symmetric(12, (0..12).flat_map(|i| (0..i).map(move |j| (i, j))))), 0, "a clique");
    }

    #[test]
    fn cycle_fills_one_chord_per_vertex_but_three() {
        assert_eq!(fill(&symmetric(20, (0..20).map(|i| (i, (i + 1) % 20)))), 17);
    }

    #[test]
    fn grids_fill_far_less_than_row_by_row() {
        // Row by row L is full within a band of 60, 60³ numbers.
        let a = grid(60);
        let natural = SymbolicCholesky::analyze_in_order(&a, (0..3600).collect()).stored();
        let minimum = SymbolicCholesky::analyze(&a).stored();
        assert!(natural > 210_000 && minimum < 75_000, "{natural} row by row, {minimum} by minimum degree");
    }
}
