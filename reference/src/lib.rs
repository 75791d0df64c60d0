//! The systems of Li 2021, "3D Human Pose and Shape Estimation Based on Parametric Model and Deep Learning", written to
//! be read and trusted.
//!
//! # Contract
//! Clear, slow where speed would cost clarity, exact: f64 throughout, the loops of the definitions, the symbols of the
//! papers. No dependencies, no unsafe code, no threads, no files, no clock, no global state: a function of the same
//! arguments gives the same bits. Two questions that this raises:
//!
//! *Why does this panic?* A wrong shape is a mistake of the caller, and an oracle that limped on would judge others by a
//! wrong number. Every such panic is documented and shows both shapes. Data without an answer (a point behind a camera, a
//! singular system) is an `Option`.
//!
//! *Why is this not shared with the runtime?* An oracle used by its subject cannot judge it. The runtime has its own
//! marching cubes, voxelisation and sampling, in f32 and fast; f32 → f64 is exact, so all difference belongs to it.
//!
//! # Conventions
//! One alphabet for the whole house:
//!
//! | letter | counts | | letter | counts |
//! |---|---|---|---|---|
//! | N | views, or images of a batch | | V | vertices |
//! | C | channels | | F | faces |
//! | D, H, W | depth, height, width of a tensor | | J | joints |
//! | P | points; in a body model 9(J−1) pose features | | B | betas |
//!
//! * **Units**: metres, radians, pixels. Names end in `_m`, `_rad`, `_px` where two are possible.
//! * **World**: right-handed; the body's up is +Y, it faces +Z, its left is +X.
//! * **Camera**: x right, y down, z forward; X_c = R X + t.
//! * **Pixels**: continuous, origin at the image's top-left *corner*. Pixel (row i, column j) covers
//!   \[j, j+1) × \[i, i+1), its centre is (j+½, i+½); u = f_x X/Z + c_x.
//! * **Matrices** are row-major, `m[row][column]`, and act on columns.
//! * **Occupancy**: 1 inside, 0 outside, level ½. The thesis writes the opposite in eq. 5.1 and 6.1 (erratum E17).
//! * **Meshes**: triangles, counter-clockwise seen from outside.
//! * **Volumes**: `values[(i·n_y + j)·n_z + k]`, axis 0 is x. The tensor of a voxel network is the other way round,
//!   \[1, 1, z, y, x\], because grid sampling's first coordinate runs along the last axis.
//! * **Images** enter networks as N×C×H×W, RGB.
//!
//! Where the thesis contradicts itself the reading taken stands beside the code with the erratum's number; the list is
//! `docs/errata.md`.
//!
//! # From the thesis to the modules
//!
//! | Li 2021 | equations | module |
//! |---|---|---|
//! | ch. 2, body model | – (Loper et al. 2015, eq. 1–9) | [`body`], [`rotation`] |
//! | ch. 2, projection | 2.3 (erratum E7) | [`camera::Pinhole`] |
//! | ch. 2 and 3, minimisation by Powell's dogleg | – (chumpy's rules) | [`least_squares`] |
//! | ch. 2, loss | 2.4 (errata E2, E3) | [`robust_loss`] |
//! | ch. 2 and ch. 3 §3.2, pose, shape and cameras from joints | 2.1–2.6, 3.1–3.4, table 3.1 (errata E1–E8, E13) | [`fitting`] |
//! | ch. 2, error of joints | 2.7 | [`metric::joints`] |
//! | ch. 3, un-posing | 3.6 (erratum E10) | [`body::unposing`] |
//! | ch. 3, rays and outlines | 3.5–3.8 | [`plucker`], [`silhouette`] |
//! | ch. 3, smoothness of offsets | 3.9 | [`surface::laplacian`] |
//! | ch. 3, shape from silhouettes | 3.5–3.11, table 3.1 (errata E9–E14d) | [`fitting::silhouette`] |
//! | ch. 3, overlap of silhouettes | – | [`metric::silhouette`] |
//! | ch. 4, regressor | – (erratum E50) | [`network::regressor`] |
//! | ch. 4, training of the regressor | 4.1, 4.3–4.6 (errata E41–E43) | [`loss`] |
//! | ch. 4 §3.3, one body from what is regressed of each view | 4.2 (errata E44–E46, E51) | [`fitting::mv_smplify`], [`fitting::camera_translation`] |
//! | ch. 4, camera and rotations of the regressor | – | [`camera::WeakPerspective`], [`rotation::from_six_d`] |
//! | ch. 4, MPJPE, reconstruction error, PCK, AUC | – | [`metric::joint_errors`], [`metric::pck`], [`metric::procrustes`] |
//! | ch. 5, MF-PIFu | 5.1–5.3 | [`network::mf_pifu`] |
//! | ch. 5, training | 5.4 | [`loss::mean_squared_error`] |
//! | ch. 5 and 6, meshing, voxels, samples | – | [`surface`] |
//! | ch. 6, VSR | 6.7–6.9 | [`network::vsr`] |
//! | ch. 6, training | 6.6, 6.10 | [`loss`] |
//! | ch. 5 and 6, P2S, Chamfer-L2, IoU | – | [`metric::surface`] |
//! | the operators of the networks | – (the ONNX specification) | [`nn`] |
//!
//! # Reading order
//! [`rotation`], then [`body`] (the model is six short files; [`body::mannequin()`] is a complete one), [`camera`],
//! [`least_squares`] with [`fitting`], then [`nn`] with [`network`], and [`surface`] with [`metric`]. [`linalg`] can wait until a name in it is met.
//!
//! ```
//! use vitruvian_reference::{body::mannequin, camera::Pinhole};
//!
//! let body = mannequin();
//! let mut pose = [0.0; 72];
//! pose[3 * 18 + 1] = -1.5; // bend the left elbow: forward, about the body's up axis
//! let posed = body.pose(&pose, &[], [0.0; 3]);
//!
//! // 3 m in front of it, upright: the camera's y points down.
//! let mut camera = Pinhole::ideal(900.0, [320.0, 240.0]);
//! camera.rotation = [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, -1.0]];
//! camera.translation = [0.0, 0.0, 3.0];
//! let [_, head_row] = camera.project(posed.joints[15]).expect("in front");
//! let [_, foot_row] = camera.project(posed.joints[10]).expect("in front");
//! assert!(head_row < foot_row);
//! ```

pub mod body;
pub mod camera;
pub mod fitting;
pub mod least_squares;
pub mod linalg;
pub mod loss;
pub mod metric;
pub mod network;
pub mod nn;
pub mod plucker;
pub mod robust_loss;
pub mod rotation;
pub mod silhouette;
pub mod surface;
