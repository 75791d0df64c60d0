//! Implicit fields: how far the surface moves, which lattice points change sides, and whether it is still the same surface.
//!
//! # How far does the surface move?
//! Two answers. To first order, a point of the surface {f = c} of the base moves along its normal by −Δf/‖∇f‖; this is
//! signed, adds up over causes, and is meaningless where the field is flat. The marched surfaces themselves are apart by
//! the distances from the vertices of each to the nearest point of the other, whose largest is Hausdorff's distance (a
//! triangle's inside can be farther only from a surface finer than the lattice).
//!
//! # Where is the gradient taken?
//! Where the base crosses the level on a lattice edge, by linear interpolation of the central differences (one-sided at the
//! border) at the edge's two ends.

use vitruvian_reference::linalg::vector::{Vector3, norm};
use vitruvian_reference::surface::aabb_tree::AabbTree;
use vitruvian_reference::surface::marching_cubes::marching_cubes;
use vitruvian_reference::surface::mesh::Mesh;

use super::{Displacement, Outputs, Ruler, output};
use crate::audit::variant::report::{FieldReport, Geometry, Summary, TopologyReport, View};

/// Metres to millimetres.
const MM: f64 = 1000.0;

/// A slope below this part of the steepest on the surface says nothing about where the surface goes.
const FLAT: f64 = 1e-3;

/// The lattice on which a field is known, and how it is read.
#[derive(Clone, Debug, PartialEq)]
pub struct Lattice {
    /// The output that holds the field, its last axis fastest, with as many numbers as points.
    pub output: String,
    /// Points along each axis.
    pub shape: [usize; 3],
    /// Where point (0, 0, 0) is, metres.
    pub origin: Vector3,
    /// Metres between neighbours.
    pub spacing: f64,
    /// The field at the surface.
    pub level: f64,
    /// Whether larger is inside.
    pub inside_is_larger: bool,
    /// How points were asked and what a unit is.
    pub words: String,
}

impl Lattice {
    /// The field on the lattice, larger inside, and how many of its numbers are not finite; those are taken as outside.
    fn field(&self, outputs: &Outputs) -> Result<(Vec<f64>, u64), String> {
        let tensor = output(outputs, &self.output)?;
        let points: usize = self.shape.iter().product();
        if tensor.data.len() != points {
            return Err(format!(
                "output \"{}\" is {:?}, expected {points} numbers for a lattice of {:?} points",
                self.output, tensor.shape, self.shape
            ));
        }
        let lost = tensor.data.iter().filter(|x| !x.is_finite()).count() as u64;
        let sign = self.sign();
        let read = |&x: &f64| if x.is_finite() { sign * x } else { f64::NEG_INFINITY };
        Ok((tensor.data.iter().map(read).collect(), lost))
    }

    fn sign(&self) -> f64 {
        if self.inside_is_larger { 1.0 } else { -1.0 }
    }

    /// The level of [`Lattice::field`].
    fn inner_level(&self) -> f64 {
        self.sign() * self.level
    }

    fn mesh(&self, field: &[f64]) -> Mesh {
        marching_cubes(field, self.shape, self.inner_level()).from_lattice(self.origin, self.spacing)
    }

    /// Where the field crosses the level between neighbours: the two points, and the share of the second.
    fn crossings(&self, field: &[f64]) -> Vec<(usize, usize, f64)> {
        let [nx, ny, nz] = self.shape;
        let level = self.inner_level();
        let strides = [ny * nz, nz, 1];
        let mut crossings = Vec::new();
        for place in 0..field.len() {
            let index = [place / strides[0], place / nz % ny, place % nz];
            for (axis, length) in [nx, ny, nz].into_iter().enumerate() {
                if index[axis] + 1 == length {
                    continue;
                }
                let other = place + strides[axis];
                let (a, b) = (field[place], field[other]);
                if (a > level) != (b > level) && a.is_finite() && b.is_finite() {
                    crossings.push((place, other, (level - a) / (b - a)));
                }
            }
        }
        crossings
    }

    /// ∇f at a lattice point, per metre.
    fn gradient(&self, field: &[f64], place: usize) -> Vector3 {
        let [_, ny, nz] = self.shape;
        let strides = [ny * nz, nz, 1];
        std::array::from_fn(|axis| {
            let index = place / strides[axis] % self.shape[axis];
            let last = self.shape[axis] - 1;
            let (low, high) = (index.saturating_sub(1), (index + 1).min(last));
            if low == high {
                return 0.0;
            }
            let at = |i: usize| field[place + i * strides[axis] - index * strides[axis]];
            (at(high) - at(low)) / ((high - low) as f64 * self.spacing)
        })
    }
}

/// A point of the base's surface on a lattice edge.
#[derive(Clone, Copy, Debug)]
struct Crossing {
    ends: [usize; 2],
    /// The second end's share.
    share: f64,
    /// ‖∇f‖, per metre.
    slope: f64,
}

/// One input's field of the base.
struct Known {
    field: Vec<f64>,
    lost: u64,
    mesh: Mesh,
    crossings: Vec<Crossing>,
    flat: u64,
}

/// The base's fields.
pub struct FieldRuler {
    lattice: Lattice,
    base: Vec<Known>,
}

impl FieldRuler {
    /// A ruler on the base's outputs.
    ///
    /// # Errors
    /// When the field's output is missing or has another number of points, or on no input reaches the level: without a
    /// surface there is nothing to measure.
    pub fn new(lattice: Lattice, base: &[Outputs]) -> Result<Self, String> {
        let known: Result<Vec<Known>, String> =
            base.iter().map(|outputs| Known::of(&lattice, outputs)).collect();
        let known = known?;
        if known.iter().all(|k| k.mesh.faces.is_empty()) {
            return Err(format!(
                "the base's output \"{}\" does not cross {} on the lattice: no surface to measure",
                lattice.output, lattice.level
            ));
        }
        Ok(Self { lattice, base: known })
    }

    /// Signed displacements along the outward normal at every crossing, millimetres.
    fn displacements(&self, variant: &[Outputs]) -> Result<Vec<f64>, String> {
        let mut signed = Vec::new();
        for (known, outputs) in self.base.iter().zip(variant) {
            let (field, _) = self.lattice.field(outputs)?;
            for Crossing { ends: [a, b], share, slope } in &known.crossings {
                let change =
                    (1.0 - share) * (field[*a] - known.field[*a]) + share * (field[*b] - known.field[*b]);
                // Where f grows the inside grows: the surface moves outwards by Δf/‖∇f‖.
                signed.push(MM * change / slope);
            }
        }
        Ok(signed)
    }
}

impl Known {
    fn of(lattice: &Lattice, outputs: &Outputs) -> Result<Known, String> {
        let (field, lost) = lattice.field(outputs)?;
        let mesh = lattice.mesh(&field);
        let slope = |(a, b, share): (usize, usize, f64)| {
            let (at_a, at_b) = (lattice.gradient(&field, a), lattice.gradient(&field, b));
            let between: Vector3 = std::array::from_fn(|i| (1.0 - share) * at_a[i] + share * at_b[i]);
            Crossing { ends: [a, b], share, slope: norm(between) }
        };
        let all: Vec<Crossing> = lattice.crossings(&field).into_iter().map(slope).collect();
        let steepest = all.iter().map(|c| c.slope).filter(|s| s.is_finite()).fold(0.0, f64::max);
        let steep = |c: &&Crossing| c.slope.is_finite() && c.slope > FLAT * steepest;
        let crossings: Vec<Crossing> = all.iter().filter(steep).copied().collect();
        let flat = (all.len() - crossings.len()) as u64;
        Ok(Known { field, lost, mesh, crossings, flat })
    }
}

impl Ruler for FieldRuler {
    fn unit(&self) -> &'static str {
        "mm of the surface, to first order"
    }

    fn displacement(&self, variant: &[Outputs]) -> Result<Displacement, String> {
        let components = self.displacements(variant)?;
        let lengths: Vec<f64> = components.iter().map(|d| d.abs()).collect();
        Ok(Displacement { components, lengths: Summary::of(&lengths) })
    }

    fn report(&self, variant: &[Outputs]) -> Result<(Geometry, Option<Summary>), String> {
        let level = self.lattice.inner_level();
        let (mut distances, mut chamfers, mut open) = (Vec::new(), Vec::new(), false);
        let (mut flipped, mut margin, mut lost) = (0, None, 0);
        let (mut base_topology, mut variant_topology) = (Vec::new(), Vec::new());
        for (known, outputs) in self.base.iter().zip(variant) {
            let (field, not_finite) = self.lattice.field(outputs)?;
            lost += not_finite + known.lost;
            for (&a, _) in known.field.iter().zip(&field).filter(|&(&a, &b)| (a > level) != (b > level)) {
                flipped += 1;
                margin = Some((a - level).abs().max(margin.unwrap_or(0.0)));
            }
            let mesh = self.lattice.mesh(&field);
            base_topology.push(TopologyReport::of(&known.mesh));
            variant_topology.push(TopologyReport::of(&mesh));
            match (distances_mm(&mesh, &known.mesh), distances_mm(&known.mesh, &mesh)) {
                (Some(there), Some(back)) => {
                    chamfers.push(0.5 * (mean(&there) + mean(&back)));
                    distances.extend(there);
                    distances.extend(back);
                }
                _ => open |= !(mesh.faces.is_empty() && known.mesh.faces.is_empty()),
            }
        }
        // A surface that vanished is farther away than any number.
        let distance = if open { None } else { Summary::of(&distances) };
        let report = FieldReport {
            lattice: self.lattice.words.clone(),
            shape: self.lattice.shape,
            spacing: MM * self.lattice.spacing,
            level: self.lattice.level,
            displacement: self.displacement(variant)?.lengths,
            flat: self.base.iter().map(|known| known.flat).sum(),
            distance,
            hausdorff: distance.map(|d| d.max),
            chamfer: distance.map(|_| mean(&chamfers)),
            flipped,
            flipped_margin: margin.filter(|m| m.is_finite()),
            points: (self.base.len() * self.lattice.shape.iter().product::<usize>()) as u64,
            not_finite: lost,
            same_topology: base_topology.iter().zip(&variant_topology).all(|(a, b)| a.same_surface(b)),
            base_topology,
            variant_topology,
        };
        Ok((Geometry::Field(report), distance))
    }

    fn view(&self, variant: &[Outputs]) -> Result<Option<View>, String> {
        let mut worst: Option<(f64, View)> = None;
        for (draw, (known, outputs)) in self.base.iter().zip(variant).enumerate() {
            let mesh = self.lattice.mesh(&self.lattice.field(outputs)?.0);
            let Some(errors) = distances_mm(&known.mesh, &mesh) else { continue };
            let largest = errors.iter().copied().fold(0.0, f64::max);
            if worst.as_ref().is_none_or(|(w, _)| largest > *w) {
                let view = View {
                    title: format!(
                        "the base's surface on input {draw}, coloured by its distance to the variant's"
                    ),
                    vertices: known.mesh.vertices.iter().map(|v| v.map(|x| x as f32)).collect(),
                    faces: known.mesh.faces.clone(),
                    millimetres: errors.into_iter().map(|e| e as f32).collect(),
                };
                worst = Some((largest, view));
            }
        }
        Ok(worst.map(|(_, view)| view))
    }
}

/// From every vertex to the nearest point of the other surface; `None` where either is empty.
fn distances_mm(from: &Mesh, to: &Mesh) -> Option<Vec<f64>> {
    let tree = AabbTree::new(to).filter(|_| !from.faces.is_empty())?;
    Some(from.vertices.iter().map(|&v| MM * tree.closest(v).distance()).collect())
}

fn mean(numbers: &[f64]) -> f64 {
    numbers.iter().sum::<f64>() / numbers.len().max(1) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use vitruvian_reference::nn::Tensor;

    const N: usize = 21;

    fn lattice() -> Lattice {
        Lattice {
            output: "occupancy".to_owned(),
            shape: [N; 3],
            origin: [-1.0; 3],
            spacing: 0.1,
            level: 0.5,
            inside_is_larger: true,
            words: String::new(),
        }
    }

    /// ½ + ½·(radius − ‖p‖), a field of slope ½ a metre whose surface is a sphere.
    fn sphere(radius: f64) -> Vec<Outputs> {
        field(|p| 0.5 + 0.5 * (radius - norm(p)))
    }

    fn field(f: impl Fn(Vector3) -> f64) -> Vec<Outputs> {
        let value = |index: &[usize]| f(std::array::from_fn(|axis| -1.0 + 0.1 * index[axis] as f64));
        let values = Tensor::from_fn(&[N; 3], value).data;
        vec![Outputs::from([("occupancy".to_owned(), Tensor::new(&[N * N * N], values))])]
    }

    fn report(ruler: &FieldRuler, variant: &[Outputs]) -> FieldReport {
        let Ok((Geometry::Field(report), _)) = ruler.report(variant) else { panic!("a field report") };
        report
    }

    #[test]
    fn a_plane_that_moves_by_three_millimetres_is_three_millimetres_off() {
        // Linear interpolation of a linear field is exact, and so are its differences.
        let plane = |at: f64| field(move |[x, ..]| 0.5 + 0.5 * (at - x));
        let ruler = FieldRuler::new(lattice(), &plane(0.042)).expect("a surface");
        let found = report(&ruler, &plane(0.045));
        let displacement = found.displacement.expect("steep");
        assert!((displacement.mean - 3.0).abs() < 1e-9 && (displacement.max - 3.0).abs() < 1e-9);
        assert!((found.hausdorff.expect("two surfaces") - 3.0).abs() < 1e-9);
        // The lids in the border planes are common to both.
        let chamfer = found.chamfer.expect("two surfaces");
        assert!(chamfer > 0.0 && chamfer < 3.0, "{chamfer}");
        assert_eq!((found.flipped, found.flat), (0, 0));
    }

    #[test]
    fn a_sphere_that_grows_moves_outwards_and_stays_a_sphere() {
        let ruler = FieldRuler::new(lattice(), &sphere(0.6)).expect("a surface");
        let found = report(&ruler, &sphere(0.603));
        // Central differences over 2h of a distance from a point at R are short by at most h²/2R² = 1.4 %.
        let displacement = found.displacement.expect("steep");
        assert!((3.0..3.06).contains(&displacement.mean), "{displacement:?}");
        assert!(found.same_topology && found.base_topology[0].euler == 2);
        let outward = ruler.displacement(&sphere(0.603)).expect("a field").components;
        assert!(outward.iter().all(|&mm| mm > 0.0), "outwards is positive");
        let inward = ruler.displacement(&sphere(0.597)).expect("a field").components;
        assert!(inward.iter().all(|&mm| mm < 0.0), "inwards is negative");
    }

    #[test]
    fn equal_fields_have_no_distance() {
        let ruler = FieldRuler::new(lattice(), &sphere(0.6)).expect("a surface");
        let found = report(&ruler, &sphere(0.6));
        assert_eq!((found.flipped, found.flipped_margin, found.same_topology), (0, None, true));
        assert!(found.hausdorff.expect("two surfaces") < 1e-9);
    }

    #[test]
    fn a_field_that_is_smaller_inside_is_the_same_surface() {
        let turned = |outputs: Vec<Outputs>| -> Vec<Outputs> {
            let map =
                |outputs: Outputs| outputs.into_iter().map(|(name, t)| (name, t.map(|x| 1.0 - x))).collect();
            outputs.into_iter().map(map).collect()
        };
        let upright = report(&FieldRuler::new(lattice(), &sphere(0.6)).expect("a surface"), &sphere(0.61));
        let lattice = Lattice { inside_is_larger: false, ..lattice() };
        let found = report(
            &FieldRuler::new(lattice, &turned(sphere(0.6))).expect("a surface"),
            &turned(sphere(0.61)),
        );
        assert_eq!(found.flipped, upright.flipped);
        assert!((found.hausdorff.expect("a") - upright.hausdorff.expect("b")).abs() < 1e-9);
    }

    #[test]
    fn a_speck_and_a_tunnel_change_the_topology_and_are_far_off() {
        let ruler = FieldRuler::new(lattice(), &sphere(0.6)).expect("a surface");
        let speck = field(|p| {
            let near = norm(vitruvian_reference::linalg::vector::sub(p, [0.9, 0.9, 0.9])) < 0.05;
            if near { 1.0 } else { 0.5 + 0.5 * (0.6 - norm(p)) }
        });
        let found = report(&ruler, &speck);
        assert_eq!((found.flipped, found.variant_topology[0].components, found.same_topology), (1, 2, false));
        assert!(found.hausdorff.expect("two surfaces") > 800.0);
        let tunnel =
            field(|[x, y, z]| if x.hypot(y) < 0.15 { 0.0 } else { 0.5 + 0.5 * (0.6 - norm([x, y, z])) });
        let found = report(&ruler, &tunnel);
        assert_eq!((found.variant_topology[0].betti_1, found.variant_topology[0].euler), (2, 0));
        assert!(!found.same_topology && found.flipped > 0);
    }

    #[test]
    fn a_surface_that_vanishes_has_no_distance_and_passes_no_budget() {
        let ruler = FieldRuler::new(lattice(), &sphere(0.6)).expect("a surface");
        let (geometry, distances) = ruler.report(&field(|_| 0.0)).expect("a field");
        let Geometry::Field(found) = geometry else { panic!("a field report") };
        assert_eq!((distances, found.hausdorff, found.same_topology), (None, None, false));
        assert!(FieldRuler::new(lattice(), &field(|_| 0.0)).is_err(), "a base without a surface");
    }

    #[test]
    fn numbers_that_are_not_finite_are_outside_and_counted() {
        let ruler = FieldRuler::new(lattice(), &sphere(0.6)).expect("a surface");
        let mut broken = sphere(0.6);
        let middle = N * N * N / 2;
        broken[0].get_mut("occupancy").expect("the field").data[middle] = f64::NAN;
        let found = report(&ruler, &broken);
        assert_eq!((found.not_finite, found.flipped, found.variant_topology[0].components), (1, 1, 2));
    }

    #[test]
    fn another_number_of_points_is_refused() {
        let short = vec![Outputs::from([("occupancy".to_owned(), Tensor::new(&[8], vec![0.0; 8]))])];
        let refusal = FieldRuler::new(lattice(), &short).err().expect("eight points");
        assert!(refusal.contains("9261 numbers"), "{refusal}");
    }
}
