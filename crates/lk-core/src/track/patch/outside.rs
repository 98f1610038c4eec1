//! A template whose gradients end where the frame does, as those of OpenCV's tracker do.

use super::Template;
use super::region::split;
use crate::frame::Plane;
use crate::pyramid::mirror;
use crate::simd::EIGHT;

impl Template {
    /// Where the window around `centre` reaches over the border of `prev`: make its gradients again, those of pixels
    /// outside of the frame 0, and their sums.
    pub(crate) fn flatten_outside(&mut self, prev: &Plane, centre: [f32; 2]) {
        let half = self.window.half();
        let (x, fx) = split(centre[0] - half[0]);
        let (y, fy) = split(centre[1] - half[1]);
        let (width, height) = (self.window.width, self.window.height);
        let within = |first: isize, pixels: usize, size: usize| {
            first >= 0 && first + (pixels as isize) < size as isize
        };
        if within(x, width, prev.width()) && within(y, height, prev.height()) {
            return;
        }
        let mut products = [0.0f64; 3];
        for row in 0..height {
            let line = y + row as isize;
            let mut left = [scharr(prev, x, line), scharr(prev, x, line + 1)];
            for column in 0..width {
                let next = x + column as isize + 1;
                let right = [scharr(prev, next, line), scharr(prev, next, line + 1)];
                let gradient = [0, 1].map(|axis| {
                    let [above, below] = [0, 1]
                        .map(|side: usize| left[side][axis] * (1.0 - fx) + right[side][axis] * fx);
                    above * (1.0 - fy) + below * fy
                });
                let cell = &mut self.cells[column / EIGHT * height + row];
                for (lanes, value) in cell.gradient.iter_mut().zip(gradient) {
                    lanes.0[column % EIGHT] = value;
                }
                let [gx, gy] = gradient.map(f64::from);
                products[0] += gx * gx;
                products[1] += gx * gy;
                products[2] += gy * gy;
                left = right;
            }
        }
        self.sums.products[3..].copy_from_slice(&products);
    }
}

/// Scharr's gradient along x and y at a pixel, in grey levels a pixel, the border mirrored; 0 outside of the plane.
fn scharr(plane: &Plane, x: isize, y: isize) -> [f32; 2] {
    let (width, height) = (plane.width(), plane.height());
    if x < 0 || y < 0 || x as usize >= width || y as usize >= height {
        return [0.0; 2];
    }
    let [left, right] = [x - 1, x + 1].map(|x| mirror(x, width));
    let [above, here, below] = [y - 1, y, y + 1].map(|y| plane.row(mirror(y, height)));
    let x = x as usize;
    let (outer, inner) = (3.0 / 32.0, 10.0 / 32.0);
    [
        inner * (here[right] - here[left])
            + outer * ((above[right] - above[left]) + (below[right] - below[left])),
        inner * (below[x] - above[x])
            + outer * ((below[left] - above[left]) + (below[right] - above[right])),
    ]
}
