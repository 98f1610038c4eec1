//! Where a small patch went, however far and however turned: every place of a coarse level under a set of rotations
//! and scales, by normalised correlation.
//!
//! One patch costs some 0.3 ms, so it is asked of a few points only, from which the others find their way.

use crate::error::Result;
use crate::frame::Plane;
use crate::scratch::with_scratch;
use crate::simd::{EIGHT, Kernel, Simd, SimdLevel, dispatch};
use crate::track::affine::sample::{Copied, Filter, SampleWarped};
use crate::track::affine::warp::{Positions, Warp};
use crate::track::patch::Window;

/// Side of the patch in pixels of the coarse level: it has to tell places apart, and to stay within one motion.
const SIDE: usize = 11;
const AREA: usize = SIDE * SIDE;
const PATCH: Window = Window {
    width: SIDE,
    height: SIDE,
};

/// Longest side, in pixels, of the level that is searched.
const LONGEST: usize = 100;

/// Rotations tried, in degrees, and scales: half a step is some 0.6 pixels at the patch's rim.
const ANGLES: [f64; 5] = [-24.0, -12.0, 0.0, 12.0, 24.0];
const SCALES: [f64; 5] = [0.8, 0.89, 1.0, 1.12, 1.25];

/// Displacements searched, as a share of the frame's width and height.
const RANGE: f64 = 0.25;

/// Correlation from which a place is worth a closer look: unrelated texture reaches some 0.65 among all places.
const LEAST_CORRELATION: f32 = 0.7;

/// Places looked at more closely.
pub(in crate::track) const PLACES: usize = 3;

/// Deviation of the grey levels of a patch below which it tells nothing.
const LEAST_DEVIATION: f32 = 1.0;

/// Both frames at the level that is searched.
#[derive(Debug)]
pub(in crate::track) struct Search<'a> {
    prev: &'a Plane,
    next: &'a Plane,
    level: usize,
    simd: SimdLevel,
    /// The largest displacement in pixels of the level.
    reach: [isize; 2],
    /// One over the deviation of each patch of `next`, times its area's root, by its middle; 0 where it has none.
    scale: &'a Plane,
}

/// Memory of a search that is kept from frame to frame.
#[derive(Debug, Default)]
pub(in crate::track) struct Workspace {
    scale: Plane,
}

impl Workspace {
    /// Make room for any level that is searched.
    pub(in crate::track) fn reserve(&mut self) -> Result<()> {
        self.scale.resize(LONGEST, LONGEST)
    }
}

/// The best places so far.
#[derive(Debug, Clone, Copy)]
struct Places {
    list: [(f32, Warp); PLACES],
    count: usize,
}

impl Places {
    fn add(&mut self, correlation: f32, warp: Warp) {
        // The neighbours of a place under a like warp lead to the same one: keep the best of them.
        let near =
            |other: &Warp| (0..2).all(|axis| (other.shift[axis] - warp.shift[axis]).abs() < 2.5);
        let known = (0..self.count).find(|place| near(&self.list[*place].1));
        let slot = match known {
            Some(place) => place,
            None if self.count < PLACES => {
                self.count += 1;
                self.list[self.count - 1].0 = f32::MIN;
                self.count - 1
            }
            None => PLACES - 1,
        };
        if correlation > self.list[slot].0 {
            self.list[slot] = (correlation, warp);
            self.list[..self.count].sort_by(|a, b| b.0.total_cmp(&a.0));
        }
    }
}

impl<'a> Search<'a> {
    pub(in crate::track) fn new(
        workspace: &'a mut Workspace,
        prev: &'a [Plane],
        next: &'a [Plane],
        longest: Option<f32>,
        simd: SimdLevel,
    ) -> Result<Self> {
        let level = prev
            .iter()
            .position(|plane| plane.width().max(plane.height()) <= LONGEST)
            .unwrap_or(prev.len() - 1);
        let (prev, next) = (&prev[level], &next[level]);
        let limit = longest.map_or(f64::INFINITY, |longest| {
            f64::from(longest) / f64::from(1u32 << level) + 1.0
        });
        let reach = [next.width(), next.height()]
            .map(|size| (size as f64 * RANGE).min(limit).ceil() as isize);
        deviations(next, &mut workspace.scale)?;
        Ok(Self {
            prev,
            next,
            level,
            simd,
            reach,
            scale: &workspace.scale,
        })
    }

    /// The level whose pixels the search knows.
    pub(in crate::track) fn level(&self) -> usize {
        self.level
    }

    /// Where the patch around `point`, in pixels of the frame, may have gone; the best first. The shifts are in pixels
    /// of the frame, right to about one of the level.
    pub(in crate::track) fn find(
        &self,
        point: [f32; 2],
        copied: &mut Copied,
        mut found: impl FnMut(Warp),
    ) -> Result<()> {
        let factor = f64::from(1u32 << self.level);
        let centre = point.map(|coordinate| f64::from(coordinate) / factor);
        let whole = centre.map(|coordinate| coordinate.round() as isize);
        let half = (SIDE / 2) as isize;
        // Middles of patches that lie inside of `next`.
        let within = |axis: usize, size: usize| {
            let first = (whole[axis] - self.reach[axis]).max(half);
            let last = (whole[axis] + self.reach[axis]).min(size as isize - 1 - half);
            (last >= first).then(|| (first as usize, (last - first + 1) as usize))
        };
        let (Some((left, columns)), Some((top, rows))) =
            (within(0, self.next.width()), within(1, self.next.height()))
        else {
            return Ok(());
        };
        let mut places = Places {
            list: [(f32::MIN, Warp::shift([0.0; 2])); PLACES],
            count: 0,
        };
        with_scratch(columns, |products| {
            for angle in ANGLES {
                for scale in SCALES {
                    let (sin, cos) = angle.to_radians().sin_cos();
                    let matrix = [[scale * cos, -scale * sin], [scale * sin, scale * cos]];
                    let warp = Warp {
                        shift: [0.0; 2],
                        matrix,
                    };
                    let Some(patch) = self.turned(centre, warp, copied) else {
                        continue;
                    };
                    for row in 0..rows {
                        let y = top + row;
                        dispatch(
                            self.simd,
                            Correlate {
                                next: self.next,
                                patch: &patch,
                                first: (left - SIDE / 2, y - SIDE / 2),
                                products: &mut *products,
                            },
                        );
                        let scales = &self.scale.row(y)[left..][..columns];
                        for (column, (product, scale)) in products.iter().zip(scales).enumerate() {
                            let correlation = product * scale;
                            if correlation > LEAST_CORRELATION {
                                let shift =
                                    [(left + column) as f64 - centre[0], y as f64 - centre[1]];
                                places.add(correlation, Warp { shift, matrix });
                            }
                        }
                    }
                }
            }
        })?;
        for (_, warp) in &places.list[..places.count] {
            found(warp.scaled(factor));
        }
        Ok(())
    }
}

impl Search<'_> {
    /// The patch around `centre` as it comes to stand in `next`, without its mean and of length 1; `None` where it is not
    /// inside of `prev` or has nothing to compare.
    fn turned(&self, centre: [f64; 2], warp: Warp, copied: &mut Copied) -> Option<[f32; AREA]> {
        let mut sampled = [0.0f32; AREA + EIGHT];
        let near = dispatch(
            self.simd,
            SampleWarped {
                plane: self.prev,
                positions: Positions::around(centre, warp.inverse().matrix, PATCH, 0),
                filter: Filter::Spline,
                copied,
                to: &mut sampled,
                stride: SIDE,
            },
        );
        let mut patch = [0.0f32; AREA];
        patch.copy_from_slice(&sampled[..AREA]);
        (near && normalise(&mut patch)).then_some(patch)
    }
}

/// Take out the mean and scale to length 1; false where there is nothing to scale.
fn normalise(patch: &mut [f32; AREA]) -> bool {
    let mean = patch.iter().sum::<f32>() / AREA as f32;
    let mut squares = 0.0;
    for value in patch.iter_mut() {
        *value -= mean;
        squares += *value * *value;
    }
    let textured = squares > LEAST_DEVIATION * LEAST_DEVIATION * AREA as f32;
    if textured && squares.is_finite() {
        let scale = squares.sqrt().recip();
        patch.iter_mut().for_each(|value| *value *= scale);
    }
    textured && squares.is_finite()
}

/// One over the length of each patch of `plane` without its mean, by its middle.
fn deviations(plane: &Plane, lengths: &mut Plane) -> Result<()> {
    let (width, height) = (plane.width(), plane.height());
    lengths.resize(width, height)?;
    lengths.data_mut().fill(0.0);
    let half = SIDE / 2;
    for y in half..height.saturating_sub(half) {
        for x in half..width.saturating_sub(half) {
            let (mut sum, mut squares) = (0.0f64, 0.0f64);
            for row in y - half..=y + half {
                for value in &plane.row(row)[x - half..=x + half] {
                    let value = f64::from(*value);
                    sum += value;
                    squares += value * value;
                }
            }
            let length = squares - sum * sum / AREA as f64;
            let least = f64::from(LEAST_DEVIATION * LEAST_DEVIATION) * AREA as f64;
            if length > least && length.is_finite() {
                lengths.row_mut(y)[x] = length.sqrt().recip() as f32;
            }
        }
    }
    Ok(())
}

/// The products of a patch with those of a row, from the one with its top left pixel at `first` on.
struct Correlate<'a> {
    next: &'a Plane,
    patch: &'a [f32; AREA],
    first: (usize, usize),
    products: &'a mut [f32],
}

impl Kernel for Correlate<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let (left, top) = self.first;
        let count = self.products.len();
        self.products.fill(0.0);
        for (row, weights) in self.patch.chunks_exact(SIDE).enumerate() {
            let pixels = &self.next.row(top + row)[left..][..count + SIDE - 1];
            for (tap, weight) in weights.iter().enumerate() {
                let shifted = &pixels[tap..][..count];
                for (product, pixel) in self.products.iter_mut().zip(shifted) {
                    *product += weight * pixel;
                }
            }
        }
    }
}
