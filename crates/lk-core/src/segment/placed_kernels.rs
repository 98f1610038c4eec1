//! Rows of planes and masks at the nearest pixels of places.

use super::morphology::Size;
use crate::simd::{Kernel, Simd};

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
