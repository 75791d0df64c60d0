//! A mask: which pixels of an image show the body.

/// H×W pixels, row by row; `inside[i·width + j]` says whether pixel (row i, column j) shows the body.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Mask {
    /// W.
    pub width: usize,
    /// H.
    pub height: usize,
    /// H·W pixels.
    pub inside: Vec<bool>,
}

impl Mask {
    /// A mask of H·W pixels given row by row.
    ///
    /// # Panics
    /// If there are not W·H pixels.
    pub fn new(width: usize, height: usize, inside: Vec<bool>) -> Mask {
        assert!(inside.len() == width * height, "Mask: {} pixels for {width}×{height}", inside.len());
        Mask { width, height, inside }
    }

    /// The mask without any body.
    pub fn empty(width: usize, height: usize) -> Mask {
        Mask { width, height, inside: vec![false; width * height] }
    }

    /// Whether pixel (row i, column j) shows the body; pixels outside the image do not.
    pub fn at(&self, i: isize, j: isize) -> bool {
        let (row, column) = (i as usize, j as usize);
        // Negative numbers become huge ones.
        row < self.height && column < self.width && self.inside[row * self.width + column]
    }

    /// Whether the pixel that holds the continuous position (u, v) shows the body.
    pub fn holds(&self, [u, v]: [f64; 2]) -> bool {
        u.is_finite() && v.is_finite() && self.at(v.floor() as isize, u.floor() as isize)
    }

    /// The number of pixels that show the body.
    pub fn area_px(&self) -> usize {
        self.inside.iter().filter(|inside| **inside).count()
    }

    /// Whether the body reaches the image's edge, where it may be cut off.
    pub fn touches_border(&self) -> bool {
        let (w, h) = (self.width, self.height);
        let ends = |row: usize| self.inside[row * w] || self.inside[row * w + w - 1];
        w > 0
            && h > 0
            && (self.inside[..w].iter().any(|p| *p)
                || self.inside[w * (h - 1)..].iter().any(|p| *p)
                || (0..h).any(ends))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn outside_the_image_there_is_no_body() {
        let full = Mask::new(2, 3, vec![true; 6]);
        assert!(full.at(2, 1) && !full.at(3, 1) && !full.at(-1, 0) && !full.at(0, 2));
        assert!(full.holds([1.99, 2.99]) && !full.holds([2.0, 1.0]) && !full.holds([f64::NAN, 0.0]));
    }

    #[test]
    fn only_the_outer_pixels_touch_the_border() {
        let mut mask = Mask::empty(3, 3);
        mask.inside[4] = true;
        assert!(!mask.touches_border());
        mask.inside[5] = true;
        assert!(mask.touches_border());
        assert_eq!(mask.area_px(), 2);
        assert!(!Mask::empty(0, 0).touches_border());
    }
}
