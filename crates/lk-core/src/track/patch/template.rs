//! The window in `prev`, its gradients, and their sums.

use super::differentiate::differentiate;
use super::joint::{Joint, Moments};
use super::light::Light;
use super::region::{
    BorderScratch, LEAST_STRIDE, MAX_SAMPLED, Region, SPLINE_BEFORE, SPLINE_TAPS, region, split,
};
use super::sampling::{Filtered, Linear, Sampling, Spline, pair, spline_weights};
use super::sums::{Cell, MAX_CELLS, TemplateSums};
use super::{MAX_SIDE, Window};
use crate::frame::Plane;
use crate::simd::{EIGHT, Eight, Kernel, Packed, Simd};
use crate::track::noise::Gradients;

/// The window in `prev`, its gradient, and their sums.
#[derive(Debug)]
pub(crate) struct Template {
    pub(crate) window: Window,
    pub(crate) sampling: Sampling,
    /// What may change in the light: only the sums that it needs are made.
    pub(super) light: Light,
    /// Samples with one more on each side, in rows of whole lanes, and a row more.
    samples: [f32; MAX_SAMPLED * (MAX_SIDE + 3)],
    /// Columns of eight pixels, one after the other, each from its top row down.
    pub(super) cells: [Cell; MAX_CELLS],
    /// Grey level of a pixel in the middle, from which `sums` counts the intensity.
    pub(super) level: f32,
    pub(crate) sums: TemplateSums,
    /// Of the whole window, while `sums` are of a part of it.
    pub(super) whole_sums: TemplateSums,
    /// The window's first sample.
    pub(super) corner: [f32; 2],
    /// Which of its pixels count, and sums over those.
    pub(super) joint: Joint,
    pub(super) moments: Moments,
}

impl Template {
    pub(crate) fn new() -> Self {
        let cell = Cell {
            prev: Packed::ZERO,
            gradient: [Packed::ZERO; 2],
        };
        Self {
            window: Window {
                width: 0,
                height: 0,
            },
            sampling: Sampling::Linear,
            light: Light::STEADY,
            samples: [0.0; _],
            cells: [cell; _],
            level: 0.0,
            sums: TemplateSums::default(),
            whole_sums: TemplateSums::default(),
            corner: [0.0; 2],
            joint: Joint::new(),
            moments: Moments::default(),
        }
    }

    /// The cells of a column of lanes, from the top row down.
    #[inline(always)]
    pub(super) fn column(&self, block: usize) -> &[Cell] {
        let height = self.window.height;
        &self.cells[block * height..][..height]
    }

    /// Pixels that count.
    pub(crate) fn area(&self) -> f64 {
        self.moments.area
    }

    /// Sums of the squares of the functions that an offset varies by, see [`Moments`].
    pub(crate) fn moments(&self) -> [f64; 2] {
        self.moments.squares
    }

    /// The window's first sample, (x, y) in `prev`.
    pub(crate) fn corner(&self) -> [f64; 2] {
        self.corner.map(f64::from)
    }

    /// Of a fine template.
    pub(crate) fn gradients(&self) -> Gradients {
        let sums = &self.sums;
        let area = self.area();
        let share = self.moments.pairs / area;
        let mean = [1, 2].map(|index| sums.plain[index] * sums.plain[index] / area);
        let energy = [sums.products[3] - mean[0], sums.products[5] - mean[1]];
        let lagged = [
            sums.lagged[0] - share * mean[0],
            sums.lagged[1] - share * mean[1],
        ];
        Gradients::new(energy, lagged, share, area)
    }
}

/// Fill a [`Template`] from `prev` around `centre`.
pub(crate) struct BuildTemplate<'a> {
    pub(crate) template: &'a mut Template,
    pub(crate) prev: &'a Plane,
    pub(crate) centre: [f32; 2],
    pub(crate) window: Window,
    pub(crate) sampling: Sampling,
    /// What may change in the light.
    pub(crate) light: Light,
    pub(crate) scratch: &'a mut BorderScratch,
}

impl Kernel for BuildTemplate<'_> {
    /// Where the template's centre is: `centre`, or near it at whole pixels.
    type Output = [f32; 2];

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> [f32; 2] {
        let Self {
            window, sampling, ..
        } = self;
        let template = &mut *self.template;
        template.window = window;
        template.sampling = sampling;
        template.light = self.light;
        let half = window.half();
        let corner = [self.centre[0] - half[0], self.centre[1] - half[1]];
        template.corner = corner;
        template.joint.reset();
        template.moments = Moments::whole(window);
        match sampling {
            Sampling::Linear => self.at_whole_pixels::<S::Eight>(corner),
            Sampling::Bouguet => self.interpolated::<S::Eight>(corner),
            Sampling::Spline => self.smoothed::<S::Eight>(corner),
        }
    }
}

impl BuildTemplate<'_> {
    /// From the pixels nearest to `corner`; where the centre is then.
    #[inline(always)]
    fn at_whole_pixels<L: Eight>(self, corner: [f32; 2]) -> [f32; 2] {
        let Self {
            template,
            window,
            light,
            ..
        } = self;
        let half = window.half();
        let [x, y] = [corner[0].round(), corner[1].round()];
        template.corner = [x, y];
        let place = (x as isize - 1, y as isize - 1);
        let (columns, rows) = (window.width + 2, window.height + 2);
        let region = region(self.prev, place, columns, rows, self.scratch);
        let cells = &mut template.cells;
        (template.level, template.sums) = match (light.changes(), light.has_tilt()) {
            (true, true) => differentiate::<L, false, false, true, true>(region, window, cells),
            (true, false) => differentiate::<L, false, false, true, false>(region, window, cells),
            (false, _) => differentiate::<L, false, false, false, false>(region, window, cells),
        };
        [x + half[0], y + half[1]]
    }

    /// Interpolated linearly, with Scharr's gradients.
    #[inline(always)]
    fn interpolated<L: Eight>(self, corner: [f32; 2]) -> [f32; 2] {
        let (template, window) = (self.template, self.window);
        let (x, fx) = split(corner[0] - 1.0);
        let (y, fy) = split(corner[1] - 1.0);
        let (columns, rows) = (window.width + 2, window.height + 2);
        let (blocks, stride) = blocks_and_stride(columns);
        let source = region(self.prev, (x, y), columns + 1, rows + 1, self.scratch);
        let (wx, wy) = (pair::<L>(fx), pair::<L>(fy));
        for block in 0..blocks {
            let at = block * EIGHT;
            let mut column = Linear::new(source, at, &wx);
            for to in template.samples[at..].chunks_exact_mut(stride).take(rows) {
                column.below(&wx, &wy).store(to, 0);
            }
        }
        let region = Region {
            data: &template.samples,
            stride,
        };
        let cells = &mut template.cells;
        (template.level, template.sums) =
            differentiate::<L, true, false, false, false>(region, window, cells);
        self.centre
    }

    /// Smoothed by the spline.
    #[inline(always)]
    fn smoothed<L: Eight>(self, corner: [f32; 2]) -> [f32; 2] {
        let (template, window) = (self.template, self.window);
        let (x, fx) = split(corner[0] - 1.0);
        let (y, fy) = split(corner[1] - 1.0);
        let (columns, rows) = (window.width + 2, window.height + 2);
        let (blocks, stride) = blocks_and_stride(columns);
        let source = region(
            self.prev,
            (x - SPLINE_BEFORE, y - SPLINE_BEFORE),
            columns + SPLINE_TAPS - 1,
            rows + SPLINE_TAPS - 1,
            self.scratch,
        );
        let (wx, wy) = (spline_weights::<L>(fx), spline_weights::<L>(fy));
        for block in 0..blocks {
            let mut column = Spline::new(source, block * EIGHT, &wx);
            let at = block * EIGHT;
            for to in template.samples[at..].chunks_exact_mut(stride).take(rows) {
                column.below(&wx, &wy).store(to, 0);
            }
        }
        let region = Region {
            data: &template.samples,
            stride,
        };
        let cells = &mut template.cells;
        (template.level, template.sums) = if self.light.changes() {
            differentiate::<L, false, true, true, true>(region, window, cells)
        } else {
            differentiate::<L, false, true, false, false>(region, window, cells)
        };
        self.centre
    }
}

/// Blocks of lanes that hold so many columns of samples, and the pixels from one row of them to the next.
#[inline(always)]
fn blocks_and_stride(columns: usize) -> (usize, usize) {
    let blocks = columns.div_ceil(EIGHT);
    let stride = (blocks * EIGHT).max(LEAST_STRIDE.next_multiple_of(EIGHT));
    (blocks, stride)
}
