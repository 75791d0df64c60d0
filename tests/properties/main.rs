//! Laws.

mod nn;
mod surface;
