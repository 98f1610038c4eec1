//! Planes of a reduced frame as the frame has them, linear between the centres of blocks.

use crate::error::Result;
use crate::execution::Execution;
use crate::parallel::{RowsMut, even_bands, for_each_band};
use crate::scratch::with_scratch;
use crate::simd::{Kernel, Simd, dispatch};

use super::morphology::Size;

/// The two of `count` blocks of `by` pixels whose centres a pixel lies between, and how far it is from the first.
#[inline(always)]
pub(super) fn between(at: usize, by: usize, count: usize) -> (usize, usize, f32) {
    let (block, inside) = (at / by, at % by);
    let way = (inside as f32 + 0.5) / by as f32 - 0.5;
    if way < 0.0 {
        (block.saturating_sub(1), block, 1.0 + way)
    } else {
        (block, (block + 1).min(count - 1), way)
    }
}

/// Write `plane`, of `size`, into `to`, of `full`; blocks have `by` pixels along each side. Where one of the four around is not
/// a number a pixel has that of its own block.
///
/// # Errors
///
/// Those of the execution; [`Error::Memory`](crate::Error::Memory).
pub(super) fn enlarge(
    (plane, size): (&[f32], Size),
    by: usize,
    (to, full): (&mut [f32], Size),
    execution: &Execution,
) -> Result<()> {
    let bands = even_bands(execution, full.1, [32_768 / full.0, 16_384 / full.0]);
    let level = execution.simd_level();
    for_each_band(
        execution,
        full.1,
        bands,
        RowsMut::new(to, full.0),
        |band, mut part| {
            with_scratch(size.0 + 2, |mixed| {
                for (local, y) in band.enumerate() {
                    let (above, below, way) = between(y, by, size.1);
                    let row = |row: usize| &plane[row * size.0..(row + 1) * size.0];
                    let kernel = Line {
                        near: [row(above), row(below)],
                        way,
                        own: row(y / by),
                        by,
                        mixed,
                        to: part.row_mut(local),
                    };
                    dispatch(level, kernel);
                }
            })
        },
    )
}

/// A row of pixels between two rows of blocks.
struct Line<'a> {
    near: [&'a [f32]; 2],
    /// How far it is from the first.
    way: f32,
    /// The row of its own blocks.
    own: &'a [f32],
    by: usize,
    /// Room for the blocks, and one on each side.
    mixed: &'a mut [f32],
    to: &'a mut [f32],
}

impl Line<'_> {
    /// Pixels of blocks of `N`, from the first on; how many blocks they are.
    #[inline(always)]
    fn whole<const N: usize>(&mut self) -> usize {
        let (blocks, _) = self.to.as_chunks_mut::<N>();
        let count = blocks.len();
        let around = self.mixed.windows(3).zip(self.own);
        for (to, (around, own)) in blocks.iter_mut().zip(around) {
            for (inside, value) in to.iter_mut().enumerate() {
                *value = mean(around, (inside, N), *own);
            }
        }
        count
    }
}

/// Between the block before, the pixel's own and the one after it.
#[inline(always)]
fn mean(around: &[f32], (inside, by): (usize, usize), own: f32) -> f32 {
    let way = (inside as f32 + 0.5) / by as f32 - 0.5;
    let mean = if way < 0.0 {
        around[0] + (1.0 + way) * (around[1] - around[0])
    } else {
        around[1] + way * (around[2] - around[1])
    };
    if mean.is_nan() { own } else { mean }
}

impl Kernel for Line<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(mut self, _: S) {
        let [above, below] = self.near;
        let count = above.len();
        let inside = &mut self.mixed[1..=count];
        for (to, (a, b)) in inside.iter_mut().zip(above.iter().zip(below)) {
            *to = a + self.way * (b - a);
        }
        self.mixed[0] = self.mixed[1];
        self.mixed[count + 1] = self.mixed[count];
        let done = match self.by {
            2 => self.whole::<2>(),
            4 => self.whole::<4>(),
            _ => 0,
        };
        let rest = self.to[done * self.by..].chunks_mut(self.by);
        for (block, to) in (done..).zip(rest) {
            for (inside, value) in to.iter_mut().enumerate() {
                *value = mean(&self.mixed[block..], (inside, self.by), self.own[block]);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::segment::made::{bits, every_way, greys};

    /// One pixel after the other, in double precision.
    fn reference(plane: &[f32], size: Size, by: usize, full: Size) -> Vec<f64> {
        let mut out = Vec::new();
        for y in 0..full.1 {
            for x in 0..full.0 {
                let place = |at: usize, count: usize| {
                    let exact = (at as f64 + 0.5) / by as f64 - 0.5;
                    let [first, next] = [exact.floor(), exact.floor() + 1.0]
                        .map(|place| place.clamp(0.0, (count - 1) as f64) as usize);
                    (first, next, exact - exact.floor())
                };
                let ((l, r, s), (a, b, t)) = (place(x, size.0), place(y, size.1));
                let at = |x: usize, y: usize| f64::from(plane[y * size.0 + x]);
                let (top, low) = (
                    at(l, a) + s * (at(r, a) - at(l, a)),
                    at(l, b) + s * (at(r, b) - at(l, b)),
                );
                let mean = top + t * (low - top);
                let own = f64::from(plane[(y / by) * size.0 + x / by]);
                out.push(if mean.is_nan() { own } else { mean });
            }
        }
        out
    }

    #[test]
    fn planes_are_linear_between_blocks() {
        for (full, by) in [
            ((37_usize, 11_usize), 2),
            ((8, 8), 4),
            ((3, 2), 2),
            ((201, 77), 4),
        ] {
            let size = (full.0.div_ceil(by), full.1.div_ceil(by));
            let mut plane = greys(size, 5);
            for (at, value) in plane.iter_mut().enumerate() {
                if at % 17 == 3 {
                    *value = f32::NAN;
                }
            }
            let want = reference(&plane, size, by, full);
            let mut first = None;
            for execution in every_way() {
                let mut to = vec![0.0; full.0 * full.1];
                enlarge((&plane, size), by, (&mut to, full), &execution).unwrap();
                for (got, want) in to.iter().zip(&want) {
                    let near = (f64::from(*got) - want).abs() < 1e-3;
                    assert!(near || (got.is_nan() && want.is_nan()), "{got} {want}");
                }
                let found = bits(&to);
                assert_eq!(first.get_or_insert(found.clone()), &found);
            }
        }
    }
}
