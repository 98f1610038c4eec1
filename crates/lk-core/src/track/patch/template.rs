//! The window in `prev`, its gradients, and their sums.

use super::region::{BorderScratch, MAX_SAMPLED, Region, region, split};
use super::sampling::{SPLINE_BEFORE, SPLINE_TAPS, Sampling, Spline, linear, pair, spline_weights};
use super::{MAX_SIDE, Window};
use crate::frame::Plane;
use crate::simd::{EIGHT, Eight, EightKernel, Packed};
use crate::track::noise::Gradients;

const MAX_BLOCKS: usize = MAX_SIDE.div_ceil(EIGHT);

/// What a template holds for eight pixels of a row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cell {
    /// Grey levels of `prev`; 0 in the padding.
    pub(super) prev: Packed,
    /// Gradients along x and y; 0 in the padding.
    pub(super) gradient: [Packed; 2],
}

/// The window in `prev`, its gradient, and their sums.
#[derive(Debug)]
pub(crate) struct Template {
    pub(crate) window: Window,
    pub(crate) sampling: Sampling,
    /// Samples with one more on each side, in rows of whole lanes.
    samples: [f32; MAX_SAMPLED * (MAX_SIDE + 2) + EIGHT],
    /// Columns of eight pixels, one after the other, each from its top row down.
    pub(super) cells: [Cell; MAX_BLOCKS * MAX_SIDE],
    /// Grey level of a pixel in the middle, from which `sums` counts the intensity.
    pub(super) level: f32,
    pub(crate) sums: TemplateSums,
    /// The window's first sample.
    corner: [f32; 2],
}

/// Sums over the window of the intensity a and the gradients x and y.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct TemplateSums {
    /// Of a, x, y.
    pub(crate) plain: [f64; 3],
    /// Of a, x, y times the x coordinate from the window's centre.
    pub(crate) with_x: [f64; 3],
    /// Of a, x, y times the y coordinate from the window's centre.
    pub(crate) with_y: [f64; 3],
    /// Of aa, ax, ay, xx, xy, yy.
    pub(crate) products: [f64; 6],
    /// Of x and of y, each with its value one row above.
    pub(crate) lagged: [f64; 2],
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
            samples: [0.0; _],
            cells: [cell; _],
            level: 0.0,
            sums: TemplateSums::default(),
            corner: [0.0; 2],
        }
    }

    /// The window's first sample, (x, y) in `prev`.
    pub(crate) fn corner(&self) -> [f64; 2] {
        self.corner.map(f64::from)
    }

    /// Of a fine template.
    pub(crate) fn gradients(&self) -> Gradients {
        let sums = &self.sums;
        let area = self.window.area();
        let share = (self.window.height - 1) as f64 / self.window.height as f64;
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
    pub(crate) scratch: &'a mut BorderScratch,
}

impl EightKernel for BuildTemplate<'_> {
    /// Where the template's centre is: `centre`, or near it at whole pixels.
    type Output = [f32; 2];

    #[inline(always)]
    fn run<L: Eight>(self) -> [f32; 2] {
        let Self {
            template,
            window,
            sampling,
            ..
        } = self;
        template.window = window;
        template.sampling = sampling;
        let half = window.half();
        let corner = [self.centre[0] - half[0], self.centre[1] - half[1]];
        template.corner = corner;
        let (columns, rows) = (window.width + 2, window.height + 2);
        if sampling == Sampling::Linear {
            let [x, y] = [corner[0].round(), corner[1].round()];
            let place = (x as isize - 1, y as isize - 1);
            let region = region(self.prev, place, columns, rows, self.scratch);
            let cells = &mut template.cells;
            (template.level, template.sums) =
                differentiate::<L, false, false>(region, window, cells);
            return [x + half[0], y + half[1]];
        }
        let (x, fx) = split(corner[0] - 1.0);
        let (y, fy) = split(corner[1] - 1.0);
        let blocks = columns.div_ceil(EIGHT);
        if sampling == Sampling::Bouguet {
            let source = region(self.prev, (x, y), columns + 1, rows + 1, self.scratch);
            let (wx, wy) = (pair::<L>(fx), pair::<L>(fy));
            for block in 0..blocks {
                let at = block * EIGHT;
                let mut above = linear(source.reach(0, at), &wx);
                for row in 0..rows {
                    let below = linear(source.reach(row + 1, at), &wx);
                    let value = above * wy[0] + below * wy[1];
                    above = below;
                    value.store(&mut template.samples, row * blocks * EIGHT + at);
                }
            }
            let region = Region {
                data: &template.samples,
                stride: blocks * EIGHT,
            };
            let cells = &mut template.cells;
            (template.level, template.sums) =
                differentiate::<L, true, false>(region, window, cells);
            return self.centre;
        }
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
            for row in 0..rows {
                let at = (row * blocks + block) * EIGHT;
                column
                    .sample(row, &wx, &wy)
                    .store(&mut template.samples, at);
            }
        }
        let region = Region {
            data: &template.samples,
            stride: blocks * EIGHT,
        };
        (template.level, template.sums) =
            differentiate::<L, false, true>(region, window, &mut template.cells);
        self.centre
    }
}

/// Fill `cells` with grey levels and their gradients by central differences, and sum them.
///
/// Only a `FINE` template has sums with coordinates and with the row above.
///
/// Central differences of the samples, not the derivative of the spline: the noise of a pixel is then uncorrelated
/// with the noise of the gradient there, at every sub-pixel offset, and cannot pull the solution.
#[inline(always)]
fn differentiate<L: Eight, const SCHARR: bool, const FINE: bool>(
    region: Region<'_>,
    window: Window,
    cells: &mut [Cell],
) -> (f32, TemplateSums) {
    let (blocks, height) = (window.blocks(), window.height);
    // Grey levels from that of the middle: sums of their squares then keep their digits.
    let level = region.reach::<1>(height / 2 + 1, window.width / 2 + 1)[0];
    let (half, base) = (L::splat(0.5), L::splat(level));
    let (mut plain, mut with_x, mut with_y) = ([L::zero(); 3], [L::zero(); 3], [L::zero(); 3]);
    let (mut products, mut lagged) = ([L::zero(); 6], [L::zero(); 2]);
    for block in 0..blocks {
        let at = block * EIGHT;
        let mask = L::unpack(&Packed::first(window.width - at));
        let mut last = [L::zero(); 2];
        let mut column = [L::zero(); 3];
        let mut y = L::splat(-window.half()[1]);
        let mut above = L::load(region.reach::<EIGHT>(0, at + 1), 0);
        let mut here = L::load(region.reach::<EIGHT>(1, at + 1), 0);
        for (row, cell) in cells[block * height..][..height].iter_mut().enumerate() {
            let sides: &[f32; EIGHT + 2] = region.reach(row + 1, at);
            let below = L::load(region.reach::<EIGHT>(row + 2, at + 1), 0);
            let a = (here - base).keep(mask);
            let mut gx = (L::load(sides, 2) - L::load(sides, 0)) * half;
            let mut gy = (below - above) * half;
            if SCHARR {
                let up: &[f32; EIGHT + 2] = region.reach(row, at);
                let down: &[f32; EIGHT + 2] = region.reach(row + 2, at);
                let (outer, inner) = (L::splat(3.0 / 32.0), L::splat(10.0 / 16.0));
                let [left, right] = [
                    L::load(down, 0) - L::load(up, 0),
                    L::load(down, 2) - L::load(up, 2),
                ];
                gy = gy * inner + (left + right) * outer;
                let [top, bottom] = [
                    L::load(up, 2) - L::load(up, 0),
                    L::load(down, 2) - L::load(down, 0),
                ];
                gx = gx * inner + (top + bottom) * outer;
            }
            let (gx, gy) = (gx.keep(mask), gy.keep(mask));
            // What stands in the padding may be NaN, which no weight of 0 takes out of a sum.
            *cell = Cell {
                prev: here.keep(mask).pack(),
                gradient: [gx.pack(), gy.pack()],
            };
            (above, here) = (here, below);
            column[0] += a;
            column[1] += gx;
            column[2] += gy;
            if FINE {
                with_y[0] += a * y;
                with_y[1] += gx * y;
                with_y[2] += gy * y;
                y += L::splat(1.0);
                lagged[0] += gx * last[0];
                lagged[1] += gy * last[1];
                last = [gx, gy];
            }
            products[0] += a * a;
            products[1] += a * gx;
            products[2] += a * gy;
            products[3] += gx * gx;
            products[4] += gx * gy;
            products[5] += gy * gy;
        }
        let x = window.block_x::<L>(block);
        for index in 0..3 {
            plain[index] += column[index];
            with_x[index] += column[index] * x;
        }
    }
    let sums = TemplateSums {
        plain: L::sums(&plain),
        with_x: L::sums(&with_x),
        with_y: L::sums(&with_y),
        products: L::sums(&products),
        lagged: L::sums(&lagged),
    };
    (level, sums)
}
