//! Numbers and names as an audit writes them for people.

/// A measured number in three digits: `0.042`, `3.12`, `203`, `1.2e5`; `∞` where it is not finite.
pub fn number(x: f64) -> String {
    let size = x.abs();
    if !x.is_finite() {
        return "∞".into();
    }
    match size {
        0.0 => "0".into(),
        _ if !(1e-3..1e5).contains(&size) => format!("{x:.1e}"),
        _ if size >= 99.95 => format!("{x:.0}"),
        _ if size >= 9.995 => format!("{x:.1}"),
        _ if size >= 0.9995 => format!("{x:.2}"),
        _ => format!("{x:.3}"),
    }
}

/// [`number`], or a dash where nothing was measured.
pub fn optional(x: Option<f64>) -> String {
    x.map_or_else(|| "–".into(), number)
}

/// How many: all digits up to 99 999, then `1.2 M` and the like.
pub fn count(n: u64) -> String {
    match n {
        0..100_000 => n.to_string(),
        100_000..1_000_000 => format!("{} k", n / 1000),
        1_000_000..1_000_000_000 => format!("{:.1} M", n as f64 / 1e6),
        _ => format!("{:.1} G", n as f64 / 1e9),
    }
}

/// `1 node`, `2 nodes`.
pub fn counted(n: usize, what: &str) -> String {
    if n == 1 { format!("1 {what}") } else { format!("{n} {what}s") }
}

/// A shape or an index as `[1, 64, 32]`.
pub fn list(axes: &[usize]) -> String {
    let axes: Vec<String> = axes.iter().map(usize::to_string).collect();
    format!("[{}]", axes.join(", "))
}

/// Text from a file without what could move a terminal's cursor or end a line: control characters are written out.
pub fn plain(text: &str) -> String {
    text.chars()
        .flat_map(|c| {
            let is_unseen = c.is_control() || ('\u{2028}'..='\u{202e}').contains(&c);
            let written = if is_unseen { c.escape_default().collect() } else { vec![c] };
            written.into_iter()
        })
        .collect()
}

/// The end of a text that is longer than `width` characters, after an ellipsis: names differ most at their ends.
pub fn ending(text: &str, width: usize) -> String {
    let length = text.chars().count();
    if length <= width {
        return text.to_owned();
    }
    let kept: String = text.chars().skip(length - width.saturating_sub(1)).collect();
    format!("…{kept}")
}

/// A word for a POSIX shell, in quotes where it needs them.
pub fn shell(word: &str) -> String {
    let is_safe = |c: char| c.is_ascii_alphanumeric() || "_-./:=@%+,".contains(c);
    if !word.is_empty() && word.chars().all(is_safe) {
        return word.to_owned();
    }
    format!("'{}'", plain(word).replace('\'', "'\\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_keep_three_digits() {
        let written = [
            0.0,
            0.04217,
            0.99949,
            0.9996,
            3.124,
            9.996,
            99.94,
            99.96,
            99_999.0,
            123_456.0,
            -2.5e-7,
            f64::NAN,
        ];
        let words: Vec<String> = written.iter().map(|&x| number(x)).collect();
        assert_eq!(
            words,
            ["0", "0.042", "0.999", "1.00", "3.12", "10.0", "99.9", "100", "99999", "1.2e5", "-2.5e-7", "∞"]
        );
        assert_eq!(
            [99_999, 100_000, 1_234_567, 5_000_000_000].map(count),
            ["99999", "100 k", "1.2 M", "5.0 G"]
        );
    }

    #[test]
    fn names_cannot_steer_a_terminal_or_a_shell() {
        assert_eq!(plain("a\u{1b}[2Jb\nc"), "a\\u{1b}[2Jb\\nc");
        assert_eq!(plain("Faltung_ß"), "Faltung_ß");
        assert_eq!(shell("layer1/conv:0"), "layer1/conv:0");
        assert_eq!(shell("a b'; rm -r ."), "'a b'\\''; rm -r .'");
        assert_eq!(shell(""), "''");
    }

    #[test]
    fn a_name_that_is_too_long_keeps_its_end() {
        assert_eq!(ending("/layer1/conv", 12), "/layer1/conv");
        assert_eq!(ending("/layer1/conv", 6), "…/conv");
    }
}
