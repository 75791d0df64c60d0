//! Laws.

mod body;
mod least_squares;
mod nn;
mod rotation;
mod silhouette;
mod surface;
