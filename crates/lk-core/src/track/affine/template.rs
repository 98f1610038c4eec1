//! What a window shows before it is warped: grey levels and their derivatives.

use crate::simd::{EIGHT, Eight, Kernel, Simd};
use crate::track::noise::Gradients;
use crate::track::patch::{MAX_SIDE, Window};

/// Samples along a side: a template has one more on each side, for its gradient.
const SIDE: usize = MAX_SIDE + 2;

/// Samples of a window, in rows of whole lanes, and room to load lanes from the last of them on.
pub(super) const ROOM: usize = SIDE * SIDE.next_multiple_of(EIGHT) + EIGHT;

/// A value for each sample of a window, in rows of whole lanes.
pub(super) type Samples = [f32; ROOM];

/// From row to row of so many samples.
#[inline(always)]
pub(super) fn stride(columns: usize) -> usize {
    columns.next_multiple_of(EIGHT)
}

/// What a window shows: its grey levels, and their derivatives, which are 0 beyond a row's end.
#[derive(Debug)]
pub(super) struct Template {
    pub(super) window: Window,
    pub(super) grey: Samples,
    /// The grey level that others are counted from.
    pub(super) middle: f32,
    pub(super) across: Samples,
    pub(super) down: Samples,
}

impl Template {
    pub(super) fn new() -> Self {
        let (width, height) = (0, 0);
        Self {
            window: Window { width, height },
            grey: [0.0; _],
            middle: 0.0,
            across: [0.0; _],
            down: [0.0; _],
        }
    }

    /// From the centre to the rim along the longer side: coordinates are in this unit.
    #[inline(always)]
    fn half(&self) -> f32 {
        0.5 * self.window.width.max(self.window.height) as f32
    }

    /// The x coordinates of a block of lanes.
    #[inline(always)]
    pub(super) fn x<L: Eight>(&self, block: usize) -> L {
        self.window.block_x::<L>(block) * L::splat(1.0 / self.half())
    }

    /// The y coordinate of a row.
    #[inline(always)]
    pub(super) fn y(&self, row: usize) -> f32 {
        (row as f32 - self.window.half()[1]) * (1.0 / self.half())
    }

    /// The lanes of a block that are of the window.
    #[inline(always)]
    pub(super) fn within<L: Eight>(&self, block: usize) -> L {
        L::first(self.window.width - block * EIGHT)
    }
}

/// Fill a template from samples with one more on each side.
pub(super) struct Differentiate<'a> {
    pub(super) samples: &'a Samples,
    pub(super) window: Window,
    pub(super) template: &'a mut Template,
}

impl Kernel for Differentiate<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let Self {
            samples,
            window,
            template,
        } = self;
        let (from, to) = (stride(window.width + 2), stride(window.width));
        template.window = window;
        template.middle = samples[(window.height / 2 + 1) * from + window.width / 2 + 1];
        let half = S::Eight::splat(0.5);
        for block in 0..window.blocks() {
            let within = template.within::<S::Eight>(block);
            for row in 0..window.height {
                let (at, here) = (row * to + block * EIGHT, (row + 1) * from + block * EIGHT);
                let across = S::Eight::load(samples, here + 2) - S::Eight::load(samples, here);
                let down = S::Eight::load(samples, here + from + 1)
                    - S::Eight::load(samples, here + 1 - from);
                S::Eight::load(samples, here + 1).store(&mut template.grey, at);
                (across * half).keep(within).store(&mut template.across, at);
                (down * half).keep(within).store(&mut template.down, at);
            }
        }
    }
}

/// How the derivatives of neighbouring pixels go together.
pub(super) struct Correlation<'a>(pub(super) &'a Template);

impl Kernel for Correlation<'_> {
    type Output = Gradients;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> Gradients {
        let Template {
            window,
            across,
            down,
            ..
        } = self.0;
        let Window { width, height } = *window;
        let mut sums = [S::Eight::zero(); 4];
        // Each pixel of a row but the first, with the one before.
        for block in 0..(width - 1).div_ceil(EIGHT) {
            let within = S::Eight::first(width - 1 - block * EIGHT);
            for row in 0..height {
                let at = row * stride(width) + block * EIGHT;
                for (line, sums) in [down, across].into_iter().zip(sums.chunks_exact_mut(2)) {
                    let here = S::Eight::load(line, at + 1).keep(within);
                    sums[0] += here * here;
                    sums[1] += here * S::Eight::load(line, at);
                }
            }
        }
        let [down, down_lagged, across, across_lagged] = S::Eight::sums(&sums);
        // Along the row: a derivative down stands across its edges there, one across along itself.
        Gradients::new(
            [down, across],
            [down_lagged, across_lagged],
            1.0,
            (width - 1) as f64 * height as f64,
        )
    }
}
