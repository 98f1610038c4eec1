//! The motion that the camera's does not explain, as a frame has it: how long it is, and what moves by it.

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::parallel::{RowsMut, SplitRows, even_bands, for_each_band};
use crate::scratch::with_scratch;
use crate::simd::{Kernel, Simd, dispatch};

use super::runs::next;
use super::segmenter::Segmenter;

/// The frame that a motion is written for: it may be larger than what is segmented.
pub(super) struct Shown<'a> {
    /// Columns and rows.
    pub(super) size: (usize, usize),
    /// How many times it was reduced.
    pub(super) by: usize,
    /// What moves in it.
    pub(super) moving: &'a [u8],
}

impl Segmenter {
    /// See [`MotionSegmenter::motion`](super::motion_segmenter::MotionSegmenter::motion).
    pub(super) fn motion(
        &self,
        shown: &Shown<'_>,
        least_px: f64,
        length: &mut [f32],
        motion: &mut [f32],
        execution: &Execution,
    ) -> Result<()> {
        let (width, height) = shown.size;
        let ((columns, rows), factor) = (self.reduced_size(), shown.by * self.factor());
        let pixels = width * height;
        for (values, wanted) in [(&*length, pixels), (&*motion, 2 * pixels)] {
            if values.len() != wanted {
                let (got, wanted) = (values.len().to_string(), wanted.to_string());
                return Err(Error::shape("motion", got, wanted));
            }
        }
        let (residual, known) = self.residual();
        let trusted = &self.work.trusted;
        if residual.len() != 2 * columns * rows || trusted.0.is_empty() {
            length.fill(f32::NAN);
            motion.fill(f32::NAN);
            return Ok(());
        }
        let step = if trusted.1 == self.frame_size() {
            shown.by
        } else {
            factor
        };
        let scale = shown.by as f32;
        let least = (least_px * least_px) as f32;
        let level = execution.simd_level();
        let outputs = Both(
            RowsMut::new(length, factor * width),
            RowsMut::new(motion, 2 * factor * width),
        );
        let bands = even_bands(execution, rows, [16_384 / columns, 8_192 / columns]);
        for_each_band(execution, rows, bands, outputs, |band, mut part| {
            with_scratch(columns, |squares| {
                for (local, y) in band.enumerate() {
                    let place = y * columns..(y + 1) * columns;
                    let residual = &residual[2 * place.start..2 * place.end];
                    let (lengths, motions) = part.rows(local);
                    let (first, others) = lengths.split_at_mut(width);
                    let kernel = Lengths {
                        residual,
                        known: &known[place],
                        factor,
                        scale,
                        squares,
                        to: first,
                    };
                    dispatch(level, kernel);
                    for row in others.chunks_exact_mut(width) {
                        row.copy_from_slice(first);
                    }
                    for (row, to) in motions.chunks_exact_mut(2 * width).enumerate() {
                        let at = y * factor + row;
                        let moving = &shown.moving[at * width..(at + 1) * width];
                        let trusted = &trusted.0[at / step * trusted.1.0..][..trusted.1.0];
                        let mut x = next(moving, 0, 1);
                        while x < width {
                            let from = x / factor;
                            let told = trusted[x / step] == 1 && squares[from] >= least;
                            for (to, part) in to[2 * x..]
                                .iter_mut()
                                .zip(&residual[2 * from..2 * from + 2])
                            {
                                *to = if told { scale * part } else { f32::NAN };
                            }
                            x += 1;
                            if moving.get(x) != Some(&1) {
                                x = next(moving, x, 1);
                            }
                        }
                    }
                }
            })
        })
    }
}

/// Rows of lengths and of motions, those of one reduced row together.
struct Both<'a>(RowsMut<'a, f32>, RowsMut<'a, f32>);

impl Both<'_> {
    fn rows(&mut self, local: usize) -> (&mut [f32], &mut [f32]) {
        (block(&mut self.0, local), block(&mut self.1, local))
    }
}

/// The last block may lack rows.
fn block<'a>(of: &'a mut RowsMut<'_, f32>, local: usize) -> &'a mut [f32] {
    let start = local * of.stride;
    let end = of.data.len().min(start + of.stride);
    &mut of.data[start..end]
}

impl SplitRows for Both<'_> {
    fn split_at_row(self, row: usize) -> (Self, Self) {
        let (a, b) = (self.0.split_at_row(row), self.1.split_at_row(row));
        (Self(a.0, b.0), Self(a.1, b.1))
    }
}

/// A row of lengths, each as often as the frame was reduced; NaN where none is known.
struct Lengths<'a> {
    residual: &'a [f32],
    known: &'a [u8],
    factor: usize,
    /// What they are multiplied by.
    scale: f32,
    /// Their squares.
    squares: &'a mut [f32],
    to: &'a mut [f32],
}

impl Kernel for Lengths<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let from = self.residual.as_chunks::<2>().0.iter().zip(self.known);
        for (square, ([u, v], known)) in self.squares.iter_mut().zip(from) {
            let sum = (u * u + v * v) * (self.scale * self.scale);
            *square = if *known == 1 { sum } else { f32::NAN };
        }
        match self.factor {
            1 => {
                for (to, square) in self.to.iter_mut().zip(&*self.squares) {
                    *to = square.sqrt();
                }
            }
            factor => {
                for (to, square) in self.to.chunks_mut(factor).zip(&*self.squares) {
                    to.fill(square.sqrt());
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::SegmenterOptions;
    use crate::segment::made::{Numbers, every_way, mask};

    #[test]
    fn pixels_have_the_motion_of_their_blocks() {
        // Of one size, judged at half of it, and reduced with blocks that lack pixels.
        for (size, by) in [((37_usize, 11_usize), 1), ((73, 21), 2), ((1203, 171), 1)] {
            let inner = (size.0.div_ceil(by), size.1.div_ceil(by));
            let mut segmenter =
                Segmenter::new(SegmenterOptions::new(true, 12, 1.0, 0.3), inner).unwrap();
            let ((columns, rows), factor) = (segmenter.reduced_size(), by * segmenter.factor());
            let mut numbers = Numbers::new(3);
            let residual: Vec<f32> = (0..2 * columns * rows)
                .map(|_| numbers.normal() as f32)
                .collect();
            let known = mask((columns, rows), 0.8, 1);
            let moving = mask(size, 0.3, 2);
            let shown = Shown {
                size,
                by,
                moving: &moving,
            };
            segmenter.work.evidence.residual.clone_from(&residual);
            segmenter.work.evidence.known.clone_from(&known);
            for of in [inner, (columns, rows)] {
                let trusted = mask(of, 0.7, 4);
                segmenter.work.trusted = (trusted.clone(), of);
                let step = if of == inner { by } else { factor };
                for execution in every_way() {
                    let pixels = size.0 * size.1;
                    let (mut length, mut motion) = (vec![7.0; pixels], vec![7.0; 2 * pixels]);
                    segmenter
                        .motion(&shown, 0.4, &mut length, &mut motion, &execution)
                        .unwrap();
                    for at in 0..pixels {
                        let (x, y) = (at % size.0, at / size.0);
                        let from = y / factor * columns + x / factor;
                        let [u, v] = [residual[2 * from], residual[2 * from + 1]]
                            .map(|part| by as f32 * part);
                        let square = u * u + v * v;
                        let want = if known[from] == 1 {
                            square.sqrt()
                        } else {
                            f32::NAN
                        };
                        assert!(
                            length[at].to_bits() == want.to_bits()
                                || (length[at].is_nan() && want.is_nan())
                        );
                        let told = known[from] == 1
                            && square >= 0.16
                            && moving[at] == 1
                            && trusted[y / step * of.0 + x / step] == 1;
                        for (got, value) in motion[2 * at..2 * at + 2].iter().zip([u, v]) {
                            let want = if told { value } else { f32::NAN };
                            let want = if moving[at] == 1 { want } else { 7.0 };
                            assert!(
                                got.to_bits() == want.to_bits() || (got.is_nan() && want.is_nan())
                            );
                        }
                    }
                }
            }
            assert!(
                segmenter
                    .motion(&shown, 0.4, &mut [], &mut [], &every_way()[0])
                    .is_err()
            );
        }
    }
}
