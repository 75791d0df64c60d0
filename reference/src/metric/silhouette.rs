//! Overlap of silhouettes.

/// Intersection over union |A ∩ B| / |A ∪ B| of two masks of one size, in 0 … 1.
///
/// None if both are empty: 0/0 is neither agreement nor failure.
///
/// # Panics
///
/// If the masks differ in length.
///
/// ```
/// use vitruvian_reference::metric::silhouette::mask_iou;
/// assert_eq!(mask_iou(&[true, true, false], &[false, true, true]), Some(1.0 / 3.0));
/// ```
pub fn mask_iou(a: &[bool], b: &[bool]) -> Option<f64> {
    assert_eq!(a.len(), b.len(), "mask IoU: {} pixels against {}", a.len(), b.len());
    let both = a.iter().zip(b).filter(|&(&a, &b)| a && b).count();
    let either = a.iter().zip(b).filter(|&(&a, &b)| a || b).count();
    (either > 0).then(|| both as f64 / either as f64)
}

/// Mean over views of [`mask_iou`], as Li 2021 table 3.2 reports it; none without views or if a view has none.
///
/// Every view counts the same, however many pixels its silhouette has.
///
/// # Panics
///
/// If the two masks of a view differ in length.
pub fn mean_mask_iou(views: &[(&[bool], &[bool])]) -> Option<f64> {
    let sum: f64 = views.iter().map(|(a, b)| mask_iou(a, b)).sum::<Option<f64>>()?;
    (!views.is_empty()).then(|| sum / views.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    const UPPER: [bool; 4] = [true, true, false, false];
    const LOWER: [bool; 4] = [false, false, true, true];
    const NONE: [bool; 4] = [false; 4];

    #[test]
    fn a_mask_overlaps_itself_wholly_and_its_complement_not_at_all() {
        assert_eq!(mask_iou(&UPPER, &UPPER), Some(1.0));
        assert_eq!(mask_iou(&UPPER, &LOWER), Some(0.0));
        assert_eq!(mask_iou(&UPPER, &[true; 4]), Some(0.5));
    }

    #[test]
    fn two_empty_masks_have_no_overlap_to_speak_of() {
        assert_eq!(mask_iou(&NONE, &NONE), None);
        assert_eq!(mask_iou(&NONE, &UPPER), Some(0.0));
    }

    #[test]
    fn views_count_the_same() {
        assert_eq!(mean_mask_iou(&[(&UPPER, &UPPER), (&UPPER, &[true; 4])]), Some(0.75));
        assert_eq!(mean_mask_iou(&[(&UPPER, &UPPER), (&NONE, &NONE)]), None);
        assert_eq!(mean_mask_iou(&[]), None);
    }

    #[test]
    #[should_panic(expected = "4 pixels against 3")]
    fn masks_of_different_size_are_refused() {
        mask_iou(&UPPER, &LOWER[1..]);
    }
}
