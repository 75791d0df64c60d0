//! `vitruvian synthesize`: captures of random people, with the truth beside them.
