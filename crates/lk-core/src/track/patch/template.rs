//! The window in `prev`, its gradients, and their sums.

use super::joint::{Joint, Moments};
use super::region::{BorderScratch, LEAST_STRIDE, MAX_SAMPLED, Region, region, split};
use super::sampling::{Linear, SPLINE_BEFORE, SPLINE_TAPS, Sampling, Spline, pair, spline_weights};
use super::{MAX_SIDE, Window};
use crate::frame::Plane;
use crate::simd::{EIGHT, Eight, EightKernel, Packed};
use crate::track::noise::Gradients;
use crate::track::normal::Light;

const MAX_BLOCKS: usize = MAX_SIDE.div_ceil(EIGHT);

/// Cells of the largest window.
pub(super) const MAX_CELLS: usize = MAX_BLOCKS * MAX_SIDE;

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

/// Sums over the window of the intensity a and the gradients x and y; 0 where they were not asked for.
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

impl EightKernel for BuildTemplate<'_> {
    /// Where the template's centre is: `centre`, or near it at whole pixels.
    type Output = [f32; 2];

    #[inline(always)]
    fn run<L: Eight>(self) -> [f32; 2] {
        let Self {
            template,
            window,
            sampling,
            light,
            ..
        } = self;
        template.window = window;
        template.sampling = sampling;
        template.light = light;
        let half = window.half();
        let corner = [self.centre[0] - half[0], self.centre[1] - half[1]];
        template.corner = corner;
        template.joint.reset();
        template.moments = Moments::whole(window);
        let (columns, rows) = (window.width + 2, window.height + 2);
        if sampling == Sampling::Linear {
            let [x, y] = [corner[0].round(), corner[1].round()];
            template.corner = [x, y];
            let place = (x as isize - 1, y as isize - 1);
            let region = region(self.prev, place, columns, rows, self.scratch);
            let cells = &mut template.cells;
            (template.level, template.sums) = match (light.changes(), light.has_tilt()) {
                (true, true) => differentiate::<L, false, false, true, true>(region, window, cells),
                (true, false) => {
                    differentiate::<L, false, false, true, false>(region, window, cells)
                }
                (false, _) => differentiate::<L, false, false, false, false>(region, window, cells),
            };
            return [x + half[0], y + half[1]];
        }
        let (x, fx) = split(corner[0] - 1.0);
        let (y, fy) = split(corner[1] - 1.0);
        let blocks = columns.div_ceil(EIGHT);
        let stride = (blocks * EIGHT).max(LEAST_STRIDE.next_multiple_of(EIGHT));
        if sampling == Sampling::Bouguet {
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
        (template.level, template.sums) = if light.changes() {
            differentiate::<L, false, true, true, true>(region, window, cells)
        } else {
            differentiate::<L, false, true, false, false>(region, window, cells)
        };
        self.centre
    }
}

/// Fill `cells` with grey levels and their gradients by central differences, and sum them.
///
/// Sums with the row above are made where `LAGGED`, those that a change of light needs where `LIGHT`, those with
/// coordinates where `TILT`.
///
/// Central differences of the samples, not the derivative of the spline: the noise of a pixel is then uncorrelated
/// with the noise of the gradient there, at every sub-pixel offset, and cannot pull the solution.
#[inline(always)]
fn differentiate<
    L: Eight,
    const SCHARR: bool,
    const LAGGED: bool,
    const LIGHT: bool,
    const TILT: bool,
>(
    region: Region<'_>,
    window: Window,
    cells: &mut [Cell],
) -> (f32, TemplateSums) {
    let (blocks, height) = (window.blocks(), window.height);
    // Grey levels from that of the middle: sums of their squares then keep their digits.
    let level = region.at(height / 2 + 1, window.width / 2 + 1);
    let (half, base) = (L::splat(0.5), L::splat(level));
    let mut total = TemplateLanes::<L>::new();
    for block in 0..blocks {
        let at = block * EIGHT;
        let mask = L::first(window.width - at);
        // Of this column of lanes: apart from those before, so that they stay in registers.
        let mut own = TemplateLanes::<L>::new();
        let mut running = [L::zero(); 3];
        let mut last = [L::zero(); 2];
        let mut rows = region.rows::<{ EIGHT + 2 }>(at);
        let (mut up, mut sides) = (rows.below(), rows.below());
        let (mut above, mut here) = (L::load(up, 1), L::load(sides, 1));
        for cell in &mut cells[block * height..][..height] {
            let down = rows.below();
            let below = L::load(down, 1);
            let a = (here - base).keep(mask);
            let mut gx = (L::load(sides, 2) - L::load(sides, 0)) * half;
            let mut gy = (below - above) * half;
            if SCHARR {
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
            (up, sides) = (sides, down);
            (above, here) = (here, below);
            own.plain[0] += a;
            own.products[0] += a * a;
            own.products[3] += gx * gx;
            own.products[4] += gx * gy;
            own.products[5] += gy * gy;
            if LIGHT {
                own.plain[1] += gx;
                own.plain[2] += gy;
                own.products[1] += a * gx;
                own.products[2] += a * gy;
            }
            if TILT {
                for (running, plain) in running.iter_mut().zip(own.plain) {
                    *running += plain;
                }
            }
            if LAGGED {
                own.lagged[0] += gx * last[0];
                own.lagged[1] += gy * last[1];
                last = [gx, gy];
            }
        }
        if TILT {
            let x = window.block_x::<L>(block);
            for (index, running) in running.into_iter().enumerate() {
                total.with_x[index] += own.plain[index] * x;
                total.with_y[index] += window.with_y([own.plain[index], running]);
            }
        }
        total.add(&own);
    }
    (level, total.finish::<LAGGED, LIGHT, TILT>())
}

/// [`TemplateSums`] as they grow.
struct TemplateLanes<L> {
    plain: [L; 3],
    with_x: [L; 3],
    with_y: [L; 3],
    products: [L; 6],
    lagged: [L; 2],
}

impl<L: Eight> TemplateLanes<L> {
    #[inline(always)]
    fn new() -> Self {
        Self {
            plain: [L::zero(); 3],
            with_x: [L::zero(); 3],
            with_y: [L::zero(); 3],
            products: [L::zero(); 6],
            lagged: [L::zero(); 2],
        }
    }

    /// Add what the pixels of `other` sum to, but for sums with coordinates.
    #[inline(always)]
    fn add(&mut self, other: &Self) {
        for (sum, other) in self.plain.iter_mut().zip(other.plain) {
            *sum += other;
        }
        for (sum, other) in self.products.iter_mut().zip(other.products) {
            *sum += other;
        }
        for (sum, other) in self.lagged.iter_mut().zip(other.lagged) {
            *sum += other;
        }
    }

    #[inline(always)]
    fn finish<const LAGGED: bool, const LIGHT: bool, const TILT: bool>(&self) -> TemplateSums {
        let mut sums = TemplateSums::default();
        if LIGHT {
            sums.plain = L::sums(&self.plain);
            sums.products = L::sums(&self.products);
        } else {
            let [aa, _, _, xx, xy, yy] = self.products;
            sums.plain[0] = self.plain[0].sum();
            let [aa, xx, xy, yy] = L::sums(&[aa, xx, xy, yy]);
            sums.products = [aa, 0.0, 0.0, xx, xy, yy];
        }
        if TILT {
            sums.with_x = L::sums(&self.with_x);
            sums.with_y = L::sums(&self.with_y);
        }
        if LAGGED {
            sums.lagged = L::sums(&self.lagged);
        }
        sums
    }
}
