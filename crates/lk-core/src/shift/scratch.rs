//! What a call needs, kept by each thread for the next: a window of 60 x 60 pixels is measured in less time than its
//! memory takes to be asked for.

use std::cell::Cell;

use super::inputs::Inputs;
use super::refine::Workspace;
use super::start;
use crate::error::{Error, Result};

/// Pixels of both frames up to which the memory is kept, about 12 bytes for each.
const KEPT_PIXELS: usize = 1 << 21;

/// The planes of both frames, and what the search and the looks need.
#[derive(Debug, Default)]
pub(super) struct Scratch {
    pub(super) inputs: Inputs,
    pub(super) start: start::Scratch,
    pub(super) workspace: Workspace,
}

thread_local! {
    static SCRATCH: Cell<Option<Box<Scratch>>> = const { Cell::new(None) };
}

/// Run `work` with the memory of the last call.
pub(super) fn with_scratch<R>(work: impl FnOnce(&mut Scratch) -> Result<R>) -> Result<R> {
    let mut scratch = SCRATCH.take().unwrap_or_default();
    let result = work(&mut scratch);
    let lacking = result.as_ref().is_err_and(Error::is_memory);
    if !lacking && scratch.inputs.pixels() <= KEPT_PIXELS {
        SCRATCH.set(Some(scratch));
    }
    result
}
