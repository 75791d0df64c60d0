//! Rows, columns and whole axes: matrix products, sums of products, reductions.

use super::{Field, View, aligned, counted};

impl View<'_> {
    pub(super) fn gemm(&self, index: &[usize]) -> Option<Vec<Option<Field>>> {
        let (a, b) = (self.shape(0)?, self.shape(1)?);
        let [m, n] = *index else { return None };
        let line = |shape: &[usize], along: usize, i: usize| -> Option<Field> {
            let mut field: Field = shape.iter().map(|&side| 0..side).collect();
            *field.get_mut(along)? = i..i + 1;
            Some(field)
        };
        let mut fields = vec![
            line(a, usize::from(self.int("transA", 0) != 0), m),
            line(b, usize::from(self.int("transB", 0) == 0), n),
        ];
        fields.extend((2..self.operands.len()).map(|i| self.broadcast(i, index)));
        Some(fields)
    }

    /// The row of a matrix product's left operand; a list is a row.
    pub(super) fn row(&self, operand: usize, index: &[usize]) -> Option<Field> {
        let shape = self.shape(operand)?;
        if shape.len() == 1 {
            return self.whole(operand);
        }
        let columns = usize::from(self.operands.iter().flatten().nth(1).is_some_and(|b| b.shape.len() > 1));
        let index = &index[..index.len() - columns];
        let mut field = aligned(&shape[..shape.len() - 1], index);
        field.push(0..shape[shape.len() - 1]);
        Some(field)
    }

    /// The column of a matrix product's right operand; a list is a column.
    pub(super) fn column(&self, operand: usize, index: &[usize]) -> Option<Field> {
        let shape = self.shape(operand)?;
        if shape.len() == 1 {
            return self.whole(operand);
        }
        let rows = usize::from(self.shape(0)?.len() > 1);
        let batch = &index[..index.len().checked_sub(1 + rows)?];
        let mut field = aligned(&shape[..shape.len() - 2], batch);
        let column = *index.last()?;
        field.extend([0..shape[shape.len() - 2], column..column + 1]);
        Some(field)
    }

    pub(super) fn einsum(&self, index: &[usize]) -> Option<Vec<Option<Field>>> {
        let equation: String = self.text("equation").chars().filter(|c| !c.is_whitespace()).collect();
        let (inputs, output) = equation.split_once("->")?;
        if equation.contains('.') || output.chars().count() != index.len() {
            return None;
        }
        let place = |letter: char| output.chars().position(|c| c == letter).map(|axis| index[axis]);
        let field = |(i, letters): (usize, &str)| -> Option<Field> {
            let shape = self.shape(i)?;
            Some(
                letters
                    .chars()
                    .zip(shape)
                    .map(|(letter, &side)| match place(letter) {
                        Some(i) if side > 1 => i..i + 1,
                        _ => 0..side,
                    })
                    .collect(),
            )
        };
        Some(inputs.split(',').enumerate().map(field).collect())
    }

    /// All elements along the axes; all of them where none is given.
    pub(super) fn reduced(&self, index: &[usize], axes: &[i64]) -> Option<Vec<Option<Field>>> {
        let shape = self.shape(0)?;
        let axes: Vec<usize> = axes.iter().map(|&axis| counted(axis, shape.len())).collect::<Option<_>>()?;
        let mut fields = self.everything();
        if axes.is_empty() && self.int("noop_with_empty_axes", 0) == 0 {
            return Some(fields);
        }
        let kept = index.len() == shape.len();
        let mut rest = index.iter();
        fields[0] = Some(
            shape
                .iter()
                .enumerate()
                .map(|(axis, &side)| {
                    if axes.contains(&axis) {
                        if kept {
                            rest.next();
                        }
                        0..side
                    } else {
                        let i = rest.next().copied().unwrap_or(0);
                        i..i + 1
                    }
                })
                .collect(),
        );
        Some(fields)
    }
}
