//! The window of one point: its template in `prev`, and one comparison of it with `next`.
//!
//! A window is sampled at one sub-pixel offset for all its pixels, so sampling is a separable filter with constant
//! weights and needs no gathers. Rows are padded to whole lanes; what stands in the padding has no weight.
//!
//! The lighting model costs no pass over the pixels: what it explains is taken out of the sums, in
//! [`super::normal::Normal`].

use crate::frame::Plane;
use crate::pyramid::mirror;
use crate::simd::{EIGHT, Eight, EightKernel, Packed};

/// The largest window, in pixels a side.
pub(crate) const MAX_WINDOW: usize = 63;

/// Taps of the cubic B-spline, and the pixels that it reaches before a position.
const SPLINE_TAPS: usize = 4;
const SPLINE_BEFORE: isize = 1;

const MAX_BLOCKS: usize = MAX_WINDOW.div_ceil(EIGHT);
/// A template has one more sample on each side, for its gradient.
const MAX_SAMPLED: usize = (MAX_WINDOW + 2).next_multiple_of(EIGHT);
const MAX_REGION: usize = MAX_SAMPLED + SPLINE_TAPS;

/// How grey levels between pixels are had.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Sampling {
    /// Linearly, the template too, with Scharr's gradients: as Bouguet's and OpenCV's trackers have it.
    Bouguet,
    /// Linearly, and the template at whole pixels: cheap, but it blurs more the further the offset is from a pixel.
    Linear,
    /// By the cubic B-spline without its prefilter: it smooths alike at every offset, so that the offset leaves no
    /// bias.
    Spline,
}

/// The size of a window, in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Window {
    pub(crate) width: usize,
    pub(crate) height: usize,
}

impl Window {
    /// From the centre to the first pixel, along x and y.
    #[inline(always)]
    pub(crate) fn half(self) -> [f32; 2] {
        [
            (self.width as f32 - 1.0) * 0.5,
            (self.height as f32 - 1.0) * 0.5,
        ]
    }

    #[inline(always)]
    fn blocks(self) -> usize {
        self.width.div_ceil(EIGHT)
    }

    /// Pixels.
    #[inline(always)]
    pub(crate) fn area(self) -> f64 {
        (self.width * self.height) as f64
    }

    /// Sums over the window of x^2 and y^2, from its centre.
    #[inline(always)]
    pub(crate) fn moments(self) -> [f64; 2] {
        let (width, height) = (self.width as f64, self.height as f64);
        let twelfth = width * height / 12.0;
        [
            twelfth * (width * width - 1.0),
            twelfth * (height * height - 1.0),
        ]
    }

    /// The x coordinates of a block of lanes, from the window's centre.
    #[inline(always)]
    fn block_x<L: Eight>(self, block: usize) -> L {
        L::splat((block * EIGHT) as f32 - self.half()[0]) + L::unpack(&Packed::STEPS)
    }
}

/// The weights of the four pixels around a position `f` after the second of them.
#[inline(always)]
fn spline_weights<L: Eight>(f: f32) -> [L; SPLINE_TAPS] {
    let g = 1.0 - f;
    let sixth = 1.0 / 6.0;
    [
        L::splat(g * g * g * sixth),
        L::splat((f * f * (3.0 * f - 6.0) + 4.0) * sixth),
        L::splat((g * g * (3.0 * g - 6.0) + 4.0) * sixth),
        L::splat(f * f * f * sixth),
    ]
}

/// Memory for windows that reach over the border.
#[derive(Debug)]
pub(crate) struct BorderScratch([f32; MAX_REGION * MAX_REGION]);

impl BorderScratch {
    pub(crate) fn new() -> Self {
        Self([0.0; MAX_REGION * MAX_REGION])
    }
}

/// Pixels of a plane from a first one on, in rows `stride` apart.
#[derive(Debug, Clone, Copy)]
struct Region<'a> {
    data: &'a [f32],
    stride: usize,
}

impl Region<'_> {
    /// `N` pixels of `row` from `column` on.
    #[inline(always)]
    fn reach<const N: usize>(&self, row: usize, column: usize) -> &[f32; N] {
        let start = row * self.stride + column;
        match self.data[start..start + N].first_chunk() {
            Some(reach) => reach,
            // The slice above has this very length.
            None => &[0.0; N],
        }
    }
}

/// The `columns` by `rows` pixels of `plane` from (x, y) on, and memory to load whole lanes from after them: the
/// plane's own where it has them all, a mirrored copy where it has not.
#[inline(always)]
fn region<'a>(
    plane: &'a Plane,
    (x, y): (isize, isize),
    columns: usize,
    rows: usize,
    scratch: &'a mut BorderScratch,
) -> Region<'a> {
    let (width, height) = (plane.width(), plane.height());
    if x >= 0 && y >= 0 && x as usize + columns <= width && y as usize + rows <= height {
        let start = y as usize * width + x as usize;
        let data = &plane.data()[start..];
        // What is loaded beyond a row's end is the next row's start, and has no weight.
        if (rows - 1) * width + columns + EIGHT <= data.len() {
            return Region {
                data,
                stride: width,
            };
        }
    }
    mirrored(plane, (x, y), columns, rows, scratch)
}

/// [`region`] where the plane has not all of it.
#[cold]
#[inline(never)]
fn mirrored<'a>(
    plane: &Plane,
    (x, y): (isize, isize),
    columns: usize,
    rows: usize,
    scratch: &'a mut BorderScratch,
) -> Region<'a> {
    let (width, height) = (plane.width(), plane.height());
    let mut source = [0usize; MAX_REGION];
    for (column, from) in source[..columns].iter_mut().enumerate() {
        *from = mirror(x + column as isize, width);
    }
    for row in 0..rows {
        let from = plane.row(mirror(y + row as isize, height));
        let to = &mut scratch.0[row * MAX_REGION..row * MAX_REGION + columns];
        for (to, column) in to.iter_mut().zip(&source) {
            *to = from[*column];
        }
    }
    Region {
        data: &scratch.0,
        stride: MAX_REGION,
    }
}

/// The whole and the fractional part of a coordinate.
#[inline(always)]
fn split(coordinate: f32) -> (isize, f32) {
    let floor = coordinate.floor();
    (floor as isize, coordinate - floor)
}

/// What a template holds for eight pixels of a row.
#[derive(Debug, Clone, Copy)]
struct Cell {
    /// Grey levels of `prev`.
    prev: Packed,
    /// Gradients along x and y; 0 in the padding.
    gradient: [Packed; 2],
}

/// The window in `prev`, its gradient, and their sums.
#[derive(Debug)]
pub(crate) struct Template {
    pub(crate) window: Window,
    pub(crate) sampling: Sampling,
    /// Samples with one more on each side, in rows of whole lanes.
    samples: [f32; MAX_SAMPLED * (MAX_WINDOW + 2) + EIGHT],
    /// Columns of eight pixels, one after the other, each from its top row down.
    cells: [Cell; MAX_BLOCKS * MAX_WINDOW],
    /// Grey level of a pixel in the middle, from which `sums` counts the intensity.
    level: f32,
    pub(crate) sums: TemplateSums,
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
        }
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

/// Eight columns of a region, filtered by the spline row by row from the top.
struct Spline<'a, L> {
    region: Region<'a>,
    column: usize,
    /// The rows above the newest, filtered along x, the newest last.
    rows: [L; SPLINE_TAPS - 1],
}

impl<'a, L: Eight> Spline<'a, L> {
    #[inline(always)]
    fn new(region: Region<'a>, column: usize, wx: &[L; SPLINE_TAPS]) -> Self {
        Self {
            region,
            column,
            rows: [
                Self::across(region, 0, column, wx),
                Self::across(region, 1, column, wx),
                Self::across(region, 2, column, wx),
            ],
        }
    }

    #[inline(always)]
    fn across(region: Region<'a>, row: usize, column: usize, w: &[L; SPLINE_TAPS]) -> L {
        let row: &[f32; EIGHT + SPLINE_TAPS - 1] = region.reach(row, column);
        (L::load(row, 1) * w[1] + L::load(row, 2) * w[2])
            + (L::load(row, 0) * w[0] + L::load(row, 3) * w[3])
    }

    /// The samples of `row`; rows come in order.
    #[inline(always)]
    fn sample(&mut self, row: usize, wx: &[L; SPLINE_TAPS], wy: &[L; SPLINE_TAPS]) -> L {
        let [a, b, c] = self.rows;
        let newest = Self::across(self.region, row + 3, self.column, wx);
        self.rows = [b, c, newest];
        (b * wy[1] + c * wy[2]) + (a * wy[0] + newest * wy[3])
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
            *cell = Cell {
                prev: here.pack(),
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
        plain: plain.map(|lanes| lanes.sum()),
        with_x: with_x.map(|lanes| lanes.sum()),
        with_y: with_y.map(|lanes| lanes.sum()),
        products: products.map(|lanes| lanes.sum()),
        lagged: lagged.map(|lanes| lanes.sum()),
    };
    (level, sums)
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

/// The weights of the two pixels around a position `f` after the first.
#[inline(always)]
fn pair<L: Eight>(f: f32) -> [L; 2] {
    [L::splat(1.0 - f), L::splat(f)]
}

/// One row of linear interpolation along x.
#[inline(always)]
fn linear<L: Eight>(row: &[f32; EIGHT + 1], wx: &[L; 2]) -> L {
    L::load(row, 0) * wx[0] + L::load(row, 1) * wx[1]
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
        let [a, x, y] = self.products;
        Sums {
            products: [a.sum(), x.sum(), y.sum()],
            plain: self.plain.sum(),
            tilt: [self.tilt[0].sum(), self.tilt[1].sum()],
            squared: self.squared.sum(),
        }
    }
}
