//! The lighting model: what may change between two frames besides motion.
//!
//! `docs/explanation/algorithms.md`, section "Light".

use crate::options::names;

/// How light may change from `prev` to `next`, within a window.
///
/// ```
/// use lk_core::Illumination;
///
/// assert_eq!("offset".parse::<Illumination>()?, Illumination::Offset);
/// assert_eq!(Illumination::default().to_string(), "gain_offset");
/// # Ok::<(), lk_core::Error>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
#[non_exhaustive]
pub enum Illumination {
    /// Not at all: `next = prev`.
    None,
    /// By an offset: `next = prev + offset`.
    Offset,
    /// By a gain and an offset: `next = gain * prev + offset`.
    #[default]
    GainOffset,
}

names!(Illumination, "illumination": None "none", Offset "offset", GainOffset "gain_offset");
