//! What the options of all estimators share: setters by value, names of enumerations, and the check of a value.

use std::fmt::Display;

use crate::error::{Error, Result};

/// Setters of options, by value: each replaces the field of its name.
macro_rules! setters {
    ($($(#[$attribute:meta])* $name:ident($value:ident: $type:ty);)+) => {$(
        $(#[$attribute])*
        #[must_use]
        pub fn $name(mut self, $value: $type) -> Self {
            self.$name = $value;
            self
        }
    )+};
}
pub(crate) use setters;

/// The names of an enumeration's values, in both directions; `$option` is what sets it.
macro_rules! names {
    ($type:ident, $option:literal: $($value:ident $name:literal),+ $(,)?) => {
        impl $type {
            /// The name used in Python and on the command line.
            #[must_use]
            pub fn name(self) -> &'static str {
                match self {
                    $(Self::$value => $name,)+
                }
            }
        }

        impl std::fmt::Display for $type {
            fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                formatter.write_str(self.name())
            }
        }

        impl std::str::FromStr for $type {
            type Err = $crate::error::Error;

            fn from_str(name: &str) -> $crate::error::Result<Self> {
                match name {
                    $($name => Ok(Self::$value),)+
                    _ => Err($crate::options::unknown($option, name, &[$($name),+])),
                }
            }
        }
    };
}
pub(crate) use names;

/// The error for a name that is none of `names`.
pub(crate) fn unknown(option: &'static str, name: &str, names: &[&str]) -> Error {
    let quoted: Vec<String> = names.iter().map(|name| format!("{name:?}")).collect();
    let expected = match quoted.split_last() {
        Some((last, others)) if !others.is_empty() => format!("{} or {last}", others.join(", ")),
        _ => quoted.join(""),
    };
    Error::option(option, format!("{name:?}"), expected)
}

/// Hold an option to what it allows.
///
/// # Errors
///
/// [`Error::Option`] unless `holds`.
pub(crate) fn expect_option(
    holds: bool,
    name: &'static str,
    got: impl Display,
    expected: impl Display,
) -> Result<()> {
    if holds {
        return Ok(());
    }
    Err(Error::option(name, got, expected.to_string()))
}

/// Whether a number of pixels, where one is given, is positive and finite.
pub(crate) fn is_positive(pixels: Option<f32>) -> bool {
    pixels.is_none_or(|pixels| pixels > 0.0 && pixels.is_finite())
}

#[cfg(test)]
mod tests {
    use super::unknown;

    #[test]
    fn an_unknown_name_is_told_beside_those_that_are_known() {
        let error = unknown("preset", "slow", &["fast", "balanced", "accurate"]);
        let want = "preset: got \"slow\", expected \"fast\", \"balanced\" or \"accurate\"";
        assert_eq!(error.to_string(), want);
    }
}
