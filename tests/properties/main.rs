//! Laws.

mod body;
mod nn;
mod rotation;
mod silhouette;
mod surface;
