//! What moves in a frame, and what a segmenter learns from it.

use crate::error::Result;
use crate::execution::Execution;
use crate::memory::{replace, resize};

use super::change::{self, changed};
use super::difference::Compared;
use super::judge::{Asked, MEMORY};
use super::morphology::{Element, Size, dilate, erode};
use super::placed::covered;
use super::runs::next;
use super::segmenter::{GAP, Segmenter, State, Work};

/// Frames in which a pixel showed the background and nothing moved, after which flow alone does not call it moving.
const CONFIRMED: u8 = 8;
/// A region that changes in less than this share of it has stopped.
const STOPPED: f64 = 0.02;
/// A thing's edge is where it covers this share of a pixel.
const COVERED: f32 = 0.5;

impl Segmenter {
    /// What moves in the frame.
    pub(super) fn decide(&mut self, execution: &Execution) -> Result<()> {
        let size = self.state.canvas.size;
        let pixels = size.0 * size.1;
        for mask in [
            &mut self.work.mask,
            &mut self.work.spare,
            &mut self.work.away,
        ] {
            resize("masks", mask, pixels, 0)?;
        }
        for (both, seen) in self.work.both.iter_mut().zip(&self.state.seen) {
            *both &= seen;
        }
        let of = change::Pictures {
            size,
            before: &self.state.picture,
            now: &self.work.raw,
            both: &self.work.both,
            noise: self.state.noise,
            moves: self.options.camera_moves,
        };
        changed(&of, &mut self.work.changed, execution)?;
        // What moved before anything was seen behind it hides what is not known.
        let State {
            background,
            heat,
            confirmed,
            seen,
            ..
        } = &mut self.state;
        let Work { by_flow, both, .. } = &mut self.work;
        hide(by_flow, confirmed, seen, &mut background.known, heat, both);
        if self.has_depth() {
            // Depth moves the background itself: the flow alone tells, but for the last pixel of an edge.
            let (from, to) = (&self.work.by_flow, &mut self.work.mask);
            dilate(from, size, Element::Square(3), to, execution)?;
        } else {
            self.compare(execution)?;
        }
        self.clean(size, execution)?;
        let asked = Asked {
            size,
            mask: &self.work.mask,
            changed: &self.work.changed,
            known: &self.state.background.known,
            background: &self.state.background.median,
            picture: &self.work.raw,
            noise: self.state.noise,
        };
        if self.has_depth() {
            self.work.judge.gone.clear();
            resize("masks", &mut self.work.judge.gone, pixels, 0)?;
        } else {
            self.work
                .judge
                .update(&asked, &mut self.state.heat, execution)?;
        }
        self.learn(size, execution)?;
        self.show(execution)
    }

    pub(super) fn compare(&mut self, execution: &Execution) -> Result<()> {
        let size = self.state.canvas.size;
        let of = Compared {
            picture: &self.work.raw,
            both: &self.work.both,
            noise: self.state.noise,
            moves: self.options.camera_moves,
        };
        self.work
            .difference
            .update(&self.state.background, &of, execution)?;
        // A thing that stopped before anything was seen behind it stays one.
        self.work.runs.label(&self.state.foreground, size)?;
        self.work
            .runs
            .sum_bytes(&self.work.changed, &mut self.work.sums)?;
        let (regions, sums) = (self.work.runs.regions(), &self.work.sums);
        let stopped = |label: usize| sums[label] as f64 <= STOPPED * f64::from(regions[label].area);
        self.work.runs.draw(stopped, &mut self.work.spare);
        let Work {
            difference,
            by_flow,
            spare,
            mask,
            ..
        } = &mut self.work;
        let known = &self.state.background.known;
        join(
            &difference.differs,
            by_flow,
            spare,
            known,
            &self.state.seen,
            mask,
        );
        Ok(())
    }

    /// Close gaps, fill holes, take small regions away, and trim what a pixel's part of a thing's edge makes too wide.
    pub(super) fn clean(&mut self, size: Size, execution: &Execution) -> Result<()> {
        let gap = if self.has_depth() { 2 * GAP - 1 } else { GAP };
        let Work {
            mask,
            morphology,
            regions,
            spare,
            raw,
            away,
            ..
        } = &mut self.work;
        // The flow alone leaves larger gaps.
        morphology.close(mask, size, Element::Disc(gap), execution)?;
        regions.fill_holes(mask, size, u32::MAX)?;
        regions.remove_small(mask, size, self.options.min_area as u32)?;
        erode(mask, size, Element::Square(3), spare, execution)?;
        let (width, height) = size;
        let median = &self.state.background.median;
        let known = &self.state.background.known;
        // The whole mask as it was: what is trimmed must not change its neighbours.
        replace("masks", away, mask.iter().copied())?;
        let whole = away;
        let apart = |at: usize| {
            if known[at] == 1 {
                (raw[at] - median[at]).abs()
            } else {
                0.0
            }
        };
        for y in 0..height {
            let row = &whole[y * width..(y + 1) * width];
            let mut x = 0;
            loop {
                x = next(row, x, 1);
                if x == width {
                    break;
                }
                let (here, at) = (x, y * width + x);
                x += 1;
                if spare[at] == 1 || known[at] == 0 {
                    continue;
                }
                let mut most = 0.0f32;
                for y in y.saturating_sub(1)..(y + 2).min(height) {
                    for x in here.saturating_sub(1)..(here + 2).min(width) {
                        let at = y * width + x;
                        if whole[at] == 1 {
                            most = most.max(apart(at));
                        }
                    }
                }
                mask[at] = u8::from(apart(at) >= COVERED * most);
            }
        }
        Ok(())
    }

    pub(super) fn learn(&mut self, size: Size, execution: &Execution) -> Result<()> {
        let state = &mut self.state;
        let work = &mut self.work;
        without(&work.mask, &work.judge.gone, &mut state.foreground);
        dilate(
            &state.foreground,
            size,
            Element::Square(GAP),
            &mut work.away,
            execution,
        )?;
        confirm(
            &work.judge.gone,
            &work.both,
            &work.by_flow,
            &state.foreground,
            &mut work.away,
            &mut state.confirmed,
        );
        let masks = [&state.seen[..], &work.away[..], &work.judge.gone[..]];
        state.background.learn(&work.raw, masks, execution)?;
        std::mem::swap(&mut state.picture, &mut work.raw);
        Ok(())
    }

    /// What moves on the canvas, as the frame has it.
    pub(super) fn show(&mut self, execution: &Execution) -> Result<()> {
        let state = &mut self.state;
        if state.canvas.rests() {
            state.moving.copy_from_slice(&state.foreground);
            return Ok(());
        }
        let (frame, size) = (state.canvas.frame, state.canvas.size);
        let map = state.canvas.to_canvas;
        covered(
            (&state.foreground, size),
            &map,
            (&mut state.moving, frame),
            execution,
        )?;
        for (moving, counts) in state.moving.iter_mut().zip(&self.work.counts_canvas) {
            *moving &= counts;
        }
        Ok(())
    }
}

// What follows goes over whole masks: slices that are arguments are known to be apart.

/// Forget what was known where flow says that something moves before anything was `confirmed`.
fn hide(
    by_flow: &[u8],
    confirmed: &[u8],
    seen: &[u8],
    known: &mut [u8],
    heat: &mut [u8],
    both: &mut [u8],
) {
    let from = by_flow.iter().zip(confirmed).zip(seen);
    let to = known.iter_mut().zip(heat).zip(both);
    for (((known, heat), both), ((by_flow, confirmed), seen)) in to.zip(from) {
        let hidden = by_flow & u8::from(*confirmed < CONFIRMED);
        *known &= 1 - hidden;
        *heat = if hidden == 1 { MEMORY } else { *heat };
        *both = *known & seen;
    }
}

/// What differs, and what moves by its flow or stopped where nothing is known.
fn join(differs: &[u8], by_flow: &[u8], stopped: &[u8], known: &[u8], seen: &[u8], to: &mut [u8]) {
    let places = known.iter().zip(seen);
    let from = differs.iter().zip(by_flow).zip(stopped).zip(places);
    for (to, (((differs, by_flow), stopped), (known, seen))) in to.iter_mut().zip(from) {
        *to = differs | ((by_flow | stopped) & (1 - known) & seen);
    }
}

fn without(mask: &[u8], gone: &[u8], to: &mut [u8]) {
    for (to, (mask, gone)) in to.iter_mut().zip(mask.iter().zip(gone)) {
        *to = mask & (1 - gone);
    }
}

/// Count the frames that showed the background, and let nothing be learned where flow says that something moves before.
fn confirm(
    gone: &[u8],
    both: &[u8],
    by_flow: &[u8],
    foreground: &[u8],
    away: &mut [u8],
    confirmed: &mut [u8],
) {
    let masks = gone.iter().zip(both).zip(by_flow.iter().zip(foreground));
    let to = away.iter_mut().zip(confirmed);
    for ((away, confirmed), ((gone, both), (by_flow, foreground))) in to.zip(masks) {
        *away |= by_flow & u8::from(*confirmed < CONFIRMED);
        let shown = both & (1 - foreground) & (1 - by_flow);
        let more = confirmed.saturating_add(shown);
        *confirmed = if *gone == 1 { 0 } else { more };
    }
}
