//! The window of one point: its template in `prev`, and one comparison of it with `next`.
//!
//! A window is sampled at one sub-pixel offset for all its pixels, so sampling is a separable filter with constant
//! weights and needs no gathers. Rows are padded to whole lanes; what stands in the padding has no weight.

use crate::frame::Plane;
use crate::illumination::Illumination;
use crate::lanes::{LANES, LaneMask, Lanes};
use crate::pyramid::mirror;
use crate::simd::Kernel;

/// The largest window, in pixels a side.
pub(crate) const MAX_WINDOW: usize = 63;

/// Taps of the sampling filter, and the columns or rows that it reaches before a pixel.
const TAPS: usize = 4;
const BEFORE: isize = 1;

/// A template has one more sample on each side, for its gradient.
const MAX_SAMPLED: usize = (MAX_WINDOW + 2).next_multiple_of(LANES);
const MAX_PADDED: usize = MAX_WINDOW.next_multiple_of(LANES);
const MAX_REGION: usize = MAX_SAMPLED + TAPS;

/// How grey levels between pixels are had.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Sampling {
    /// Two taps: cheap; blurs more the further the offset is from a pixel.
    Linear,
    /// The cubic B-spline, without its prefilter: smooths alike at every offset, so that the offset leaves no bias.
    Spline,
}

impl Sampling {
    /// The weights of the four pixels around a position `fraction` after the second of them.
    fn weights(self, fraction: f32) -> [f32; TAPS] {
        let f = fraction;
        match self {
            Self::Linear => [0.0, 1.0 - f, f, 0.0],
            Self::Spline => {
                let g = 1.0 - f;
                let sixth = 1.0 / 6.0;
                [
                    g * g * g * sixth,
                    (f * f * (3.0 * f - 6.0) + 4.0) * sixth,
                    (g * g * (3.0 * g - 6.0) + 4.0) * sixth,
                    f * f * f * sixth,
                ]
            }
        }
    }
}

/// The size of a window, in pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Window {
    pub(crate) width: usize,
    pub(crate) height: usize,
}

impl Window {
    /// From the centre to the first pixel, along x and y.
    pub(crate) fn half(self) -> [f32; 2] {
        [
            (self.width as f32 - 1.0) * 0.5,
            (self.height as f32 - 1.0) * 0.5,
        ]
    }

    fn blocks(self) -> usize {
        self.width.div_ceil(LANES)
    }

    /// Pixels.
    pub(crate) fn area(self) -> f32 {
        (self.width * self.height) as f32
    }
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
    #[inline(always)]
    fn from(&self, row: usize, column: usize) -> &[f32] {
        &self.data[row * self.stride + column..]
    }
}

/// The `columns` by `rows` pixels of `plane` from (x, y) on: the plane's own where it has them all, a mirrored copy
/// where it has not.
fn region<'a>(
    plane: &'a Plane,
    (x, y): (isize, isize),
    columns: usize,
    rows: usize,
    scratch: &'a mut BorderScratch,
) -> Region<'a> {
    let (width, height) = (plane.width(), plane.height());
    if x >= 0 && y >= 0 && x as usize + columns <= width && y as usize + rows <= height {
        return Region {
            data: &plane.data()[y as usize * width + x as usize..],
            stride: width,
        };
    }
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
fn split(coordinate: f32) -> (isize, f32) {
    let floor = coordinate.floor();
    (floor as isize, coordinate - floor)
}

/// The window in `prev`, its gradient with the lighting taken out, and the normal equations.
#[derive(Debug)]
pub(crate) struct Template {
    window: Window,
    sampling: Sampling,
    /// Samples with one more on each side.
    samples: [f32; MAX_SAMPLED * (MAX_WINDOW + 2)],
    /// Intensity less its mean.
    intensity: [f32; MAX_PADDED * MAX_WINDOW],
    /// Gradients less what the lighting model explains of them.
    gradient: [[f32; MAX_PADDED * MAX_WINDOW]; 2],
    /// Sums over the window of products of the gradients: xx, xy, yy.
    pub(crate) tensor: [f64; 3],
    /// Sum of the squared intensity, and of its products with the plain gradients.
    pub(crate) intensity_sums: [f64; 3],
}

/// Sums over the window of the difference d = next - prev: with the gradients, the intensity, alone, and squared.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Sums {
    pub(crate) gradient: [f64; 2],
    pub(crate) intensity: f64,
    pub(crate) plain: f64,
    pub(crate) squared: f64,
}

impl Template {
    pub(crate) fn new() -> Self {
        Self {
            window: Window {
                width: 0,
                height: 0,
            },
            sampling: Sampling::Linear,
            samples: [0.0; _],
            intensity: [0.0; _],
            gradient: [[0.0; _]; 2],
            tensor: [0.0; 3],
            intensity_sums: [0.0; 3],
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
    pub(crate) illumination: Illumination,
    pub(crate) scratch: &'a mut BorderScratch,
}

impl Kernel for BuildTemplate<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self {
            template,
            window,
            sampling,
            illumination,
            ..
        } = self;
        template.window = window;
        template.sampling = sampling;
        let half = window.half();
        let (x, fx) = split(self.centre[0] - half[0] - 1.0);
        let (y, fy) = split(self.centre[1] - half[1] - 1.0);
        let blocks = (window.width + 2).div_ceil(LANES);
        let rows = window.height + 2;
        let region = region(
            self.prev,
            (x - BEFORE, y - BEFORE),
            blocks * LANES + TAPS - 1,
            rows + TAPS - 1,
            self.scratch,
        );
        let (wx, wy) = (sampling.weights(fx), sampling.weights(fy));
        match sampling {
            Sampling::Linear => {
                sample::<false>(region, wx, wy, blocks, rows, &mut template.samples)
            }
            Sampling::Spline => sample::<true>(region, wx, wy, blocks, rows, &mut template.samples),
        }
        match illumination {
            Illumination::None => normal_equations::<false, false>(template),
            Illumination::Offset => normal_equations::<true, false>(template),
            Illumination::GainOffset => normal_equations::<true, true>(template),
        }
    }
}

/// One row of the filter along x, at eight columns.
#[inline(always)]
fn across<const SPLINE: bool>(row: &[f32], weights: &[Lanes; TAPS]) -> Lanes {
    let inner = Lanes::load(&row[1..]) * weights[1] + Lanes::load(&row[2..]) * weights[2];
    if SPLINE {
        inner + (Lanes::load(row) * weights[0] + Lanes::load(&row[3..]) * weights[3])
    } else {
        inner
    }
}

/// The filter along y over four filtered rows.
#[inline(always)]
fn down<const SPLINE: bool>(rows: &[Lanes; TAPS], weights: &[Lanes; TAPS]) -> Lanes {
    let inner = rows[1] * weights[1] + rows[2] * weights[2];
    if SPLINE {
        inner + (rows[0] * weights[0] + rows[3] * weights[3])
    } else {
        inner
    }
}

/// Call `visit(row, sample)` for each of `rows` rows of the lanes from `column` on.
#[inline(always)]
fn sample_column<const SPLINE: bool>(
    region: Region<'_>,
    column: usize,
    rows: usize,
    wx: &[Lanes; TAPS],
    wy: &[Lanes; TAPS],
    mut visit: impl FnMut(usize, Lanes),
) {
    let mut filtered = [Lanes::ZERO; TAPS];
    for (row, lanes) in filtered[..TAPS - 1].iter_mut().enumerate() {
        if SPLINE || row > 0 {
            *lanes = across::<SPLINE>(region.from(row, column), wx);
        }
    }
    for row in 0..rows {
        // Without the spline the fourth row has no weight, and the third is the newest.
        if SPLINE {
            filtered[3] = across::<SPLINE>(region.from(row + 3, column), wx);
        } else {
            filtered[2] = across::<SPLINE>(region.from(row + 2, column), wx);
        }
        visit(row, down::<SPLINE>(&filtered, wy));
        if SPLINE {
            filtered = [filtered[1], filtered[2], filtered[3], Lanes::ZERO];
        } else {
            filtered[1] = filtered[2];
        }
    }
}

#[inline(always)]
fn splat_all(weights: [f32; TAPS]) -> [Lanes; TAPS] {
    let [a, b, c, d] = weights;
    [
        Lanes::splat(a),
        Lanes::splat(b),
        Lanes::splat(c),
        Lanes::splat(d),
    ]
}

#[inline(always)]
fn sample<const SPLINE: bool>(
    region: Region<'_>,
    wx: [f32; TAPS],
    wy: [f32; TAPS],
    blocks: usize,
    rows: usize,
    samples: &mut [f32],
) {
    let (wx, wy) = (splat_all(wx), splat_all(wy));
    for block in 0..blocks {
        let column = block * LANES;
        sample_column::<SPLINE>(region, column, rows, &wx, &wy, |row, value| {
            value.store(&mut samples[row * blocks * LANES + column..]);
        });
    }
}

/// Gradients by central differences, the part of them that the lighting model explains taken out, and their sums.
///
/// Central differences of the samples, not the derivative of the spline: the noise of a pixel is then uncorrelated
/// with the noise of the gradient there, at every sub-pixel offset, and cannot pull the solution.
#[inline(always)]
fn normal_equations<const OFFSET: bool, const GAIN: bool>(template: &mut Template) {
    let window = template.window;
    let blocks = window.blocks();
    let stride = blocks * LANES;
    let wide = (window.width + 2).div_ceil(LANES) * LANES;
    let half = Lanes::splat(0.5);
    let [gradient_x, gradient_y] = &mut template.gradient;
    let mut sums = [Lanes::ZERO; 3];
    for block in 0..blocks {
        let mask = LaneMask::first(window.width - block * LANES);
        for row in 0..window.height {
            let at = row * stride + block * LANES;
            let above = &template.samples[row * wide + block * LANES..];
            let here = &above[wide..];
            let below = &here[wide..];
            let a = Lanes::load(&here[1..]).keep(mask);
            let gx = ((Lanes::load(&here[2..]) - Lanes::load(here)) * half).keep(mask);
            let gy = ((Lanes::load(&below[1..]) - Lanes::load(&above[1..])) * half).keep(mask);
            a.store(&mut template.intensity[at..]);
            gx.store(&mut gradient_x[at..]);
            gy.store(&mut gradient_y[at..]);
            sums[0] += a;
            sums[1] += gx;
            sums[2] += gy;
        }
    }
    let area = window.area();
    let mean = sums.map(|sum| sum.sum() / area);
    let mean_a = Lanes::splat(mean[0]);
    let (mean_x, mean_y) = if OFFSET {
        (Lanes::splat(mean[1]), Lanes::splat(mean[2]))
    } else {
        (Lanes::ZERO, Lanes::ZERO)
    };
    let mut products = [Lanes::ZERO; 6];
    for block in 0..blocks {
        let mask = LaneMask::first(window.width - block * LANES);
        for row in 0..window.height {
            let at = row * stride + block * LANES;
            let a = (Lanes::load(&template.intensity[at..]) - mean_a).keep(mask);
            let gx = (Lanes::load(&gradient_x[at..]) - mean_x).keep(mask);
            let gy = (Lanes::load(&gradient_y[at..]) - mean_y).keep(mask);
            a.store(&mut template.intensity[at..]);
            gx.store(&mut gradient_x[at..]);
            gy.store(&mut gradient_y[at..]);
            products[0] += a * a;
            products[1] += a * gx;
            products[2] += a * gy;
            products[3] += gx * gx;
            products[4] += gx * gy;
            products[5] += gy * gy;
        }
    }
    let products = products.map(|lanes| f64::from(lanes.sum()));
    template.intensity_sums = [products[0], products[1], products[2]];
    template.tensor = [products[3], products[4], products[5]];
    if GAIN && products[0] > 0.0 {
        let slope_x = Lanes::splat((products[1] / products[0]) as f32);
        let slope_y = Lanes::splat((products[2] / products[0]) as f32);
        let mut tensor = [Lanes::ZERO; 3];
        for block in 0..blocks {
            for row in 0..window.height {
                let at = row * stride + block * LANES;
                let a = Lanes::load(&template.intensity[at..]);
                let gx = Lanes::load(&gradient_x[at..]) - a * slope_x;
                let gy = Lanes::load(&gradient_y[at..]) - a * slope_y;
                gx.store(&mut gradient_x[at..]);
                gy.store(&mut gradient_y[at..]);
                tensor[0] += gx * gx;
                tensor[1] += gx * gy;
                tensor[2] += gy * gy;
            }
        }
        template.tensor = tensor.map(|lanes| f64::from(lanes.sum()));
    }
}

/// Compare a [`Template`] with `next` around `centre`.
pub(crate) struct Compare<'a> {
    pub(crate) template: &'a Template,
    pub(crate) next: &'a Plane,
    pub(crate) centre: [f32; 2],
    pub(crate) scratch: &'a mut BorderScratch,
}

impl Kernel for Compare<'_> {
    type Output = Sums;

    #[inline(always)]
    fn run(self) -> Sums {
        match self.template.sampling {
            Sampling::Linear => compare::<false>(self),
            Sampling::Spline => compare::<true>(self),
        }
    }
}

#[inline(always)]
fn compare<const SPLINE: bool>(job: Compare<'_>) -> Sums {
    let template = job.template;
    let window = template.window;
    let half = window.half();
    let (x, fx) = split(job.centre[0] - half[0]);
    let (y, fy) = split(job.centre[1] - half[1]);
    let blocks = window.blocks();
    let stride = blocks * LANES;
    let wide = (window.width + 2).div_ceil(LANES) * LANES;
    let region = region(
        job.next,
        (x - BEFORE, y - BEFORE),
        stride + TAPS - 1,
        window.height + TAPS - 1,
        job.scratch,
    );
    let wx = splat_all(template.sampling.weights(fx));
    let wy = splat_all(template.sampling.weights(fy));
    let mut sums = [Lanes::ZERO; 5];
    for block in 0..blocks {
        let column = block * LANES;
        let mask = LaneMask::first(window.width - column);
        sample_column::<SPLINE>(region, column, window.height, &wx, &wy, |row, value| {
            let at = row * stride + column;
            let prev = Lanes::load(&template.samples[(row + 1) * wide + column + 1..]);
            let d = (value - prev).keep(mask);
            sums[0] += d * Lanes::load(&template.gradient[0][at..]);
            sums[1] += d * Lanes::load(&template.gradient[1][at..]);
            sums[2] += d * Lanes::load(&template.intensity[at..]);
            sums[3] += d;
            sums[4] += d * d;
        });
    }
    let [gx, gy, intensity, plain, squared] = sums.map(|lanes| f64::from(lanes.sum()));
    Sums {
        gradient: [gx, gy],
        intensity,
        plain,
        squared,
    }
}
