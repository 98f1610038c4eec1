//! What a mask shows: its regions, with the motion, the grey levels and the picture in them.

use crate::error::{Error, Result};
use crate::frame::{Frame, Pixel, expect_size};
use crate::memory::{reserve, resize, zeros};

use super::components::Runs;

/// Motion and grey levels of a region are taken at so many places along each side of its box.
const ALONG: usize = 16;
/// Samples of a region.
pub const REGION_SAMPLES: usize = ALONG * ALONG;
/// What is kept of each sample of a picture: weight, x and y, level, and how that changes along x and y.
pub const SAMPLE_PARTS: usize = 6;
/// Grey levels fall into so many bins.
pub const REGION_BINS: usize = 16;
/// Share of a region's samples whose motion must be known for their median to be its motion.
const ENOUGH_MOTION: f64 = 0.3;
/// What moves by less than this share of the fastest tenth stands, if so much of the rest goes, and that tenth by so many
/// pixels per frame: what is chosen from noise by its length is too long.
const GOING: f64 = 0.3;
const LEAST_GOING: f64 = 0.25;
const LEAST_FASTEST_PX: f64 = 1.0;
/// Neighbouring pixels' motion is alike: so many count as one.
const ALIKE_PX: f64 = 50.0;
/// Samples so near to a region's outline show what is around it too.
const CORE_PX: usize = 2;
const RIM_WEIGHT: f32 = 0.5;

/// A region of a mask.
#[derive(Debug, Clone)]
#[non_exhaustive]
pub struct SeenRegion {
    /// First column and row, and those after its last ones.
    pub bounds: [usize; 4],
    /// Its pixels.
    pub area: usize,
    /// Their mean place.
    pub centre: [f64; 2],
    /// Columns and rows at which it is sampled: every row with every column.
    pub places: [[usize; ALONG]; 2],
    /// Which of the samples are its pixels.
    pub inside: [bool; REGION_SAMPLES],
    /// Median of the motion in it, NaN where too little of it is known, and the variance of that, infinite then.
    pub motion: [f64; 2],
    /// See `motion`.
    pub variance: [f64; 2],
    /// Shares of its grey levels; all zero without a picture.
    pub shares: [f64; REGION_BINS],
    /// Samples of its picture; all zero without one.
    pub picture: [[f32; SAMPLE_PARTS]; REGION_SAMPLES],
}

/// The regions of a mask, in the order of their first pixels.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct SeenRegions {
    /// The region at each pixel, row by row: its place among `regions` and one, 0 where there is none.
    pub labels: Vec<i32>,
    /// The regions.
    pub regions: Vec<SeenRegion>,
}

/// What is seen beside a mask.
#[derive(Debug, Clone, Copy)]
pub struct SeenBeside<'a, T> {
    /// Motion of each pixel, x and y; not finite where it is not known.
    pub motion: Option<&'a [f32]>,
    /// The frame.
    pub image: Option<Frame<'a, T>>,
}

/// Take a mask, `(height, width)`, apart into its regions by eight neighbours that have at least `least` pixels; `levels` is
/// the frame in levels of 256, smoothed, from which their pictures are taken.
///
/// # Errors
///
/// [`Error::Shape`] if the sizes do not fit together; [`Error::Memory`].
///
/// ```
/// use lk_core::{SeenBeside, see_regions};
/// use ndarray::array;
///
/// let mask = array![[true, true, false, false], [false, false, false, true]];
/// let nothing = SeenBeside::<u8> { motion: None, image: None };
/// let seen = see_regions::<u8, u8>(mask.view(), 1, nothing, None)?;
/// assert_eq!(seen.labels, [1, 1, 0, 0, 0, 0, 0, 2]);
/// assert_eq!((seen.regions[0].area, seen.regions[0].centre), (2, [0.5, 0.0]));
/// # Ok::<(), lk_core::Error>(())
/// ```
pub fn see_regions<T: Pixel, L: Pixel>(
    mask: ndarray::ArrayView2<'_, bool>,
    least: usize,
    beside: SeenBeside<'_, T>,
    levels: Option<Frame<'_, L>>,
) -> Result<SeenRegions> {
    let (height, width) = mask.dim();
    let pixels = width * height;
    for size in [
        beside.image.map(|image| image.dim()),
        levels.map(|levels| levels.dim()),
    ] {
        expect_size("image", size.unwrap_or(mask.dim()), "the mask", mask.dim())?;
    }
    if let Some(motion) = beside.motion.filter(|motion| motion.len() != 2 * pixels) {
        let (got, wanted) = (motion.len().to_string(), (2 * pixels).to_string());
        return Err(Error::shape("motion", got, wanted));
    }
    let runs = labelled(mask, least)?;
    let mut seen = SeenRegions {
        labels: zeros("labels", pixels)?,
        regions: Vec::new(),
    };
    let mut sums = Vec::new();
    resize(
        "sums of regions",
        &mut sums,
        runs.regions().len(),
        [0u64; 2],
    )?;
    for run in runs.runs() {
        seen.labels[run.place(width)].fill(run.label as i32 + 1);
        let (count, ends) = (
            u64::from(run.end - run.start),
            u64::from(run.end + run.start - 1),
        );
        let sums = &mut sums[run.label as usize];
        sums[0] += count * ends / 2;
        sums[1] += count * u64::from(run.y);
    }
    reserve("regions", &mut seen.regions, sums.len())?;
    for (label, (region, sums)) in runs.regions().iter().zip(&sums).enumerate() {
        let bounds =
            [region.left, region.top, region.right, region.bottom].map(|edge| edge as usize);
        let area = region.area as usize;
        let places = [0, 1].map(|axis| along(bounds[axis], bounds[axis + 2]));
        let mut of = SeenRegion {
            bounds,
            area,
            centre: sums.map(|sum| sum as f64 / area as f64),
            places,
            inside: [false; REGION_SAMPLES],
            motion: [f64::NAN; 2],
            variance: [f64::INFINITY; 2],
            shares: [0.0; REGION_BINS],
            picture: [[0.0; SAMPLE_PARTS]; REGION_SAMPLES],
        };
        let number = label as i32 + 1;
        of.see_inside(&seen.labels, width, number);
        if let Some(motion) = beside.motion {
            of.see_motion(motion, width);
        }
        if let Some(image) = beside.image {
            of.see_levels(image);
        }
        if let Some(levels) = levels {
            of.see_picture(levels, &seen.labels, number);
        }
        seen.regions.push(of);
    }
    Ok(seen)
}

/// The regions of a mask with at least `least` pixels.
fn labelled(mask: ndarray::ArrayView2<'_, bool>, least: usize) -> Result<Runs> {
    let (height, width) = mask.dim();
    let mut runs = Runs::default();
    let mut row = Vec::new();
    resize("a row of a mask", &mut row, width, 0u8)?;
    runs.begin((width, height))?;
    for (y, from) in mask.outer_iter().enumerate() {
        for (to, from) in row.iter_mut().zip(&from) {
            *to = u8::from(*from);
        }
        runs.take_row(y, &row, 0)?;
    }
    runs.join(super::components::Neighbours::Eight)?;
    runs.keep(|_, region| region.area as usize >= least)?;
    Ok(runs)
}

/// Places within a range, evenly.
fn along(start: usize, end: usize) -> [usize; ALONG] {
    let mut places = [0; ALONG];
    for (k, place) in places.iter_mut().enumerate() {
        let step = (k as f64 + 0.5) / ALONG as f64;
        *place = (start as f64 + (end - start) as f64 * step) as usize;
    }
    places
}

impl SeenRegion {
    /// Column and row of a sample.
    fn place(&self, sample: usize) -> [usize; 2] {
        [
            self.places[0][sample % ALONG],
            self.places[1][sample / ALONG],
        ]
    }

    fn see_inside(&mut self, labels: &[i32], width: usize, number: i32) {
        for sample in 0..REGION_SAMPLES {
            let [x, y] = self.place(sample);
            self.inside[sample] = labels[y * width + x] == number;
        }
    }

    /// Median of the motion that is known; the lower of two middle ones.
    fn see_motion(&mut self, motion: &[f32], width: usize) {
        let (mut known, mut count) = ([[0.0; 3]; REGION_SAMPLES], 0);
        let mut within = 0;
        for sample in 0..REGION_SAMPLES {
            if !self.inside[sample] {
                continue;
            }
            within += 1;
            let [x, y] = self.place(sample);
            let at = 2 * (y * width + x);
            let [u, v] = [motion[at], motion[at + 1]].map(f64::from);
            if u.is_finite() && v.is_finite() {
                known[count] = [u, v, u.hypot(v)];
                count += 1;
            }
        }
        let told = count;
        if told == 0 || (told as f64) < ENOUGH_MOTION * within as f64 {
            return;
        }
        let mut values = [0.0; REGION_SAMPLES];
        let lengths = &mut values[..told];
        for (to, from) in lengths.iter_mut().zip(&known) {
            *to = from[2];
        }
        lengths.sort_unstable_by(f64::total_cmp);
        // What stands in a region that goes is shadow and pavement around a thing.
        let high = lengths[told - 1 - (told / 10).min(told - 1)];
        let goes = |vector: &[f64; 3]| vector[2] >= GOING * high;
        let going = known[..told].iter().filter(|vector| goes(vector)).count();
        let mut count = told;
        if going as f64 >= LEAST_GOING * told as f64 && high >= LEAST_FASTEST_PX {
            count = 0;
            for at in 0..told {
                if goes(&known[at]) {
                    known[count] = known[at];
                    count += 1;
                }
            }
        }
        let free = self.area as f64 * (count as f64 / within.max(1) as f64) / ALIKE_PX;
        let free = free.max(1.0).min(count as f64);
        for axis in 0..2 {
            let values = &mut values[..count];
            for (to, from) in values.iter_mut().zip(&known) {
                *to = from[axis];
            }
            values.sort_unstable_by(f64::total_cmp);
            let [low, median, high] = [1, 2, 3].map(|part| values[(count - 1) * part / 4]);
            // Of normal values a quarter of the range between the quartiles is 0.337 deviations, of a median 1.25 over
            // the root.
            let spread = (high - low) * (0.7413 * 1.2533);
            self.motion[axis] = median;
            self.variance[axis] = spread * spread / free;
        }
    }

    fn see_levels<T: Pixel>(&mut self, image: Frame<'_, T>) {
        let top = match T::DEPTH {
            Some(8) | None => 256.0,
            Some(bits) => f64::from(1u32 << bits),
        };
        let (mut counts, mut all) = ([0u32; REGION_BINS], 0u32);
        for sample in 0..REGION_SAMPLES {
            if self.inside[sample] {
                let [x, y] = self.place(sample);
                let level = f64::from(image[(y, x)].to_f32()) * (REGION_BINS as f64 / top);
                // What is no number, or below 0, is 0.
                counts[(level as usize).min(REGION_BINS - 1)] += 1;
                all += 1;
            }
        }
        for (share, count) in self.shares.iter_mut().zip(counts) {
            *share = f64::from(count) / f64::from(all.max(1));
        }
    }

    fn see_picture<L: Pixel>(&mut self, levels: Frame<'_, L>, labels: &[i32], number: i32) {
        let (height, width) = levels.dim();
        let count = self.inside.iter().filter(|inside| **inside).count().max(1);
        // Of a small region some places are taken twice.
        let share = (self.area as f64 / count as f64).min(1.0) as f32;
        let of = |y: usize, x: usize| labels[y * width + x] == number;
        for sample in 0..REGION_SAMPLES {
            let [x, y] = self.place(sample);
            let (left, up) = (x.saturating_sub(CORE_PX), y.saturating_sub(CORE_PX));
            let (right, down) = ((x + CORE_PX).min(width - 1), (y + CORE_PX).min(height - 1));
            let core = of(y, left) && of(y, right) && of(up, x) && of(down, x);
            let weight = match (self.inside[sample], core) {
                (false, _) => 0.0,
                (true, true) => share,
                (true, false) => RIM_WEIGHT * share,
            };
            let level = |y: usize, x: usize| levels[(y, x)].to_f32();
            let across = level(y, (x + 1).min(width - 1)) - level(y, x.saturating_sub(1));
            let down = level((y + 1).min(height - 1), x) - level(y.saturating_sub(1), x);
            let place = [x as f32, y as f32];
            self.picture[sample] = [
                weight,
                place[0],
                place[1],
                level(y, x),
                across / 2.0,
                down / 2.0,
            ];
        }
    }
}

#[cfg(test)]
mod tests;
