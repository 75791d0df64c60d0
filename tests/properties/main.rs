//! Laws.

mod bodies;
mod body;
mod body_derivative;
mod body_layouts;
mod fitting;
mod joint_metrics;
mod least_squares;
mod mv_smplify;
mod nn;
mod plain_body;
mod rotation;
mod silhouette;
mod surface;
