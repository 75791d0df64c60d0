//! Dense factorisations.
