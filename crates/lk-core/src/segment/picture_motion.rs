//! How far each thing went by its own picture: samples of it are laid over the next frame. B. Lucas and T. Kanade, "An
//! iterative image registration technique", IJCAI 1981, with Tukey's weights.

use crate::error::{Error, Result};
use crate::frame::{Frame, Pixel, expect_size};
use crate::memory::reserve;

use super::seen_regions::{REGION_SAMPLES, SAMPLE_PARTS};

/// Steps of Gauss and Newton, and the longest of each in pixels.
const STEPS: usize = 4;
const LONGEST_PX: f64 = 1.5;
const CONVERGED_PX: f64 = 0.01;
/// Of so many samples one is looked at to choose where to begin.
const SKIPPED: usize = 3;
/// Samples that are off by more than so many deviations do not count; the deviation is at least so many levels of 256.
const OUTLIER: f64 = 3.0;
const LEAST_LEVELS: f64 = 1.5;
/// So many samples, and so much of them, must lie on what moves.
const LEAST_SAMPLES: usize = 12;
const LEAST_SHARE: f64 = 0.4;
/// Samples so near tell the same: so many count as one.
const ALIKE: f64 = 6.0;
/// Deviation that no number of samples falls below: in pixels, and as a share of the motion.
const LEAST_PX: f64 = 0.03;
const SPEED_SHARE: f64 = 0.01;
/// A motion that is less sure than this many pixels tells nothing.
const UNSURE_PX: f64 = 1.0;
/// Nor does one that ends farther than this share of the thing's size from where it began, or these pixels.
const FAR_SHARE: f64 = 0.25;
const FAR_PX: f64 = 2.0;

/// Motions to begin from.
pub const RIDE_STARTS: usize = 4;

/// What the picture of a thing says of a frame; NaN and infinite variance where it says nothing.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct Ridden {
    /// Since the frame before, in pixels.
    pub motion: [f64; 2],
    /// Its variance.
    pub variance: [f64; 2],
    /// Deviation of its levels, or root of the mean square of what they are off at rest if that is larger.
    pub contrast: f64,
}

/// The things whose pictures are laid over a frame.
#[derive(Debug, Clone, Copy)]
pub struct Riders<'a> {
    /// Samples of each, as [`SeenRegion::picture`](crate::SeenRegion) has them, one after the other.
    pub pictures: &'a [f32],
    /// Motions of each to begin from, x and y.
    pub starts: &'a [[[f64; 2]; RIDE_STARTS]],
    /// The larger of each one's width and height.
    pub sizes: &'a [f64],
}

/// Lay the samples of things over a frame, in smoothed levels of 256, in which `mask` is what moves.
///
/// # Errors
///
/// [`Error::Shape`] if the sizes do not fit together; [`Error::Memory`].
///
/// ```
/// use lk_core::{Riders, SeenBeside, ride, see_regions};
/// use ndarray::Array2;
///
/// let picture = |dx: f64| Array2::from_shape_fn((40, 60), |(y, x)| {
///     (128.0 + 60.0 * ((x as f64 - dx) * 0.4).sin() * (y as f64 * 0.3).cos()) as f32
/// });
/// let mask = Array2::from_shape_fn((40, 60), |(y, x)| (10..30).contains(&y) && (15..45).contains(&x));
/// let nothing = SeenBeside::<f32> { motion: None, image: None };
/// let seen = see_regions(mask.view(), 1, nothing, Some(picture(0.0).view()))?;
/// let riders = Riders { pictures: seen.regions[0].picture.as_flattened(), starts: &[[[0.0; 2]; 4]], sizes: &[30.0] };
/// let moved = ride(riders, picture(0.7).view(), mask.view())?[0].motion;
/// assert!((moved[0] - 0.7).abs() < 0.05 && moved[1].abs() < 0.05);
/// # Ok::<(), lk_core::Error>(())
/// ```
pub fn ride<L: Pixel>(
    riders: Riders<'_>,
    levels: Frame<'_, L>,
    mask: ndarray::ArrayView2<'_, bool>,
) -> Result<Vec<Ridden>> {
    expect_size("mask", mask.dim(), "the frame", levels.dim())?;
    let parts = riders.pictures.as_chunks::<SAMPLE_PARTS>().0;
    let pictures = parts.as_chunks::<REGION_SAMPLES>().0;
    let count = pictures.len();
    let whole = riders.pictures.len() == count * REGION_SAMPLES * SAMPLE_PARTS;
    if !whole || riders.starts.len() != count || riders.sizes.len() != count {
        let got = [
            riders.pictures.len(),
            riders.starts.len(),
            riders.sizes.len(),
        ];
        return Err(Error::shape(
            "things",
            format!("{got:?}"),
            "as many of each",
        ));
    }
    if count > 0 && levels.is_empty() {
        let got = format!("{:?}", levels.dim());
        return Err(Error::shape("image", got, "at least one pixel"));
    }
    let mut all = Vec::new();
    reserve("things", &mut all, count)?;
    let mut work = Work::default();
    for ((picture, starts), size) in pictures.iter().zip(riders.starts).zip(riders.sizes) {
        let mut over = Over {
            picture,
            levels,
            mask,
            work: &mut work,
        };
        all.push(over.ridden(starts, *size));
    }
    Ok(all)
}

/// For each sample what it is off, whether it counts, and its weight.
struct Work {
    off: [f64; REGION_SAMPLES],
    seen: [bool; REGION_SAMPLES],
    weight: [f64; REGION_SAMPLES],
    values: [f64; REGION_SAMPLES],
}

impl Default for Work {
    fn default() -> Self {
        Self {
            off: [0.0; REGION_SAMPLES],
            seen: [false; REGION_SAMPLES],
            weight: [0.0; REGION_SAMPLES],
            values: [0.0; REGION_SAMPLES],
        }
    }
}

/// One thing over the frame.
struct Over<'a, L> {
    picture: &'a [[f32; SAMPLE_PARTS]; REGION_SAMPLES],
    levels: Frame<'a, L>,
    mask: ndarray::ArrayView2<'a, bool>,
    work: &'a mut Work,
}

/// The solution of normal equations.
struct Solution {
    pull: [f64; 2],
    /// Diagonal of the inverse.
    inverse: [f64; 2],
    solvable: bool,
}

impl<L: Pixel> Over<'_, L> {
    fn ridden(&mut self, starts: &[[f64; 2]; RIDE_STARTS], size: f64) -> Ridden {
        let nothing = Ridden {
            motion: [f64::NAN; 2],
            variance: [f64::INFINITY; 2],
            contrast: 0.0,
        };
        if self.picture.iter().filter(|part| part[0] > 0.0).count() < LEAST_SAMPLES {
            return nothing;
        }
        let start = self.best_start(starts);
        let (motion, spread) = self.registered(start);
        let Solution {
            inverse, solvable, ..
        } = self.solution();
        let variance = inverse.map(|inverse| inverse * ALIKE * spread * spread);
        let (mut inside, mut kept, mut all) = (0, 0.0, 0.0);
        for (part, weight) in self.picture.iter().zip(&self.work.weight) {
            let own = f64::from(part[0]);
            all += own;
            if *weight > 0.0 {
                inside += 1;
                kept += own;
            }
        }
        let away = (motion[0] - start[0]).hypot(motion[1] - start[1]);
        let known = solvable
            && away <= FAR_PX.max(FAR_SHARE * size)
            && variance[0].max(variance[1]) <= UNSURE_PX * UNSURE_PX
            && kept >= LEAST_SHARE * all
            && inside >= LEAST_SAMPLES;
        let contrast = self.contrast();
        if !known {
            return Ridden {
                contrast,
                ..nothing
            };
        }
        let least = SPEED_SHARE * motion[0].hypot(motion[1]);
        Ridden {
            motion,
            variance: variance.map(|value| value + LEAST_PX * LEAST_PX + least * least),
            contrast,
        }
    }

    /// The motion that one of so many samples fit best.
    fn best_start(&mut self, starts: &[[f64; 2]; RIDE_STARTS]) -> [f64; 2] {
        let (mut best, mut least) = (starts[0], f64::INFINITY);
        let every = self.picture.iter().step_by(SKIPPED);
        let all: f64 = every.map(|part| f64::from(part[0])).sum();
        for start in starts {
            self.lay(*start, SKIPPED, true);
            let middle = self.middle_off(SKIPPED);
            let (mut total, mut cost) = (0.0, 0.0);
            for at in (0..REGION_SAMPLES).step_by(SKIPPED) {
                if self.work.seen[at] {
                    let weight = f64::from(self.picture[at][0]);
                    total += weight;
                    cost += weight * (self.work.off[at] - middle).abs();
                }
            }
            let cost = cost / total.max(1e-9);
            if total >= LEAST_SHARE * all && cost < least {
                (best, least) = (*start, cost);
            }
        }
        best
    }

    /// Refine a motion; give it and the deviation, and keep what is off with it and the weights of the samples.
    fn registered(&mut self, start: [f64; 2]) -> ([f64; 2], f64) {
        let (mut motion, mut length) = (start, f64::INFINITY);
        let mut step = 0;
        loop {
            self.lay(motion, 1, true);
            for (seen, part) in self.work.seen.iter_mut().zip(self.picture) {
                *seen &= part[0] > 0.0;
            }
            let middle = self.middle_off(1);
            for off in &mut self.work.off {
                *off -= middle;
            }
            let spread = (1.4826 * self.middle(1, f64::abs)).max(LEAST_LEVELS);
            for at in 0..REGION_SAMPLES {
                let share = self.work.off[at] / (OUTLIER * spread);
                let left = (1.0 - share * share).max(0.0);
                let counts = if self.work.seen[at] {
                    f64::from(self.picture[at][0])
                } else {
                    0.0
                };
                self.work.weight[at] = counts * left * left;
            }
            if step == STEPS || length < CONVERGED_PX {
                return (motion, spread);
            }
            let pull = self.solution().pull;
            length = pull[0].hypot(pull[1]);
            let share = (LONGEST_PX / length.max(1e-9)).min(1.0);
            for (motion, pull) in motion.iter_mut().zip(pull) {
                *motion -= pull * share;
            }
            step += 1;
        }
    }

    /// Solve the normal equations of what is off, with the weights at hand.
    fn solution(&self) -> Solution {
        let (mut total, mut mean) = (0.0, [0.0; 2]);
        for (part, weight) in self.picture.iter().zip(&self.work.weight) {
            total += weight;
            mean[0] += weight * f64::from(part[4]);
            mean[1] += weight * f64::from(part[5]);
        }
        let total: f64 = f64::max(total, 1e-9);
        let [mx, my] = mean.map(|sum| sum / total);
        let [mut xx, mut xy, mut yy, mut bx, mut by] = [0.0; 5];
        for (part, (weight, off)) in self
            .picture
            .iter()
            .zip(self.work.weight.iter().zip(&self.work.off))
        {
            let (gx, gy) = (f64::from(part[4]) - mx, f64::from(part[5]) - my);
            xx += weight * gx * gx;
            xy += weight * gx * gy;
            yy += weight * gy * gy;
            bx += weight * gx * off;
            by += weight * gy * off;
        }
        let more = 1e-3 * (xx + yy) + 1e-6;
        let (xx, yy) = (xx + more, yy + more);
        let determinant = xx * yy - xy * xy;
        Solution {
            pull: [
                (yy * bx - xy * by) / determinant,
                (xx * by - xy * bx) / determinant,
            ],
            inverse: [yy / determinant, xx / determinant],
            solvable: xx + yy > 1e-3,
        }
    }

    /// Write how much the levels at some samples' new places are off, and which places count; `moving`: of what moves alone.
    fn lay(&mut self, motion: [f64; 2], every: usize, moving: bool) {
        let (height, width) = self.levels.dim();
        let (last_x, last_y) = ((width - 1) as f64, (height - 1) as f64);
        let (beside, below) = (1.min(width - 1), 1.min(height - 1));
        for at in (0..REGION_SAMPLES).step_by(every) {
            let part = &self.picture[at];
            let (x, y) = (
                f64::from(part[1]) + motion[0],
                f64::from(part[2]) + motion[1],
            );
            let mut inside = x >= 0.0 && x <= last_x && y >= 0.0 && y <= last_y;
            // A place that is no number is at the border.
            let (x, y) = (x.max(0.0).min(last_x), y.max(0.0).min(last_y));
            let left = (x as usize).min(width.saturating_sub(2));
            let top = (y as usize).min(height.saturating_sub(2));
            let (fx, fy) = (x - left as f64, y - top as f64);
            let level = |y: usize, x: usize| f64::from(self.levels[(y, x)].to_f32());
            let upper = level(top, left) * (1.0 - fx) + level(top, left + beside) * fx;
            let lower =
                level(top + below, left) * (1.0 - fx) + level(top + below, left + beside) * fx;
            if moving && inside {
                inside = self.mask[(y.round_ties_even() as usize, x.round_ties_even() as usize)];
            }
            self.work.off[at] = upper * (1.0 - fy) + lower * fy - f64::from(part[3]);
            self.work.seen[at] = inside;
        }
    }

    /// How far the levels differ within themselves, or from what the picture has where the thing was.
    fn contrast(&mut self) -> f64 {
        self.lay([0.0; 2], 1, false);
        let middle = self.middle_off(1);
        let (mut still, mut total) = (0.0, 0.0);
        for at in 0..REGION_SAMPLES {
            if self.work.seen[at] {
                let (weight, off) = (f64::from(self.picture[at][0]), self.work.off[at] - middle);
                still += weight * off * off;
                total += weight;
            }
        }
        let still = still / f64::max(total, 1e-9);
        for (at, part) in self.picture.iter().enumerate() {
            self.work.seen[at] = part[0] > 0.0;
            self.work.off[at] = f64::from(part[3]);
        }
        let middle = self.middle_off(1);
        let (mut own, mut total) = (0.0, 0.0);
        for part in self.picture {
            let (weight, off) = (f64::from(part[0]), f64::from(part[3]) - middle);
            own += weight * off * off;
            total += weight;
        }
        f64::max(own / f64::max(total, 1e-9), still).sqrt()
    }

    fn middle_off(&mut self, every: usize) -> f64 {
        self.middle(every, |off| off)
    }

    /// Median of what counts; 0 where nothing does.
    fn middle(&mut self, every: usize, of: impl Fn(f64) -> f64) -> f64 {
        let mut count = 0;
        for at in (0..REGION_SAMPLES).step_by(every) {
            if self.work.seen[at] {
                self.work.values[count] = of(self.work.off[at]);
                count += 1;
            }
        }
        if count == 0 {
            return 0.0;
        }
        let values = &mut self.work.values[..count];
        *values
            .select_nth_unstable_by((count - 1) / 2, f64::total_cmp)
            .1
    }
}

#[cfg(test)]
mod tests;
