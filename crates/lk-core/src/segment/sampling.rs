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
                for (to, (px, py)) in to.iter_mut().zip(px.iter().zip(py)) {
                    *to = cubic_at(self.from, self.size, *px, *py);
                }
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
            let [a, b, c, d] = [0, 1, 2, 3].map(|l| s.load(from, start + l));
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

/// Pixels whose places are found at once.
const BLOCK: usize = 64;

/// A row of what a plane has at the nearest pixel of each place; `missing` beyond.
pub(super) struct Nearest<'a, T> {
    pub(super) from: &'a [T],
    pub(super) size: Size,
    pub(super) places: [&'a [f32]; 2],
    pub(super) missing: T,
    pub(super) to: &'a mut [T],
}

impl<T: Copy> Kernel for Nearest<'_, T> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let [px, py] = self.places;
        let (width, height) = (self.size.0 as f32, self.size.1 as f32);
        let stride = self.size.0 as i32;
        let places = px.chunks(BLOCK).zip(py.chunks(BLOCK));
        for (to, (px, py)) in self.to.chunks_mut(BLOCK).zip(places) {
            let mut index = [0i32; BLOCK];
            let first = index_of([px[0], py[0]], [width, height], stride);
            let mut in_a_row = first >= 0;
            let steps = index.iter_mut().zip(px.iter().zip(py)).zip(0..);
            for ((index, (px, py)), step) in steps {
                *index = index_of([*px, *py], [width, height], stride);
                in_a_row &= *index == first.wrapping_add(step);
            }
            if in_a_row {
                to.copy_from_slice(&self.from[first as usize..][..to.len()]);
                continue;
            }
            for (to, index) in to.iter_mut().zip(&index) {
                *to = match usize::try_from(*index) {
                    Ok(at) => self.from[at],
                    Err(_) => self.missing,
                };
            }
        }
    }
}

/// The pixel at a place, -1 beyond the plane.
#[inline(always)]
fn index_of([px, py]: [f32; 2], [width, height]: [f32; 2], stride: i32) -> i32 {
    let (px, py) = (px + 0.5, py + 0.5);
    let within = (px >= 0.0) & (py >= 0.0) & (px < width) & (py < height);
    let at = (py as i32).wrapping_mul(stride).wrapping_add(px as i32);
    if within { at } else { -1 }
}

/// A row of where a mask covers at least half of what is around each place.
pub(super) struct Covered<'a> {
    pub(super) from: &'a [u8],
    pub(super) size: Size,
    pub(super) places: [&'a [f32]; 2],
    pub(super) to: &'a mut [u8],
}

impl Kernel for Covered<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let (from, (width, height)) = (self.from, self.size);
        let [px, py] = self.places;
        for (to, (px, py)) in self.to.iter_mut().zip(px.iter().zip(py)) {
            let within = *px > -1.0 && *py > -1.0 && *px < width as f32 && *py < height as f32;
            if !within {
                *to = 0;
                continue;
            }
            let (left, top) = (px.max(0.0) as u32 as usize, py.max(0.0) as u32 as usize);
            let (right, down) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
            let (a, b) = (from[top * width + left], from[top * width + right]);
            let (c, d) = (from[down * width + left], from[down * width + right]);
            *to = match a + b + c + d {
                0 => 0,
                4 => 1,
                _ => {
                    let (fx, fy) = (px - left as f32, py - top as f32);
                    let (a, b, c, d) = (f32::from(a), f32::from(b), f32::from(c), f32::from(d));
                    let (upper, lower) = (a + fx * (b - a), c + fx * (d - c));
                    u8::from(upper + fy * (lower - upper) >= 0.5)
                }
            };
        }
    }
}

#[cfg(test)]
mod tests;
