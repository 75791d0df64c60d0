//! Laws of surfaces: what marching cubes, containment, voxels, distances and samples owe each other.

use approx::abs_diff_eq;
use proptest::collection::vec;
use proptest::prelude::*;
use vitruvian_reference::linalg::matrix::{self, Matrix3};
use vitruvian_reference::linalg::vector::{Vector3, add, distance, norm, scale, sub};
use vitruvian_reference::metric::joints::{mean_joint_error, pa_mpjpe};
use vitruvian_reference::metric::procrustes::Similarity;
use vitruvian_reference::metric::surface::{SurfaceDistance, volume_iou};
use vitruvian_reference::surface::aabb_tree::AabbTree;
use vitruvian_reference::surface::cube::Cube;
use vitruvian_reference::surface::distance::closest_point_on_triangle;
use vitruvian_reference::surface::inside::Inside;
use vitruvian_reference::surface::marching_cubes::marching_cubes;
use vitruvian_reference::surface::mesh::Mesh;
use vitruvian_reference::surface::sampling::{SplitMix64, sample_surface};
use vitruvian_reference::surface::topology::Topology;
use vitruvian_reference::surface::voxelize::voxelize;
use vitruvian_reference::surface::winding_number::winding_number;

/// Values on a lattice.
#[derive(Debug, Clone)]
struct Field {
    shape: [usize; 3],
    values: Vec<f64>,
}

impl Field {
    /// A function sampled at the points of a cubic lattice, n points a side, in index units.
    fn sample(n: usize, f: impl Fn(Vector3) -> f64) -> Field {
        let point = |p: usize| [p / (n * n), p / n % n, p % n].map(|index| index as f64);
        Field { shape: [n; 3], values: (0..n.pow(3)).map(|p| f(point(p))).collect() }
    }

    fn at(&self, [i, j, k]: [usize; 3]) -> f64 {
        self.values[(i * self.shape[1] + j) * self.shape[2] + k]
    }

    fn points(&self) -> impl Iterator<Item = [usize; 3]> + '_ {
        let [nx, ny, nz] = self.shape;
        (0..nx * ny * nz).map(move |p| [p / (ny * nz), p / nz % ny, p % nz])
    }

    fn mesh(&self, level: f64) -> Mesh {
        marching_cubes(&self.values, self.shape, level)
    }
}

/// Fields of up to 5 × 5 × 5 points, each value of which is random, or exactly the level 0, or ±1.
///
/// Random signs at every point reach all 256 cases and every pair of them across a face.
fn any_field() -> impl Strategy<Value = Field> {
    let value = prop_oneof![4 => -1.0..1.0, 1 => Just(0.0), 1 => Just(1.0), 1 => Just(-1.0)];
    [1..=5_usize, 1..=5_usize, 1..=5_usize].prop_flat_map(move |shape| {
        vec(value.clone(), shape.iter().product::<usize>()).prop_map(move |values| Field { shape, values })
    })
}

fn any_point(reach: f64) -> impl Strategy<Value = Vector3> {
    [-reach..reach, -reach..reach, -reach..reach]
}

/// Turns about x, then y, then z.
fn any_rotation() -> impl Strategy<Value = Matrix3> {
    any_point(3.2).prop_map(|[a, b, c]| {
        let about_x = [[1.0, 0.0, 0.0], [0.0, a.cos(), -a.sin()], [0.0, a.sin(), a.cos()]];
        let about_y = [[b.cos(), 0.0, b.sin()], [0.0, 1.0, 0.0], [-b.sin(), 0.0, b.cos()]];
        let about_z = [[c.cos(), -c.sin(), 0.0], [c.sin(), c.cos(), 0.0], [0.0, 0.0, 1.0]];
        matrix::mul(&about_z, &matrix::mul(&about_y, &about_x))
    })
}

/// Closed meshes with handles, cavities and several pieces, off the lattice: random fields, moved.
fn any_closed_mesh() -> impl Strategy<Value = Mesh> {
    (any_field(), any_rotation(), any_point(3.0), 0.2..2.0)
        .prop_map(|(field, turn, shift, size)| field.mesh(0.0).affine(&matrix::scaled(&turn, size), shift))
        .prop_filter("a field that is outside everywhere has no mesh", |mesh| !mesh.faces.is_empty())
}

/// Triangles without any order.
fn any_soup() -> impl Strategy<Value = Mesh> {
    vec(any_point(1.0), 3..40).prop_flat_map(|vertices| {
        let index = 0..vertices.len() as u32;
        let faces = vec([index.clone(), index.clone(), index], 1..60);
        faces.prop_map(move |faces| Mesh::new(vertices.clone(), faces))
    })
}

/// Distance to a sphere of radius `radius` about the middle of a lattice of n points a side, positive inside.
fn sphere(n: usize, radius: f64) -> Field {
    let middle = [(n - 1) as f64 / 2.0; 3];
    Field::sample(n, |p| radius - distance(p, middle))
}

/// A sphere of radius 1 about the origin.
fn unit_sphere(n: usize) -> Mesh {
    let reach = (n - 1) as f64 / 2.0;
    let mesh = sphere(n, 0.9 * reach).mesh(0.0);
    mesh.affine(&matrix::diagonal([1.0 / (0.9 * reach); 3]), [-1.0 / 0.9; 3])
}

fn ball_volume(radius: f64) -> f64 {
    4.0 / 3.0 * std::f64::consts::PI * radius.powi(3)
}

/// An octahedron split three times, each vertex pushed to its own radius: every ray from the origin meets it
/// once.
fn any_star() -> impl Strategy<Value = Mesh> {
    // Vertex 2a is one step up axis a, vertex 2a + 1 one step down.
    let step = |v: usize| [1.0, -1.0][v % 2];
    let axes = (0..6).map(|v| [0, 1, 2].map(|axis| if v / 2 == axis { step(v) } else { 0.0 }));
    let octants =
        vec![[0, 2, 4], [2, 1, 4], [1, 3, 4], [3, 0, 4], [2, 0, 5], [1, 2, 5], [3, 1, 5], [0, 3, 5]];
    let mut ball = Mesh::new(axes.collect(), octants);
    for _ in 0..3 {
        ball = split(&ball);
    }
    vec(0.5..1.0, ball.vertices.len()).prop_map(move |radii| {
        let push = |(direction, radius): (&Vector3, &f64)| scale(*direction, radius / norm(*direction));
        Mesh { vertices: ball.vertices.iter().zip(&radii).map(push).collect(), faces: ball.faces.clone() }
    })
}

/// Every triangle cut into four at the middles of its edges.
fn split(mesh: &Mesh) -> Mesh {
    let mut vertices = mesh.vertices.clone();
    let mut middles = std::collections::HashMap::new();
    let mut middle = |a: u32, b: u32| {
        *middles.entry((a.min(b), a.max(b))).or_insert_with(|| {
            vertices.push(scale(add(mesh.vertices[a as usize], mesh.vertices[b as usize]), 0.5));
            vertices.len() as u32 - 1
        })
    };
    let mut faces = Vec::new();
    for &[a, b, c] in &mesh.faces {
        let (ab, bc, ca) = (middle(a, b), middle(b, c), middle(c, a));
        faces.extend([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]]);
    }
    Mesh::new(vertices, faces)
}

proptest! {
    #[test]
    fn any_field_gives_a_closed_oriented_manifold(field in any_field(), level in -0.5..0.5) {
        let topology = Topology::of(&field.mesh(level));
        prop_assert!(topology.is_closed_surface(), "{:?}", topology);
    }

    #[test]
    fn every_vertex_lies_on_a_crossed_edge_at_the_level(field in any_field(), level in -0.5..0.5) {
        let mesh = field.mesh(level);
        for vertex in mesh.vertices {
            let lower = vertex.map(|x| x.floor() as usize);
            let fractional: Vec<usize> = (0..3).filter(|&axis| vertex[axis].fract() > 0.0).collect();
            prop_assert!(fractional.len() <= 1, "{vertex:?} is off the lattice edges");
            // At a lattice point: the level itself, or the lid of the border.
            let Some(&axis) = fractional.first() else { continue };
            let mut upper = lower;
            upper[axis] += 1;
            let (a, b) = (field.at(lower), field.at(upper));
            let t = vertex[axis].fract();
            prop_assert!((a > level) != (b > level));
            // Adding t to an index up to 4 rounds it by 4u, which the slope, at most 2, turns into 8u;
            // computing t and this line adds a few more u of values up to 2 (u = ε/2).
            prop_assert!((a + t * (b - a) - level).abs() <= 16.0 * f64::EPSILON);
        }
    }

    #[test]
    fn a_lattice_point_is_inside_the_mesh_where_its_value_is(field in any_field()) {
        // The border is shut through the border points themselves, so a layer of outside is put around them
        // first.
        let n = 7;
        let padded = Field::sample(n, |p| {
            let index = p.map(|x| (x as usize).wrapping_sub(1));
            if (0..3).all(|axis| index[axis] < field.shape[axis]) { field.at(index) } else { -1.0 }
        });
        let mesh = padded.mesh(0.0);
        let inside = Inside::new(&mesh);
        for point in padded.points() {
            // At the level exactly the surface passes through the point.
            if padded.at(point) != 0.0 {
                let winding = inside.winding(point.map(|index| index as f64));
                prop_assert_eq!(winding, i32::from(padded.at(point) > 0.0), "{:?}", point);
            }
        }
    }

    #[test]
    fn shifting_the_field_shifts_the_mesh(field in any_field(), shift in [0..3_usize, 0..3_usize, 0..3_usize]) {
        let frame = |by: [usize; 3]| Field::sample(9, |p| {
            let index = [0, 1, 2].map(|axis| (p[axis] as usize).wrapping_sub(1 + by[axis]));
            if (0..3).all(|axis| index[axis] < field.shape[axis]) { field.at(index) } else { -1.0 }
        });
        let (here, there) = (frame([0; 3]).mesh(0.0), frame(shift).mesh(0.0));
        prop_assert_eq!(&here.faces, &there.faces);
        for (a, b) in here.vertices.iter().zip(&there.vertices) {
            // Adding whole numbers below 8 moves the last bit of a coordinate by at most 8 ulps of 1.
            prop_assert!(distance(add(*a, shift.map(|x| x as f64)), *b) <= 8.0 * f64::EPSILON);
        }
    }

    #[test]
    fn containment_is_the_winding_number(mesh in any_closed_mesh(), points in vec(any_point(1.0), 20)) {
        let inside = Inside::new(&mesh);
        let bounds = mesh.bounding_box().unwrap().padded(0.1);
        let tree = AabbTree::new(&mesh).unwrap();
        for unit in points {
            let half = scale(bounds.extent(), 0.5);
            let point = [0, 1, 2].map(|axis| bounds.center()[axis] + unit[axis] * half[axis]);
            // On the surface itself the definition has no integer value.
            if tree.closest(point).distance() > 1e-9 {
                let defined = winding_number(&mesh, point);
                prop_assert!((defined - defined.round()).abs() < 1e-6, "{defined} is no integer");
                prop_assert_eq!(f64::from(inside.winding(point)), defined.round(), "{:?}", point);
            }
        }
    }

    #[test]
    fn voxels_are_containment_at_cell_centres(mesh in any_closed_mesh(), resolution in 1..9_usize) {
        let bounds = mesh.bounding_box().unwrap();
        prop_assume!(bounds.longest_side() > 0.0, "one point inside at the border is all lids in one place");
        let cube = Cube::around(&bounds, 0.9);
        let values = voxelize(&mesh, &cube, resolution);
        let (inside, tree) = (Inside::new(&mesh), AabbTree::new(&mesh).unwrap());
        for (number, value) in values.iter().enumerate() {
            let cell = [number / (resolution * resolution), number / resolution % resolution, number % resolution];
            let center = cube.cell_center(cell, resolution);
            // On the surface the column and the slanted rays of `Inside` round differently.
            if tree.closest(center).distance() > 1e-9 {
                prop_assert_eq!(*value, f64::from(u8::from(inside.contains(center))), "cell {:?}", cell);
            }
        }
    }

    #[test]
    fn a_bigger_body_fills_every_cell_of_a_smaller_one(
        star in any_star(), growth in 1.0..1.5, resolution in 4..20_usize,
    ) {
        let grown = star.affine(&matrix::diagonal([growth; 3]), [0.0; 3]);
        let cube = Cube { origin: [-1.5; 3], side: 3.0 };
        let (small, big) = (voxelize(&star, &cube, resolution), voxelize(&grown, &cube, resolution));
        prop_assert!(small.iter().zip(&big).all(|(small, big)| small <= big));
        // And so does the surface of its voxels, which is where voxelise and mesh meet.
        let shape = [resolution; 3];
        let volumes = [small, big].map(|values| marching_cubes(&values, shape, 0.5).signed_volume());
        prop_assert!(volumes[0] <= volumes[1] + 1e-9, "{volumes:?}");
    }

    #[test]
    fn the_tree_finds_what_looking_at_every_triangle_finds(mesh in any_soup(), points in vec(any_point(2.0), 20)) {
        let tree = AabbTree::new(&mesh).unwrap();
        for point in points {
            let found = tree.closest(point);
            let nearest = mesh
                .triangles()
                .map(|corners| closest_point_on_triangle(point, corners).distance_squared)
                .fold(f64::INFINITY, f64::min);
            prop_assert_eq!(found.closest.distance_squared, nearest);
            prop_assert_eq!(closest_point_on_triangle(point, mesh.corners(found.face)), found.closest);
        }
    }

    #[test]
    fn no_point_of_the_triangle_is_nearer(
        corners in [any_point(1.0), any_point(1.0), any_point(1.0)], query in any_point(2.0),
    ) {
        let found = closest_point_on_triangle(query, corners);
        let [a, b, c] = corners;
        for i in 0..=20 {
            for j in 0..=20 - i {
                let (beta, gamma) = (f64::from(i) / 20.0, f64::from(j) / 20.0);
                let other = add(a, add(scale(sub(b, a), beta), scale(sub(c, a), gamma)));
                prop_assert!(found.distance() <= distance(query, other) + 1e-14);
            }
        }
    }

    #[test]
    fn distance_to_a_surface_grows_no_faster_than_the_point_moves(
        mesh in any_soup(), p in any_point(2.0), q in any_point(2.0),
    ) {
        let tree = AabbTree::new(&mesh).unwrap();
        prop_assert!((tree.closest(p).distance() - tree.closest(q).distance()).abs() <= distance(p, q) + 1e-14);
    }

    #[test]
    fn area_and_volume_change_as_lengths_squared_and_cubed(
        mesh in any_closed_mesh(), turn in any_rotation(), shift in any_point(5.0), size in 0.5..2.0,
    ) {
        let moved = mesh.affine(&matrix::scaled(&turn, size), shift);
        let (area, volume) = (mesh.area(), mesh.signed_volume());
        // A body one lattice point thick is all lids: its volume is 0, to the rounding of terms below 10³.
        prop_assert!(volume >= -1e-13, "outward faces enclose a positive volume, or none: {volume}");
        prop_assert!((moved.area() - area * size.powi(2)).abs() <= 1e-12 * area.max(1.0) * 4.0);
        prop_assert!((moved.signed_volume() - volume * size.powi(3)).abs() <= 1e-11 * area.powf(1.5).max(1.0) * 8.0);
    }

    #[test]
    fn surface_distances_scale_as_lengths_and_overlap_does_not(
        mesh in any_star(), other in any_star(), size in 0.5..2.0,
    ) {
        let larger = |mesh: &Mesh| mesh.affine(&matrix::diagonal([size; 3]), [0.0; 3]);
        let plain = SurfaceDistance::between(&mesh, &other, 200, 9).unwrap();
        let scaled = SurfaceDistance::between(&larger(&mesh), &larger(&other), 200, 9).unwrap();
        prop_assert!(abs_diff_eq!(scaled.p2s, size * plain.p2s, epsilon = 1e-12));
        prop_assert!(abs_diff_eq!(scaled.completeness, size * plain.completeness, epsilon = 1e-12));
        prop_assert!(abs_diff_eq!(scaled.chamfer_l2, size * size * plain.chamfer_l2, epsilon = 1e-12));
        // The mean of squares is at least the square of the mean: the law that erratum E15 rests on.
        prop_assert!(plain.chamfer_l2 >= 0.5 * (plain.p2s.powi(2) + plain.completeness.powi(2)) - 1e-15);
        let overlap = volume_iou(&mesh, &other, 200, 9).unwrap();
        prop_assert_eq!(overlap, volume_iou(&other, &mesh, 200, 9).unwrap());
    }

    #[test]
    fn procrustes_undoes_any_similarity(
        joints in vec(any_point(1.0), 4..24), turn in any_rotation(), shift in any_point(5.0), size in 0.2..5.0,
    ) {
        let planted = Similarity { scale: size, rotation: turn, translation: shift };
        let moved: Vec<Vector3> = joints.iter().map(|&joint| planted.apply(joint)).collect();
        prop_assert!(pa_mpjpe(&moved, &joints) < 1e-12);
    }

    #[test]
    fn procrustes_never_raises_the_sum_of_squares(a in vec(any_point(1.0), 14), b in vec(any_point(1.0), 14)) {
        let similarity = Similarity::aligning(&a, &b);
        let squares = |points: &[Vector3]| points.iter().zip(&b).map(|(&p, &q)| distance(p, q).powi(2)).sum::<f64>();
        let aligned: Vec<Vector3> = a.iter().map(|&p| similarity.apply(p)).collect();
        prop_assert!(squares(&aligned) <= squares(&a) + 1e-12);
        // The estimate's own frame does not matter.
        prop_assert!(abs_diff_eq!(pa_mpjpe(&a, &b), mean_joint_error(&aligned, &b), epsilon = 1e-12));
    }
}

#[test]
fn a_sphere_is_closed_outward_and_has_characteristic_two() {
    let mesh = unit_sphere(33);
    let topology = Topology::of(&mesh);
    assert!(topology.is_closed_surface());
    assert_eq!((topology.euler_characteristic(), topology.components), (2, 1));
    // Interpolating |p| linearly along an edge of length h errs by at most h²/8; the facets, as wide as a
    // cell's diagonal of √3·h, sink below the sphere by at most three times that.
    let h = 2.0 / (0.9 * 32.0);
    let sagitta = (1.0 + 3.0) * h * h / 8.0;
    for (vertex, normal) in mesh.vertices.iter().zip(mesh.vertex_normals()) {
        assert!((norm(*vertex) - 1.0).abs() < h * h / 8.0);
        assert!(distance(normal, *vertex) < 0.2, "the normal of a sphere is its radius");
    }
    assert!((mesh.signed_volume() / ball_volume(1.0) - 1.0).abs() < 3.0 * sagitta);
    assert!(mesh.signed_volume() > 0.0);
}

#[test]
fn a_torus_has_characteristic_zero() {
    let torus = Field::sample(40, |p| {
        let [x, y, z] = p.map(|x| x - 19.5);
        6.0 - (x.hypot(z) - 12.0).hypot(y)
    });
    let topology = Topology::of(&torus.mesh(0.0));
    assert!(topology.is_closed_surface());
    assert_eq!((topology.euler_characteristic(), topology.components), (0, 1));
}

#[test]
fn two_spheres_are_two_pieces_until_they_touch() {
    let pair = |gap: f64| {
        let field = Field::sample(32, |p| {
            let center = |side: f64| [15.5 + side * (6.0 + gap / 2.0), 15.5, 15.5];
            (6.0 - distance(p, center(-1.0))).max(6.0 - distance(p, center(1.0)))
        });
        Topology::of(&field.mesh(0.0))
    };
    assert_eq!((pair(2.0).components, pair(2.0).euler_characteristic()), (2, 4));
    assert_eq!((pair(-2.0).components, pair(-2.0).euler_characteristic()), (1, 2));
}

#[test]
fn a_hollow_sphere_has_an_inner_wall() {
    let shell = Field::sample(32, |p| 2.0 - (distance(p, [15.5; 3]) - 10.0).abs()).mesh(0.0);
    let topology = Topology::of(&shell);
    assert_eq!((topology.components, topology.euler_characteristic()), (2, 4));
    let inside = Inside::new(&shell);
    let found = [0.0, 6.0, 10.0, 14.0].map(|r| inside.contains([15.5 + r, 15.5, 15.5]));
    assert_eq!(found, [false, false, true, false]);
}

#[test]
fn voxels_of_a_sphere_converge_to_its_volume() {
    let mesh = unit_sphere(41);
    let cube = Cube::around(&mesh.bounding_box().unwrap(), 0.9);
    for resolution in [8, 16, 32, 64] {
        let h = cube.spacing(resolution);
        let volume = voxelize(&mesh, &cube, resolution).iter().sum::<f64>() * h.powi(3);
        // The occupied cells cover the ball less half a cell's diagonal and lie in the ball plus as much; 0.005
        // is more than the mesh departs from the ball.
        let reach = 3.0_f64.sqrt() / 2.0 * h + 0.005;
        assert!(volume > ball_volume(1.0 - reach), "{resolution}: {volume}");
        assert!(volume < ball_volume(1.0 + reach), "{resolution}: {volume}");
        // Cells at the surface err either way: of n ~ r²/h² of them the sum goes as √n, an order better than
        // the bound.
        assert!((volume / ball_volume(1.0) - 1.0).abs() < 2.0 * h.powf(1.5) + 0.01, "{resolution}: {volume}");
    }
}

#[test]
fn meshing_the_voxels_of_a_sphere_gives_a_sphere() {
    let mesh = unit_sphere(41);
    let cube = Cube::around(&mesh.bounding_box().unwrap(), 0.9);
    let resolution = 48;
    let values = voxelize(&mesh, &cube, resolution);
    let again = marching_cubes(&values, [resolution; 3], 0.5)
        .from_lattice(cube.cell_center([0; 3], resolution), cube.spacing(resolution));
    let topology = Topology::of(&again);
    assert!(topology.is_closed_surface());
    assert_eq!(topology.euler_characteristic(), 2);
    let found = SurfaceDistance::between(&again, &mesh, 5000, 1).unwrap();
    // The surface of a binary field runs half-way between centres on either side of the true one.
    assert!(found.p2s < 0.5 * cube.spacing(resolution), "{found:?}");
}

#[test]
fn concentric_spheres_have_their_closed_forms() {
    let truth = unit_sphere(41);
    let predicted = truth.affine(&matrix::diagonal([0.9; 3]), [0.0; 3]);
    let found = SurfaceDistance::between(&predicted, &truth, 10_000, 7).unwrap();
    // Radii depart from 1 by less than 0.003 at this resolution, and so do the distances from 0.1.
    assert!((found.p2s - 0.1).abs() < 0.003, "{found:?}");
    assert!((found.completeness - 0.1).abs() < 0.003, "{found:?}");
    assert!((found.chamfer_l2 - 0.01).abs() < 2.0 * 0.1 * 0.003, "{found:?}");
    assert!(found.normal_consistency > 0.99);
    // A polyhedron scaled by 0.9 about a point inside: exactly 0.9³ of the volume; five standard errors.
    let points = 50_000;
    let iou = volume_iou(&predicted, &truth, points, 8).unwrap();
    let in_union = points as f64 * ball_volume(1.0) / 2.2_f64.powi(3);
    assert!((iou - 0.729).abs() < 5.0 * (0.729 * 0.271 / in_union).sqrt(), "{iou}");
}

/// A level that χ² with `freedom` degrees of freedom exceeds with probability below e⁻²⁰ (Laurent and Massart
/// 2000, lemma 1).
fn chi_square_bound(freedom: usize) -> f64 {
    let (freedom, x) = (freedom as f64, 20.0_f64);
    freedom + 2.0 * (freedom * x).sqrt() + 2.0 * x
}

/// Σ (found − expected)² / expected.
fn chi_square(found: &[usize], expected: &[f64]) -> f64 {
    found.iter().zip(expected).map(|(&found, &expected)| (found as f64 - expected).powi(2) / expected).sum()
}

#[test]
fn samples_are_uniform_over_the_faces() {
    // A coarse sphere, squeezed, its faces split twice: faces of very unequal area.
    let mesh = split(&split(&unit_sphere(4))).affine(&matrix::diagonal([1.0, 2.0, 0.3]), [0.0; 3]);
    let count = 100_000;
    let area = mesh.area();
    let areas: Vec<f64> = mesh.area_vectors().into_iter().map(norm).collect();
    let mut found = vec![0; areas.len()];
    for sample in sample_surface(&mesh, count, &mut SplitMix64::new(11)).unwrap() {
        found[sample.face] += 1;
    }
    let expected: Vec<f64> = areas.iter().map(|face| face / area * count as f64).collect();
    let least = expected.iter().copied().fold(f64::INFINITY, f64::min);
    assert!(least > 5.0, "the χ² approximation asks for 5 a cell: {least}");
    let statistic = chi_square(&found, &expected);
    assert!(statistic < chi_square_bound(areas.len() - 1), "{statistic} for {} faces", areas.len());
}

#[test]
fn samples_are_uniform_within_a_face() {
    // The triangle is cut into 16 equal ones along lines of equal barycentric coordinates: four rows of 1, 3,
    // 5, 7.
    let [a, b, c] = [[0.0, 0.0, 0.0], [4.0, 0.0, 0.0], [1.0, 4.0, 0.0]];
    let triangle = Mesh::new(vec![a, b, c], vec![[0, 1, 2]]);
    let mut found = [0; 16];
    let count = 32_000;
    for sample in sample_surface(&triangle, count, &mut SplitMix64::new(12)).unwrap() {
        let gamma = sample.point[1] / 4.0;
        let beta = (sample.point[0] - gamma) / 4.0;
        let [row, column] = [beta, gamma].map(|x| (4.0 * x) as usize);
        let upper = usize::from((4.0 * beta).fract() + (4.0 * gamma).fract() > 1.0);
        // Row `row` holds 2·(4 − row) − 1 triangles, two a column but for the last.
        found[8 * row - row * row + 2 * column + upper] += 1;
    }
    let statistic = chi_square(&found, &[count as f64 / 16.0; 16]);
    assert!(statistic < chi_square_bound(15), "{statistic}: {found:?}");
}
