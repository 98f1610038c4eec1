//! How much the windows of a level say of their displacement: the share of what is known of it that is their own, beside a
//! flow that is known to half a pixel or so of the frame.
//!
//! The variance of a displacement is that of the noise over the smaller eigenvalue of the structure tensor and the pixels of
//! the window that are independent; on a coarse level its pixels count as many times as much. Noise is read off the windows
//! that fit best: what others are left with may be an error of the flow so far.
//!
//! `docs/explanation/algorithms.md`, section "Windows that say nothing".

use crate::error::Result;
use crate::frame::Plane;
use crate::memory::{reserve, resize};

use super::padded_plane::PaddedPlane;

/// Half the windows, in pixels of the grid.
const RADIUS: usize = 2;
const SIZE: usize = 2 * RADIUS + 1;
/// The mean squared differences of this share of the windows are those of noise.
const QUIET: f32 = 0.2;
/// Noise is at most this many times as strong elsewhere.
const STRONG: f32 = 4.0;
/// Mean squared differences that noise alone has, as a multiple of the smaller eigenvalue of its structure tensor: 8 to 10;
/// less, as flat ground must say nothing however large it is.
const NOISE: f32 = 4.0;
/// The noise of the quietest pictures, in squared grey levels.
const QUIETEST: f32 = 0.002;
/// The variance of a displacement that is as much as nothing, over that of one pixel of noise: squared pixels of the frame,
/// for windows of 12 independent pixels.
const VAGUE: f32 = 1.3;
/// Windows that say less than this share of the mean do not speak for the whole flow.
const LITTLE: f32 = 0.25;

/// What windows say, and the memory for it.
#[derive(Debug, Default)]
pub(super) struct Sureness {
    /// Of the grid; 0 where nothing is known of any window.
    width: usize,
    /// Windows that say less do not speak for the whole flow.
    least: f32,
    /// 0 to 1.
    shares: Vec<f32>,
    /// Products of the gradients: xx, xy, yy.
    products: [Vec<f32>; 3],
    /// Their sums over columns, with room on both sides.
    columns: [Vec<f32>; 3],
    energies: Vec<f32>,
}

impl Sureness {
    /// Nothing is known of any window.
    pub(super) fn forget(&mut self) {
        self.width = 0;
    }

    /// Rows of the shares, 0 to 1.
    pub(super) fn rows(&self) -> impl Iterator<Item = &[f32]> {
        self.shares.chunks_exact(self.width.max(1))
    }

    /// Whether the window at this place, -1 to 1 along each axis, speaks for the whole flow; all do where nothing is known.
    pub(super) fn speaks(&self, place: [f64; 2]) -> bool {
        if self.width == 0 {
            return true;
        }
        let height = self.shares.len() / self.width;
        let [x, y] = [(place[0], self.width), (place[1], height)]
            .map(|(place, size)| ((0.5 * (place + 1.0) * size as f64) as usize).min(size - 1));
        self.shares[y * self.width + x] >= self.least
    }

    /// Find what the windows of `plane`, that of `level`, say at one pixel in `step` x `step`, where `energy` is what the
    /// flow leaves of them, on that grid or on one of twice or half its size. Pixels without `weight` say nothing.
    pub(super) fn measure(
        &mut self,
        plane: &Plane,
        (level, step): (usize, usize),
        energy: &PaddedPlane,
        weight: Option<&Plane>,
    ) -> Result<()> {
        let (width, height) = (plane.width().div_ceil(step), plane.height().div_ceil(step));
        self.width = 0;
        resize("shares of windows", &mut self.shares, width * height, 0.0)?;
        let most = STRONG * self.quiet(energy)?;
        self.multiply_gradients(plane, step, (width, height))?;
        for columns in &mut self.columns {
            columns.clear();
            resize("sums of gradients", columns, width + 2 * RADIUS, 0.0)?;
        }
        let vague = VAGUE * (1u32 << (2 * level)) as f32;
        let counts =
            |at: usize, size: usize| (at + RADIUS + 1).min(size) - at.saturating_sub(RADIUS);
        let mut sum = 0.0;
        for y in 0..height {
            let rows = y.saturating_sub(RADIUS)..(y + RADIUS + 1).min(height);
            let down = rows.len();
            for (columns, products) in self.columns.iter_mut().zip(&self.products) {
                let columns = &mut columns[RADIUS..RADIUS + width];
                columns.fill(0.0);
                for near in rows.clone() {
                    for (sum, value) in columns.iter_mut().zip(&products[near * width..]) {
                        *sum += value;
                    }
                }
            }
            let energies = energy.row(place(y, height, energy.height()));
            let weights = weight.map(|weight| weight.row(y * step));
            let shares = &mut self.shares[y * width..][..width];
            for (x, share) in shares.iter_mut().enumerate() {
                let [xx, xy, yy] = self
                    .columns
                    .each_ref()
                    .map(|columns| columns[x..x + SIZE].iter().sum::<f32>());
                let (mean, half) = (0.5 * (xx + yy), 0.5 * (xx - yy));
                let least = mean - (half * half + xy * xy).sqrt();
                let texture = least / (down * counts(x, width)) as f32;
                let own = energies[place(x, width, energies.len())];
                let noise = own.max(0.0).min(most) + QUIETEST;
                let signal = (texture - noise / NOISE).max(0.0);
                let counts = weights.is_none_or(|weights| weights[x * step] > 0.0);
                *share = if counts {
                    signal / (signal + vague * noise)
                } else {
                    0.0
                };
                sum += *share;
            }
        }
        self.width = width;
        self.least = LITTLE * sum / self.shares.len() as f32;
        Ok(())
    }

    /// The mean squared difference of the windows that fit best.
    fn quiet(&mut self, energy: &PaddedPlane) -> Result<f32> {
        self.energies.clear();
        let pixels = energy.width() * energy.height();
        reserve("energies", &mut self.energies, pixels)?;
        for y in 0..energy.height() {
            let known = energy.row(y).iter().filter(|value| **value < f32::MAX);
            self.energies.extend(known);
        }
        if self.energies.is_empty() {
            return Ok(0.0);
        }
        let place = (QUIET * self.energies.len() as f32) as usize;
        let (_, quiet, _) = self.energies.select_nth_unstable_by(place, f32::total_cmp);
        Ok(quiet.max(0.0))
    }

    /// Write the products of the central differences of `plane` at one pixel in `step` x `step`.
    fn multiply_gradients(
        &mut self,
        plane: &Plane,
        step: usize,
        (width, height): (usize, usize),
    ) -> Result<()> {
        for products in &mut self.products {
            resize("products of gradients", products, width * height, 0.0)?;
        }
        let [xx, xy, yy] = &mut self.products;
        for y in 0..height {
            let at = y * step;
            let above = plane.row(at.saturating_sub(1));
            let below = plane.row((at + 1).min(plane.height() - 1));
            let row = plane.row(at);
            let [xx, xy, yy] =
                [&mut *xx, xy, yy].map(|products| &mut products[y * width..][..width]);
            for x in 0..width {
                let at = x * step;
                let along = 0.5 * (row[(at + 1).min(row.len() - 1)] - row[at.saturating_sub(1)]);
                let down = 0.5 * (below[at] - above[at]);
                (xx[x], xy[x], yy[x]) = (along * along, along * down, down * down);
            }
        }
        Ok(())
    }
}

/// The pixel of a grid of `other` pixels, of the same, half or twice the size, at pixel `at` of one of `size`.
fn place(at: usize, size: usize, other: usize) -> usize {
    if other == size {
        at
    } else if other < size {
        (at / 2).min(other - 1)
    } else {
        (2 * at).min(other - 1)
    }
}

#[cfg(test)]
mod tests {
    use super::super::padded_plane::PAD;
    use super::*;

    fn energies(width: usize, height: usize, value: f32) -> PaddedPlane {
        let mut energy = PaddedPlane::default();
        energy.resize(width, height).unwrap();
        for y in 0..height {
            energy.padded_mut(y)[PAD..PAD + width].fill(value);
        }
        energy
    }

    #[test]
    fn texture_speaks_and_flat_ground_does_not() {
        let (width, height) = (40, 30);
        let mut plane = Plane::new(width, height).unwrap();
        for y in 0..height {
            for x in 0..width / 2 {
                plane.row_mut(y)[x] = ((x * x * 7 + y * y * 13 + x * y) % 11) as f32 * 10.0;
            }
        }
        for (step, size) in [(1, (width, height)), (2, (width / 2, height / 2))] {
            for energy in [
                energies(width, height, 0.1),
                energies(width / 2, height / 2, 0.1),
            ] {
                let mut sureness = Sureness::default();
                assert!(sureness.speaks([0.9, 0.0]));
                sureness.measure(&plane, (2, step), &energy, None).unwrap();
                assert_eq!(sureness.rows().count(), size.1);
                for row in sureness.rows() {
                    assert_eq!(row.len(), size.0);
                    assert!(row[..size.0 / 2 - 3].iter().all(|share| *share > 0.8));
                    assert!(row[size.0 / 2 + 4..].iter().all(|share| *share == 0.0));
                }
                assert!(sureness.speaks([-0.9, 0.0]) && !sureness.speaks([0.9, 0.0]));
            }
        }
    }

    #[test]
    fn lines_do_not_tell_where_they_slide() {
        let mut plane = Plane::new(32, 32).unwrap();
        for y in 0..32 {
            for x in 0..32 {
                plane.row_mut(y)[x] = (x % 4) as f32 * 20.0;
            }
        }
        let mut sureness = Sureness::default();
        sureness
            .measure(&plane, (0, 1), &energies(32, 32, 1.0), None)
            .unwrap();
        assert!(sureness.rows().flatten().all(|share| *share < 0.01));
    }

    #[test]
    fn what_does_not_count_says_nothing() {
        let mut plane = Plane::new(16, 16).unwrap();
        let mut weight = Plane::new(16, 16).unwrap();
        for y in 0..16 {
            for x in 0..16 {
                plane.row_mut(y)[x] = ((x * x * 7 + y * y * 13 + x * y) % 11) as f32 * 10.0;
                weight.row_mut(y)[x] = if x < 8 { 1.0 } else { 0.0 };
            }
        }
        let mut sureness = Sureness::default();
        sureness
            .measure(&plane, (0, 1), &energies(16, 16, f32::MAX), Some(&weight))
            .unwrap();
        for row in sureness.rows() {
            assert!(row[..8].iter().all(|share| *share > 0.0));
            assert!(row[8..].iter().all(|share| *share == 0.0));
        }
    }
}
