//! A frame copied and lightly smoothed in one pass: its gradients are then less of noise and of what falls between pixels.
//!
//! `docs/explanation/algorithms.md`, section "Presmoothing".

use crate::error::Result;
use crate::execution::Execution;
use crate::frame::{Frame, Pixel, Plane, read_row, scale_by};
use crate::parallel::{even_bands, for_each_band};
use crate::scratch::with_scratch;
use crate::simd::{Kernel, Simd, SimdLevel, dispatch};

/// Rows under way.
const RING: usize = 3;

/// Write `frame`, times `scale` and smoothed by the taps `side`, `1 - 2 side`, `side` along both axes, into `plane`; borders
/// repeat the edge. The variance of the filter is `2 side`.
pub(crate) fn copy_smoothed<T: Pixel>(
    plane: &mut Plane,
    frame: Frame<'_, T>,
    (scale, side): (f32, f32),
    execution: &Execution,
) -> Result<()> {
    if side == 0.0 {
        return plane.copy_scaled(frame, scale, execution);
    }
    let read = |y: usize, row: &mut [f32]| {
        read_row(frame, y, row);
        scale_by(row, scale);
    };
    smooth_rows(plane, frame.dim(), read, side, execution)
}

/// The same of a plane as it stands.
pub(crate) fn smooth(plane: &mut Plane, side: f32, execution: &Execution) -> Result<()> {
    if side == 0.0 {
        return Ok(());
    }
    let mut source = Plane::default();
    source.copy_of(plane)?;
    let read = |y: usize, row: &mut [f32]| row.copy_from_slice(source.row(y));
    smooth_rows(
        plane,
        (source.height(), source.width()),
        read,
        side,
        execution,
    )
}

fn smooth_rows(
    plane: &mut Plane,
    (height, width): (usize, usize),
    read: impl Fn(usize, &mut [f32]) + Sync,
    side: f32,
    execution: &Execution,
) -> Result<()> {
    plane.resize(width, height)?;
    if width == 0 || height == 0 {
        return Ok(());
    }
    let level = execution.simd_level();
    let min_rows = even_bands(execution, height, [32_768 / width, 8_192 / width]);
    for_each_band(
        execution,
        height,
        min_rows,
        plane.rows_mut(),
        |rows, mut part| {
            with_scratch(RING * width + width + 2, |memory| {
                let (ring, down) = memory.split_at_mut(RING * width);
                let fill = |ring: &mut [f32], y: usize| {
                    read(y, &mut ring[y % RING * width..][..width]);
                };
                let first = rows.start.saturating_sub(1);
                for y in first..(rows.start + 1).min(height) {
                    fill(ring, y);
                }
                for (local, y) in rows.enumerate() {
                    if y + 1 < height {
                        fill(ring, y + 1);
                    }
                    let near = [y.saturating_sub(1), y, (y + 1).min(height - 1)];
                    let kernel = Smooth {
                        rows: near.map(|y| &ring[y % RING * width..][..width]),
                        side,
                        level,
                        down: &mut *down,
                        to: part.row_mut(local),
                    };
                    kernel.run();
                }
            })
        },
    )
}

struct Smooth<'a> {
    rows: [&'a [f32]; 3],
    side: f32,
    level: SimdLevel,
    /// The row smoothed down the columns, with one column on either side.
    down: &'a mut [f32],
    to: &'a mut [f32],
}

impl Smooth<'_> {
    fn run(self) {
        let width = self.to.len();
        let taps = [self.side, 1.0 - 2.0 * self.side];
        dispatch(
            self.level,
            Down {
                rows: self.rows,
                taps,
                to: &mut self.down[1..=width],
            },
        );
        self.down[0] = self.down[1];
        self.down[width + 1] = self.down[width];
        dispatch(
            self.level,
            Across {
                from: self.down,
                taps,
                to: self.to,
            },
        );
    }
}

struct Down<'a> {
    rows: [&'a [f32]; 3],
    taps: [f32; 2],
    to: &'a mut [f32],
}

impl Kernel for Down<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let width = self.to.len();
        let [above, here, below] = self.rows.map(|row| &row[..width]);
        let [side, middle] = self.taps;
        for x in 0..width {
            self.to[x] = side * (above[x] + below[x]) + middle * here[x];
        }
    }
}

struct Across<'a> {
    from: &'a [f32],
    taps: [f32; 2],
    to: &'a mut [f32],
}

impl Kernel for Across<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let width = self.to.len();
        let (left, here, right) = (
            &self.from[..width],
            &self.from[1..=width],
            &self.from[2..width + 2],
        );
        let [side, middle] = self.taps;
        for x in 0..width {
            self.to[x] = side * (left[x] + right[x]) + middle * here[x];
        }
    }
}

#[cfg(test)]
mod tests {
    use ndarray::Array2;
    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn every_pixel_is_the_weighted_mean_of_nine(
            height in 1usize..30, width in 1usize..70, seed in any::<u32>(), threads in 1usize..4
        ) {
            let frame = Array2::from_shape_fn((height, width), |(y, x)| {
                ((y * 57 + x * 131 + seed as usize % 1009) * 7919 % 256) as u8
            });
            let side = 0.2;
            for level in SimdLevel::available() {
                let execution = Execution::default().threads(threads).level(level);
                let mut plane = Plane::default();
                copy_smoothed(&mut plane, frame.view(), (2.0, side), &execution).unwrap();
                let mut again = Plane::default();
                again.copy_scaled(frame.view(), 2.0, &execution).unwrap();
                smooth(&mut again, side, &execution).unwrap();
                prop_assert_eq!(&plane, &again);
                for y in 0..height {
                    for x in 0..width {
                        let mut want = 0.0;
                        for (dy, dx) in (0..9).map(|k| (k / 3, k % 3)) {
                            let weight = |d: usize| if d == 1 { 0.6 } else { 0.2 };
                            let row = (y + dy).saturating_sub(1).min(height - 1);
                            let column = (x + dx).saturating_sub(1).min(width - 1);
                            want += weight(dy) * weight(dx) * 2.0 * f64::from(frame[(row, column)]);
                        }
                        prop_assert!((f64::from(plane.row(y)[x]) - want).abs() < 1e-3);
                    }
                }
            }
        }
    }
}
