//! A box of a tensor: a range of places along each axis.

use std::ops::Range;

use vitruvian_reference::nn::{Scalar, Tensor};

use crate::onnx::typed_tensor::{Elements, TypedTensor};
use crate::onnx::value::{Data, Value};

/// A range of places per axis; a scalar has none and one place.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Region(pub Vec<Range<usize>>);

impl Region {
    /// All of a tensor.
    pub fn whole(shape: &[usize]) -> Self {
        Self(shape.iter().map(|&side| 0..side).collect())
    }

    /// Length of each axis.
    pub fn shape(&self) -> Vec<usize> {
        self.0.iter().map(ExactSizeIterator::len).collect()
    }

    /// Number of places.
    pub fn len(&self) -> usize {
        self.0.iter().map(ExactSizeIterator::len).product()
    }

    /// Whether it has no place.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Whether it lies within a tensor of this shape.
    pub fn fits(&self, shape: &[usize]) -> bool {
        self.0.len() == shape.len() && self.0.iter().zip(shape).all(|(range, &side)| range.end <= side)
    }

    /// The runs of places that lie one after the other in a tensor of this shape, in order: a range of offsets each.
    ///
    /// # Panics
    /// When the region does not lie within the shape.
    pub fn runs(&self, shape: &[usize]) -> impl Iterator<Item = Range<usize>> {
        assert!(self.fits(shape), "region {self:?} does not lie in shape {shape:?}");
        // Trailing axes that are taken whole join the run of the axis before them.
        let whole = self.0.iter().zip(shape).rev().take_while(|(range, side)| range.len() == **side).count();
        let split = shape.len().saturating_sub(whole + 1);
        let strides: Vec<usize> = (0..shape.len()).map(|axis| shape[axis + 1..].iter().product()).collect();
        let inner: usize = shape.get(split + 1..).unwrap_or_default().iter().product();
        let (first, length) =
            self.0.get(split).map_or((0, 1), |range| (range.start * inner, range.len() * inner));
        let outer = self.0[..split].to_vec();
        let count: usize =
            if self.is_empty() { 0 } else { outer.iter().map(ExactSizeIterator::len).product() };
        (0..count).map(move |mut run| {
            let mut offset = first;
            for (range, stride) in outer.iter().zip(&strides).rev() {
                offset += (range.start + run % range.len()) * stride;
                run /= range.len();
            }
            offset..offset + length
        })
    }

    /// The offset in a tensor of this shape of the region's `place`-th element.
    ///
    /// # Panics
    /// When there are not so many.
    pub fn offset(&self, mut place: usize, shape: &[usize]) -> usize {
        assert!(place < self.len(), "place {place} of region {self:?}");
        let (mut offset, mut stride) = (0, 1);
        for (range, &side) in self.0.iter().zip(shape).rev() {
            offset += (range.start + place % range.len()) * stride;
            place /= range.len();
            stride *= side;
        }
        offset
    }
}

/// The part of a tensor that lies in a region.
///
/// # Panics
/// When the region does not lie within the tensor.
pub fn part(tensor: &TypedTensor, region: &Region) -> TypedTensor {
    let runs: Vec<Range<usize>> = region.runs(&tensor.shape).collect();
    TypedTensor { shape: region.shape(), elements: taken(&tensor.elements, &runs) }
}

/// The elements that lie at these offsets, one after the other, as a tensor of one axis.
///
/// # Panics
/// When there are not so many.
pub fn flat(tensor: &TypedTensor, offsets: Range<usize>) -> TypedTensor {
    TypedTensor { shape: vec![offsets.len()], elements: taken(&tensor.elements, &[offsets]) }
}

/// The part of a value that lies in a region.
///
/// # Panics
/// When the region does not lie within the value.
pub fn value_part<T: Scalar>(value: &Value<T>, region: &Region) -> Value<T> {
    let runs: Vec<Range<usize>> = region.runs(value.shape()).collect();
    value_taken(value, &region.shape(), &runs)
}

/// The elements of a value that lie at these offsets, as a value of one axis.
///
/// # Panics
/// When there are not so many.
pub fn value_flat<T: Scalar>(value: &Value<T>, offsets: Range<usize>) -> Value<T> {
    value_taken(value, &[offsets.len()], &[offsets])
}

fn value_taken<T: Scalar>(value: &Value<T>, shape: &[usize], runs: &[Range<usize>]) -> Value<T> {
    let data = match &value.data {
        Data::Numbers(x) => Data::Numbers(Tensor::new(shape, joined(&x.data, runs))),
        Data::Integers(x) => Data::Integers(Tensor::new(shape, joined(&x.data, runs))),
        Data::Truths(x) => Data::Truths(Tensor::new(shape, joined(&x.data, runs))),
    };
    Value { element: value.element, data }
}

fn joined<E: Clone>(elements: &[E], runs: &[Range<usize>]) -> Vec<E> {
    let mut part = Vec::with_capacity(runs.iter().map(ExactSizeIterator::len).sum());
    runs.iter().for_each(|run| part.extend_from_slice(&elements[run.clone()]));
    part
}

fn taken(elements: &Elements, runs: &[Range<usize>]) -> Elements {
    match elements {
        Elements::F32(v) => Elements::F32(joined(v, runs)),
        Elements::F64(v) => Elements::F64(joined(v, runs)),
        Elements::F16(v) => Elements::F16(joined(v, runs)),
        Elements::Bf16(v) => Elements::Bf16(joined(v, runs)),
        Elements::I8(v) => Elements::I8(joined(v, runs)),
        Elements::U8(v) => Elements::U8(joined(v, runs)),
        Elements::I16(v) => Elements::I16(joined(v, runs)),
        Elements::U16(v) => Elements::U16(joined(v, runs)),
        Elements::I32(v) => Elements::I32(joined(v, runs)),
        Elements::U32(v) => Elements::U32(joined(v, runs)),
        Elements::I64(v) => Elements::I64(joined(v, runs)),
        Elements::U64(v) => Elements::U64(joined(v, runs)),
        Elements::Bool(v) => Elements::Bool(joined(v, runs)),
    }
}

/// The place, one index per axis, of an element that lies at this offset.
pub fn unravel(mut offset: usize, shape: &[usize]) -> Vec<usize> {
    let mut index = vec![0; shape.len()];
    for (place, &side) in index.iter_mut().zip(shape).rev() {
        *place = offset % side.max(1);
        offset /= side.max(1);
    }
    index
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_part_has_the_elements_of_its_places_in_order() {
        let shape = [2, 3, 4];
        let tensor = TypedTensor { shape: shape.to_vec(), elements: Elements::I64((0..24).collect()) };
        for region in [
            Region::whole(&shape),
            Region(vec![1..2, 0..3, 0..4]),
            Region(vec![0..2, 1..3, 0..4]),
            Region(vec![0..2, 1..2, 2..4]),
            Region(vec![0..2, 1..1, 2..4]),
        ] {
            let by_place: Vec<i64> = (0..region.len()).map(|i| region.offset(i, &shape) as i64).collect();
            let expected = TypedTensor { shape: region.shape(), elements: Elements::I64(by_place) };
            assert_eq!(part(&tensor, &region), expected, "{region:?}");
        }
        let scalar = TypedTensor { shape: vec![], elements: Elements::Bool(vec![true]) };
        assert_eq!(part(&scalar, &Region::whole(&[])), scalar, "a scalar has one place");
        assert_eq!(unravel(17, &shape), [1, 1, 1]);
    }

    #[test]
    #[should_panic(expected = "does not lie in shape [2]")]
    fn a_part_lies_within_its_tensor() {
        part(&TypedTensor { shape: vec![2], elements: Elements::Bool(vec![true; 2]) }, &Region(vec![1..3]));
    }
}
