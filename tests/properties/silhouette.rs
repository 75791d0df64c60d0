//! Laws of lines, masks, outlines and the Laplacian.

use proptest::prelude::*;
use vitruvian_reference::body::kinematic_tree::Rigid;
use vitruvian_reference::camera::Pinhole;
use vitruvian_reference::linalg::matrix;
use vitruvian_reference::linalg::vector::{Vector3, add, add_scaled, cross, distance, dot, norm, scale, sub};
use vitruvian_reference::plucker::Line;
use vitruvian_reference::rotation::rodrigues;
use vitruvian_reference::silhouette::boundary::contour;
use vitruvian_reference::silhouette::dilation::{StructuringElement, dilate, erode};
use vitruvian_reference::silhouette::{Mask, raster::Raster};
use vitruvian_reference::surface::laplacian::cotangent_laplacian;

fn point() -> impl Strategy<Value = Vector3> {
    prop::array::uniform3(-3.0..3.0f64)
}

fn line() -> impl Strategy<Value = Line> {
    (point(), point())
        .prop_filter_map("two points", |(a, b)| (distance(a, b) > 0.1).then(|| Line::through(a, b)).flatten())
}

fn motion() -> impl Strategy<Value = Rigid> {
    (point(), point()).prop_map(|(turn, translation)| Rigid { rotation: rodrigues(turn), translation })
}

fn mask() -> impl Strategy<Value = Mask> {
    (1usize..14, 1usize..14).prop_flat_map(|(w, h)| {
        prop::collection::vec(prop::bool::weighted(0.4), w * h)
            .prop_map(move |inside| Mask::new(w, h, inside))
    })
}

proptest! {
    #[test]
    fn any_two_points_of_a_line_give_the_same_line(from in point(), to in point(), s in 0.1..9.0f64, shift in -4.0..4.0f64) {
        prop_assume!(distance(from, to) > 0.1);
        let line = Line::through(from, to).expect("two points");
        let moved = add_scaled(from, line.direction, shift);
        let again = Line::through(moved, add_scaled(moved, sub(to, from), s)).expect("two points");
        prop_assert!(distance(line.direction, again.direction) < 1e-12);
        prop_assert!(distance(line.moment, again.moment) < 1e-12);
        prop_assert!(dot(line.direction, line.moment).abs() < 1e-14);
    }

    #[test]
    fn residual_is_perpendicular_and_as_long_as_the_point_is_far(line in line(), v in point()) {
        let residual = line.residual(v);
        let foot = line.nearest_point(v);
        prop_assert!(line.distance(foot) < 1e-13);
        prop_assert!((norm(residual) - distance(v, foot)).abs() < 1e-13);
        prop_assert!(dot(residual, line.direction).abs() < 1e-13);
        prop_assert!(distance(residual, cross(sub(v, foot), line.direction)) < 1e-13);
    }

    #[test]
    fn rigid_motions_turn_residuals_and_keep_distances(line in line(), other in line(), v in point(), motion in motion()) {
        let moved = line.moved(&motion);
        let turned = matrix::apply(&motion.rotation, line.residual(v));
        prop_assert!(distance(moved.residual(motion.apply(v)), turned) < 1e-12);
        let change = moved.reciprocal_product(&other.moved(&motion)) - line.reciprocal_product(&other);
        prop_assert!(change.abs() < 1e-11, "{change:e}");
    }

    #[test]
    fn reversing_changes_signs_and_no_distance(line in line(), other in line(), v in point()) {
        let back = line.reversed();
        prop_assert_eq!(back.residual(v), scale(line.residual(v), -1.0));
        prop_assert_eq!(back.reciprocal_product(&other), -line.reciprocal_product(&other));
        prop_assert!((back.distance_to_line(&other) - line.distance_to_line(&other)).abs() < 1e-12);
    }

    #[test]
    fn scaling_space_scales_moments_and_distances(from in point(), to in point(), v in point(), s in 0.01..100.0f64) {
        prop_assume!(distance(from, to) > 0.1);
        let line = Line::through(from, to).expect("two points");
        let scaled = Line::through(scale(from, s), scale(to, s)).expect("two points");
        prop_assert!(distance(scaled.residual(scale(v, s)), scale(line.residual(v), s)) < 1e-12 * (1.0 + s));
    }

    #[test]
    fn nearest_points_lie_on_their_lines_and_their_distance_is_perpendicular(a in line(), b in line()) {
        let sine = norm(cross(a.direction, b.direction));
        prop_assume!(sine > 1e-2);
        let [p, q] = a.nearest_points(&b).expect("not parallel");
        prop_assert!(a.distance(p) < 1e-10 && b.distance(q) < 1e-10);
        let gap = sub(p, q);
        prop_assert!(dot(gap, a.direction).abs() < 1e-10 && dot(gap, b.direction).abs() < 1e-10);
        prop_assert!((a.reciprocal_product(&b).abs() - norm(gap) * sine).abs() < 1e-11);
    }

    #[test]
    fn every_crossing_between_pixels_is_one_contour_point_half_way(mask in mask()) {
        let points = contour(&mask);
        let (w, h) = (mask.width, mask.height);
        let across = |p: usize, q: usize| usize::from(mask.inside[p] != mask.inside[q]);
        let sideways: usize = (0..w * h).filter(|p| p % w + 1 < w).map(|p| across(p, p + 1)).sum();
        let downwards: usize = (0..w * (h - 1)).map(|p| across(p, p + w)).sum();
        prop_assert_eq!(points.len(), sideways + downwards);
        for point in points {
            let [u, v] = point.position_px;
            let [x, y] = point.normal;
            prop_assert!((x.hypot(y) - 1.0).abs() < 1e-12);
            // Half a pixel along the axis that the normal leans to lies the outside pixel, half a pixel back the inside one.
            let step = if u.fract() == 0.0 { [0.5 * x.signum(), 0.0] } else { [0.0, 0.5 * y.signum()] };
            prop_assert!(!mask.holds([u + step[0], v + step[1]]) && mask.holds([u - step[0], v - step[1]]));
        }
    }

    #[test]
    fn dilation_grows_erosion_shrinks_and_they_are_dual(mask in mask(), size in prop::sample::select(vec![1usize, 3, 5, 7, 9]), disc in any::<bool>()) {
        let element = if disc { StructuringElement::Disc { size } } else { StructuringElement::Square { size } };
        let (grown, shrunk) = (dilate(&mask, element), erode(&mask, element));
        for pixel in 0..mask.inside.len() {
            prop_assert!(shrunk.inside[pixel] <= mask.inside[pixel] && mask.inside[pixel] <= grown.inside[pixel]);
        }
        let outside = Mask::new(mask.width, mask.height, mask.inside.iter().map(|p| !p).collect());
        let grown_outside = dilate(&outside, element);
        prop_assert!(shrunk.inside.iter().zip(&grown_outside.inside).all(|(a, b)| a != b));
    }

    #[test]
    fn a_fan_of_triangles_covers_every_pixel_of_its_polygon_once(
        radii in prop::collection::vec(0.3..1.0f64, 3..12),
        center in prop::array::uniform2(10i32..30),
        eighths in any::<bool>(),
    ) {
        // On a lattice of eighths of a pixel many edges run through pixel centres exactly: the hard case.
        let n = radii.len();
        let snap = |x: f64| if eighths { (8.0 * x).round() / 8.0 } else { x };
        let center = [f64::from(center[0]) + 0.5, f64::from(center[1]) + 0.5];
        let mut vertices = vec![[center[0], center[1], 1.0]];
        for (k, r) in radii.iter().enumerate() {
            let turn = std::f64::consts::TAU * k as f64 / n as f64;
            vertices.push([snap(center[0] + 9.0 * r * turn.cos()), snap(center[1] + 9.0 * r * turn.sin()), 1.0]);
        }
        let camera = Pinhole::ideal(1.0, [0.0; 2]);
        let faces: Vec<[u32; 3]> = (0..n as u32).map(|k| [0, 1 + k, 1 + (k + 1) % n as u32]).collect();
        let whole = Raster::of(&vertices, &faces, &camera, 40, 40);
        let mut times = vec![0; 1600];
        for face in &faces {
            for (count, inside) in times.iter_mut().zip(Raster::of(&vertices, &[*face], &camera, 40, 40).mask.inside) {
                *count += usize::from(inside);
            }
        }
        prop_assert!(times.iter().all(|count| *count <= 1), "a pixel was covered twice");
        // n ≥ 4 corners see the centre at less than a half turn each, so the fan is star-shaped and holds its centre.
        prop_assert!(n < 4 || whole.mask.holds(center));
        prop_assert!(times.iter().zip(&whole.mask.inside).all(|(count, inside)| (*count == 1) == *inside));
    }

    #[test]
    fn laplacian_is_symmetric_and_constants_are_in_its_kernel(points in prop::collection::vec(point(), 5..9)) {
        let n = points.len() as u32;
        let faces: Vec<[u32; 3]> = (0..n).map(|k| [k, (k + 1) % n, (k + 2) % n]).collect();
        let entries = cotangent_laplacian(&points, &faces);
        let at = |i: usize, j: usize| entries.iter().find(|e| (e.0, e.1) == (i, j)).map_or(0.0, |e| e.2);
        let mut rows = vec![0.0; points.len()];
        for &(i, j, w) in &entries {
            prop_assert!((w - at(j, i)).abs() <= 1e-12 * w.abs().max(1.0));
            rows[i] += w;
        }
        prop_assert!(rows.iter().all(|sum| sum.abs() < 1e-10), "{rows:?}");
    }

    #[test]
    fn linear_functions_on_a_flat_patch_have_no_laplacian_inside(
        jitter in prop::collection::vec(prop::array::uniform2(-0.15..0.15f64), 25),
        motion in motion(),
        slope in point(),
    ) {
        // A jittered 5×5 lattice, turned somewhere in space.
        let vertices: Vec<Vector3> = (0..25)
            .map(|p| motion.apply([(p % 5) as f64 + jitter[p][0], (p / 5) as f64 + jitter[p][1], 0.0]))
            .collect();
        let mut faces = Vec::new();
        for row in 0..4u32 {
            for column in 0..4u32 {
                let [a, b, c, d] = [0, 1, 6, 5].map(|n| 5 * row + column + n);
                faces.extend([[a, b, c], [a, c, d]]);
            }
        }
        let mut image = [0.0; 25];
        for (i, j, w) in cotangent_laplacian(&vertices, &faces) {
            image[i] += w * dot(slope, add(vertices[j], [1.0; 3]));
        }
        for p in (0..25).filter(|p| (1..4).contains(&(p % 5)) && (1..4).contains(&(p / 5))) {
            prop_assert!(image[p].abs() < 1e-11, "vertex {p}: {}", image[p]);
        }
    }
}
