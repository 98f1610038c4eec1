//! Row buffers that a thread keeps from band to band and from call to call.

use std::cell::RefCell;

use crate::error::Result;
use crate::memory::resize;

thread_local! {
    static MEMORY: RefCell<Vec<f32>> = const { RefCell::new(Vec::new()) };
}

/// Call `work` with `size` elements of unspecified content that belong to this thread.
///
/// `work` must not call it again.
///
/// # Errors
///
/// [`Error::Memory`](crate::Error::Memory).
pub(crate) fn with_scratch<R>(size: usize, work: impl FnOnce(&mut [f32]) -> R) -> Result<R> {
    MEMORY.with_borrow_mut(|memory| {
        if memory.len() < size {
            resize("rows", memory, size, 0.0)?;
        }
        Ok(work(&mut memory[..size]))
    })
}
