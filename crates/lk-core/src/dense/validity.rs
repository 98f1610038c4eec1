//! The end: the flow and what the last windows said of it, at every pixel.
//!
//! `docs/explanation/algorithms.md`, section "Confidence and validity".

use crate::error::Result;
use crate::execution::Execution;
use crate::frame::Plane;
use crate::parallel::{RowsMut, even_bands, for_each_band};
use crate::scratch::with_scratch;
use crate::simd::{Floats, Kernel, LANES, Simd, blocks, blocks_mut, dispatch};

use super::confidence::Judged;
use super::field::FlowField;
use super::padded_plane::{self, PAD, PaddedPlane};
use super::support::APART;
use super::trend::Slopes;
use super::windows::Views;

/// Half the windows within which all pixels must be finite and move alike.
pub(super) const RADIUS: usize = 3;

/// Where the flow differs by this much from its trend within the window, in pixels, it holds the edge of something that
/// moves: part of it may be uncovered, and none of it is told from the other side for sure.
const EDGE: f32 = 1.0;

/// Fill `field` with the flow of `views` and with what its windows and those of a coarse level, `support`, said. `given` is 0
/// at pixels of `prev` that were not to be measured, `bad` is not 0 within [`RADIUS`] of those of `next` that do not count;
/// `slopes` are those of most of the flow; `unit` is what one grey level of the planes is in those of the caller.
pub(super) fn mark(
    views: Views<'_>,
    (judged, support): (&Judged, &PaddedPlane),
    (given, bad): (Option<&Plane>, Option<&[u8]>),
    (slopes, unit): (Slopes, f32),
    field: &mut FlowField,
    execution: &Execution,
) -> Result<()> {
    let (width, height) = (views.prev.width(), views.prev.height());
    let level = execution.simd_level();
    let stride = padded_plane::stride(width);
    // From an element of the grids to the next, before their values are multiplied.
    let step = views.halved.map_or(1.0, |scale| 2.0 / scale);
    let slopes = slopes.map(|axis| axis.map(|slope| slope * step));
    for_each_band(
        execution,
        height,
        even_bands(execution, height, [16_384 / width, 4_096 / width]),
        rows_of(field),
        |rows, (mut uv, mut valid, mut residual)| {
            with_scratch(6 * stride, |memory| {
                let (row_of_flow, rest) = memory.split_at_mut(2 * stride);
                let (fit, rest) = rest.split_at_mut(stride);
                let (misfit, rest) = rest.split_at_mut(stride);
                let (row_of_flags, supported) = rest.split_at_mut(stride);
                supported.fill(-1.0);
                for (local, y) in rows.enumerate() {
                    if local == 0 || y % 2 == 0 {
                        let upper = y / 2;
                        if local == 0 || (upper + APART / 2).is_multiple_of(APART) {
                            spread_support(support, upper, &mut supported[PAD..]);
                        }
                        let kernel = Spread {
                            width,
                            flow: rows_around(&views, upper),
                            halved: views.halved,
                            slopes,
                            unit,
                            judged: [&judged.fit, &judged.bearable, &judged.misfit]
                                .map(|grid| grid.padded(upper)),
                            supported: &*supported,
                            fit: &mut *fit,
                            misfit: &mut *misfit,
                        };
                        dispatch(level, kernel);
                    }
                    let flow = views.flow(level, y, 0..width, row_of_flow);
                    let kernel = Inside {
                        y: y as f32,
                        size: [(width - 1) as f32, (height - 1) as f32],
                        flow,
                        fit,
                        flags: &mut *row_of_flags,
                    };
                    dispatch(level, kernel);
                    let (uv, _) = uv.row_mut(local).as_chunks_mut::<2>();
                    let (valid, residual) = (valid.row_mut(local), residual.row_mut(local));
                    residual.copy_from_slice(&misfit[PAD..PAD + width]);
                    let flow = flow.map(|row| &row[PAD..PAD + width]);
                    let kernel = Write {
                        flow,
                        flags: &row_of_flags[PAD..PAD + width],
                        uv: &mut *uv,
                        valid: &mut *valid,
                    };
                    dispatch(level, kernel);
                    if let Some(weight) = given {
                        blank(weight.row(y), uv, residual, valid);
                    }
                    if let Some(bad) = bad {
                        refuse_bad(bad, y, flow, valid);
                    }
                }
            })
        },
    )
}

/// The flow, whether it is valid, and the residual of each row.
fn rows_of(field: &mut FlowField) -> (RowsMut<'_, f32>, RowsMut<'_, bool>, RowsMut<'_, f32>) {
    let width = field.width;
    (
        RowsMut::new(&mut field.uv, 2 * width),
        RowsMut::new(&mut field.valid, width),
        RowsMut::new(&mut field.residual, width),
    )
}

/// Rows of u and v around that of judgements `upper`: as far above and below as no edge may be.
fn rows_around<'a>(views: &Views<'a>, upper: usize) -> [[&'a [f32]; 3]; 2] {
    // On grids of half the size, of two rows and columns of theirs: 4 pixels.
    let reach = reach(views.halved);
    let place = match views.halved {
        Some(_) => upper,
        None => 2 * upper,
    };
    let near = [
        place.saturating_sub(reach),
        place,
        (place + reach).min(views.u.height() - 1),
    ];
    [views.u, views.v].map(|grid| near.map(|y| grid.padded(y)))
}

/// What has no weight was not to be measured.
fn blank(weights: &[f32], uv: &mut [[f32; 2]], residual: &mut [f32], valid: &mut [bool]) {
    for (x, weight) in weights.iter().enumerate() {
        if *weight == 0.0 {
            uv[x] = [f32::NAN; 2];
            residual[x] = f32::NAN;
            valid[x] = false;
        }
    }
}

/// What leads from row `y` to where `bad` is not 0 is not valid.
fn refuse_bad(bad: &[u8], y: usize, [u, v]: [&[f32]; 2], valid: &mut [bool]) {
    let width = valid.len();
    for x in 0..width {
        if valid[x] {
            // It is inside: what is valid stays within the picture.
            let [to_x, to_y] = [x as f32 + u[x], y as f32 + v[x]].map(|at| (at + 0.5) as usize);
            valid[x] = bad[to_y * width + to_x] == 0;
        }
    }
}

/// What is longer than `most` is not valid.
pub(super) fn refuse_longer(field: &mut FlowField, most: f32) {
    for (valid, uv) in field.valid.iter_mut().zip(field.uv.chunks_exact(2)) {
        *valid &= uv[0].hypot(uv[1]) <= most;
    }
}

/// What the even pixels of a row were found to be, and whether the flow around them is of one piece, for both pixels of
/// each pair.
struct Spread<'a> {
    width: usize,
    /// u and v, some rows above, at the row, and as many below.
    flow: [[&'a [f32]; 3]; 2],
    /// If those are of half the size: what their values are multiplied by.
    halved: Option<f32>,
    /// What u and v change by from an element to the next without an edge.
    slopes: Slopes,
    unit: f32,
    judged: [&'a [f32]; 3],
    /// At least 0 where a coarse level finds the flow right.
    supported: &'a [f32],
    /// At least 0 where all is well; for an even pixel and the odd one after it.
    fit: &'a mut [f32],
    /// In grey levels of the caller.
    misfit: &'a mut [f32],
}

impl Kernel for Spread<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let count = self.width.div_ceil(2 * LANES);
        let fit = blocks_mut(self.fit, PAD, 2 * count);
        let misfit = blocks_mut(self.misfit, PAD, 2 * count);
        let judged = self.judged.map(|row| blocks(row, PAD, count));
        let supported = blocks(self.supported, PAD, count);
        let [[ua, u, ub], [va, v, vb]] = self.flow;
        let reach = reach(self.halved);
        let groups = match self.halved {
            Some(_) => count,
            None => 2 * count,
        };
        let [slopes_u, slopes_v] = self
            .slopes
            .map(|axis| axis.map(|slope| slope * reach as f32));
        let near_u = Near::new([ua, u, ub], (reach, slopes_u), groups);
        let near_v = Near::new([va, v, vb], (reach, slopes_v), groups);
        let scale = s.splat(self.halved.unwrap_or(1.0));
        let (edge, unit) = (s.splat(EDGE), s.splat(self.unit));
        for i in 0..count {
            let range = if self.halved.is_some() {
                (near_u.range(s, i) + near_v.range(s, i)) * scale
            } else {
                let first = near_u.range(s, 2 * i) + near_v.range(s, 2 * i);
                let second = near_u.range(s, 2 * i + 1) + near_v.range(s, 2 * i + 1);
                first.deinterleave(second).0
            };
            let elsewhere = s.get(&judged[1][i]).min(s.get(&supported[i]));
            let good = s.get(&judged[0][i]).max(elsewhere).min(edge - range);
            let (first, second) = good.interleave(good);
            first.put(&mut fit[2 * i]);
            second.put(&mut fit[2 * i + 1]);
            let residual = s.get(&judged[2][i]) * unit;
            let (first, second) = residual.interleave(residual);
            first.put(&mut misfit[2 * i]);
            second.put(&mut misfit[2 * i + 1]);
        }
    }
}

/// How far around a pixel of the grids of the flow no edge may be: that of a flow that was measured at half the size is not
/// sharp.
fn reach(halved: Option<f32>) -> usize {
    match halved {
        Some(scale) if scale > 1.0 => RADIUS + 1,
        Some(_) => RADIUS.div_ceil(2),
        None => RADIUS,
    }
}

/// Write what `support` says of the pixels of row `y` of the grid of judgements, if it says anything.
fn spread_support(support: &PaddedPlane, y: usize, to: &mut [f32]) {
    if support.height() == 0 {
        return;
    }
    let nearest = |at: usize, size: usize| ((at + APART / 2) / APART).min(size - 1);
    let row = support.row(nearest(y, support.height()));
    for (x, to) in to.iter_mut().enumerate() {
        *to = row[nearest(x, row.len())];
    }
}

/// Nine values around each pixel, and what they change by along x and y from one to the next.
struct Near<'a>([&'a [[f32; LANES]]; 9], [f32; 2]);

impl<'a> Near<'a> {
    #[inline(always)]
    fn new(
        [above, here, below]: [&'a [f32]; 3],
        (reach, slopes): (usize, [f32; 2]),
        count: usize,
    ) -> Self {
        let (left, right) = (PAD - reach, PAD + reach);
        let around = [
            blocks(above, left, count),
            blocks(above, PAD, count),
            blocks(above, right, count),
            blocks(here, left, count),
            blocks(here, PAD, count),
            blocks(here, right, count),
            blocks(below, left, count),
            blocks(below, PAD, count),
            blocks(below, right, count),
        ];
        Self(around, slopes)
    }

    /// The difference of the largest and the least, as they would be without the slopes.
    #[inline(always)]
    fn range<S: Simd>(&self, s: S, i: usize) -> S::F {
        let [along_x, along_y] = self.1;
        let first = s.get(&self.0[0][i]) + s.splat(along_x + along_y);
        let (mut least, mut largest) = (first, first);
        macro_rules! each {
            ($($k:literal)+) => {$(
                let (column, row) = (($k % 3) as f32 - 1.0, ($k / 3) as f32 - 1.0);
                let value = s.get(&self.0[$k][i]) - s.splat(along_x * column + along_y * row);
                least = value.min(least);
                largest = value.max(largest);
            )+};
        }
        each!(1 2 3 4 5 6 7 8);
        largest - least
    }
}

/// What is left of `fit` at pixels that stay inside of the picture.
struct Inside<'a> {
    y: f32,
    /// The last column and row.
    size: [f32; 2],
    flow: [&'a [f32]; 2],
    fit: &'a [f32],
    flags: &'a mut [f32],
}

impl Kernel for Inside<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let count = padded_plane::groups(self.size[0] as usize + 1);
        let [u, v] = self.flow;
        let (u, v) = (blocks(u, PAD, count), blocks(v, PAD, count));
        let fit = blocks(self.fit, PAD, count);
        let flags = blocks_mut(self.flags, PAD, count);
        let (y, right, bottom) = (
            s.splat(self.y),
            s.splat(self.size[0]),
            s.splat(self.size[1]),
        );
        let (ramp, zero, outside) = (s.ramp(), s.splat(0.0), s.splat(-1.0));
        for i in 0..count {
            let at_x = s.splat((i * LANES) as f32) + ramp + s.get(&u[i]);
            let at_y = y + s.get(&v[i]);
            // A flow that is not a number is within nothing.
            let across = <S::F as Floats>::both(zero.le(at_x), at_x.le(right));
            let down = <S::F as Floats>::both(zero.le(at_y), at_y.le(bottom));
            let within = <S::F as Floats>::both(across, down);
            S::F::select(within, s.get(&fit[i]), outside).put(&mut flags[i]);
        }
    }
}

/// One row of the result.
struct Write<'a> {
    flow: [&'a [f32]; 2],
    flags: &'a [f32],
    uv: &'a mut [[f32; 2]],
    valid: &'a mut [bool],
}

impl Kernel for Write<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let [u, v] = self.flow;
        for ((uv, u), v) in self.uv.iter_mut().zip(u).zip(v) {
            *uv = [*u, *v];
        }
        for (valid, flag) in self.valid.iter_mut().zip(self.flags) {
            *valid = *flag >= 0.0;
        }
    }
}
