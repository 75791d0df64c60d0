//! Asking a field for lattice points: in chunks, each once, counted and checked.

use std::collections::HashMap;
use std::collections::hash_map::Entry;

use ndarray::Array3;

use super::{ImplicitField, Lattice};
use crate::error::{Error, Result};
use crate::marching_cubes;

/// Asks a field for points of a lattice.
pub(super) struct Asker<'a, F> {
    field: &'a mut F,
    pub(super) lattice: &'a Lattice,
    progress: &'a mut dyn FnMut(u64, u64),
    /// Points asked.
    pub(super) asked: u64,
    /// Points known to be outside without asking.
    pub(super) outside: u64,
    /// The smallest and the largest value met.
    pub(super) range: (f32, f32),
}

impl<'a, F: ImplicitField> Asker<'a, F> {
    pub(super) fn new(field: &'a mut F, lattice: &'a Lattice, progress: &'a mut dyn FnMut(u64, u64)) -> Self {
        Asker { field, lattice, progress, asked: 0, outside: 0, range: (f32::INFINITY, f32::NEG_INFINITY) }
    }

    fn world(&self, point: [i32; 3]) -> [f64; 3] {
        self.lattice.world(point.map(f64::from))
    }

    fn note(&mut self, value: f32) {
        self.range = (self.range.0.min(value), self.range.1.max(value));
    }

    /// The outside value if the point is certainly outside.
    fn outside_value(&mut self, point: [i32; 3]) -> Option<f32> {
        self.field.certainly_outside(self.world(point)).then(|| {
            let value = self.field.outside_value();
            self.outside += 1;
            self.note(value);
            value
        })
    }

    /// The values of up to a chunk of points.
    fn ask(&mut self, points: &[[i32; 3]], still_to_come: u64) -> Result<Vec<f32>> {
        let world: Vec<[f64; 3]> = points.iter().map(|&point| self.world(point)).collect();
        let values = self.field.values(&world)?;
        if values.len() != points.len() {
            return Err(Error::Unanswerable(format!(
                "the field was asked for {} points and gave {} values",
                points.len(),
                values.len()
            )));
        }
        if let Some(at) = values.iter().position(|value| !value.is_finite()) {
            return Err(Error::Unanswerable(format!(
                "the field is {} at {:?} metres: check the network's weights and its inputs",
                values[at], world[at]
            )));
        }
        values.iter().for_each(|&value| self.note(value));
        self.asked += points.len() as u64;
        (self.progress)(self.asked, self.asked + still_to_come);
        Ok(values)
    }

    /// The values at all points, `[x][y][z]`.
    pub(super) fn everything(&mut self) -> Result<Array3<f32>> {
        let n = self.lattice.resolution + 1;
        let mut volume = Array3::zeros((n, n, n));
        let mut pending: Vec<[i32; 3]> = Vec::new();
        let chunk = self.field.chunk().max(1);
        let total = self.lattice.point_count();
        for number in 0..n * n * n {
            let index = [number / (n * n), number / n % n, number % n];
            match self.outside_value(index.map(|i| i as i32)) {
                Some(value) => volume[index] = value,
                None => pending.push(index.map(|i| i as i32)),
            }
            if pending.len() == chunk || (number + 1 == n * n * n && !pending.is_empty()) {
                let values = self.ask(&pending, total - number as u64 - 1)?;
                for (point, value) in pending.drain(..).zip(values) {
                    volume[point.map(|i| i as usize)] = value;
                }
            }
        }
        Ok(volume)
    }

    /// Makes sure that the samples hold every one of the points that is on the lattice.
    pub(super) fn complete(
        &mut self,
        samples: &mut Samples,
        points: impl IntoIterator<Item = [i32; 3]>,
    ) -> Result<()> {
        let mut pending = Vec::new();
        let inside_lattice = |point: [i32; 3]| point.iter().all(|&i| (0..=samples.resolution).contains(&i));
        for point in points.into_iter().filter(|&point| inside_lattice(point)) {
            if let Entry::Vacant(place) = samples.values.entry(point) {
                let known = self.outside_value(point);
                // Marked as asked, so that no point is pending twice; the value replaces the mark below.
                place.insert(known.unwrap_or(f32::NAN));
                if known.is_none() {
                    pending.push(point);
                }
            }
        }
        let mut left = pending.len() as u64;
        for points in pending.chunks(self.field.chunk().max(1)) {
            left -= points.len() as u64;
            let values = self.ask(points, left)?;
            samples.values.extend(points.iter().copied().zip(values));
        }
        Ok(())
    }
}

/// The lattice points looked at so far.
pub(super) struct Samples {
    resolution: i32,
    values: HashMap<[i32; 3], f32>,
}

impl Samples {
    pub(super) fn new(resolution: i32) -> Samples {
        Samples { resolution, values: HashMap::new() }
    }
}

impl marching_cubes::Lattice for Samples {
    fn value(&self, point: [i32; 3]) -> Option<f32> {
        self.values.get(&point).copied()
    }
}
