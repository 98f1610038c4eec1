//! What came and stopped before anything was seen behind it: it stays as it was.

use crate::error::Result;
use crate::memory::resize;

use super::morphology::Size;
use super::segmenter::Segmenter;

/// A region that changes in less than this share of it has stopped.
pub(super) const STOPPED: f64 = 0.02;
/// What moved for so many frames in the mean over its pixels is a thing: what a fast one uncovers did not.
const LIVED: f64 = 3.0;
const MOST_LIVED: u8 = 15;
/// Every so manyth frame its outline is trimmed all the same: what is none becomes less.
const TRIMMED: u64 = 8;

impl Segmenter {
    /// Write what stopped of what moved in the frame before, and of that what is held as it was.
    pub(super) fn find_stopped(&mut self, size: Size) -> Result<()> {
        let (state, work) = (&mut self.state, &mut self.work);
        resize("masks", &mut work.held, size.0 * size.1, 0)?;
        work.runs.label(&state.foreground, size)?;
        work.runs.sum_bytes(&work.changed, &mut work.sums)?;
        let (regions, sums) = (work.runs.regions(), &work.sums);
        let stopped = |label: usize| sums[label] as f64 <= STOPPED * f64::from(regions[label].area);
        work.runs.draw(stopped, &mut work.spare);
        let moved = state.foreground.iter().zip(&work.spare);
        for (lived, (foreground, stopped)) in state.lived.iter_mut().zip(moved) {
            *lived = (*lived + (1 - stopped)).min(MOST_LIVED) * foreground;
        }
        if state.frames.is_multiple_of(TRIMMED) {
            work.held.fill(0);
            return Ok(());
        }
        work.runs.sum_bytes(&state.lived, &mut work.lives)?;
        let lives = &work.lives;
        let held = |label: usize| {
            stopped(label) && lives[label] as f64 >= LIVED * f64::from(regions[label].area)
        };
        work.runs.draw(held, &mut work.held);
        // Leaves rest for a moment where they turn.
        for (held, flutters) in work.held.iter_mut().zip(&state.flutter.mask) {
            *held &= 1 - flutters;
        }
        Ok(())
    }
}
