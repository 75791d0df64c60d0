//! Laws.

mod surface;
