//! The change of light between two pictures, as a gain and an offset that vary slowly over the picture.
//!
//! Both come from the means and the deviations of large windows of `prev` and of warped `next`, on coarse levels,
//! where large windows are cheap. `prev` is then given the light of `next`, so that what remains for the small windows
//! of the flow is an offset. A ratio of deviations, unlike a regression, is not drawn to zero where the flow is not yet
//! right.
//!
//! `docs/explanation/algorithms.md`, section "Slow light".

use crate::error::Result;
use crate::frame::Plane;
use crate::memory::resize;
use crate::simd::{Kernel, Simd, SimdLevel, dispatch};

use super::padded_plane::{self, PAD};
use super::warp::WarpRow;
use super::windows::Views;

/// What memory here holds.
const SUMS: &str = "sums of grey levels";

/// Half the windows of the trend of the light over the picture, and of what differs locally, in pixels of coarse levels.
pub(super) const LIGHT_RADII: (usize, usize) = (3, 8);

/// Gains outside of this range are no change of light.
const GAIN: std::ops::RangeInclusive<f64> = 0.2..=5.0;

/// Share of the picture's own variance that is added to a window's: a window without texture takes the gain of the
/// picture.
const PRIOR: f64 = 0.02;

/// Gain and offset at each pixel of a coarse level, and the memory to find them.
#[derive(Debug, Default)]
pub(super) struct Light {
    pub(super) gain: Plane,
    pub(super) offset: Plane,
    /// Integral images of: weight, p, p p, w, w w.
    integral: Vec<[f64; 5]>,
    rows: Vec<f32>,
    /// A row of sums of both frames, which nothing here needs.
    sum: Vec<f32>,
}

impl Light {
    /// Find gain and offset for the flow of `input`: a trend over the whole picture from windows of `2 small + 1`, and
    /// what windows of `2 large + 1` say beyond it.
    pub(super) fn estimate(
        &mut self,
        input: Views<'_>,
        (small, large): (usize, usize),
        level: SimdLevel,
    ) -> Result<()> {
        let (width, height) = (input.prev.width(), input.prev.height());
        self.begin(width, height)?;
        self.accumulate(input, level)?;
        let whole = self.moments(width, (0, 0), (width, height));
        let gain_trend = self.gain_trend(small, 1, whole).solve();
        let gain = |x: usize, y: usize| gain_trend(x, y).exp().clamp(*GAIN.start(), *GAIN.end());
        let mut offset_trend = Trend::default();
        for y in 0..height {
            for x in 0..width {
                let [n, p, _, w, ..] = self.around(x, y, small);
                if n > 0.0 {
                    offset_trend.add(x, y, w - gain(x, y) * p, 1.0);
                }
            }
        }
        let offset = offset_trend.solve();
        for y in 0..height {
            for x in 0..width {
                self.gain.row_mut(y)[x] = gain(x, y) as f32;
                self.offset.row_mut(y)[x] = offset(x, y) as f32;
            }
        }
        if 2 * large >= width.min(height) {
            return Ok(());
        }
        self.accumulate(input, level)?;
        let whole = self.moments(width, (0, 0), (width, height));
        for y in 0..height {
            for x in 0..width {
                let (gain, offset) = model(self.around(x, y, large), whole);
                let (trend_gain, trend_offset) =
                    (&mut self.gain.row_mut(y)[x], &mut self.offset.row_mut(y)[x]);
                *trend_gain *= gain as f32;
                *trend_offset = *trend_offset * gain as f32 + offset as f32;
            }
        }
        Ok(())
    }

    /// How far the light of `next` is from that of `prev`, without regard to motion: the largest logarithm of the gain
    /// of a trend over the picture, and the root mean square of what windows of `2 radius + 1` pixels say beyond it.
    pub(super) fn change(
        &mut self,
        prev: &Plane,
        next: &Plane,
        weight: Option<&Plane>,
        radius: usize,
    ) -> Result<[f64; 2]> {
        self.begin(prev.width(), prev.height())?;
        self.integrate(prev, weight, |y, _, [_, moved]| {
            let pixels = next.row(y).iter().zip(prev.row(y));
            for (to, (next, prev)) in moved[PAD..].iter_mut().zip(pixels) {
                *to = next - prev;
            }
        })?;
        Ok(self.gains(radius))
    }

    /// The same for the flow of `input`: what motion does to windows is left out.
    pub(super) fn change_along(
        &mut self,
        input: Views<'_>,
        radius: usize,
        level: SimdLevel,
    ) -> Result<[f64; 2]> {
        self.begin(input.prev.width(), input.prev.height())?;
        self.accumulate(input, level)?;
        Ok(self.gains(radius))
    }

    /// The largest logarithm of the gain of a trend over the picture, and the root mean square of what windows of
    /// `2 radius + 1` pixels say beyond it.
    fn gains(&self, radius: usize) -> [f64; 2] {
        let (width, height) = (self.gain.width(), self.gain.height());
        let whole = self.moments(width, (0, 0), (width, height));
        let step = radius.div_ceil(2);
        let trend = self.gain_trend(radius, step, whole).solve();
        let corners = [
            (0, 0),
            (width - 1, 0),
            (0, height - 1),
            (width - 1, height - 1),
        ];
        let most = corners
            .map(|(x, y)| trend(x, y).abs())
            .into_iter()
            .fold(0.0, f64::max);
        let (mut sum, mut all) = (0.0, 0.0);
        for y in (0..height).step_by(step) {
            for x in (0..width).step_by(step) {
                if let Some((gain, weight)) = log_gain(self.around(x, y, radius), whole) {
                    sum += weight * (gain - trend(x, y)).powi(2);
                    all += weight;
                }
            }
        }
        [most, if all > 0.0 { (sum / all).sqrt() } else { 0.0 }]
    }

    /// Steady light, of a size.
    fn begin(&mut self, width: usize, height: usize) -> Result<()> {
        self.gain.resize(width, height)?;
        self.offset.resize(width, height)?;
        self.gain.data_mut().fill(1.0);
        self.offset.data_mut().fill(0.0);
        Ok(())
    }

    /// The trend of the logarithm of the gain, from windows of `2 radius + 1` pixels, one in each `step` rows and columns.
    fn gain_trend(&self, radius: usize, step: usize, whole: [f64; 5]) -> Trend {
        let mut trend = Trend::default();
        for y in (0..self.gain.height()).step_by(step) {
            for x in (0..self.gain.width()).step_by(step) {
                if let Some((gain, weight)) = log_gain(self.around(x, y, radius), whole) {
                    trend.add(x, y, gain, weight);
                }
            }
        }
        trend
    }

    fn around(&self, x: usize, y: usize, radius: usize) -> [f64; 5] {
        let (width, height) = (self.gain.width(), self.gain.height());
        let (top, bottom) = (y.saturating_sub(radius), (y + radius + 1).min(height));
        let (left, right) = (x.saturating_sub(radius), (x + radius + 1).min(width));
        self.moments(width, (left, top), (right, bottom))
    }

    /// Integral images of `prev` and of what it moved to. A sample between pixels has less contrast than they have: `prev` is
    /// smoothed where it is, by as much as that takes of its contrast.
    fn accumulate(&mut self, input: Views<'_>, level: SimdLevel) -> Result<()> {
        let mut sum = std::mem::take(&mut self.sum);
        let (width, height) = (input.prev.width(), input.prev.height());
        resize(SUMS, &mut sum, padded_plane::stride(width), 0.0)?;
        self.integrate(input.prev, input.weight, |y, inside, [own, moved]| {
            let (u, v) = (input.u.padded(y), input.v.padded(y));
            let mut full = false;
            let kernel = WarpRow {
                from: 0,
                prev: input.prev.row(y),
                next: input.next,
                y,
                u,
                v,
                sum: &mut sum,
                difference: moved,
                inside,
                full: &mut full,
            };
            dispatch(level, kernel);
            let rows = [y.saturating_sub(1), y, (y + 1).min(height - 1)];
            let [above, here, below] = rows.map(|y| input.prev.row(y));
            let kernel = Smooth {
                rows: [above, here, below],
                flow: [u, v].map(|row| &row[PAD..PAD + width]),
                to: &mut own[PAD..PAD + width],
            };
            dispatch(level, kernel);
        })?;
        self.sum = sum;
        Ok(())
    }

    /// Integral images of `prev`, in the light so far, and of the second picture. `second` writes the weights of a row, and what
    /// both are to differ by from the row of `prev`, as it came.
    fn integrate(
        &mut self,
        prev: &Plane,
        weight: Option<&Plane>,
        mut second: impl FnMut(usize, &mut [f32], [&mut [f32]; 2]),
    ) -> Result<()> {
        let (width, height) = (prev.width(), prev.height());
        let stride = padded_plane::stride(width);
        self.integral.clear();
        let count = (width + 1) * (height + 1);
        resize(SUMS, &mut self.integral, count, [0.0; 5])?;
        self.rows.clear();
        resize(SUMS, &mut self.rows, stride, 1.0)?;
        resize(SUMS, &mut self.rows, 3 * stride, 0.0)?;
        for y in 0..height {
            let (inside, rest) = self.rows.split_at_mut(stride);
            let (own, moved) = rest.split_at_mut(stride);
            second(y, inside, [own, moved]);
            let mut sum = [0.0; 5];
            for x in 0..width {
                let mut share = f64::from(inside[PAD + x]);
                if let Some(plane) = weight {
                    share *= f64::from(plane.row(y)[x]);
                }
                if share > 0.0 {
                    let prev = prev.row(y)[x];
                    let p = self.gain.row(y)[x] * (prev + own[PAD + x]) + self.offset.row(y)[x];
                    let w = prev + moved[PAD + x];
                    let (p, w) = (f64::from(p), f64::from(w));
                    for (sum, value) in sum.iter_mut().zip([1.0, p, p * p, w, w * w]) {
                        *sum += share * value;
                    }
                }
                let above = self.integral[y * (width + 1) + x + 1];
                self.integral[(y + 1) * (width + 1) + x + 1] =
                    std::array::from_fn(|k| above[k] + sum[k]);
            }
        }
        Ok(())
    }

    /// Weight, means and variances (p, then w) within a rectangle.
    fn moments(
        &self,
        width: usize,
        (left, top): (usize, usize),
        (right, bottom): (usize, usize),
    ) -> [f64; 5] {
        let at = |x: usize, y: usize| self.integral[y * (width + 1) + x];
        let (a, b, c, d) = (
            at(left, top),
            at(right, top),
            at(left, bottom),
            at(right, bottom),
        );
        let [n, p, pp, w, ww] = std::array::from_fn(|k| (d[k] - c[k]) - (b[k] - a[k]));
        if n < 1.0 {
            return [0.0; 5];
        }
        let (p, w) = (p / n, w / n);
        [
            n,
            p,
            (pp / n - p * p).max(0.0),
            w,
            (ww / n - w * w).max(0.0),
        ]
    }
}

/// What smoothing adds to a row that takes as much of its contrast as sampling where the flow leads takes of the other
/// picture's.
struct Smooth<'a> {
    /// Above, at and below the row.
    rows: [&'a [f32]; 3],
    flow: [&'a [f32]; 2],
    to: &'a mut [f32],
}

impl Kernel for Smooth<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let [above, here, below] = self.rows;
        let [u, v] = self.flow;
        let last = here.len() - 1;
        for (x, to) in self.to.iter_mut().enumerate() {
            *to = smoothing(v[x]) * (above[x] + below[x] - 2.0 * here[x]);
        }
        let inner = self.to.iter_mut().zip(u).zip(here).skip(1);
        let beside = here.iter().zip(here.iter().skip(2));
        for (((to, u), middle), (left, right)) in inner.zip(beside) {
            *to += smoothing(*u) * (left + right - 2.0 * middle);
        }
        // Beyond the border the picture goes on as it is.
        self.to[0] += smoothing(u[0]) * (here[1.min(last)] - here[0]);
        self.to[last] += smoothing(u[last]) * (here[last.saturating_sub(1)] - here[last]);
    }
}

/// The outer taps of the filter of three that takes as much contrast as bilinear samples do that are this far from the pixels:
/// those have 1 - 2 f (1 - f) (1 - cos w) of the power at frequency w, and the filter has (1 - 2 s (1 - cos w))^2.
#[inline(always)]
fn smoothing(flow: f32) -> f32 {
    // The same whether f is how far it is from the pixel before or from the one after.
    let fraction = (flow - flow as i32 as f32).abs();
    0.5 * fraction * (1.0 - fraction)
}

/// The logarithm of the gain within a window, and how much that says.
fn log_gain(window: [f64; 5], whole: [f64; 5]) -> Option<(f64, f64)> {
    let (from, to) = (window[2] + PRIOR * whole[2], window[4] + PRIOR * whole[4]);
    (from > 0.0 && to > 0.0).then(|| (0.5 * (to / from).ln(), (from * to).sqrt()))
}

fn model(window: [f64; 5], whole: [f64; 5]) -> (f64, f64) {
    let [n, p, pp, w, ww] = window;
    let [all, _, whole_pp, _, whole_ww] = whole;
    if n < 1.0 || all < 1.0 {
        return (1.0, 0.0);
    }
    let (from, to) = (pp + PRIOR * whole_pp, ww + PRIOR * whole_ww);
    let gain = if from > 0.0 && to > 0.0 {
        (to / from).sqrt()
    } else {
        1.0
    };
    let gain = gain.clamp(*GAIN.start(), *GAIN.end());
    (gain, w - gain * p)
}

/// A weighted least squares fit of c0 + c1 x + c2 y.
#[derive(Default)]
struct Trend {
    sums: [f64; 9],
}

impl Trend {
    fn add(&mut self, x: usize, y: usize, value: f64, weight: f64) {
        let (x, y) = (x as f64, y as f64);
        let terms = [1.0, x, y, x * x, x * y, y * y, value, x * value, y * value];
        for (sum, term) in self.sums.iter_mut().zip(terms) {
            *sum += weight * term;
        }
    }

    fn solve(self) -> impl Fn(usize, usize) -> f64 {
        let [n, x, y, xx, xy, yy, v, xv, yv] = self.sums;
        let n = if n > 0.0 { n } else { 1.0 };
        let (mx, my, mv) = (x / n, y / n, v / n);
        let (cxx, cxy, cyy) = (xx / n - mx * mx, xy / n - mx * my, yy / n - my * my);
        let (cxv, cyv) = (xv / n - mx * mv, yv / n - my * mv);
        let det = cxx * cyy - cxy * cxy;
        let (sx, sy) = if det > 1e-6 * cxx * cyy && det > 0.0 {
            ((cyy * cxv - cxy * cyv) / det, (cxx * cyv - cxy * cxv) / det)
        } else {
            (0.0, 0.0)
        };
        move |x, y| mv + sx * (x as f64 - mx) + sy * (y as f64 - my)
    }
}
