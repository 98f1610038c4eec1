//! Eight `f32` side by side: what kernels compute with.
//!
//! The count is fixed, so that a sum over lanes has one order on every CPU level. Sixteen lanes would leave more of a
//! window's rows to padding than they gain.

use std::ops::{Add, AddAssign, Mul, Sub};

/// Lanes of one [`Lanes`].
pub(crate) const LANES: usize = 8;

/// Eight `f32`; arithmetic is element by element.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Lanes([f32; LANES]);

impl Lanes {
    pub(crate) const ZERO: Self = Self([0.0; LANES]);

    /// The same value in every lane.
    #[inline(always)]
    pub(crate) fn splat(value: f32) -> Self {
        Self([value; LANES])
    }

    /// The first eight values of `from`.
    #[inline(always)]
    pub(crate) fn load(from: &[f32]) -> Self {
        let mut lanes = [0.0; LANES];
        lanes.copy_from_slice(&from[..LANES]);
        Self(lanes)
    }

    /// Write to the first eight values of `to`.
    #[inline(always)]
    pub(crate) fn store(self, to: &mut [f32]) {
        to[..LANES].copy_from_slice(&self.0);
    }

    /// Keep the lanes of `mask`, zero the others, whatever they hold.
    #[inline(always)]
    pub(crate) fn keep(self, mask: LaneMask) -> Self {
        let mut lanes = self.0;
        for (lane, mask) in lanes.iter_mut().zip(mask.0) {
            *lane = f32::from_bits(lane.to_bits() & mask);
        }
        Self(lanes)
    }

    /// The square roots.
    #[inline(always)]
    pub(crate) fn sqrt(self) -> Self {
        let mut lanes = self.0;
        for lane in &mut lanes {
            *lane = lane.sqrt();
        }
        Self(lanes)
    }

    /// The sum over lanes, in a fixed order.
    #[inline(always)]
    pub(crate) fn sum(self) -> f32 {
        let [a, b, c, d, e, f, g, h] = self.0;
        ((a + e) + (c + g)) + ((b + f) + (d + h))
    }
}

/// Which lanes count.
#[derive(Debug, Clone, Copy)]
pub(crate) struct LaneMask([u32; LANES]);

impl LaneMask {
    /// The first `count` lanes, all of them from eight on.
    #[inline(always)]
    pub(crate) fn first(count: usize) -> Self {
        let mut mask = [0; LANES];
        for lane in mask.iter_mut().take(count) {
            *lane = u32::MAX;
        }
        Self(mask)
    }
}

macro_rules! elementwise {
    ($trait:ident, $method:ident, $assign:tt) => {
        impl $trait for Lanes {
            type Output = Self;

            #[inline(always)]
            fn $method(self, other: Self) -> Self {
                let mut lanes = self.0;
                for (lane, other) in lanes.iter_mut().zip(other.0) {
                    *lane $assign other;
                }
                Self(lanes)
            }
        }
    };
}
elementwise!(Add, add, +=);
elementwise!(Sub, sub, -=);
elementwise!(Mul, mul, *=);

impl AddAssign for Lanes {
    #[inline(always)]
    fn add_assign(&mut self, other: Self) {
        *self = *self + other;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lanes_are_independent_and_summed_once() {
        let lanes = Lanes::load(&[1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0]) * Lanes::splat(2.0)
            - Lanes::splat(1.0);
        assert_eq!(lanes.sum(), 64.0);
        let mut nan = [f32::NAN; LANES];
        nan[0] = 3.0;
        assert_eq!(Lanes::load(&nan).keep(LaneMask::first(1)).sum(), 3.0);
        let mut out = [0.0; LANES];
        lanes.store(&mut out);
        assert_eq!(out, [1.0, 3.0, 5.0, 7.0, 9.0, 11.0, 13.0, 15.0]);
    }
}
