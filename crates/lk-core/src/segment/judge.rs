//! Which of what differs from the background moves, or stands where it came to, and what is only the place that something
//! left: each quiet part is judged by its rim.

use crate::error::Result;
use crate::execution::Execution;
use crate::memory::resize;

use super::components::{Region, Runs};
use super::flow_evidence::quantile;
use super::morphology::{Element, Size, dilate, erode};
use super::runs::next;

/// For how many frames after it moved a thing that differs from the background is still called moving; for how many where
/// its rim does not say which.
pub(crate) const MEMORY: u8 = 100;
const UNTOLD: u8 = 20;
/// Where nothing is known behind it, what was seen to move is not taken for the background within so many frames.
const GRACE: u8 = 2;
/// What did not change for this many frames, and so many times as long as the background was seen there, is the background.
const QUIET: f64 = 2.0;
const LONGER: f64 = 2.0;
/// A region lives where this share of it changes, and at least so many pixels.
const LIVE: f64 = 0.06;
const LEAST: f64 = 3.0;
/// Around what changes, in pixels, nothing is quiet.
const NEAR: usize = 5;
/// A thing has a rim: so many times stronger in the picture than in the background where it stands, the other way round where
/// it left. Squares of steps over the rim; in units of what noise makes of it, so strong at least.
const RIM: f64 = 2.25;
const ABOVE_NOISE: f64 = 1.3;
const UNKNOWN_RIM: f64 = 4.0;
/// Where the background is not known, a thing's rim is so many times stronger than steps around it, which are looked at this
/// far around, in pixels, and at every so manyth place.
const ABOVE_AROUND: f64 = 2.0;
/// What left has a contour in the background, stronger than what is around by this factor.
const CONTOUR: f64 = 1.5;
const AROUND: u32 = 8;
const AROUND_STEP: usize = 3;
/// Variance of a step between the means of two windows of 5 x 5 that share a row, both ways, in that of a pixel.
const STEP_NOISE: f64 = 0.128;

/// What is judged, all of one size.
pub(crate) struct Asked<'a> {
    pub(crate) size: Size,
    /// 1 where something may move.
    pub(crate) mask: &'a [u8],
    /// 1 where the picture changed since the frame before.
    pub(crate) changed: &'a [u8],
    /// 1 where the background is known.
    pub(crate) known: &'a [u8],
    /// Frames in which it was seen.
    pub(crate) age: &'a [u8],
    pub(crate) background: &'a [f32],
    pub(crate) picture: &'a [f32],
    pub(crate) noise: f32,
}

/// The judge, with memory that is kept.
#[derive(Debug, Default)]
pub(crate) struct Judge {
    /// 1 where nothing moves and what is seen is the background from now on.
    pub(crate) gone: Vec<u8>,
    whole: Runs,
    parts: Runs,
    near: Vec<u8>,
    pub(super) quiet: Vec<u8>,
    rim: Vec<u8>,
    spare: Vec<u8>,
    of_whole: Vec<u32>,
    of_part: Vec<u32>,
    changes: Vec<u64>,
    known: Vec<u64>,
    ages: Vec<u64>,
    rims: Vec<Rim>,
    steps: Vec<f32>,
}

/// What is known of a quiet part.
#[derive(Debug, Default, Clone, Copy)]
struct Rim {
    before: f64,
    here: f64,
    count: f64,
    heat: u8,
    beside_live: bool,
    gone: bool,
}

impl Judge {
    /// Write what is gone; `heat` says for how many frames each pixel may still be called moving without a change.
    pub(crate) fn update(
        &mut self,
        of: &Asked<'_>,
        heat: &mut [u8],
        execution: &Execution,
    ) -> Result<()> {
        let (size, pixels) = (of.size, of.size.0 * of.size.1);
        for mask in [
            &mut self.gone,
            &mut self.near,
            &mut self.quiet,
            &mut self.rim,
            &mut self.spare,
        ] {
            resize("masks", mask, pixels, 0)?;
        }
        for labels in [&mut self.of_whole, &mut self.of_part] {
            resize("labels", labels, pixels, 0)?;
        }
        for heat in heat.iter_mut() {
            *heat = heat.saturating_sub(1);
        }
        self.gone.fill(0);
        self.whole.label(of.mask, size)?;
        if self.whole.regions().is_empty() {
            return Ok(());
        }
        self.whole.sum_bytes(of.changed, &mut self.changes)?;
        // Where no run is nothing is read.
        self.whole.paint_labels(&mut self.of_whole);
        dilate(
            of.changed,
            size,
            Element::Square(NEAR),
            &mut self.near,
            execution,
        )?;
        self.quiet.fill(0);
        for run in self.whole.runs() {
            let place = run.place(size.0);
            let lives = self.lives(run.label as usize);
            let quiet = &mut self.quiet[place.clone()];
            if !lives {
                quiet.fill(1);
                continue;
            }
            let near = self.near[place.clone()].iter().zip(&mut heat[place]);
            for (quiet, (near, heat)) in quiet.iter_mut().zip(near) {
                *quiet = 1 - near;
                *heat = if *near == 1 { MEMORY } else { *heat };
            }
        }
        // Those of the frame before.
        self.parts.paint(|_| true, 0, &mut self.of_part);
        self.parts.label(&self.quiet, size)?;
        self.parts.paint_labels(&mut self.of_part);
        self.parts.sum_bytes(of.known, &mut self.known)?;
        self.parts.sum_bytes(of.age, &mut self.ages)?;
        self.find_rims(of, heat, execution)?;
        self.decide(of, heat);
        Ok(())
    }

    fn lives(&self, region: usize) -> bool {
        let area = f64::from(self.whole.regions()[region].area);
        self.changes[region] as f64 > (LIVE * area).max(LEAST)
    }

    /// Steps over the outer rim of each quiet part, away from what changes.
    fn find_rims(&mut self, of: &Asked<'_>, heat: &[u8], execution: &Execution) -> Result<()> {
        let (size, (width, height)) = (of.size, of.size);
        self.rims.clear();
        resize(
            "quiet parts",
            &mut self.rims,
            self.parts.regions().len(),
            Rim::default(),
        )?;
        for run in self.parts.runs() {
            let place = run.place(width);
            let beside_live = self.lives(self.of_whole[place.start] as usize - 1);
            let rim = &mut self.rims[run.label as usize];
            rim.heat = heat[place].iter().copied().fold(rim.heat, u8::max);
            rim.beside_live = beside_live;
        }
        erode(
            of.mask,
            size,
            Element::Square(3),
            &mut self.spare,
            execution,
        )?;
        for (outer, mask) in self.spare.iter_mut().zip(of.mask) {
            *outer = mask & (1 - *outer);
        }
        dilate(
            &self.spare,
            size,
            Element::Square(3),
            &mut self.rim,
            execution,
        )?;
        dilate(
            of.changed,
            size,
            Element::Square(3),
            &mut self.near,
            execution,
        )?;
        for y in 0..height {
            let row = &self.rim[y * width..(y + 1) * width];
            let mut x = next(row, 0, 1);
            while x < width {
                let (here, at) = (x, y * width + x);
                x += 1;
                if row.get(x) != Some(&1) {
                    x = next(row, x, 1);
                }
                if self.near[at] == 1 {
                    continue;
                }
                let x = here;
                let across = x.saturating_sub(1)..(x + 2).min(width);
                let rows = y.saturating_sub(1)..(y + 2).min(height);
                let labels = rows.flat_map(|y| &self.of_part[y * width..][across.clone()]);
                let label = labels.copied().max().unwrap_or(0);
                if label > 0 {
                    let rim = &mut self.rims[label as usize - 1];
                    rim.before += step(of.background, size, x, y);
                    rim.here += step(of.picture, size, x, y);
                    rim.count += 1.0;
                }
            }
        }
        Ok(())
    }

    fn decide(&mut self, of: &Asked<'_>, heat: &mut [u8]) {
        let size = of.size;
        let width = size.0;
        let noise = f64::from(of.noise * of.noise) * STEP_NOISE;
        for (label, rim) in self.rims.iter_mut().enumerate() {
            let made = rim.count * noise;
            let (before, here) = ((rim.before - made).max(0.0), (rim.here - made).max(0.0));
            let area = f64::from(self.parts.regions()[label].area);
            let unknown = (self.known[label] as f64) < 0.5 * area;
            let region = &self.parts.regions()[label];
            let left = !unknown
                && before > RIM * here
                && rim.before > ABOVE_NOISE * made
                && rim.count > 3.0
                && rim.before
                    > CONTOUR
                        * rim.count
                        * around(of.background, size, &self.rim, region, &mut self.steps);
            let stands = here > RIM * before && rim.here > ABOVE_NOISE * made;
            let alone = !rim.beside_live;
            let rimless = unknown
                && alone
                && rim.heat < MEMORY - GRACE
                && (rim.here < UNKNOWN_RIM * made
                    || rim.here
                        < ABOVE_AROUND
                            * rim.count
                            * mostly(of.picture, size, &self.rim, region, &mut self.steps));
            let untold = alone && !unknown && !stands && rim.heat < MEMORY - UNTOLD;
            // What is seen for longer than the background was is that.
            let quiet = f64::from(MEMORY.saturating_sub(rim.heat));
            let age = self.ages[label] as f64 / area;
            let longer = alone && !unknown && quiet > QUIET + LONGER * age;
            let gone = left || rimless || untold || longer || (alone && rim.heat == 0);
            rim.gone = gone;
        }
        for run in self.parts.runs() {
            let rim = &self.rims[run.label as usize];
            let place = run.place(width);
            if rim.gone {
                self.gone[place.clone()].fill(1);
                heat[place].fill(0);
            } else if rim.beside_live {
                // The inside of a thing that moves stays warm.
                for heat in &mut heat[place] {
                    *heat = (*heat).max(MEMORY - 5);
                }
            }
        }
    }
}

/// The mean step of a picture in and around a region, without the rims.
fn around(plane: &[f32], size: Size, rims: &[u8], region: &Region, steps: &mut Vec<f32>) -> f64 {
    steps_around(plane, size, rims, region, steps);
    let sum: f64 = steps.iter().map(|step| f64::from(*step)).sum();
    sum / f64::max(steps.len() as f64, 1.0)
}

/// The same, or the median step where that is less: strong edges of others in a part of it count for nothing.
fn mostly(plane: &[f32], size: Size, rims: &[u8], region: &Region, steps: &mut Vec<f32>) -> f64 {
    let mean = around(plane, size, rims, region, steps);
    if steps.is_empty() {
        return mean;
    }
    mean.min(f64::from(quantile(steps, 0.5)))
}

fn steps_around(
    plane: &[f32],
    (width, height): Size,
    rims: &[u8],
    region: &Region,
    steps: &mut Vec<f32>,
) {
    let (left, top) = (
        region.left.saturating_sub(AROUND) as usize,
        region.top.saturating_sub(AROUND) as usize,
    );
    let (right, bottom) = (
        (region.right + AROUND) as usize,
        (region.bottom + AROUND) as usize,
    );
    steps.clear();
    for y in (top..bottom.min(height)).step_by(AROUND_STEP) {
        for x in (left..right.min(width)).step_by(AROUND_STEP) {
            if rims[y * width + x] == 0 {
                steps.push(step(plane, (width, height), x, y) as f32);
            }
        }
    }
}

/// Squared step across a place: between the means of windows on its left and right, above and below.
fn step(plane: &[f32], (width, height): Size, x: usize, y: usize) -> f64 {
    let mean = |x: isize, y: isize| {
        let mut sum = 0.0;
        for dy in -2..=2 {
            let row = (y + dy).clamp(0, height as isize - 1) as usize * width;
            for dx in -2..=2 {
                sum += plane[row + (x + dx).clamp(0, width as isize - 1) as usize];
            }
        }
        f64::from(sum) / 25.0
    };
    let (x, y) = (x as isize, y as isize);
    let across = mean(x + 2, y) - mean(x - 2, y);
    let down = mean(x, y + 2) - mean(x, y - 2);
    across * across + down * down
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::segment::made::greys;

    #[test]
    fn what_is_seen_for_longer_than_the_background_was_is_that() {
        let (size, pixels) = ((40, 40), 1600);
        let mut mask = vec![0; pixels];
        for y in 12..28 {
            mask[y * 40 + 12..y * 40 + 28].fill(1);
        }
        let picture = greys(size, 3);
        let gone = |age: u8, quiet: u8| {
            let asked = Asked {
                size,
                mask: &mask,
                changed: &vec![0; pixels],
                known: &vec![1; pixels],
                age: &vec![age; pixels],
                background: &vec![100.0; pixels],
                picture: &picture,
                noise: 1.0,
            };
            let mut judge = Judge::default();
            let mut heat = vec![MEMORY - quiet; pixels];
            judge
                .update(&asked, &mut heat, &Execution::default())
                .unwrap();
            judge.gone.contains(&1)
        };
        // A thing that was there from the first frame on and left; one that came and stands.
        assert!(gone(2, 10));
        assert!(!gone(2, 1));
        assert!(!gone(20, 10));
        assert!(gone(20, 50));
        assert!(!gone(200, 90));
    }
}
