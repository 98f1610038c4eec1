//! What moves in a frame, and what a segmenter learns from it.

use crate::error::Result;
use crate::execution::Execution;
use crate::memory::{replace, resize};

use super::background::OLD;
use super::change::{self, changed};
use super::difference::Compared;
use super::earlier::{Earlier, Now};
use super::flutter::Going;
use super::held::STOPPED;
use super::judge::{Asked, MEMORY};
use super::masks::{confirm, hide, join, keep_away, learned, without};
use super::morphology::{Element, Size, dilate, erode};
use super::outline::Outline;
use super::placed::{covered, nearest_mask};
use super::runs::next;
use super::segmenter::{GAP, Segmenter, State, Work};

/// Frames in which a pixel showed the background and nothing moved, after which flow alone does not call it moving.
const CONFIRMED: u8 = 8;
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
        self.find_flutter(size, execution)?;
        self.add_slow(size, execution)?;
        // What moved before anything was seen behind it hides what is not known.
        let State {
            background,
            heat,
            confirmed,
            seen,
            flutter,
            ..
        } = &mut self.state;
        let Work { hides, both, .. } = &mut self.work;
        let known = &mut background.known;
        hide(
            (hides, CONFIRMED),
            confirmed,
            seen,
            known,
            (heat, MEMORY),
            both,
        );
        learned(&flutter.mask, (&background.age, OLD), both);
        if self.has_depth() {
            // Depth moves the background itself: the flow alone tells, but for the last pixel of an edge.
            let (from, to) = (&self.work.by_flow, &mut self.work.mask);
            dilate(from, size, Element::Square(3), to, execution)?;
            self.state.shaded.fill(0);
            self.state.lived.fill(0);
            self.work.held.clear();
            resize("masks", &mut self.work.held, pixels, 0)?;
        } else {
            self.compare(execution)?;
        }
        self.clean(size, execution)?;
        let asked = Asked {
            size,
            mask: &self.work.mask,
            changed: &self.work.changed,
            known: &self.state.background.known,
            age: &self.state.background.age,
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

    /// See what goes to and fro; where that begins, what was known is young again.
    fn find_flutter(&mut self, size: Size, execution: &Execution) -> Result<()> {
        let (state, work) = (&mut self.state, &mut self.work);
        resize("masks", &mut work.begins, size.0 * size.1, 0)?;
        // What moves changes the picture.
        work.runs.label(&work.by_flow, size)?;
        work.runs.sum_bytes(&work.changed, &mut work.sums)?;
        let (regions, sums) = (work.runs.regions(), &work.sums);
        let unmoved = |label: usize| sums[label] as f64 <= STOPPED * f64::from(regions[label].area);
        work.runs.paint(unmoved, 0, &mut work.by_flow);
        let masks = [&mut work.begins, &mut work.spare];
        if state.flutter.update(&work.going, size, masks, execution)? {
            let places = state.background.age.iter_mut().zip(&mut work.by_flow);
            for (begins, (age, by_flow)) in work.begins.iter().zip(places) {
                if *begins == 1 {
                    *age = (*age).min(1);
                    *by_flow = 0;
                }
            }
        }
        resize("masks", &mut work.hides, size.0 * size.1, 0)?;
        let from = work.by_flow.iter().zip(&work.going);
        for (hides, (by_flow, going)) in work.hides.iter_mut().zip(from) {
            *hides = by_flow | u8::from(*going == Going::LEFT);
        }
        Ok(())
    }

    /// See what moves slowly: the background may have taken it for itself before that was known.
    pub(super) fn add_slow(&mut self, size: Size, execution: &Execution) -> Result<()> {
        if !self.work.slow.any || self.has_depth() {
            return Ok(());
        }
        let (small, map, factor) = (self.reduced_size(), self.to_reduced(), self.factor());
        let (state, work) = (&mut self.state, &mut self.work);
        let now = Now {
            size,
            picture: &work.raw,
            to_canvas: &state.canvas.to_canvas,
            age: Earlier::age(state.frames),
            noise: state.noise,
            factor: factor as f64,
        };
        state
            .earlier
            .confirm(&state.slow, &now, small, &mut work.slow)?;
        if !work.slow.any {
            return Ok(());
        }
        let Work {
            slow,
            by_slow,
            by_flow,
            hides,
            ..
        } = work;
        resize("masks", by_slow, size.0 * size.1, 0)?;
        nearest_mask((&slow.moving, small), &map, (by_slow, size), execution)?;
        for (at, slow) in by_slow.iter().enumerate() {
            if slow & state.seen[at] & (1 - state.flutter.mask[at]) == 1 {
                (by_flow[at], hides[at]) = (1, 1);
                // What the background was taken for is not known behind it.
                state.confirmed[at] *= state.foreground[at];
            }
        }
        Ok(())
    }

    pub(super) fn compare(&mut self, execution: &Execution) -> Result<()> {
        let size = self.state.canvas.size;
        let of = Compared {
            picture: &self.work.raw,
            both: &self.work.both,
            noise: self.state.noise,
            moves: self.options.camera_moves,
        };
        let difference = &mut self.work.difference;
        std::mem::swap(&mut difference.shadows, &mut self.state.shadows);
        let compared = difference.update(&self.state.background, &of, execution);
        std::mem::swap(&mut difference.shadows, &mut self.state.shadows);
        compared?;
        // A thing that stopped before anything was seen behind it stays one.
        self.find_stopped(size)?;
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
        self.state
            .shaded
            .copy_from_slice(&self.work.difference.body);
        Ok(())
    }

    /// Close gaps, fill holes, take small regions away, and trim what a pixel's part of a thing's edge makes too wide.
    pub(super) fn clean(&mut self, size: Size, execution: &Execution) -> Result<()> {
        let depth = self.has_depth();
        let gap = if depth { 2 * GAP - 1 } else { GAP };
        let Work {
            mask,
            morphology,
            regions,
            spare,
            raw,
            away,
            held,
            like,
            ..
        } = &mut self.work;
        // The flow alone leaves larger gaps.
        morphology.close(mask, size, Element::Disc(gap), execution)?;
        regions.fill_holes(mask, size, u32::MAX)?;
        regions.remove_small(mask, size, self.options.min_area as u32)?;
        let (width, height) = size;
        erode(mask, size, Element::Square(3), spare, execution)?;
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
                if spare[at] == 1 {
                    continue;
                }
                if known[at] == 0 {
                    // Windows of the flow reach over a thing's edge.
                    mask[at] = u8::from(depth) | held[at];
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
        if depth {
            return Ok(());
        }
        let outline = Outline {
            size,
            known,
            held,
            seen: &self.state.seen,
            picture: raw,
            noise: self.state.noise,
        };
        outline.trim(mask, like)
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
            (&work.by_flow, &work.hides, CONFIRMED),
            &state.foreground,
            &mut work.away,
            &mut state.confirmed,
        );
        let age = (&state.background.age[..], OLD);
        keep_away(&state.flutter.mask, &state.shaded, age, &mut work.away);
        let masks = [&state.seen[..], &work.away[..], &work.judge.gone[..]];
        state.background.learn(&work.raw, masks, execution)?;
        state.earlier.keep(&work.raw, &state.seen, state.frames);
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
