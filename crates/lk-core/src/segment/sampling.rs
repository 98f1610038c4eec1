//! Planes seen at places between their pixels, along a row, sixteen at a time where these lie well within the plane.

use super::morphology::Size;
use super::transform::{Map, cubic};
use crate::simd::{Floats, Kernel, LANES, Simd};

/// Where a map takes the pixels of row `y` from column `first` on.
pub(super) struct Places<'a> {
    pub(super) map: &'a Map,
    pub(super) y: usize,
    pub(super) first: usize,
    pub(super) to: [&'a mut [f32]; 2],
}

impl Kernel for Places<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let y = self.y as f64;
        let [[a, b, c], [d, e, f], [g, h, i]] = *self.map;
        let (start_x, start_y, start_w) = (b * y + c, e * y + f, h * y + i);
        let [to_x, to_y] = self.to;
        let to = to_x.iter_mut().zip(to_y.iter_mut());
        let columns = self.first as i32..;
        if g == 0.0 && h == 0.0 {
            for (x, (to_x, to_y)) in columns.zip(to) {
                let x = f64::from(x);
                *to_x = (a * x + start_x) as f32;
                *to_y = (d * x + start_y) as f32;
            }
        } else {
            for (x, (to_x, to_y)) in columns.zip(to) {
                let x = f64::from(x);
                let w = 1.0 / (g * x + start_w);
                *to_x = ((a * x + start_x) * w) as f32;
                *to_y = ((d * x + start_y) * w) as f32;
            }
        }
    }
}

/// Values between pixels, along straight lines; beyond the plane stands its border. `None` where the last pixel of the
/// plane is among them, which has to be looked at alone.
#[inline(always)]
pub(super) fn bilinear_lanes<S: Simd>(
    s: S,
    from: &[f32],
    (width, height): Size,
    [x, y]: [S::F; 2],
) -> Option<S::F> {
    let (zero, one) = (s.splat(0.0), s.splat(1.0));
    let (last_x, last_y) = (s.splat((width - 1) as f32), s.splat((height - 1) as f32));
    let (x, y) = (x.max(zero).min(last_x), y.max(zero).min(last_y));
    let (left, top) = (x.trunc(), y.trunc());
    let down = (top + one).min(last_y);
    // The pair of a row's last pixel has the next row's first one, with no weight; the last row has none.
    if S::F::any(S::F::both(last_x.le(left), last_y.le(down))) {
        return None;
    }
    let (fx, fy) = (x - left, y - top);
    let (a, b) = s.pairs(from, width, top, left);
    let (c, d) = s.pairs(from, width, down, left);
    let (above, below) = (a + fx * (b - a), c + fx * (d - c));
    Some(above + fy * (below - above))
}

/// A row with cubic interpolation. Beyond the picture stands its border, and `inside` is 0.
pub(super) struct Cubic<'a> {
    pub(super) from: &'a [f32],
    pub(super) size: Size,
    /// Where each pixel is in the picture, x and y.
    pub(super) places: [&'a [f32]; 2],
    pub(super) to: &'a mut [f32],
    pub(super) inside: &'a mut [u8],
}

impl Kernel for Cubic<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let [px, py] = self.places;
        let (width, height) = self.size;
        let count = self.to.len();
        let (px, py, inside) = (&px[..count], &py[..count], &mut self.inside[..count]);
        let (high_x, high_y) = ((width - 1) as f32 + 0.01, (height - 1) as f32 + 0.01);
        for x in 0..count {
            inside[x] = u8::from(px[x] >= -0.01)
                & u8::from(py[x] >= -0.01)
                & u8::from(px[x] <= high_x)
                & u8::from(py[x] <= high_y);
        }
        let (blocks, rest) = self.to.as_chunks_mut::<LANES>();
        let (px, rest_x) = px.as_chunks::<LANES>();
        let (py, rest_y) = py.as_chunks::<LANES>();
        for (to, (px, py)) in blocks.iter_mut().zip(px.iter().zip(py)) {
            if !cubic_lanes(s, self.from, self.size, [px, py], to) {
                cubic_border(s, self.from, self.size, [px, py], to);
            }
        }
        for (to, (px, py)) in rest.iter_mut().zip(rest_x.iter().zip(rest_y)) {
            *to = cubic_at(self.from, self.size, *px, *py);
        }
    }
}

/// Sixteen values; false where they reach over the picture's border.
#[inline(always)]
fn cubic_lanes<S: Simd>(
    s: S,
    from: &[f32],
    (width, height): Size,
    [px, py]: [&[f32; LANES]; 2],
    to: &mut [f32; LANES],
) -> bool {
    if width < 4 || height < 4 {
        return false;
    }
    let (px, py) = (s.get(px), s.get(py));
    let one = s.splat(1.0);
    // From the second pixel on, and before the last but one.
    let low = S::F::both(one.le(px), one.le(py));
    let high = S::F::both(
        px.lt(s.splat((width - 2) as f32)),
        py.lt(s.splat((height - 2) as f32)),
    );
    if !S::F::all(S::F::both(low, high)) {
        return false;
    }
    let (left, top) = (px.trunc(), py.trunc());
    let (wx, wy) = (weights(s, px - left), weights(s, py - top));
    let mut sum = s.splat(0.0);
    let (first_x, first_y) = (left.first(), top.first());
    let row = s.splat(first_y);
    let column = left - s.ramp();
    let (low, high) = (s.splat(first_x), s.splat(first_x));
    let in_a_row = S::F::both(
        S::F::both(column.le(high), low.le(column)),
        S::F::both(top.le(row), row.le(top)),
    );
    if S::F::all(in_a_row) {
        let start = (first_y as usize - 1) * width + first_x as usize - 1;
        for (k, wy) in wy.into_iter().enumerate() {
            let start = start + k * width;
            let (a, b) = (s.load(from, start), s.load(from, start + 1));
            let (c, d) = (s.load(from, start + 2), s.load(from, start + 3));
            sum = sum + wy * ((wx[0] * a + wx[1] * b) + (wx[2] * c + wx[3] * d));
        }
    } else {
        let mut row = top - one;
        for wy in wy {
            let (a, b) = s.pairs(from, width, row, left - one);
            let (c, d) = s.pairs(from, width, row, left + one);
            sum = sum + wy * ((wx[0] * a + wx[1] * b) + (wx[2] * c + wx[3] * d));
            row = row + one;
        }
    }
    sum.put(to);
    true
}

/// Sixteen values, some of which may reach over the picture's border. As in [`cubic_at`] a value is the sum of four rows'
/// sums where it is within the picture, and else one sum over all.
#[inline(always)]
fn cubic_border<S: Simd>(
    s: S,
    from: &[f32],
    (width, height): Size,
    [px, py]: [&[f32; LANES]; 2],
    to: &mut [f32; LANES],
) {
    if from.len() < 2 {
        for (to, (px, py)) in to.iter_mut().zip(px.iter().zip(py)) {
            *to = cubic_at(from, (width, height), *px, *py);
        }
        return;
    }
    let (zero, one, two) = (s.splat(0.0), s.splat(1.0), s.splat(2.0));
    let (last_x, last_y) = (s.splat((width - 1) as f32), s.splat((height - 1) as f32));
    let (px, py) = (
        s.get(px).max(zero).min(last_x),
        s.get(py).max(zero).min(last_y),
    );
    let (left, top) = (px.trunc(), py.trunc());
    let (wx, wy) = (weights(s, px - left), weights(s, py - top));
    // No closures: what is not inlined has none of a level's instructions.
    let (first, third, fourth) = (
        (left - one).max(zero),
        (left + one).min(last_x),
        (left + two).min(last_x),
    );
    let mut row = top - one;
    let (mut within, mut beyond) = (zero, zero);
    for wy in wy {
        let y = row.max(zero).min(last_y);
        row = row + one;
        let (a, b) = (
            at(s, from, (width, height), first, y),
            at(s, from, (width, height), left, y),
        );
        let (c, d) = (
            at(s, from, (width, height), third, y),
            at(s, from, (width, height), fourth, y),
        );
        within = within + wy * ((wx[0] * a + wx[1] * b) + (wx[2] * c + wx[3] * d));
        beyond = beyond + wy * wx[0] * a + wy * wx[1] * b + wy * wx[2] * c + wy * wx[3] * d;
    }
    let low = S::F::both(one.le(left), one.le(top));
    let high = S::F::both((left + two).lt(last_x + one), (top + two).lt(last_y + one));
    S::F::select(S::F::both(low, high), within, beyond).put(to);
}

/// Single pixels.
#[inline(always)]
fn at<S: Simd>(s: S, from: &[f32], (width, height): Size, x: S::F, y: S::F) -> S::F {
    let (value, next) = s.pairs(from, width, y, x);
    // The last pixel is the second one of the last pair.
    let (last_x, last_y) = (s.splat((width - 1) as f32), s.splat((height - 1) as f32));
    S::F::select(S::F::both(last_x.le(x), last_y.le(y)), next, value)
}

/// [`cubic`] of sixteen fractions.
#[inline(always)]
fn weights<S: Simd>(s: S, t: S::F) -> [S::F; 4] {
    let (t2, half) = (t * t, s.splat(0.5));
    let t3 = t2 * t;
    [
        s.splat(-0.5) * t3 + t2 - half * t,
        s.splat(1.5) * t3 - s.splat(2.5) * t2 + s.splat(1.0),
        s.splat(-1.5) * t3 + s.splat(2.0) * t2 + half * t,
        half * t3 - half * t2,
    ]
}

/// One value with cubic interpolation, plainly.
#[inline(never)]
pub(super) fn cubic_at(from: &[f32], (width, height): Size, px: f32, py: f32) -> f32 {
    let (last_x, last_y) = ((width - 1) as f32, (height - 1) as f32);
    // A place that is no number is beyond.
    let (px, py) = (px.max(0.0).min(last_x), py.max(0.0).min(last_y));
    let (left, top) = (px as usize, py as usize);
    let (wx, wy) = (cubic(px - left as f32), cubic(py - top as f32));
    let mut sum = 0.0;
    if left >= 1 && top >= 1 && left + 2 < width && top + 2 < height {
        for (k, wy) in wy.into_iter().enumerate() {
            let start = (top + k - 1) * width + left - 1;
            if let Some([a, b, c, d]) = from[start..].first_chunk::<4>() {
                sum += wy * ((wx[0] * a + wx[1] * b) + (wx[2] * c + wx[3] * d));
            }
        }
    } else {
        for (k, wy) in wy.into_iter().enumerate() {
            let row = (top + k).saturating_sub(1).min(height - 1) * width;
            for (l, wx) in wx.into_iter().enumerate() {
                sum += wy * wx * from[row + (left + l).saturating_sub(1).min(width - 1)];
            }
        }
    }
    sum
}

/// A row of a plane between four pixels, or of the nearest one where one of them is not known; NaN beyond the plane.
pub(super) struct Known<'a> {
    pub(super) from: &'a [f32],
    pub(super) size: Size,
    pub(super) places: [&'a [f32]; 2],
    pub(super) to: &'a mut [f32],
}

impl Kernel for Known<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        let [px, py] = self.places;
        let (blocks, rest) = self.to.as_chunks_mut::<LANES>();
        let (px, rest_x) = px.as_chunks::<LANES>();
        let (py, rest_y) = py.as_chunks::<LANES>();
        for (to, (px, py)) in blocks.iter_mut().zip(px.iter().zip(py)) {
            if !known_lanes(s, self.from, self.size, [px, py], to) {
                for (to, (px, py)) in to.iter_mut().zip(px.iter().zip(py)) {
                    *to = known_at(self.from, self.size, *px, *py);
                }
            }
        }
        for (to, (px, py)) in rest.iter_mut().zip(rest_x.iter().zip(rest_y)) {
            *to = known_at(self.from, self.size, *px, *py);
        }
    }
}

/// Sixteen values; false where they reach over the border, or something is not known.
#[inline(always)]
fn known_lanes<S: Simd>(
    s: S,
    from: &[f32],
    (width, height): Size,
    [px, py]: [&[f32; LANES]; 2],
    to: &mut [f32; LANES],
) -> bool {
    let (px, py, zero) = (s.get(px), s.get(py), s.splat(0.0));
    let low = S::F::both(zero.le(px), zero.le(py));
    let high = S::F::both(
        px.lt(s.splat((width - 1) as f32)),
        py.lt(s.splat((height - 1) as f32)),
    );
    if !S::F::all(S::F::both(low, high)) {
        return false;
    }
    let Some(between) = bilinear_lanes(s, from, (width, height), [px, py]) else {
        return false;
    };
    between.put(to);
    S::F::all(between.le(between))
}

/// One value, plainly.
#[inline(never)]
fn known_at(plane: &[f32], (width, height): Size, x: f32, y: f32) -> f32 {
    if !(x > -0.5 && y > -0.5 && x < width as f32 - 0.5 && y < height as f32 - 0.5) {
        return f32::NAN;
    }
    let (cx, cy) = (
        x.max(0.0).min((width - 1) as f32),
        y.max(0.0).min((height - 1) as f32),
    );
    let (left, top) = (cx as usize, cy as usize);
    let (right, down) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
    let (fx, fy) = (cx - left as f32, cy - top as f32);
    let (a, b) = (plane[top * width + left], plane[top * width + right]);
    let (c, d) = (plane[down * width + left], plane[down * width + right]);
    let (upper, lower) = (a + fx * (b - a), c + fx * (d - c));
    let between = upper + fy * (lower - upper);
    if between.is_nan() {
        plane[(cy + 0.5) as usize * width + (cx + 0.5) as usize]
    } else {
        between
    }
}

#[cfg(test)]
mod tests;
