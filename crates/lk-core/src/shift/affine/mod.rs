//! Windows that deform: the displacement of the centre and its gradient, with their joint covariance.
//!
//! Each pixel of `prev` is compared with one of `next`, whole pixels away; both are moved towards each other by half of
//! what is left, as in the rest of this module, so that noise does not bias the result. What is left differs from pixel
//! to pixel: `w(m) = d + G (m - c)`, with m halfway between the two pixels and c halfway between the centres.
//!
//! `docs/explanation/algorithms.md`, section "Windows that deform".

mod clusters;
mod curvature;
mod iteration;
#[cfg(test)]
mod reference;
mod solution;
mod solve;
mod stripe;
mod sums;
mod view;

pub(super) use clusters::Workspace;
pub(super) use solution::Affine;
