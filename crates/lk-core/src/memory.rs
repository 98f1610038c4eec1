//! Memory whose size comes from a frame or from an argument: where there is none, the call fails and the process lives.
//!
//! Nothing of such a size is allocated in another way: `vec!`, `collect`, `clone` and a `push` without room end the
//! process where memory ends.

use zerocopy::FromZeros;

use crate::error::{Error, Result};

fn lacking<T>(what: &'static str, count: usize) -> Error {
    Error::Memory {
        what,
        bytes: count.saturating_mul(size_of::<T>()),
    }
}

/// Make room for `count` elements in all.
pub(crate) fn reserve<T>(what: &'static str, memory: &mut Vec<T>, count: usize) -> Result<()> {
    memory
        .try_reserve_exact(count.saturating_sub(memory.len()))
        .map_err(|_| lacking::<T>(what, count))
}

/// Make room for `more` elements after those that are there, with some to spare: for memory that grows step by step.
pub(crate) fn reserve_more<T>(what: &'static str, memory: &mut Vec<T>, more: usize) -> Result<()> {
    memory
        .try_reserve(more)
        .map_err(|_| lacking::<T>(what, memory.len().saturating_add(more)))
}

/// Take a length; what is new is `value`.
pub(crate) fn resize<T: Clone>(
    what: &'static str,
    memory: &mut Vec<T>,
    count: usize,
    value: T,
) -> Result<()> {
    reserve(what, memory, count)?;
    memory.resize(count, value);
    Ok(())
}

/// Replace the content by `values`.
pub(crate) fn replace<T>(
    what: &'static str,
    memory: &mut Vec<T>,
    values: impl ExactSizeIterator<Item = T>,
) -> Result<()> {
    memory.clear();
    reserve(what, memory, values.len())?;
    memory.extend(values);
    Ok(())
}

/// Zeros, which cost nothing before they are touched.
pub(crate) fn zeros<T: FromZeros>(what: &'static str, count: usize) -> Result<Vec<T>> {
    T::new_vec_zeroed(count).map_err(|_| lacking::<T>(what, count))
}

/// [`zeros`] for those who hand over memory.
///
/// # Errors
///
/// [`Error::Memory`].
#[doc(hidden)]
pub fn zero_floats(what: &'static str, count: usize) -> Result<Vec<f32>> {
    zeros(what, count)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_no_memory_holds_is_an_error() {
        let mut bytes = vec![1u8, 2];
        for count in [usize::MAX / 2, usize::MAX] {
            for found in [
                reserve("bytes", &mut bytes, count),
                reserve_more("bytes", &mut bytes, count),
                resize("bytes", &mut bytes, count, 0),
                zeros::<u64>("bytes", count).map(drop),
            ] {
                assert!(matches!(found, Err(Error::Memory { what: "bytes", .. })));
            }
        }
        assert_eq!(bytes, [1, 2]);
        let error = resize("numbers", &mut Vec::new(), usize::MAX / 16, 0u64).unwrap_err();
        assert_eq!(
            error.to_string(),
            "out of memory: numbers take 9223372036854775800 bytes"
        );
    }

    #[test]
    fn room_is_made_once() {
        let mut numbers = Vec::new();
        reserve("numbers", &mut numbers, 10).unwrap();
        let room = numbers.capacity();
        resize("numbers", &mut numbers, 10, 7u32).unwrap();
        replace("numbers", &mut numbers, [1, 2].into_iter()).unwrap();
        assert_eq!((numbers.capacity(), &numbers[..]), (room, &[1, 2][..]));
        assert_eq!(zeros::<f32>("zeros", 3).unwrap(), [0.0; 3]);
    }
}
