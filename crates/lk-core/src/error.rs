//! Errors: every message says what, where, got and expected.

/// What a misused call returns.
///
/// A point, window or frame that cannot be measured is not an error: it gets a status, NaN and infinite variance.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The size or shape of an input does not fit.
    #[error("{what}: got {got}, expected {expected}")]
    Shape {
        /// The input in question, by its argument name.
        what: &'static str,
        /// What was passed.
        got: String,
        /// What would have been accepted.
        expected: String,
    },
    /// An option is outside of what it allows.
    #[error("{name}: got {got}, expected {expected}")]
    Option {
        /// The option's name, the same as in Python and on the command line.
        name: &'static str,
        /// What was passed.
        got: String,
        /// What would have been accepted.
        expected: String,
    },
    /// The system has no memory for something whose size follows from a frame or an argument. Whatever was called can be
    /// called again, with less.
    #[error("out of memory: {what} take {bytes} bytes")]
    Memory {
        /// What was to be held there.
        what: &'static str,
        /// How much was asked for.
        bytes: usize,
    },
    /// The caller's cancel flag was raised while the call ran.
    #[error("cancelled by the caller")]
    Cancelled,
    /// The thread pool could not be started.
    #[error("could not start {threads} threads: {reason}")]
    Threads {
        /// How many threads were asked for.
        threads: usize,
        /// What the operating system said.
        reason: String,
    },
}

impl Error {
    /// Whether memory that is kept from call to call had better be given back.
    pub(crate) fn is_memory(&self) -> bool {
        matches!(self, Self::Memory { .. })
    }

    /// A [`Error::Shape`] from anything that can be written.
    pub fn shape(what: &'static str, got: impl Into<String>, expected: impl Into<String>) -> Self {
        Self::Shape {
            what,
            got: got.into(),
            expected: expected.into(),
        }
    }

    /// A [`Error::Option`] from anything that can be written.
    pub fn option(name: &'static str, got: impl ToString, expected: impl Into<String>) -> Self {
        Self::Option {
            name,
            got: got.to_string(),
            expected: expected.into(),
        }
    }
}

/// The result of every fallible function of this crate.
pub type Result<T> = std::result::Result<T, Error>;
