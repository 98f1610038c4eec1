//! Where a picture of the canvas changed since the one before.

use crate::error::Result;
use crate::execution::Execution;
use crate::memory::resize;
use crate::parallel::RowsMut;
use crate::simd::{Kernel, Simd, dispatch};

use super::box_filter::{Window, window_means};
use super::morphology::Size;
use super::slopes::rows_around;

/// Mean squared deviations over the window from which on it did, and the most of one pixel.
const CHANGED: f32 = 2.6;
const MOST: f32 = 8.0;
/// The variance that misregistration brings, in squared pixels of the gradient: of a camera at rest, of one that moves.
const REGISTRATION_PX2: [f32; 2] = [0.019, 0.0625];
const FIVE: Window = Window { size: 5 };

/// Two pictures of the canvas in one light, and where both are seen.
pub(crate) struct Pictures<'a> {
    pub(crate) size: Size,
    pub(crate) before: &'a [f32],
    pub(crate) now: &'a [f32],
    pub(crate) both: &'a [u8],
    /// Standard deviation of the noise of one.
    pub(crate) noise: f32,
    /// Whether the camera moves.
    pub(crate) moves: bool,
}

/// Write 1 where the pictures differ by more than noise and registration make.
///
/// # Errors
///
/// Those of the execution; [`Error::Memory`](crate::Error::Memory).
pub(crate) fn changed(of: &Pictures<'_>, to: &mut Vec<u8>, execution: &Execution) -> Result<()> {
    let (width, height) = of.size;
    resize("masks", to, width * height, 0)?;
    let level = execution.simd_level();
    let place = |y: usize| y * width..(y + 1) * width;
    let fill = |y: usize, [to]: [&mut [f32]; 1]| {
        let kernel = Squares {
            around: rows_around(of.now, of.size, y),
            before: &of.before[place(y)],
            both: &of.both[place(y)],
            noise: 2.0 * of.noise * of.noise,
            part: REGISTRATION_PX2[usize::from(of.moves)],
            to,
        };
        dispatch(level, kernel);
    };
    let emit = |local: usize, y: usize, [means]: [&[f32]; 1], to: &mut RowsMut<'_, u8>| {
        let kernel = Above {
            means,
            both: &of.both[place(y)],
            to: to.row_mut(local),
        };
        dispatch(level, kernel);
    };
    window_means(
        of.size,
        FIVE,
        RowsMut::new(to, width),
        fill,
        emit,
        execution,
    )
}

struct Squares<'a> {
    around: [&'a [f32]; 3],
    before: &'a [f32],
    both: &'a [u8],
    noise: f32,
    part: f32,
    to: &'a mut [f32],
}

impl Kernel for Squares<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let [above, row, below] = self.around;
        let Some(last) = row.len().checked_sub(1) else {
            return;
        };
        // The border is repeated.
        for x in [0, last] {
            let right = 0.5 * (row[(x + 1).min(last)] - row[x.saturating_sub(1)]);
            let slopes = [right, 0.5 * (below[x] - above[x])];
            let d = row[x] - self.before[x];
            self.to[x] = square([self.noise, self.part], slopes, d, self.both[x]);
        }
        if last < 2 {
            return;
        }
        let inner = last - 1;
        let (left, now, right) = (&row[..inner], &row[1..][..inner], &row[2..][..inner]);
        let (above, below) = (&above[1..][..inner], &below[1..][..inner]);
        let (before, both) = (&self.before[1..][..inner], &self.both[1..][..inner]);
        let (noise, part) = (self.noise, self.part);
        let to = &mut self.to[1..][..inner];
        for x in 0..inner {
            let slopes = [0.5 * (right[x] - left[x]), 0.5 * (below[x] - above[x])];
            to[x] = square([noise, part], slopes, now[x] - before[x], both[x]);
        }
    }
}

/// How many variances the square of a difference has.
#[inline(always)]
fn square([noise, part]: [f32; 2], [gx, gy]: [f32; 2], d: f32, both: u8) -> f32 {
    let square = d * d / (noise + part * (gx * gx + gy * gy));
    f32::from(both) * if square < MOST { square } else { MOST }
}

struct Above<'a> {
    means: &'a [f32],
    both: &'a [u8],
    to: &'a mut [u8],
}

impl Kernel for Above<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        for ((to, mean), both) in self.to.iter_mut().zip(self.means).zip(self.both) {
            *to = both & u8::from(*mean > CHANGED);
        }
    }
}
