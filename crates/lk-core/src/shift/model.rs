//! What is known, or taken to be, when sums are solved.

use super::filters::NoiseGain;
use super::gain::KnownGain;
use super::gram::Light;

/// Over what part of the window one model of the light holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum LightScope {
    /// All of it.
    Window,
    /// Blocks of tiles, as large as the tiles allow.
    Tiles,
    /// The blocks of the last evaluation.
    HeldTiles,
}

/// What is known, or taken to be, when the sums are solved.
#[derive(Debug, Clone, Copy)]
pub(super) struct Model {
    pub(super) light: Light,
    pub(super) scope: LightScope,
    /// Whether what either frame shows is known to be in both.
    pub(super) common_structure: bool,
    pub(super) noise: NoiseGain,
    /// The least variance of a difference: grey levels are rounded.
    pub(super) floor: f64,
    /// What the differences are rid of.
    pub(super) known: KnownGain,
}
