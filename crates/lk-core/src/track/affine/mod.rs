//! Points whose surroundings turn, grow or shear too much for a displacement alone.

mod align;
mod attempt;
mod candidates;
mod fit;
mod propagate;
mod sample;
mod search;
mod warp;

pub(super) use propagate::Deformed;
pub(super) use warp::Warp;
