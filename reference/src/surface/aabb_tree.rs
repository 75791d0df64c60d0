//! A tree of axis-aligned boxes over the triangles of a mesh: the nearest point of a surface without looking at
//! all of it.

use super::bounding_box::BoundingBox;
use super::distance::{ClosestPoint, closest_point_on_triangle};
use super::mesh::Mesh;
use crate::linalg::vector::Vector3;

/// Triangles at a leaf. More make the tree shallower and each leaf slower; between 2 and 8 it hardly matters.
const LEAF_SIZE: usize = 4;

/// A mesh prepared for nearest-point queries.
///
/// Each node holds the box around its triangles. Splitting puts the half of the triangles with the smaller
/// centroids along the longest side of the box into one child, the other half into the other. A query descends
/// into the nearer child first and leaves out every box that is no nearer than the nearest point found so far;
/// what it returns is the minimum over
/// *all* triangles, exactly.
///
/// ```
/// use vitruvian_reference::surface::{aabb_tree::AabbTree, mesh::Mesh};
/// let triangle = Mesh::new(vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], vec![[0, 1, 2]]);
/// let tree = AabbTree::new(&triangle).expect("the mesh has a face");
/// assert_eq!(tree.closest([0.25, 0.25, 2.0]).distance(), 2.0);
/// ```
pub struct AabbTree<'a> {
    mesh: &'a Mesh,
    /// Face numbers, the triangles of one node side by side.
    order: Vec<usize>,
    /// Node 0 is the root.
    nodes: Vec<Node>,
}

struct Node {
    bounds: BoundingBox,
    content: Content,
}

enum Content {
    /// A range of `order`.
    Leaf(std::ops::Range<usize>),
    /// Numbers of two nodes.
    Children([usize; 2]),
}

/// The point of a surface nearest to a query, and the face that it lies on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// Number of the face; if several are equally near, any of them.
    pub face: usize,
    /// Where on that face.
    pub closest: ClosestPoint,
}

impl SurfacePoint {
    /// Distance from the query, in the units of the mesh.
    pub fn distance(&self) -> f64 {
        self.closest.distance()
    }
}

impl<'a> AabbTree<'a> {
    /// Prepares a mesh; none if it has no faces, for then nothing is nearest.
    pub fn new(mesh: &'a Mesh) -> Option<AabbTree<'a>> {
        let boxes: Vec<BoundingBox> =
            mesh.triangles().map(|corners| BoundingBox::around(corners).expect("three corners")).collect();
        if boxes.is_empty() {
            return None;
        }
        let mut tree = AabbTree { mesh, order: (0..boxes.len()).collect(), nodes: Vec::new() };
        tree.build(&boxes, 0..boxes.len());
        Some(tree)
    }

    /// Adds the node of a range of `order` and everything below it; returns its number.
    fn build(&mut self, boxes: &[BoundingBox], range: std::ops::Range<usize>) -> usize {
        let members = &mut self.order[range.clone()];
        let bounds = members.iter().map(|&face| boxes[face]).reduce(|all, next| all.union(&next));
        let bounds = bounds.expect("a node has triangles");
        let number = self.nodes.len();
        self.nodes.push(Node { bounds, content: Content::Leaf(range.clone()) });
        if range.len() > LEAF_SIZE {
            let extent = bounds.extent();
            let axis = (0..3).max_by(|&a, &b| extent[a].total_cmp(&extent[b])).expect("three axes");
            let middle = range.len() / 2;
            members.select_nth_unstable_by(middle, |&a, &b| {
                // The face number decides ties, so that the tree is the same on every run.
                boxes[a].center()[axis].total_cmp(&boxes[b].center()[axis]).then(a.cmp(&b))
            });
            let lower = self.build(boxes, range.start..range.start + middle);
            let upper = self.build(boxes, range.start + middle..range.end);
            self.nodes[number].content = Content::Children([lower, upper]);
        }
        number
    }

    /// The point of the surface nearest to a query.
    pub fn closest(&self, query: Vector3) -> SurfacePoint {
        let face = self.order[0];
        let mut best =
            SurfacePoint { face, closest: closest_point_on_triangle(query, self.mesh.corners(face)) };
        self.search(0, query, &mut best);
        best
    }

    fn search(&self, number: usize, query: Vector3, best: &mut SurfacePoint) {
        match &self.nodes[number].content {
            Content::Leaf(range) => {
                for &face in &self.order[range.clone()] {
                    let closest = closest_point_on_triangle(query, self.mesh.corners(face));
                    if closest.distance_squared < best.closest.distance_squared {
                        *best = SurfacePoint { face, closest };
                    }
                }
            }
            Content::Children(children) => {
                let mut children =
                    children.map(|child| (self.nodes[child].bounds.distance_squared(query), child));
                if children[1].0 < children[0].0 {
                    children.swap(0, 1);
                }
                for (distance_squared, child) in children {
                    if distance_squared < best.closest.distance_squared {
                        self.search(child, query, best);
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::surface::mesh::tests::cuboid;

    #[test]
    fn the_nearest_side_of_a_box_is_found() {
        let mesh = cuboid([2.0, 3.0, 4.0]);
        let tree = AabbTree::new(&mesh).unwrap();
        for (query, distance) in [
            ([1.0, 1.0, 5.5], 1.5),
            ([1.0, 1.5, 3.75], 0.25),
            ([-3.0, -4.0, 2.0], 5.0),
            ([2.0, 3.0, 4.0], 0.0),
        ] {
            assert_eq!(tree.closest(query).distance(), distance, "{query:?}");
        }
        assert!(tree.closest([1.0, 1.5, 7.0]).face >= 10, "faces 10 and 11 are the lid");
    }

    #[test]
    fn a_mesh_without_faces_has_no_nearest_point() {
        assert!(AabbTree::new(&Mesh::default()).is_none());
    }

    #[test]
    fn many_faces_in_one_place_are_no_obstacle() {
        let mesh = Mesh::new(vec![[1.0, 0.0, 0.0]; 3], vec![[0, 1, 2]; 100]);
        assert_eq!(AabbTree::new(&mesh).unwrap().closest([0.0; 3]).distance(), 1.0);
    }
}
