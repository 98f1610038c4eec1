//! One comparison of a template with `next`, and the sums that a step needs.

use super::region::{BorderScratch, region, split};
use super::sampling::{SPLINE_BEFORE, SPLINE_TAPS, Sampling, Spline, linear, pair, spline_weights};
use super::template::{Cell, Template};
use crate::frame::Plane;
use crate::simd::{EIGHT, Eight, EightKernel, Packed};

/// Sums over the window of the difference d = next - prev.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sums {
    /// With the intensity and the gradients.
    pub(crate) products: [f64; 3],
    /// Alone.
    pub(crate) plain: f64,
    /// With the coordinates from the window's centre.
    pub(crate) tilt: [f64; 2],
    /// Squared.
    pub(crate) squared: f64,
}

/// Compare a [`Template`] with `next` around `centre`.
pub(crate) struct Compare<'a> {
    pub(crate) template: &'a Template,
    pub(crate) next: &'a Plane,
    pub(crate) centre: [f32; 2],
    pub(crate) scratch: &'a mut BorderScratch,
}

impl EightKernel for Compare<'_> {
    type Output = Sums;

    #[inline(always)]
    fn run<L: Eight>(self) -> Sums {
        let template = self.template;
        let window = template.window;
        let half = window.half();
        let (x, fx) = split(self.centre[0] - half[0]);
        let (y, fy) = split(self.centre[1] - half[1]);
        let (blocks, height) = (window.blocks(), window.height);
        let mut sums = DifferenceSums::<L>::new(template.level);
        if template.sampling != Sampling::Spline {
            let region = region(
                self.next,
                (x, y),
                window.width + 1,
                height + 1,
                self.scratch,
            );
            let (wx, wy) = (pair::<L>(fx), pair::<L>(fy));
            for block in 0..blocks {
                let at = block * EIGHT;
                let mask = L::unpack(&Packed::first(window.width - at));
                let mut above = linear(region.reach(0, at), &wx);
                let (mut column, mut y) = (L::zero(), L::splat(-half[1]));
                for (row, cell) in template.cells[block * height..][..height]
                    .iter()
                    .enumerate()
                {
                    let below = linear(region.reach(row + 1, at), &wx);
                    let value = above * wy[0] + below * wy[1];
                    above = below;
                    sums.add::<false>(value, cell, mask, &mut column, &mut y);
                }
                sums.close(column, window.block_x(block));
            }
        } else {
            let region = region(
                self.next,
                (x - SPLINE_BEFORE, y - SPLINE_BEFORE),
                window.width + SPLINE_TAPS - 1,
                height + SPLINE_TAPS - 1,
                self.scratch,
            );
            let (wx, wy) = (spline_weights::<L>(fx), spline_weights::<L>(fy));
            for block in 0..blocks {
                let at = block * EIGHT;
                let mask = L::unpack(&Packed::first(window.width - at));
                let mut samples = Spline::new(region, at, &wx);
                let (mut column, mut y) = (L::zero(), L::splat(-half[1]));
                for (row, cell) in template.cells[block * height..][..height]
                    .iter()
                    .enumerate()
                {
                    let value = samples.sample(row, &wx, &wy);
                    sums.add::<true>(value, cell, mask, &mut column, &mut y);
                }
                sums.close(column, window.block_x(block));
            }
        }
        sums.finish()
    }
}

/// The sum of the absolute differences of a [`Template`] and `next` around `centre`.
pub(crate) struct AbsoluteDifference<'a>(pub(crate) Compare<'a>);

impl EightKernel for AbsoluteDifference<'_> {
    type Output = f64;

    #[inline(always)]
    fn run<L: Eight>(self) -> f64 {
        let Compare {
            template,
            next,
            centre,
            scratch,
        } = self.0;
        let window = template.window;
        let half = window.half();
        let (x, fx) = split(centre[0] - half[0]);
        let (y, fy) = split(centre[1] - half[1]);
        let (columns, rows) = (window.width + 1, window.height + 1);
        let region = region(next, (x, y), columns, rows, scratch);
        let (wx, wy) = (pair::<L>(fx), pair::<L>(fy));
        // All bits but the sign's.
        let magnitude = L::splat(f32::from_bits(0x7fff_ffff));
        let mut sum = L::zero();
        for block in 0..window.blocks() {
            let at = block * EIGHT;
            let mask = L::unpack(&Packed::first(window.width - at));
            let cells = &template.cells[block * window.height..][..window.height];
            let mut above = linear(region.reach(0, at), &wx);
            for (row, cell) in cells.iter().enumerate() {
                let below = linear(region.reach(row + 1, at), &wx);
                let value = above * wy[0] + below * wy[1];
                above = below;
                sum += (value - L::unpack(&cell.prev)).keep(mask).keep(magnitude);
            }
        }
        sum.sum()
    }
}

/// [`Sums`] as they grow.
struct DifferenceSums<L> {
    level: L,
    products: [L; 3],
    plain: L,
    tilt: [L; 2],
    squared: L,
}

impl<L: Eight> DifferenceSums<L> {
    #[inline(always)]
    fn new(level: f32) -> Self {
        Self {
            level: L::splat(level),
            products: [L::zero(); 3],
            plain: L::zero(),
            tilt: [L::zero(); 2],
            squared: L::zero(),
        }
    }

    /// Add eight pixels of a row, of `next` and of the template.
    #[inline(always)]
    fn add<const FINE: bool>(&mut self, value: L, cell: &Cell, mask: L, column: &mut L, y: &mut L) {
        let prev = L::unpack(&cell.prev);
        let d = (value - prev).keep(mask);
        self.products[0] += d * (prev - self.level);
        self.products[1] += d * L::unpack(&cell.gradient[0]);
        self.products[2] += d * L::unpack(&cell.gradient[1]);
        self.squared += d * d;
        *column += d;
        if FINE {
            self.tilt[1] += d * *y;
            *y += L::splat(1.0);
        }
    }

    /// Take in the plain sum of a column of lanes with these x coordinates.
    #[inline(always)]
    fn close(&mut self, column: L, x: L) {
        self.plain += column;
        self.tilt[0] += column * x;
    }

    #[inline(always)]
    fn finish(self) -> Sums {
        Sums {
            products: L::sums(&self.products),
            plain: self.plain.sum(),
            tilt: L::sums(&self.tilt),
            squared: self.squared.sum(),
        }
    }
}
