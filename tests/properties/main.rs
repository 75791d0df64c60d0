//! Laws.

mod body;
mod nn;
mod rotation;
mod surface;
