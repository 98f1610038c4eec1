//! Points whose surroundings turn, grow or shear too much for a displacement alone.
//!
//! `docs/explanation/algorithms.md`, section "Windows that turn, grow and shear".

mod align;
mod attempt;
mod candidates;
mod confirm;
mod deformed;
mod factor;
mod fit;
mod meeting;
mod propagate;
mod sample;
mod search;
mod sums;
mod template;
mod warp;

pub(super) use deformed::Deformed;
pub(super) use warp::Warp;
