//! Pictures of meshes, drawn on the processor alone, and what stands around them on a page.

pub mod color_map;
pub mod contact_sheet;
pub mod overlay;
pub mod rasterizer;
pub mod text;
pub mod turntable;

pub use color_map::{color_bar, heat, viridis};
pub use contact_sheet::{Row, contact_sheet};
pub use overlay::overlay;
pub use rasterizer::{Light, Picture, render, render_before};
pub use turntable::{CLAY, Turntable, preview};
