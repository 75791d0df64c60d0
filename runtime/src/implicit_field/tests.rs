use super::*;
use proptest::prelude::*;
use std::collections::{HashMap, HashSet};

const CUBE: Cube = Cube { origin: [-1.0; 3], side: 2.0 };

/// A ball of radius `radius` around `centre` with soft edge: 1 in the middle, ½ at the radius.
type Blob = ([f64; 3], f64);

fn blobs(blobs: &[Blob]) -> impl FnMut(&[[f64; 3]]) -> Result<Vec<f32>> {
    move |points: &[[f64; 3]]| {
        let value = |point: &[f64; 3]| -> f32 {
            let weight = |(centre, radius): &Blob| {
                let squared: f64 = (0..3).map(|axis| (point[axis] - centre[axis]).powi(2)).sum();
                (-std::f64::consts::LN_2 * squared / (radius * radius)).exp()
            };
            blobs.iter().map(weight).sum::<f64>() as f32
        };
        Ok(points.iter().map(value).collect())
    }
}

fn surface_of(field: &mut impl ImplicitField, resolution: usize, mode: Mode) -> Result<(Mesh, Report)> {
    surface(field, &Lattice { cube: CUBE, resolution }, 0.5, mode, &mut |_, _| {})
}

/// The components of a mesh, each as its set of triangles, a triangle as the bits of its corner positions.
fn components(mesh: &Mesh) -> Vec<HashSet<[[u32; 3]; 3]>> {
    let mut root: Vec<usize> = (0..mesh.vertices.len()).collect();
    fn find(root: &mut [usize], mut vertex: usize) -> usize {
        while root[vertex] != vertex {
            root[vertex] = root[root[vertex]];
            vertex = root[vertex];
        }
        vertex
    }
    for face in &mesh.faces {
        for pair in [[face[0], face[1]], [face[0], face[2]]] {
            let [a, b] = pair.map(|vertex| find(&mut root, vertex as usize));
            root[a] = b;
        }
    }
    let mut by_root: HashMap<usize, HashSet<[[u32; 3]; 3]>> = HashMap::new();
    for face in &mesh.faces {
        let corners = face.map(|vertex| mesh.vertices[vertex as usize].map(f32::to_bits));
        by_root.entry(find(&mut root, face[0] as usize)).or_default().insert(corners);
    }
    by_root.into_values().collect()
}

fn open_sides(mesh: &Mesh) -> usize {
    let mut sides = HashSet::new();
    for &[a, b, c] in &mesh.faces {
        for side in [[a, b], [b, c], [c, a]] {
            assert!(sides.insert(side), "side {side:?} is drawn twice");
        }
    }
    sides.iter().filter(|[a, b]| !sides.contains(&[*b, *a])).count()
}

#[test]
fn a_ball_is_found_vertex_for_vertex_with_few_questions() {
    for resolution in [96, 130] {
        let ball = [([0.1, 0.0, -0.05], 0.6)];
        let (followed, report) =
            surface_of(&mut blobs(&ball), resolution, Mode::CoarseToFine).expect("a ball");
        let (dense, all) = surface_of(&mut blobs(&ball), resolution, Mode::Dense).expect("a ball");
        assert_eq!(followed, dense, "resolution {resolution}");
        assert_eq!(open_sides(&followed), 0);
        assert_eq!((all.asked, all.cells), (all.points, report.cells));
        assert!(report.asked * 4 < all.asked, "asked {} of {}", report.asked, all.asked);
    }
}

#[test]
fn at_256_a_body_sized_surface_needs_less_than_a_fortieth() {
    // A capsule-like chain, 1.8 high and 0.4 wide in a cube of 2.
    let chain: Vec<Blob> = (0..9).map(|i| ([0.0, -0.75 + 0.1875 * f64::from(i), 0.0], 0.16)).collect();
    let (_, report) = surface_of(&mut blobs(&chain), 256, Mode::CoarseToFine).expect("a chain");
    assert!(report.asked * 40 < report.points, "asked {} of {}", report.asked, report.points);
}

#[test]
fn a_field_that_is_inside_at_the_border_is_closed_there() {
    for centre in [[1.0, 0.2, 0.1], [0.95, -1.0, 1.0]] {
        let half = [(centre, 0.5)];
        let (followed, _) = surface_of(&mut blobs(&half), 128, Mode::CoarseToFine).expect("half a ball");
        assert_eq!(followed, surface_of(&mut blobs(&half), 128, Mode::Dense).expect("half a ball").0);
        assert_eq!(open_sides(&followed), 0);
        assert!(followed.vertices.iter().flatten().all(|x| (-1.0..=1.0).contains(x)), "within the cube");
    }
}

#[test]
fn points_that_are_certainly_outside_are_not_asked() {
    struct Half<F>(F);
    impl<F: ImplicitField> ImplicitField for Half<F> {
        fn values(&mut self, points: &[[f64; 3]]) -> Result<Vec<f32>> {
            assert!(points.len() <= self.chunk(), "{} points at once", points.len());
            assert!(points.iter().all(|point| point[0] < 0.0), "a point outside was asked");
            self.0.values(points)
        }
        fn certainly_outside(&self, point: [f64; 3]) -> bool {
            point[0] >= 0.0
        }
        fn chunk(&self) -> usize {
            1000
        }
    }
    let ball = [([0.0; 3], 0.5)];
    let (followed, report) =
        surface_of(&mut Half(blobs(&ball)), 128, Mode::CoarseToFine).expect("half a ball");
    let (dense, all) = surface_of(&mut Half(blobs(&ball)), 128, Mode::Dense).expect("half a ball");
    assert_eq!(followed, dense);
    assert_eq!((open_sides(&followed), all.asked + all.outside), (0, all.points));
    assert!(report.outside > 0 && report.asked < all.asked);
}

#[test]
fn a_level_that_is_never_reached_is_an_error_with_the_range() {
    for mode in [Mode::CoarseToFine, Mode::Dense] {
        let faint = |points: &[[f64; 3]]| Ok(vec![0.25; points.len()]);
        let message = surface_of(&mut { faint }, 128, mode).expect_err("all outside").to_string();
        assert!(
            message.contains("level 0.5 is never reached: the values run from 0.25 to 0.25"),
            "{message}"
        );
        let full = |points: &[[f64; 3]]| Ok(vec![0.75; points.len()]);
        let message = surface_of(&mut { full }, 128, mode).expect_err("all inside").to_string();
        assert!(message.contains("all above it"), "{message}");
    }
}

#[test]
fn values_that_are_not_finite_or_too_few_are_errors() {
    let broken = |points: &[[f64; 3]]| Ok(vec![f32::NAN; points.len()]);
    let message = surface_of(&mut { broken }, 128, Mode::CoarseToFine).expect_err("NaN").to_string();
    assert!(message.contains("the field is NaN at [-1.0, -1.0, -1.0]"), "{message}");
    let short = |points: &[[f64; 3]]| Ok(vec![0.0; points.len() - 1]);
    assert!(surface_of(&mut { short }, 128, Mode::Dense).is_err(), "a value is missing");
}

#[test]
fn resolutions_out_of_range_are_refused() {
    for (resolution, mode) in [(1, Mode::CoarseToFine), (1025, Mode::CoarseToFine), (513, Mode::Dense)] {
        let message = surface_of(&mut blobs(&[([0.0; 3], 0.5)]), resolution, mode).expect_err("out of range");
        assert!(message.to_string().contains("out of range"), "{message}");
    }
}

#[test]
fn progress_never_runs_backwards_and_ends_at_the_count() {
    let mut seen = vec![(0, 0)];
    let lattice = Lattice { cube: CUBE, resolution: 128 };
    let mut note = |done, total| seen.push((done, total));
    let mut ball = blobs(&[([0.0; 3], 0.5)]);
    let (_, report) = surface(&mut ball, &lattice, 0.5, Mode::CoarseToFine, &mut note).expect("a ball");
    assert!(seen.windows(2).all(|pair| pair[0].0 < pair[1].0), "{seen:?}");
    assert!(seen.iter().all(|(done, total)| done <= total), "{seen:?}");
    assert_eq!(seen.last().map(|(done, _)| *done), Some(report.asked));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(12))]
    #[test]
    fn every_component_is_the_dense_one_and_none_that_the_coarse_level_sees_is_missing(
        seeds in proptest::collection::vec((proptest::array::uniform3(-1.0_f64..1.0), 0.02_f64..0.3), 1..8),
        resolution in 65_usize..80,
    ) {
        let Ok((dense, _)) = surface_of(&mut blobs(&seeds), resolution, Mode::Dense) else { return Ok(()) };
        // What the coarse level sees: dense vertices on coarse edges whose ends differ.
        let lattice = Lattice { cube: CUBE, resolution };
        let station = |i: i64| i % 2 == 0 || i == resolution as i64;
        let mut field = blobs(&seeds);
        let mut is_inside = |index: [i64; 3]| -> bool {
            let on = index.iter().all(|i| (0..=resolution as i64).contains(i));
            on && field(&[lattice.world(index.map(|i| i as f64))]).expect("a value")[0] > 0.5
        };
        let spacing = 2.0 / resolution as f64;
        let mut seen_by_coarse = |position: [u32; 3]| {
            let index = position.map(|bits| (f64::from(f32::from_bits(bits)) + 1.0) / spacing);
            let whole = index.map(|x| (x - x.round()).abs() < 1e-4);
            let Some(axis) = (0..3).find(|&axis| !whole[axis]) else { return false };
            let nearest = index.map(|x| x.round() as i64);
            if (0..3).any(|other| other != axis && (!whole[other] || !station(nearest[other]))) {
                return false;
            }
            let (mut low, mut high) = (nearest, nearest);
            low[axis] = index[axis].floor() as i64 / 2 * 2;
            high[axis] = (low[axis] + 2).min(resolution as i64);
            is_inside(low) != is_inside(high)
        };
        let followed = surface_of(&mut blobs(&seeds), resolution, Mode::CoarseToFine);
        let found = followed.as_ref().map(|(mesh, _)| components(mesh)).unwrap_or_default();
        let expected = components(&dense);
        for component in &found {
            prop_assert!(expected.contains(component), "a component that the dense surface does not have");
        }
        for component in expected.iter().filter(|component| !found.contains(component)) {
            let seen = component.iter().flatten().any(|&position| seen_by_coarse(position));
            prop_assert!(!seen, "a component that the coarse level sees is missing");
        }
        if let Ok((mesh, report)) = followed {
            prop_assert_eq!(open_sides(&mesh), 0);
            prop_assert!(report.asked < report.points);
        }
    }
}
