//! The figures of a table, from the errors of joints.

use serde::Serialize;
use vitruvian_reference::metric::joint_errors::JointErrors;
use vitruvian_reference::metric::pck::PCK_THRESHOLD_M;

use super::pairing::Pair;

/// The errors of some frames, three times over.
pub struct Errors {
    /// As the joints stand.
    pub raw: JointErrors,
    /// Relative to the roots.
    pub relative: JointErrors,
    /// After Procrustes alignment of each frame.
    pub aligned: JointErrors,
}

impl Errors {
    /// Of every frame of a pair.
    pub fn of(pair: &Pair) -> Errors {
        let [found, expected] = &pair.relative;
        Errors {
            raw: JointErrors::between(&pair.raw[0], &pair.raw[1]),
            relative: JointErrors::between(found, expected),
            aligned: JointErrors::aligned(found, expected),
        }
    }

    /// Of all of these together.
    ///
    /// # Panics
    /// If there are none, or they are of different joints.
    pub fn concatenated<'a>(all: impl Iterator<Item = &'a Errors> + Clone) -> Errors {
        let of = |each: fn(&Errors) -> &JointErrors| {
            JointErrors::concatenated(&all.clone().map(|errors| each(errors).clone()).collect::<Vec<_>>())
        };
        Errors { raw: of(|e| &e.raw), relative: of(|e| &e.relative), aligned: of(|e| &e.aligned) }
    }

    /// What a table says of them.
    pub fn measures(&self) -> Measures {
        Measures {
            frames: self.raw.frame_count(),
            joints: self.raw.joint_count(),
            error_mm: 1000.0 * self.raw.mean(),
            mpjpe_mm: 1000.0 * self.relative.mean(),
            pa_mpjpe_mm: 1000.0 * self.aligned.mean(),
            pck_150: self.relative.pck(PCK_THRESHOLD_M),
            auc: self.relative.auc(),
            pa_pck_150: self.aligned.pck(PCK_THRESHOLD_M),
            pa_auc: self.aligned.auc(),
        }
    }
}

/// A view or a capture, and its errors.
pub type Row = (String, Errors);

/// The parts of an evaluation that have a row of their own.
pub enum Rows {
    /// None: two files.
    None,
    /// The views of one capture.
    Views(Vec<Row>),
    /// Captures, and those of the truth that nothing was predicted for.
    Captures(Vec<Row>, Vec<String>),
}

/// Means over frames and joints, or of such means over captures.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Measures {
    /// F, of all captures together.
    pub frames: usize,
    /// J.
    pub joints: usize,
    /// Eq. 2.7, without any alignment.
    pub error_mm: f64,
    /// The same relative to the root.
    pub mpjpe_mm: f64,
    /// The same after Procrustes.
    pub pa_mpjpe_mm: f64,
    /// Per cent of joints relative to the root within 150 mm.
    pub pck_150: f64,
    /// Area under that curve, per cent.
    pub auc: f64,
    /// PCK@150 after Procrustes.
    pub pa_pck_150: f64,
    /// AUC after Procrustes.
    pub pa_auc: f64,
}

impl Measures {
    /// The heads of [`Measures::cells`].
    pub const HEAD: [&str; 7] =
        ["eq. 2.7 mm", "MPJPE mm", "PA-MPJPE mm", "PCK@150 %", "AUC %", "PA PCK@150 %", "PA AUC %"];

    /// The numbers as a table prints them.
    pub fn cells(&self) -> Vec<String> {
        self.values().map(|x| format!("{x:.1}")).into()
    }

    fn values(&self) -> [f64; 7] {
        let Measures { error_mm, mpjpe_mm, pa_mpjpe_mm, pck_150, auc, pa_pck_150, pa_auc, .. } = *self;
        [error_mm, mpjpe_mm, pa_mpjpe_mm, pck_150, auc, pa_pck_150, pa_auc]
    }

    /// A figure of each for all, as their mean or median.
    ///
    /// # Panics
    /// If there are none.
    pub fn over(all: &[Measures], figure: impl Fn(&mut [f64]) -> f64) -> Measures {
        let of = |k: usize| figure(&mut all.iter().map(|m| m.values()[k]).collect::<Vec<_>>());
        Measures {
            frames: all.iter().map(|m| m.frames).sum(),
            joints: all[0].joints,
            error_mm: of(0),
            mpjpe_mm: of(1),
            pa_mpjpe_mm: of(2),
            pck_150: of(3),
            auc: of(4),
            pa_pck_150: of(5),
            pa_auc: of(6),
        }
    }
}

/// The mean; not a number of none.
pub fn mean(values: &mut [f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

/// The value in the middle, or between the two there.
///
/// # Panics
/// If there are none.
pub fn median(values: &mut [f64]) -> f64 {
    values.sort_by(f64::total_cmp);
    let n = values.len();
    0.5 * (values[(n - 1) / 2] + values[n / 2])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn medians_lie_in_the_middle() {
        assert_eq!((median(&mut [5.0, 1.0, 9.0]), median(&mut [4.0, 1.0, 2.0, 100.0])), (5.0, 3.0));
        assert_eq!(mean(&mut [4.0, 1.0, 2.0, 100.0]), 26.75);
    }

    #[test]
    fn figures_over_captures_are_of_each_column_by_itself() {
        let one = Measures {
            frames: 4,
            joints: 24,
            error_mm: 1.0,
            mpjpe_mm: 2.0,
            pa_mpjpe_mm: 3.0,
            pck_150: 4.0,
            auc: 5.0,
            pa_pck_150: 6.0,
            pa_auc: 7.0,
        };
        let all = [one, Measures { mpjpe_mm: 20.0, ..one }, Measures { mpjpe_mm: 5.0, pa_auc: 1.0, ..one }];
        let expected = Measures { frames: 12, mpjpe_mm: 9.0, pa_auc: 5.0, ..one };
        assert_eq!(Measures::over(&all, mean), expected);
        assert_eq!(Measures::over(&all, median), Measures { frames: 12, mpjpe_mm: 5.0, ..one });
    }
}
