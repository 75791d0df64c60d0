//! What is judged, written once and run by tests, by the sweep and by the command.
//!
//! | file | judges |
//! |---|---|
//! | [`operators`] | every operator of the networks on random problems |
//! | [`faults`] | the judge itself: planted faults must be seen |

pub mod operators;
