//! Many pictures on one: a grid with captions for its rows and columns.

use image::{Rgb, RgbImage, imageops};

use super::text;

/// Pixels a dot of the captions' font.
const SCALE: u32 = 2;

/// White space around everything, in pixels.
const GAP: u32 = 8;

/// One row of a contact sheet.
#[derive(Clone, Debug)]
pub struct Row {
    /// Stands above the row, on the left.
    pub caption: String,
    /// From left to right; `None` leaves its place white.
    pub pictures: Vec<Option<RgbImage>>,
}

/// Lays `rows` out on white, each picture in the middle of its cell, `columns` above the first row.
///
/// A column is as wide as its widest picture or its caption, a row as high as its highest picture; there are as many
/// columns as the longest row or the captions need.
pub fn contact_sheet(columns: &[&str], rows: &[Row]) -> RgbImage {
    let line = text::HEIGHT * SCALE + GAP;
    let count = rows.iter().map(|r| r.pictures.len()).max().unwrap_or(0).max(columns.len());
    let widths: Vec<u32> = (0..count)
        .map(|c| {
            let pictures = rows.iter().filter_map(|r| r.pictures.get(c)?.as_ref());
            let caption = columns.get(c).map_or(0, |t| text::width(t, SCALE));
            pictures.map(RgbImage::width).max().unwrap_or(0).max(caption)
        })
        .collect();
    let heights: Vec<u32> =
        rows.iter().map(|r| r.pictures.iter().flatten().map(RgbImage::height).max().unwrap_or(0)).collect();
    let captions = rows.iter().map(|r| text::width(&r.caption, SCALE)).max().unwrap_or(0);
    let width = GAP + (widths.iter().map(|w| w + GAP).sum::<u32>()).max(captions + GAP);
    let header = if columns.is_empty() { 0 } else { line };
    let above = |row: &Row| if row.caption.is_empty() { 0 } else { line };
    let height = GAP + header + rows.iter().zip(&heights).map(|(r, h)| above(r) + h + GAP).sum::<u32>();
    let mut sheet = RgbImage::from_pixel(width, height, Rgb([255; 3]));
    let lefts: Vec<u32> = widths
        .iter()
        .scan(GAP, |x, w| {
            let left = *x;
            *x += w + GAP;
            Some(left)
        })
        .collect();
    for ((&caption, left), w) in columns.iter().zip(&lefts).zip(&widths) {
        let indent = (w - text::width(caption, SCALE)) / 2;
        text::draw(&mut sheet, left + indent, GAP, caption, SCALE, [0; 3]);
    }
    let mut top = GAP + header;
    for (row, h) in rows.iter().zip(&heights) {
        text::draw(&mut sheet, GAP, top, &row.caption, SCALE, [0; 3]);
        top += above(row);
        for ((picture, left), w) in row.pictures.iter().zip(&lefts).zip(&widths) {
            if let Some(p) = picture {
                let at = (left + (w - p.width()) / 2, top + (h - p.height()) / 2);
                imageops::replace(&mut sheet, p, i64::from(at.0), i64::from(at.1));
            }
        }
        top += h + GAP;
    }
    sheet
}

#[cfg(test)]
mod tests {
    use super::*;

    fn patch(width: u32, height: u32, color: [u8; 3]) -> Option<RgbImage> {
        Some(RgbImage::from_pixel(width, height, Rgb(color)))
    }

    #[test]
    fn every_picture_is_on_the_sheet_whole_and_none_overlap() {
        let rows = [
            Row {
                caption: "one".into(),
                pictures: vec![patch(30, 20, [255, 0, 0]), None, patch(10, 40, [0, 255, 0])],
            },
            Row { caption: String::new(), pictures: vec![patch(5, 5, [0, 0, 255])] },
        ];
        let sheet = contact_sheet(&["front", "a long caption"], &rows);
        let count = |color: [u8; 3]| sheet.pixels().filter(|p| p.0 == color).count();
        assert_eq!((count([255, 0, 0]), count([0, 255, 0]), count([0, 0, 255])), (600, 400, 25));
        assert!(count([0, 0, 0]) > 50, "captions are drawn");
    }

    #[test]
    fn nothing_makes_a_small_white_sheet() {
        let sheet = contact_sheet(&[], &[]);
        assert!(sheet.pixels().all(|p| p.0 == [255; 3]));
        contact_sheet(&["a"], &[Row { caption: "b".into(), pictures: vec![] }]);
    }
}
