//! Rows of which only what is not zero is kept.

/// For each vertex a few joints, each with its value.
pub struct Rows<T> {
    /// Row i is `starts[i]..starts[i + 1]`.
    starts: Vec<usize>,
    entries: Vec<(usize, T)>,
}

impl<T> Rows<T> {
    /// Keeps the values of a `rows` × `columns` table that are to be kept.
    pub fn new(
        rows: usize,
        columns: usize,
        value: impl Fn(usize, usize) -> T,
        is_kept: impl Fn(&T) -> bool,
    ) -> Rows<T> {
        let mut starts = vec![0];
        let mut entries = Vec::new();
        for row in 0..rows {
            entries
                .extend((0..columns).map(|column| (column, value(row, column))).filter(|(_, x)| is_kept(x)));
            starts.push(entries.len());
        }
        entries.shrink_to_fit();
        Rows { starts, entries }
    }

    /// The column and value of everything in a row.
    #[inline]
    pub fn row(&self, row: usize) -> &[(usize, T)] {
        &self.entries[self.starts[row]..self.starts[row + 1]]
    }
}
