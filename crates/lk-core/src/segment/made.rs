//! What the tests of this folder share: masks and planes without a pattern, every way to run, and a clock.
#![allow(
    clippy::print_stdout,
    reason = "figures are printed for those who ask for them"
)]

use std::time::Instant;

use crate::execution::Execution;
use crate::simd::SimdLevel;

/// Numbers without a pattern, the same for the same seed.
pub(crate) struct Numbers(u64);

impl Numbers {
    /// From this seed on.
    pub(crate) fn new(seed: u64) -> Self {
        Self(seed ^ 0x9e37_79b9_7f4a_7c15)
    }

    /// One of 0..1.
    pub(crate) fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
    }

    /// One of a standard normal distribution, nearly: the sum of twelve.
    pub(crate) fn normal(&mut self) -> f64 {
        (0..12).map(|_| self.next()).sum::<f64>() - 6.0
    }
}

/// A mask of which about this share is set.
pub(crate) fn mask((width, height): (usize, usize), share: f64, seed: u64) -> Vec<u8> {
    let mut numbers = Numbers::new(seed);
    (0..width * height)
        .map(|_| u8::from(numbers.next() < share))
        .collect()
}

/// Grey levels from 0 to 255.
pub(crate) fn greys((width, height): (usize, usize), seed: u64) -> Vec<f32> {
    let mut numbers = Numbers::new(seed);
    (0..width * height)
        .map(|_| (255.0 * numbers.next()) as f32)
        .collect()
}

/// One thread and several, on each level.
pub(crate) fn every_way() -> Vec<Execution> {
    SimdLevel::available()
        .into_iter()
        .flat_map(|level| [1, 3].map(|threads| Execution::default().threads(threads).level(level)))
        .collect()
}

/// The bits of each value.
pub(crate) fn bits(values: &[f32]) -> Vec<u32> {
    values.iter().map(|value| value.to_bits()).collect()
}

/// Print the best of some runs, in nanoseconds a pixel and in microseconds.
pub(crate) fn time(name: &str, (width, height): (usize, usize), work: &mut dyn FnMut()) {
    let best = (0..40)
        .map(|_| {
            let start = Instant::now();
            work();
            start.elapsed().as_secs_f64()
        })
        .fold(f64::INFINITY, f64::min);
    println!(
        "{name:32} {:7.3} ns/px {:8.1} us",
        best * 1e9 / (width * height) as f64,
        best * 1e6
    );
}
