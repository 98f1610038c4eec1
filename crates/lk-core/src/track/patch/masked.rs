//! A template of which not all pixels count: which do at a place, and its sums over those.

use super::joint::{LEAST_SHARE, Moments, Place, WHOLE, reads};
use super::sampling::Sampling;
use super::sums::{Sums, TemplateSums};
use super::template::Template;
use crate::simd::{Eight, Kernel, Simd};
use crate::support::{CLIPPED, Support};

impl Template {
    /// Whether some of the window may not count, after [`Template::belongs_to`].
    pub(crate) fn is_masked(&self) -> bool {
        self.joint.masked
    }

    /// Whether too few pixels count wherever it is compared, after [`Template::belongs_to`].
    pub(crate) fn is_bare(&self) -> bool {
        let count = self.window.width * self.window.height;
        let own = self.joint.own[..count].iter();
        let there = own.filter(|byte| **byte >= CLIPPED).count();
        !self.joint.own_whole && (there as f64) < LEAST_SHARE * count as f64
    }

    /// Take into account which pixels of the frame it was built from count.
    pub(crate) fn belongs_to(&mut self, support: &Support) {
        let spline = self.sampling == Sampling::Spline;
        self.joint
            .take_own(support, self.corner, self.window, spline);
    }

    /// Take into account which pixels of `next` count with the window around `centre`.
    pub(crate) fn meets(&mut self, support: &Support, centre: [f32; 2]) -> Place {
        let half = self.window.half();
        let corner = [centre[0] - half[0], centre[1] - half[1]];
        let spline = self.sampling == Sampling::Spline;
        let reach = if spline { [1, 1] } else { [0, 0] };
        if self.joint.masked {
            // What is read near a whole pixel has no weight: a window that rests there does not change.
            let within = [0, 1].into_iter().all(|axis| {
                let [low, high] = self.joint.seen[axis];
                let first = (corner[axis] + 2.0 * WHOLE).floor() as isize;
                let last = (corner[axis] - 2.0 * WHOLE).ceil() as isize;
                first >= low && last <= high
            });
            if within {
                return Place::Same;
            }
        }
        let reads = corner.map(reads);
        let window = self.window;
        let size = (window.width, window.height);
        let joint = &mut self.joint;
        let whole = support.least(reads, size, reach, &mut joint.scratch);
        if whole && joint.own_whole {
            if !joint.masked {
                return Place::Same;
            }
            joint.masked = false;
            self.moments = Moments::whole(window);
            self.sums = self.whole_sums;
            return Place::Other;
        }
        if !joint.masked {
            self.whole_sums = self.sums;
        }
        joint.seen = reads;
        joint.unite(whole, window)
    }

    /// Sums over the window of the difference, with the coordinates made orthogonal.
    #[inline(always)]
    pub(super) fn orthogonal(&self, sums: Sums) -> Sums {
        Sums {
            tilt: self.moments.orthogonal(sums.plain, sums.tilt),
            ..sums
        }
    }
}

/// Make the sums of a template again, over the pixels that count.
pub(crate) struct SumAgain<'a>(pub(crate) &'a mut Template);

impl Kernel for SumAgain<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let template = self.0;
        if !template.joint.masked {
            return;
        }
        let window = template.window;
        let base = S::Eight::splat(template.level);
        let half = window.half();
        let mut plain = [S::Eight::zero(); 3];
        let mut with = [[S::Eight::zero(); 3]; 2];
        let mut products = [S::Eight::zero(); 6];
        let mut lagged = [S::Eight::zero(); 2];
        let mut moments = [S::Eight::zero(); 6];
        let one = S::Eight::splat(1.0);
        for block in 0..window.blocks() {
            let x = window.block_x::<S::Eight>(block);
            let keep = template.joint.column(block, window);
            let cells = template.column(block);
            let mut last = [S::Eight::zero(); 2];
            let mut own = [S::Eight::zero(); 3];
            for (row, (cell, keep)) in cells.iter().zip(keep).enumerate() {
                let keep = S::Eight::unpack(keep);
                let y = S::Eight::splat(row as f32 - half[1]);
                let a = (S::Eight::unpack(&cell.prev) - base).keep(keep);
                let gx = S::Eight::unpack(&cell.gradient[0]).keep(keep);
                let gy = S::Eight::unpack(&cell.gradient[1]).keep(keep);
                for (index, value) in [a, gx, gy].into_iter().enumerate() {
                    own[index] += value;
                    with[1][index] += value * y;
                }
                products[0] += a * a;
                products[1] += a * gx;
                products[2] += a * gy;
                products[3] += gx * gx;
                products[4] += gx * gy;
                products[5] += gy * gy;
                lagged[0] += gx * last[0];
                lagged[1] += gy * last[1];
                last = [gx, gy];
                let (counts, along) = (one.keep(keep), x.keep(keep));
                moments[0] += counts;
                moments[1] += along;
                moments[2] += counts * y;
                moments[3] += along * x;
                moments[4] += along * y;
                moments[5] += counts * y * y;
            }
            for (index, own) in own.into_iter().enumerate() {
                plain[index] += own;
                with[0][index] += own * x;
            }
        }
        let plain = S::Eight::sums(&plain);
        let [with_x, with_y] = [S::Eight::sums(&with[0]), S::Eight::sums(&with[1])];
        let moments = template.joint.moments(S::Eight::sums(&moments));
        let mut sums = TemplateSums {
            plain,
            products: S::Eight::sums(&products),
            lagged: S::Eight::sums(&lagged),
            ..TemplateSums::default()
        };
        for index in 0..3 {
            let [x, y] = moments.orthogonal(plain[index], [with_x[index], with_y[index]]);
            (sums.with_x[index], sums.with_y[index]) = (x, y);
        }
        template.sums = sums;
        template.moments = moments;
    }
}
