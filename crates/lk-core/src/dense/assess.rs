//! The end: the flow and what the last windows said of it, at every pixel.

use crate::error::Result;
use crate::execution::Execution;
use crate::frame::Plane;
use crate::parallel::{RowsMut, even_bands, for_each_band};
use crate::scratch::with_scratch;
use crate::simd::{
    Floats, Kernel, LANES, LaneKernel, Simd, blocks, blocks_mut, dispatch, dispatch_lanes,
};

use super::field::FlowField;
use super::grid::{self, PAD};
use super::judge::Judged;
use super::windows::Views;

/// Half the windows within which all pixels must be finite and move alike.
const RADIUS: usize = 3;

/// Where the flow differs by this much within the window, in pixels, it holds the edge of something that moves: part of
/// it may be uncovered, and none of it is told from the other side for sure.
const EDGE: f32 = 1.0;

/// Fill `field` with the flow of `views` and with what its windows said. `given` is 0 at pixels of `prev` that were not
/// to be measured, `finite` where `next` is not finite; `unit` is what one grey level of the planes is in those of the
/// caller.
pub(super) fn assess(
    views: Views<'_>,
    judged: &Judged,
    (given, finite): (Option<&Plane>, Option<&Plane>),
    unit: f32,
    field: &mut FlowField,
    execution: &Execution,
) -> Result<()> {
    let (width, height) = (views.prev.width(), views.prev.height());
    let level = execution.simd_level();
    let stride = grid::stride(width);
    let outputs = (
        RowsMut::new(&mut field.uv, 2 * width),
        RowsMut::new(&mut field.valid, width),
        RowsMut::new(&mut field.residual, width),
    );
    for_each_band(
        execution,
        height,
        even_bands(execution, height, [16_384 / width, 4_096 / width]),
        outputs,
        |rows, (mut uv, mut valid, mut residual)| {
            with_scratch(5 * stride, |memory| {
                let (row_of_flow, rest) = memory.split_at_mut(2 * stride);
                let (fit, rest) = rest.split_at_mut(stride);
                let (misfit, row_of_flags) = rest.split_at_mut(stride);
                for (local, y) in rows.enumerate() {
                    if local == 0 || y % 2 == 0 {
                        let upper = y / 2;
                        // On grids of half the size, of two rows and columns of theirs: 4 pixels.
                        let (place, reach) = match views.halved {
                            Some(_) => (upper, RADIUS.div_ceil(2)),
                            None => (2 * upper, RADIUS),
                        };
                        let near = [
                            place.saturating_sub(reach),
                            place,
                            (place + reach).min(views.u.height() - 1),
                        ];
                        let kernel = Spread {
                            width,
                            flow: [views.u, views.v].map(|grid| near.map(|y| grid.padded(y))),
                            halved: views.halved,
                            unit,
                            judged: [judged.fit.padded(upper), judged.misfit.padded(upper)],
                            fit: &mut *fit,
                            misfit: &mut *misfit,
                        };
                        dispatch_lanes(level, kernel);
                    }
                    let flow = views.flow(level, y, 0..width, row_of_flow);
                    let kernel = Inside {
                        y: y as f32,
                        size: [(width - 1) as f32, (height - 1) as f32],
                        flow,
                        fit,
                        flags: &mut *row_of_flags,
                    };
                    dispatch_lanes(level, kernel);
                    let (uv, _) = uv.row_mut(local).as_chunks_mut::<2>();
                    let (valid, residual) = (valid.row_mut(local), residual.row_mut(local));
                    residual.copy_from_slice(&misfit[PAD..PAD + width]);
                    let [u, v] = flow.map(|row| &row[PAD..PAD + width]);
                    let kernel = Write {
                        flow: [u, v],
                        flags: &row_of_flags[PAD..PAD + width],
                        uv: &mut *uv,
                        valid: &mut *valid,
                    };
                    dispatch(level, kernel);
                    if let Some(weight) = given {
                        for (x, weight) in weight.row(y).iter().enumerate() {
                            if *weight == 0.0 {
                                uv[x] = [f32::NAN; 2];
                                residual[x] = f32::NAN;
                                valid[x] = false;
                            }
                        }
                    }
                    if let Some(finite) = finite {
                        for x in 0..width {
                            valid[x] =
                                valid[x] && near_finite(finite, x as f32 + u[x], y as f32 + v[x]);
                        }
                    }
                }
            })
        },
    )
}

/// What the even pixels of a row were found to be, and whether the flow around them is of one piece, for both pixels of
/// each pair.
struct Spread<'a> {
    width: usize,
    /// u and v, some rows above, at the row, and as many below.
    flow: [[&'a [f32]; 3]; 2],
    /// If those are of half the size: what their values are multiplied by.
    halved: Option<f32>,
    unit: f32,
    judged: [&'a [f32]; 2],
    /// At least 0 where all is well; for an even pixel and the odd one after it.
    fit: &'a mut [f32],
    /// In grey levels of the caller.
    misfit: &'a mut [f32],
}

impl LaneKernel for Spread<'_> {
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let count = self.width.div_ceil(2 * LANES);
        let fit = blocks_mut(self.fit, PAD, 2 * count);
        let misfit = blocks_mut(self.misfit, PAD, 2 * count);
        let judged = self.judged.map(|row| blocks(row, PAD, count));
        let [[ua, u, ub], [va, v, vb]] = self.flow;
        let (reach, groups) = match self.halved {
            Some(_) => (RADIUS.div_ceil(2), count),
            None => (RADIUS, 2 * count),
        };
        let near_u = Near::new([ua, u, ub], reach, groups);
        let near_v = Near::new([va, v, vb], reach, groups);
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
            let good = s.get(&judged[0][i]).min(edge - range);
            let (first, second) = good.interleave(good);
            first.put(&mut fit[2 * i]);
            second.put(&mut fit[2 * i + 1]);
            let residual = s.get(&judged[1][i]) * unit;
            let (first, second) = residual.interleave(residual);
            first.put(&mut misfit[2 * i]);
            second.put(&mut misfit[2 * i + 1]);
        }
    }
}

/// Nine values around each pixel.
struct Near<'a>([&'a [[f32; LANES]]; 9]);

impl<'a> Near<'a> {
    #[inline(always)]
    fn new([above, here, below]: [&'a [f32]; 3], reach: usize, count: usize) -> Self {
        let (left, right) = (PAD - reach, PAD + reach);
        Self([
            blocks(above, left, count),
            blocks(above, PAD, count),
            blocks(above, right, count),
            blocks(here, left, count),
            blocks(here, PAD, count),
            blocks(here, right, count),
            blocks(below, left, count),
            blocks(below, PAD, count),
            blocks(below, right, count),
        ])
    }

    /// The difference of the largest and the least.
    #[inline(always)]
    fn range<S: Simd>(&self, s: S, i: usize) -> S::F {
        let first = s.get(&self.0[0][i]);
        let (mut least, mut largest) = (first, first);
        macro_rules! each {
            ($($k:literal)+) => {$(
                let value = s.get(&self.0[$k][i]);
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

impl LaneKernel for Inside<'_> {
    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let count = grid::groups(self.size[0] as usize + 1);
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
    fn run(self) {
        let [u, v] = self.flow;
        for ((uv, u), v) in self.uv.iter_mut().zip(u).zip(v) {
            *uv = [*u, *v];
        }
        for (valid, flag) in self.valid.iter_mut().zip(self.flags) {
            *valid = *flag >= 0.0;
        }
    }
}

/// Whether all pixels of the window around (x, y) are finite.
fn near_finite(finite: &Plane, x: f32, y: f32) -> bool {
    let range = |at: f32, size: usize| {
        let at = at.round().max(0.0) as usize;
        at.saturating_sub(RADIUS)..(at + RADIUS + 1).min(size)
    };
    range(y, finite.height())
        .all(|row| range(x, finite.width()).all(|column| finite.row(row)[column] > 0.0))
}
