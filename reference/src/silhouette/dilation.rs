//! Dilation and erosion of masks by a structuring element.
//!
//! Li 2021, fig. 3.5, dilates the silhouettes by elements of 3, 5, 7 and 9 pixels to see how much the fit suffers.

use super::Mask;

/// The set of offsets that a mask is grown by, centred on the pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum StructuringElement {
    /// `size` × `size` pixels.
    Square {
        /// Odd.
        size: usize,
    },
    /// The pixels of that square whose centres are within size/2 of the middle.
    Disc {
        /// Odd.
        size: usize,
    },
}

impl StructuringElement {
    /// The offsets (rows, columns); the element is its own mirror image.
    fn offsets(self) -> Vec<(isize, isize)> {
        let (StructuringElement::Square { size } | StructuringElement::Disc { size }) = self;
        assert!(size % 2 == 1, "StructuringElement: size {size} is even and has no middle pixel");
        let reach = (size / 2) as isize;
        let belongs = |i: isize, j: isize| match self {
            StructuringElement::Square { .. } => true,
            StructuringElement::Disc { .. } => 4 * (i * i + j * j) <= (size * size) as isize,
        };
        let rows = -reach..=reach;
        rows.flat_map(|i| (-reach..=reach).map(move |j| (i, j))).filter(|&(i, j)| belongs(i, j)).collect()
    }
}

/// The pixels that the element, centred there, shares with the mask: grown by about size/2.
///
/// # Panics
/// If the element's size is even.
pub fn dilate(mask: &Mask, element: StructuringElement) -> Mask {
    morph(mask, element, true)
}

/// The pixels where the element, centred there, lies in the mask wholly: the dilation of what is outside. Beyond the
/// image's border nothing is known and nothing eaten away.
///
/// # Panics
/// If the element's size is even.
pub fn erode(mask: &Mask, element: StructuringElement) -> Mask {
    morph(mask, element, false)
}

/// Spreads the pixels that are `spreading`: dilation spreads the inside, erosion the outside.
fn morph(mask: &Mask, element: StructuringElement, spreading: bool) -> Mask {
    let offsets = element.offsets();
    let (w, h) = (mask.width as isize, mask.height as isize);
    let mut grown = mask.clone();
    for i in 0..h {
        for j in 0..w {
            if mask.at(i, j) != spreading {
                continue;
            }
            for &(di, dj) in &offsets {
                let (row, column) = (i + di, j + dj);
                if (0..h).contains(&row) && (0..w).contains(&column) {
                    grown.inside[(row * w + column) as usize] = spreading;
                }
            }
        }
    }
    grown
}

#[cfg(test)]
mod tests {
    use super::*;

    fn dot() -> Mask {
        let mut mask = Mask::empty(9, 9);
        mask.inside[40] = true;
        mask
    }

    #[test]
    fn a_pixel_becomes_the_element() {
        let areas = [1, 3, 5, 7, 9].map(|size| {
            let area = |element| dilate(&dot(), element).area_px();
            (area(StructuringElement::Square { size }), area(StructuringElement::Disc { size }))
        });
        assert_eq!(areas, [(1, 1), (9, 9), (25, 21), (49, 37), (81, 69)]);
    }

    #[test]
    fn erosion_undoes_the_dilation_of_a_pixel() {
        for element in [StructuringElement::Square { size: 5 }, StructuringElement::Disc { size: 7 }] {
            assert_eq!(erode(&dilate(&dot(), element), element), dot());
        }
    }

    #[test]
    fn the_border_eats_nothing_away() {
        let full = Mask::new(4, 3, vec![true; 12]);
        assert_eq!(erode(&full, StructuringElement::Square { size: 3 }), full);
    }

    #[test]
    #[should_panic(expected = "size 4 is even")]
    fn an_element_without_a_middle_is_refused() {
        dilate(&dot(), StructuringElement::Square { size: 4 });
    }
}
