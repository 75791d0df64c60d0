//! Windows: what lies under a kernel, and what a transposed kernel was put down from.

use std::ops::Range;

use super::{Field, View, clipped};

impl View<'_> {
    /// Begin of the padding of a window on spatial axis `axis`.
    fn padding(&self, axis: usize, side: usize, out: usize, extent: i64, stride: i64) -> i64 {
        let total = ((out as i64 - 1) * stride + extent - side as i64).max(0);
        match self.text("auto_pad") {
            "SAME_UPPER" => total / 2,
            "SAME_LOWER" => total - total / 2,
            "VALID" => 0,
            _ => self.along("pads", axis, 0),
        }
    }

    /// The window over spatial axis `axis` of operand 0, clipped to it.
    fn window(&self, index: &[usize], axis: usize, kernel: usize) -> Option<Range<usize>> {
        let (side, out) = (*self.shape(0)?.get(axis + 2)?, *self.output.get(axis + 2)?);
        let (stride, dilation) = (self.along("strides", axis, 1), self.along("dilations", axis, 1));
        let extent = (kernel as i64 - 1) * dilation + 1;
        let begin = index[axis + 2] as i64 * stride - self.padding(axis, side, out, extent, stride);
        Some(clipped(begin, begin + extent, side))
    }

    pub(super) fn convolution(&self, index: &[usize], weights: usize) -> Option<Vec<Option<Field>>> {
        let (x, w) = (self.shape(0)?, self.shape(weights)?);
        let groups = usize::try_from(self.int("group", 1)).ok()?;
        let group = index.get(1)? / w.first()?.checked_div(groups)?.max(1);
        let channels = *w.get(1)?;
        let mut field = vec![index[0]..index[0] + 1, group * channels..(group + 1) * channels];
        for axis in 0..x.len().checked_sub(2)? {
            field.push(self.window(index, axis, *w.get(axis + 2)?)?);
        }
        let own = |i: usize| match i {
            0 => Some(field.clone()),
            i if i == weights => self.leading(weights, &index[1..2]),
            i => match self.shape(i)? {
                [side] if *side == w[0] => self.channel(i, index[1]),
                _ => self.whole(i),
            },
        };
        Some((0..self.operands.len()).map(own).collect())
    }

    pub(super) fn transposed_convolution(&self, index: &[usize]) -> Option<Vec<Option<Field>>> {
        let (x, w) = (self.shape(0)?, self.shape(1)?);
        let groups = usize::try_from(self.int("group", 1)).ok()?;
        let (own, per_group) = (*w.get(1)?, w.first()?.checked_div(groups)?);
        let group = index.get(1)?.checked_div(own)?;
        let inputs = group * per_group..(group + 1) * per_group;
        let mut field = vec![index[0]..index[0] + 1, inputs.clone()];
        for axis in 0..x.len().checked_sub(2)? {
            let (side, out, kernel) = (x[axis + 2], *self.output.get(axis + 2)?, *w.get(axis + 2)?);
            let (stride, dilation) = (self.along("strides", axis, 1), self.along("dilations", axis, 1));
            let reach = (kernel as i64 - 1) * dilation;
            // Paddings that are not given follow from the output's side.
            let total =
                stride * (side as i64 - 1) + self.along("output_padding", axis, 0) + reach + 1 - out as i64;
            let computed =
                self.attribute("output_shape").is_some() || self.text("auto_pad").starts_with("SAME");
            let before = match (computed, self.text("auto_pad")) {
                (true, "SAME_UPPER") => total / 2,
                (true, _) => total - total / 2,
                (false, _) => self.along("pads", axis, 0),
            };
            // o = i·stride − before + k·dilation for some k < kernel.
            let last = index[axis + 2] as i64 + before;
            let first = (last - reach + stride - 1).div_euclid(stride.max(1));
            field.push(clipped(first, last.div_euclid(stride.max(1)) + 1, side));
        }
        let mut weights = self.whole(1)?;
        (weights[0], weights[1]) = (inputs, index[1] % own..index[1] % own + 1);
        let mut fields = vec![Some(field), Some(weights)];
        fields.extend((2..self.operands.len()).map(|i| self.channel(i, index[1])));
        Some(fields)
    }

    pub(super) fn pool(&self, index: &[usize]) -> Option<Field> {
        let mut field = vec![index[0]..index[0] + 1, *index.get(1)?..index[1] + 1];
        for axis in 0..index.len() - 2 {
            let kernel = usize::try_from(self.along("kernel_shape", axis, 1)).ok()?;
            field.push(self.window(index, axis, kernel)?);
        }
        Some(field)
    }
}
