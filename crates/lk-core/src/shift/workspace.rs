//! What a call needs, kept by each thread for the next: a window of 60 x 60 pixels is measured in less time than its
//! memory takes to be asked for.

use std::cell::Cell;

use super::inputs::Inputs;
use super::{affine, evaluate, start};
use crate::error::{Error, Result};

/// Pixels of both frames up to which the memory is kept, about 12 bytes for each.
const KEPT_PIXELS: usize = 1 << 21;

/// The planes of both frames, and what the search and the evaluations need.
#[derive(Debug, Default)]
pub(super) struct Workspace {
    pub(super) inputs: Inputs,
    pub(super) start: start::Workspace,
    pub(super) evaluation: evaluate::Workspace,
    pub(super) clusters: affine::Workspace,
}

thread_local! {
    static WORKSPACE: Cell<Option<Box<Workspace>>> = const { Cell::new(None) };
}

/// Run `work` with the memory of the last call.
pub(super) fn with_workspace<R>(work: impl FnOnce(&mut Workspace) -> Result<R>) -> Result<R> {
    let mut workspace = WORKSPACE.take().unwrap_or_default();
    let result = work(&mut workspace);
    let lacking = result.as_ref().is_err_and(Error::is_memory);
    if !lacking && workspace.inputs.pixels() <= KEPT_PIXELS {
        WORKSPACE.set(Some(workspace));
    }
    result
}
