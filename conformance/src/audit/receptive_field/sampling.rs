//! What lies around a coordinate: resizing and sampling at the points of a grid.

use super::{Field, View, clipped, numbers};

impl View<'_> {
    /// Each axis by the widest of the coordinate transformations, which differ by less than one element of the input, or
    /// one of the output where that is larger.
    pub(super) fn resized(&self, index: &[usize]) -> Option<Vec<Option<Field>>> {
        let shape = self.shape(0)?;
        if self.text("coordinate_transformation_mode") == "tf_crop_and_resize" {
            return None;
        }
        let taps = match self.text("mode") {
            "linear" | "bilinear" => 1.0,
            "cubic" => 2.0,
            _ => 0.5,
        };
        let mut fields = self.everything();
        fields[0] = Some(
            shape
                .iter()
                .zip(index)
                .zip(self.output)
                .map(|((&side, &i), &out)| {
                    if side == out {
                        return i..i + 1;
                    }
                    let ratio = side as f64 / out.max(1) as f64;
                    let widened = if self.int("antialias", 0) != 0 { ratio.max(1.0) } else { 1.0 };
                    let centre = (i as f64 + 0.5) * ratio - 0.5;
                    let reach = taps * widened + ratio.max(1.0);
                    clipped((centre - reach).floor() as i64, (centre + reach).ceil() as i64 + 1, side)
                })
                .collect(),
        );
        Some(fields)
    }

    /// The point, and the corners around its coordinates; a whole axis where a coordinate lies outside and is reflected.
    pub(super) fn sampled(&self, index: &[usize]) -> Option<Vec<Option<Field>>> {
        let (x, grid) = (self.shape(0)?, self.operands.get(1)?.as_ref()?);
        let space = x.len().checked_sub(2)?;
        let mut point: Field = self.leading(1, &[&index[..1], &index[2..]].concat())?;
        point[space + 1] = 0..space;
        let first =
            grid.shape[1..=space].iter().zip(&index[2..]).fold(index[0], |at, (&side, &i)| at * side + i)
                * space;
        let coordinates = numbers(grid)?;
        let align = self.int("align_corners", 0) != 0;
        let reach = if matches!(self.text("mode"), "cubic" | "bicubic") { 2.0 } else { 1.0 };
        let mut field = vec![index[0]..index[0] + 1, index[1]..index[1] + 1];
        for axis in 0..space {
            // The last coordinate belongs to the first spatial axis.
            let g = *coordinates.get(first + space - 1 - axis)?;
            let side = x[axis + 2];
            let at = if align {
                (g + 1.0) / 2.0 * (side as f64 - 1.0)
            } else {
                ((g + 1.0) * side as f64 - 1.0) / 2.0
            };
            let outside = !(0.0..=side as f64 - 1.0).contains(&at);
            field.push(match self.text("padding_mode") {
                _ if at.is_nan() => 0..side,
                "reflection" if outside => 0..side,
                "border" => {
                    let at = at.clamp(0.0, side as f64 - 1.0);
                    clipped((at - reach).ceil() as i64, (at + reach).floor() as i64 + 1, side)
                }
                _ => clipped((at - reach).ceil() as i64, (at + reach).floor() as i64 + 1, side),
            });
        }
        Some(vec![Some(field), Some(point)])
    }
}
