//! Tables and machine-readable results on standard output.

use std::io::Write;

/// Writes `text` and a newline to standard output; a reader that has gone away (`| head`) is no failure.
pub fn say(text: &str) {
    let _ = writeln!(std::io::stdout().lock(), "{text}");
}

/// Rows under a head, the first column flush left and the others flush right, two spaces apart.
pub fn aligned(head: &[&str], rows: &[Vec<String>]) -> String {
    let width = |column: usize| {
        let cells = rows.iter().filter_map(|row| row.get(column)).map(|cell| cell.chars().count());
        cells.chain([head[column].chars().count()]).max().unwrap_or(0)
    };
    let widths: Vec<usize> = (0..head.len()).map(width).collect();
    let line = |cells: &mut dyn Iterator<Item = &str>| {
        let mut line = String::new();
        for (column, cell) in cells.enumerate() {
            match column {
                0 => line.push_str(&format!("{cell:<0$}", widths[0])),
                _ => line.push_str(&format!("  {cell:>0$}", widths[column])),
            }
        }
        line.trim_end().to_owned()
    };
    let mut lines = vec![line(&mut head.iter().copied())];
    lines.extend(rows.iter().map(|row| line(&mut row.iter().map(String::as_str))));
    lines.join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_are_as_wide_as_their_widest_cell() {
        let rows = [vec!["a".into(), "1.25".into()], vec!["longer".into(), "10".into()]];
        assert_eq!(aligned(&["name", "cm"], &rows), "name      cm\na       1.25\nlonger    10");
    }
}
