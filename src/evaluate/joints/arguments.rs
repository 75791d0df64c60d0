//! What the command line says about joints.

use std::cell::OnceCell;
use std::path::{Path, PathBuf};

use vitruvian_reference::body::BodyModel;
use vitruvian_reference::metric::joint_set::JointSet;

use super::array::{self, Sequence, Side};
use super::posed::{self, Regressor};
use crate::failure::{Failure, Result};
use crate::{body, chart};

/// How joints are read, compared and shown.
#[derive(Clone, Debug, clap::Args)]
#[command(next_help_heading = "Joints")]
pub struct Arguments {
    /// Compare the joints of this set alone (both sides must have them)
    #[arg(long, value_enum, value_name = "SET")]
    joints: Option<Set>,
    /// The order of the predicted joints, where their number does not say it
    #[arg(long, value_enum, value_name = "SET")]
    predicted_joints: Option<Set>,
    /// The order of the true joints, where their number does not say it
    #[arg(long, value_enum, value_name = "SET")]
    truth_joints: Option<Set>,
    /// The point that joints are relative to (MPJPE, PCK, AUC); without it the pelvis, or the middle of the hips where a side
    /// has no pelvis
    #[arg(long, value_enum)]
    root: Option<RootChoice>,
    /// Regress the joints from posed vertices with this matrix [J, V] (.npy, .npz), as J_regressor_h36m.npy for Human3.6M's 17
    #[arg(long, value_name = "FILE")]
    regressor: Option<PathBuf>,
    /// Compare results of `fit` in each camera's axes, as those of `regress` always are
    #[arg(long)]
    pub per_view: bool,
    /// Print a row for every joint
    #[arg(long)]
    pub per_joint: bool,
    /// Draw PCK over its threshold, a line for each PREDICTED (.svg, .png)
    #[arg(long, value_name = "FILE")]
    pub curve: Option<PathBuf>,
    /// The name of a PREDICTED in tables and the curve; once for each, in their order
    #[arg(long = "label", value_name = "NAME")]
    labels: Vec<String>,
}

/// A named order of joints, as a word.
#[derive(Clone, Copy, Debug, clap::ValueEnum)]
enum Set {
    /// SMPL's 24 joints
    Smpl24,
    /// The 22 that SMPL, SMPL-H and SMPL-X share
    Smpl22,
    /// Human3.6M's 17, left leg first, as J_regressor_h36m gives them
    H36m17,
    /// The same 17 in LSP's order (SPIN's J17)
    J17,
    /// LSP's 14 (SPIN's J14)
    Lsp14,
    /// The 17 of MPI-INF-3DHP's test set
    Mpi17,
    /// The 24 of SPIN's files of truth
    J24,
    /// SPIN's 49
    Spin49,
}

impl From<Set> for JointSet {
    fn from(set: Set) -> JointSet {
        match set {
            Set::Smpl24 => JointSet::Smpl24,
            Set::Smpl22 => JointSet::Smpl22,
            Set::H36m17 => JointSet::H36m17,
            Set::J17 => JointSet::J17,
            Set::Lsp14 => JointSet::Lsp14,
            Set::Mpi17 => JointSet::Mpi17,
            Set::J24 => JointSet::J24,
            Set::Spin49 => JointSet::Spin49,
        }
    }
}

/// The word for a set.
pub fn word(set: JointSet) -> &'static str {
    match set {
        JointSet::Smpl24 => "smpl24",
        JointSet::Smpl22 => "smpl22",
        JointSet::H36m17 => "h36m17",
        JointSet::J17 => "j17",
        JointSet::Lsp14 => "lsp14",
        JointSet::Mpi17 => "mpi17",
        JointSet::J24 => "j24",
        JointSet::Spin49 => "spin49",
    }
}

/// What joints are relative to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, clap::ValueEnum)]
pub enum RootChoice {
    /// The pelvis of each side
    Pelvis,
    /// The middle of the hips
    MidHip,
    /// Nothing: each side as it stands in its file
    Origin,
}

/// The arguments with the files that they name.
pub struct Choices<'a> {
    body_path: Option<&'a Path>,
    body: OnceCell<BodyModel>,
    regressor: Option<Regressor>,
    predicted: Option<JointSet>,
    truth: Option<JointSet>,
    /// The joints to compare.
    pub wanted: Option<JointSet>,
    /// What they are relative to.
    pub root: Option<RootChoice>,
    /// Whether results of `fit` are seen from each camera.
    pub per_view: bool,
    /// A name for each prediction.
    pub labels: Vec<String>,
}

impl<'a> Choices<'a> {
    /// Checks what can be checked before any work is done.
    pub fn new(body: Option<&'a Path>, arguments: &Arguments, predicted: &[PathBuf]) -> Result<Choices<'a>> {
        if let Some(path) = &arguments.curve {
            chart::check_path(path)?;
            if predicted.len() > chart::MAX_SERIES {
                let message =
                    format!("--curve: {} lines; {} is the most", predicted.len(), chart::MAX_SERIES);
                return Err(Failure::Usage(message));
            }
        }
        let (labels, files) = (arguments.labels.len(), predicted.len());
        if labels != 0 && labels != files {
            let message = format!("--label: {labels} names for {files} predictions; give one for each");
            return Err(Failure::Usage(message));
        }
        let own =
            |path: &PathBuf| path.file_stem().unwrap_or(path.as_os_str()).to_string_lossy().into_owned();
        let labels = if labels == 0 { predicted.iter().map(own).collect() } else { arguments.labels.clone() };
        Ok(Choices {
            body_path: body,
            body: OnceCell::new(),
            regressor: arguments.regressor.as_deref().map(posed::read_regressor).transpose()?,
            predicted: arguments.predicted_joints.map(JointSet::from),
            truth: arguments.truth_joints.map(JointSet::from),
            wanted: arguments.joints.map(JointSet::from),
            root: arguments.root,
            per_view: arguments.per_view,
            labels,
        })
    }

    /// The joints of a file: regressed or posed from its parameters, or as they stand in it.
    pub fn read(&self, path: &Path, side: Side) -> Result<Sequence> {
        let given = match side {
            Side::Predicted => self.predicted,
            Side::Truth => self.truth,
        };
        let sequence = match &self.regressor {
            None => match array::read(path, side)? {
                Some(sequence) => sequence,
                None => posed::read(path, self.body()?, None)?,
            },
            Some(regressor) => posed::read(path, self.body()?, Some(regressor))?,
        };
        sequence.named(given)
    }

    /// The name of the file of a result's folder that this reads.
    pub fn file_of_result(&self) -> &'static str {
        if self.regressor.is_some() { "params.npz" } else { "joints.npz" }
    }

    fn body(&self) -> Result<&BodyModel> {
        if let Some(body) = self.body.get() {
            return Ok(body);
        }
        let body = body::load(self.body_path)?;
        Ok(self.body.get_or_init(|| body))
    }
}
