//! The levels of a CPU, and which of them a call uses.

use std::sync::OnceLock;

use crate::error::{Error, Result};

/// A set of vector instructions. Results do not depend on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[non_exhaustive]
pub enum SimdLevel {
    /// What the compiler makes of plain code for every CPU of the architecture, with SSE2 on x86-64.
    Baseline,
    /// NEON (aarch64): every CPU has it.
    Neon,
    /// AVX2 (x86-64).
    Avx2,
    /// AVX-512 F, BW, DQ and VL (x86-64).
    Avx512,
}

impl SimdLevel {
    /// The best level of this CPU, or less where the environment variable `RSFLOW_CPU` says
    /// `baseline`, `neon`, `avx2` or `avx512`. Read once; where it says anything else, every call that follows it fails.
    #[must_use]
    pub fn detected() -> Self {
        Self::of_environment().unwrap_or_else(|_| Self::of_this_cpu())
    }

    /// What `RSFLOW_CPU` says, the best level of this CPU if it is not set or empty.
    ///
    /// # Errors
    ///
    /// [`Error::Option`] where it says something that is no level.
    pub fn of_environment() -> Result<Self> {
        static SAID: OnceLock<Result<SimdLevel>> = OnceLock::new();
        SAID.get_or_init(|| match std::env::var_os("RSFLOW_CPU") {
            Some(name) if !name.is_empty() => Self::named(&name.to_string_lossy()),
            _ => Ok(Self::of_this_cpu()),
        })
        .clone()
    }

    /// The level of this name, or the best below it that this CPU has.
    fn named(name: &str) -> Result<Self> {
        Self::ALL
            .into_iter()
            .find(|level| level.name() == name)
            .map(Self::here)
            .ok_or_else(|| {
                let names = Self::ALL.map(|level| format!("{:?}", level.name()));
                let expected = format!("one of {}, or nothing", names.join(", "));
                Error::option("RSFLOW_CPU", format!("{name:?}"), expected)
            })
    }

    const ALL: [Self; 4] = [Self::Baseline, Self::Neon, Self::Avx2, Self::Avx512];

    /// Those of this architecture.
    const LADDER: &[Self] = if cfg!(target_arch = "x86_64") {
        &[Self::Baseline, Self::Avx2, Self::Avx512]
    } else if cfg!(all(target_arch = "aarch64", target_endian = "little")) {
        &[Self::Baseline, Self::Neon]
    } else {
        &[Self::Baseline]
    };

    /// This level, or the best below it that this CPU has.
    pub(crate) fn here(self) -> Self {
        let most = self.min(Self::of_this_cpu());
        let found = Self::LADDER.iter().rev().find(|level| **level <= most);
        found.copied().unwrap_or(Self::Baseline)
    }

    /// Every level that this CPU can run, the plainest first.
    #[must_use]
    pub fn available() -> Vec<Self> {
        let best = Self::of_this_cpu();
        let here = Self::LADDER.iter().copied();
        here.filter(|level| *level <= best).collect()
    }

    /// The level's name, as `RSFLOW_CPU` takes it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Baseline => "baseline",
            Self::Neon => "neon",
            Self::Avx2 => "avx2",
            Self::Avx512 => "avx512",
        }
    }

    /// Asked by every dispatch: found once.
    #[inline]
    pub(super) fn of_this_cpu() -> Self {
        static FOUND: OnceLock<SimdLevel> = OnceLock::new();
        *FOUND.get_or_init(Self::detect)
    }

    fn detect() -> Self {
        #[cfg(target_arch = "x86_64")]
        {
            let avx2 = is_x86_feature_detected!("avx2");
            let avx512 = is_x86_feature_detected!("avx512f")
                && is_x86_feature_detected!("avx512bw")
                && is_x86_feature_detected!("avx512dq")
                && is_x86_feature_detected!("avx512vl");
            if avx2 && avx512 {
                return Self::Avx512;
            }
            if avx2 {
                return Self::Avx2;
            }
            Self::Baseline
        }
        #[cfg(not(target_arch = "x86_64"))]
        Self::LADDER[Self::LADDER.len() - 1]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_ordered_and_named() {
        let levels = SimdLevel::available();
        assert_eq!(levels[0], SimdLevel::Baseline);
        assert!(levels.windows(2).all(|pair| pair[0] < pair[1]));
        assert!(levels.contains(&SimdLevel::detected()));
        assert_eq!(SimdLevel::Avx2.name(), "avx2");
    }

    #[test]
    fn a_level_has_one_of_the_names_or_is_an_error() {
        for level in SimdLevel::available() {
            assert_eq!(SimdLevel::named(level.name()), Ok(level));
        }
        let error = SimdLevel::named("avx1024").unwrap_err();
        let want = "RSFLOW_CPU: got \"avx1024\", expected one of \"baseline\", \"neon\", \"avx2\", \"avx512\", or nothing";
        assert_eq!(error.to_string(), want);
    }

    #[test]
    fn a_level_that_this_cpu_lacks_is_the_best_below_it() {
        let best = SimdLevel::available()[SimdLevel::available().len() - 1];
        assert_eq!(SimdLevel::named("avx512"), Ok(best));
        let want = if cfg!(all(target_arch = "aarch64", target_endian = "little")) {
            SimdLevel::Neon
        } else {
            SimdLevel::Baseline
        };
        assert_eq!(SimdLevel::named("neon"), Ok(want));
        assert_eq!(SimdLevel::Neon.here(), want);
    }
}
