//! One comparison of a template with `next`, and the sums that a step needs.

use super::Window;
use super::region::{BorderScratch, SPLINE_BEFORE, SPLINE_TAPS, region, split};
use super::sampling::{Filtered, Linear, Sampling, Spline, pair, spline_weights};
use super::sums::{Cell, Sums};
use super::template::Template;
use crate::frame::Plane;
use crate::simd::{EIGHT, Eight, Kernel, Simd};

/// Compare a [`Template`] with `next` around `centre`. Sums that only a change of light needs are those
/// that the template has.
pub(crate) struct Compare<'a> {
    pub(crate) template: &'a Template,
    pub(crate) next: &'a Plane,
    pub(crate) centre: [f32; 2],
    /// Whether to sum squares; a spline always does.
    pub(crate) squared: bool,
    pub(crate) scratch: &'a mut BorderScratch,
}

impl Kernel for Compare<'_> {
    type Output = Sums;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> Sums {
        let light = self.template.light;
        let spline = self.template.sampling == Sampling::Spline;
        if self.template.is_masked() {
            let template = self.template;
            let sums = if spline {
                self.spline::<S::Eight, true, true>()
            } else {
                self.linear::<S::Eight, true, true, true, true>()
            };
            return template.orthogonal(sums);
        }
        match (spline, light.changes(), light.has_tilt(), self.squared) {
            (true, true, ..) => self.spline::<S::Eight, true, false>(),
            (true, false, ..) => self.spline::<S::Eight, false, false>(),
            (false, true, true, _) => self.linear::<S::Eight, true, true, true, false>(),
            (false, true, false, true) => self.linear::<S::Eight, true, false, true, false>(),
            (false, true, false, false) => self.linear::<S::Eight, true, false, false, false>(),
            (false, false, _, true) => self.linear::<S::Eight, false, false, true, false>(),
            (false, false, _, false) => self.linear::<S::Eight, false, false, false, false>(),
        }
    }
}

impl Compare<'_> {
    #[inline(always)]
    fn linear<
        L: Eight,
        const LIGHT: bool,
        const TILT: bool,
        const SQUARED: bool,
        const MASKED: bool,
    >(
        self,
    ) -> Sums {
        let template = self.template;
        let window = template.window;
        let half = window.half();
        let (x, fx) = split(self.centre[0] - half[0]);
        let (y, fy) = split(self.centre[1] - half[1]);
        let (columns, rows) = (window.width + 1, window.height + 1);
        let region = region(self.next, (x, y), columns, rows, self.scratch);
        let (wx, wy) = (pair::<L>(fx), pair::<L>(fy));
        let mut sums = DifferenceSums::<L, LIGHT, TILT, SQUARED>::new(template);
        for block in 0..window.blocks() {
            let samples = Linear::new(region, block * EIGHT, &wx);
            sums.block::<_, MASKED>(template, block, samples, (&wx, &wy));
        }
        sums.finish()
    }

    #[inline(always)]
    fn spline<L: Eight, const LIGHT: bool, const MASKED: bool>(self) -> Sums {
        let template = self.template;
        let window = template.window;
        let half = window.half();
        let (x, fx) = split(self.centre[0] - half[0]);
        let (y, fy) = split(self.centre[1] - half[1]);
        let region = region(
            self.next,
            (x - SPLINE_BEFORE, y - SPLINE_BEFORE),
            window.width + SPLINE_TAPS - 1,
            window.height + SPLINE_TAPS - 1,
            self.scratch,
        );
        let (wx, wy) = (spline_weights::<L>(fx), spline_weights::<L>(fy));
        let mut sums = DifferenceSums::<L, LIGHT, LIGHT, true>::new(template);
        for block in 0..window.blocks() {
            let samples = Spline::new(region, block * EIGHT, &wx);
            sums.block::<_, MASKED>(template, block, samples, (&wx, &wy));
        }
        sums.finish()
    }
}

/// The sum of the absolute differences of a [`Template`] and `next` around `centre`.
pub(crate) struct AbsoluteDifference<'a>(pub(crate) Compare<'a>);

impl Kernel for AbsoluteDifference<'_> {
    type Output = f64;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> f64 {
        let Compare {
            template,
            next,
            centre,
            scratch,
            ..
        } = self.0;
        let window = template.window;
        let half = window.half();
        let (x, fx) = split(centre[0] - half[0]);
        let (y, fy) = split(centre[1] - half[1]);
        let (columns, rows) = (window.width + 1, window.height + 1);
        let region = region(next, (x, y), columns, rows, scratch);
        let (wx, wy) = (pair::<S::Eight>(fx), pair::<S::Eight>(fy));
        // All bits but the sign's.
        let magnitude = S::Eight::splat(f32::from_bits(0x7fff_ffff));
        let mut sum = S::Eight::zero();
        for block in 0..window.blocks() {
            let at = block * EIGHT;
            let mask = S::Eight::first(window.width - at);
            let mut samples = Linear::new(region, at, &wx);
            for cell in template.column(block) {
                let value = samples.below(&wx, &wy);
                sum += (value - S::Eight::unpack(&cell.prev))
                    .keep(mask)
                    .keep(magnitude);
            }
        }
        sum.sum()
    }
}

/// [`Sums`] as they grow: those of a change of light, of squares and of coordinates where they are wanted.
struct DifferenceSums<L, const LIGHT: bool, const TILT: bool, const SQUARED: bool> {
    level: L,
    products: [L; 3],
    plain: L,
    tilt: [L; 2],
    squared: L,
}

impl<L: Eight, const LIGHT: bool, const TILT: bool, const SQUARED: bool>
    DifferenceSums<L, LIGHT, TILT, SQUARED>
{
    #[inline(always)]
    fn new(template: &Template) -> Self {
        Self {
            level: L::splat(template.level),
            products: [L::zero(); 3],
            plain: L::zero(),
            tilt: [L::zero(); 2],
            squared: L::zero(),
        }
    }

    /// Add a block of lanes of the template, and the samples of `next` for it, from the top row down.
    #[inline(always)]
    fn block<F: Filtered<L>, const MASKED: bool>(
        &mut self,
        template: &Template,
        block: usize,
        mut samples: F,
        (wx, wy): (&F::Weights, &F::Weights),
    ) {
        let window = template.window;
        let mask = L::first(window.width - block * EIGHT);
        let mut columns = [L::zero(); 2];
        if MASKED {
            let keep = template.joint.column(block, window);
            for (cell, keep) in template.column(block).iter().zip(keep) {
                self.add(samples.below(wx, wy), cell, L::unpack(keep), &mut columns);
            }
        } else {
            for cell in template.column(block) {
                self.add(samples.below(wx, wy), cell, mask, &mut columns);
            }
        }
        self.close(columns, window, block);
    }

    /// Add eight pixels of a row, of `next` and of the template. `columns` are the sum of this column of lanes, and that
    /// of its sums after each row.
    #[inline(always)]
    fn add(&mut self, value: L, cell: &Cell, mask: L, columns: &mut [L; 2]) {
        let prev = L::unpack(&cell.prev);
        let d = (value - prev).keep(mask);
        self.products[1] += d * L::unpack(&cell.gradient[0]);
        self.products[2] += d * L::unpack(&cell.gradient[1]);
        if SQUARED {
            self.squared += d * d;
        }
        if LIGHT {
            self.products[0] += d * (prev - self.level);
            columns[0] += d;
        }
        if TILT {
            columns[1] += columns[0];
        }
    }

    /// Take in the sums of a column of lanes.
    #[inline(always)]
    fn close(&mut self, columns: [L; 2], window: Window, block: usize) {
        if LIGHT {
            self.plain += columns[0];
        }
        if TILT {
            self.tilt[0] += columns[0] * window.block_x(block);
            self.tilt[1] += window.with_y(columns);
        }
    }

    #[inline(always)]
    fn finish(self) -> Sums {
        let mut sums = Sums::default();
        let [intensity, x, y] = self.products;
        [sums.products[1], sums.products[2]] = L::sums(&[x, y]);
        if LIGHT {
            [sums.products[0], sums.plain] = L::sums(&[intensity, self.plain]);
        }
        if TILT {
            sums.tilt = L::sums(&self.tilt);
        }
        if SQUARED {
            sums.squared = self.squared.sum();
        }
        sums
    }
}
