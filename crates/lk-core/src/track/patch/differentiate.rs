//! The gradients of a template by central differences, and the sums over its window.

use super::Window;
use super::region::Region;
use super::sums::{Cell, TemplateSums};
use crate::simd::{EIGHT, Eight};

/// Fill `cells` with grey levels and their gradients by central differences, and sum them.
///
/// Sums with the row above are made where `LAGGED`, those that a change of light needs where `LIGHT`, those with
/// coordinates where `TILT`.
///
/// Central differences of the samples, not the derivative of the spline: the noise of a pixel is then uncorrelated
/// with the noise of the gradient there, at every sub-pixel offset, and cannot pull the solution.
#[inline(always)]
pub(super) fn differentiate<
    L: Eight,
    const SCHARR: bool,
    const LAGGED: bool,
    const LIGHT: bool,
    const TILT: bool,
>(
    region: Region<'_>,
    window: Window,
    cells: &mut [Cell],
) -> (f32, TemplateSums) {
    let (blocks, height) = (window.blocks(), window.height);
    // Grey levels from that of the middle: sums of their squares then keep their digits.
    let level = region.at(height / 2 + 1, window.width / 2 + 1);
    let (half, base) = (L::splat(0.5), L::splat(level));
    let mut total = TemplateLanes::<L>::new();
    for block in 0..blocks {
        let at = block * EIGHT;
        let mask = L::first(window.width - at);
        // Of this column of lanes: apart from those before, so that they stay in registers.
        let mut own = TemplateLanes::<L>::new();
        let mut running = [L::zero(); 3];
        let mut last = [L::zero(); 2];
        let mut rows = region.rows::<{ EIGHT + 2 }>(at);
        let (mut up, mut sides) = (rows.below(), rows.below());
        let (mut above, mut here) = (L::load(up, 1), L::load(sides, 1));
        for cell in &mut cells[block * height..][..height] {
            let down = rows.below();
            let below = L::load(down, 1);
            let a = (here - base).keep(mask);
            let mut gx = (L::load(sides, 2) - L::load(sides, 0)) * half;
            let mut gy = (below - above) * half;
            if SCHARR {
                [gx, gy] = scharr([gx, gy], [up, down]);
            }
            let (gx, gy) = (gx.keep(mask), gy.keep(mask));
            // What stands in the padding may be NaN, which no weight of 0 takes out of a sum.
            *cell = Cell {
                prev: here.keep(mask).pack(),
                gradient: [gx.pack(), gy.pack()],
            };
            (up, sides) = (sides, down);
            (above, here) = (here, below);
            own.plain[0] += a;
            own.products[0] += a * a;
            own.products[3] += gx * gx;
            own.products[4] += gx * gy;
            own.products[5] += gy * gy;
            if LIGHT {
                own.plain[1] += gx;
                own.plain[2] += gy;
                own.products[1] += a * gx;
                own.products[2] += a * gy;
            }
            if TILT {
                for (running, plain) in running.iter_mut().zip(own.plain) {
                    *running += plain;
                }
            }
            if LAGGED {
                own.lagged[0] += gx * last[0];
                own.lagged[1] += gy * last[1];
                last = [gx, gy];
            }
        }
        if TILT {
            let x = window.block_x::<L>(block);
            for (index, running) in running.into_iter().enumerate() {
                total.with_x[index] += own.plain[index] * x;
                total.with_y[index] += window.with_y([own.plain[index], running]);
            }
        }
        total.add(&own);
    }
    (level, total.finish::<LAGGED, LIGHT, TILT>())
}

/// Scharr's gradients of the pixels between the rows `up` and `down`, from those by central differences.
#[inline(always)]
fn scharr<L: Eight>([gx, gy]: [L; 2], [up, down]: [&[f32; EIGHT + 2]; 2]) -> [L; 2] {
    let (outer, inner) = (L::splat(3.0 / 32.0), L::splat(10.0 / 16.0));
    let [left, right] = [
        L::load(down, 0) - L::load(up, 0),
        L::load(down, 2) - L::load(up, 2),
    ];
    let [top, bottom] = [
        L::load(up, 2) - L::load(up, 0),
        L::load(down, 2) - L::load(down, 0),
    ];
    [
        gx * inner + (top + bottom) * outer,
        gy * inner + (left + right) * outer,
    ]
}

/// [`TemplateSums`] as they grow.
struct TemplateLanes<L> {
    plain: [L; 3],
    with_x: [L; 3],
    with_y: [L; 3],
    products: [L; 6],
    lagged: [L; 2],
}

impl<L: Eight> TemplateLanes<L> {
    #[inline(always)]
    fn new() -> Self {
        Self {
            plain: [L::zero(); 3],
            with_x: [L::zero(); 3],
            with_y: [L::zero(); 3],
            products: [L::zero(); 6],
            lagged: [L::zero(); 2],
        }
    }

    /// Add what the pixels of `other` sum to, but for sums with coordinates.
    #[inline(always)]
    fn add(&mut self, other: &Self) {
        for (sum, other) in self.plain.iter_mut().zip(other.plain) {
            *sum += other;
        }
        for (sum, other) in self.products.iter_mut().zip(other.products) {
            *sum += other;
        }
        for (sum, other) in self.lagged.iter_mut().zip(other.lagged) {
            *sum += other;
        }
    }

    #[inline(always)]
    fn finish<const LAGGED: bool, const LIGHT: bool, const TILT: bool>(&self) -> TemplateSums {
        let mut sums = TemplateSums::default();
        if LIGHT {
            sums.plain = L::sums(&self.plain);
            sums.products = L::sums(&self.products);
        } else {
            let [aa, _, _, xx, xy, yy] = self.products;
            sums.plain[0] = self.plain[0].sum();
            let [aa, xx, xy, yy] = L::sums(&[aa, xx, xy, yy]);
            sums.products = [aa, 0.0, 0.0, xx, xy, yy];
        }
        if TILT {
            sums.with_x = L::sums(&self.with_x);
            sums.with_y = L::sums(&self.with_y);
        }
        if LAGGED {
            sums.lagged = L::sums(&self.lagged);
        }
        sums
    }
}
