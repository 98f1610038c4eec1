//! The lighting model: what may change between two frames besides motion.
//!
//! `docs/algorithms.md`, section "Light".

use std::fmt;
use std::str::FromStr;

use crate::error::Error;

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
pub enum Illumination {
    /// Not at all: `next = prev`.
    None,
    /// By an offset: `next = prev + offset`.
    Offset,
    /// By a gain and an offset: `next = gain * prev + offset`.
    #[default]
    GainOffset,
}

impl Illumination {
    /// The name used in Python and on the command line.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::None => "none",
            Self::Offset => "offset",
            Self::GainOffset => "gain_offset",
        }
    }
}

impl fmt::Display for Illumination {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        formatter.write_str(self.name())
    }
}

impl FromStr for Illumination {
    type Err = Error;

    fn from_str(name: &str) -> Result<Self, Error> {
        [Self::None, Self::Offset, Self::GainOffset]
            .into_iter()
            .find(|model| model.name() == name)
            .ok_or_else(|| {
                Error::option(
                    "illumination",
                    format!("{name:?}"),
                    "\"none\", \"offset\" or \"gain_offset\"",
                )
            })
    }
}
