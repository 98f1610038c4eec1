//! What may change in the light of one window.

use crate::illumination::Illumination;

/// What of the light is unknown in one window.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Light {
    pub(crate) gain: bool,
    pub(crate) offset: bool,
    /// Whether the offset varies linearly over the window.
    pub(crate) tilt: bool,
}

impl Light {
    pub(crate) const STEADY: Self = Self {
        gain: false,
        offset: false,
        tilt: false,
    };
    pub(crate) const OFFSET: Self = Self {
        offset: true,
        ..Self::STEADY
    };
    pub(crate) const GAIN_OFFSET: Self = Self {
        gain: true,
        ..Self::OFFSET
    };
    pub(crate) const TILTED_OFFSET: Self = Self {
        tilt: true,
        ..Self::OFFSET
    };

    pub(crate) fn of(illumination: Illumination) -> Self {
        match illumination {
            Illumination::None => Self::STEADY,
            Illumination::Offset => Self::OFFSET,
            Illumination::GainOffset => Self::GAIN_OFFSET,
        }
    }

    pub(crate) fn has_gain(self) -> bool {
        self.gain
    }

    pub(crate) fn has_offset(self) -> bool {
        self.offset
    }

    /// Whether anything of it may change.
    pub(crate) fn changes(self) -> bool {
        self.gain || self.offset
    }

    pub(crate) fn has_tilt(self) -> bool {
        self.tilt
    }

    /// The same, with an offset that varies over the window where the model has a gain.
    pub(crate) fn with_tilt(self) -> Self {
        Self {
            tilt: self.gain,
            ..self
        }
    }
}
