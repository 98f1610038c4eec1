//! Rows of the samples of a background.

use crate::simd::{Kernel, Simd};

/// Samples of a pixel.
pub(crate) const SAMPLES: usize = 16;

/// Units of a sample in a grey level.
pub(super) const UNITS: f32 = 16.0;

/// Pixels whose medians are made at once.
pub(super) const BLOCK: usize = 64;

#[inline(always)]
pub(super) fn sample_of(value: f32) -> i16 {
    (value * UNITS + 0.5).floor() as i16
}

/// [`sample_of`] of single values: where there is no instruction for it, rounding down is a call.
#[inline(always)]
pub(super) fn one_sample_of(value: f32) -> i16 {
    let value = value * UNITS + 0.5;
    let whole = value as i32;
    let whole = whole.saturating_sub(i32::from(whole as f32 > value));
    whole.clamp(i32::from(i16::MIN), i32::from(i16::MAX)) as i16
}

pub(super) struct RelitSamples<'a> {
    pub(super) gain: &'a [f32],
    pub(super) offset: &'a [f32],
    pub(super) samples: &'a mut [i16],
}

impl Kernel for RelitSamples<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        for ((sample, gain), offset) in self.samples.iter_mut().zip(self.gain).zip(self.offset) {
            *sample = sample_of(f32::from(*sample) * (1.0 / UNITS) * gain + offset);
        }
    }
}

pub(super) struct Distances<'a> {
    pub(super) samples: &'a [i16],
    pub(super) pixels: usize,
    pub(super) start: usize,
    pub(super) picture: &'a [f32],
    /// Where both samples are found this near, in units, others are not looked for.
    pub(super) enough: i16,
    pub(super) to: &'a mut [f32],
}

impl Kernel for Distances<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let plane = |k: usize| &self.samples[k * self.pixels + self.start..][..self.picture.len()];
        let planes: [&[i16]; SAMPLES] = std::array::from_fn(plane);
        let (whole, rest) = self.picture.as_chunks::<BLOCK>();
        let (whole_to, rest_to) = self.to.as_chunks_mut::<BLOCK>();
        for (block, (picture, to)) in whole.iter().zip(whole_to).enumerate() {
            let at = block * BLOCK;
            let samples = |k: usize| planes[k][at..].first_chunk::<BLOCK>();
            nearest_two(picture, samples, self.enough, to);
        }
        if rest.is_empty() {
            return;
        }
        let (mut picture, mut to, mut padded) = ([0.0; BLOCK], [0.0; BLOCK], [[0; BLOCK]; SAMPLES]);
        picture[..rest.len()].copy_from_slice(rest);
        for (padded, plane) in padded.iter_mut().zip(planes) {
            padded[..rest.len()].copy_from_slice(&plane[whole.len() * BLOCK..]);
        }
        nearest_two(&picture, |k| padded.get(k), self.enough, &mut to);
        rest_to.copy_from_slice(&to[..rest.len()]);
    }
}

/// How far the second nearest of the samples is from each pixel of a block.
#[inline(always)]
fn nearest_two<'a>(
    picture: &[f32; BLOCK],
    samples: impl Fn(usize) -> Option<&'a [i16; BLOCK]>,
    enough: i16,
    to: &mut [f32; BLOCK],
) {
    let mut value = [0i16; BLOCK];
    for (to, from) in value.iter_mut().zip(picture) {
        *to = sample_of(*from);
    }
    let (mut first, mut second) = ([i16::MAX; BLOCK], [i16::MAX; BLOCK]);
    // Two at a time, so that what is nearest is seldom written.
    for pair in 0..SAMPLES / 2 {
        let (Some(a), Some(b)) = (samples(2 * pair), samples(2 * pair + 1)) else {
            return;
        };
        let mut most = 0;
        for x in 0..BLOCK {
            let a = a[x].saturating_sub(value[x]).saturating_abs();
            let b = b[x].saturating_sub(value[x]).saturating_abs();
            let (low, high) = (a.min(b), a.max(b));
            second[x] = second[x].min(first[x].max(low)).min(high);
            first[x] = first[x].min(low);
            most = second[x].max(most);
        }
        if most <= enough {
            break;
        }
    }
    for (to, second) in to.iter_mut().zip(&second) {
        *to = f32::from(*second) * (1.0 / UNITS);
    }
}

/// Sort each column of sixteen: K. Batcher's odd-even merge sort.
pub(super) struct Sort<'a>(pub(super) &'a mut [[i16; BLOCK]; SAMPLES]);

impl Kernel for Sort<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let mut p = 1;
        while p < SAMPLES {
            let mut k = p;
            while k >= 1 {
                let mut j = k % p;
                while j + k < SAMPLES {
                    for i in 0..k.min(SAMPLES - j - k) {
                        let (a, b) = (i + j, i + j + k);
                        if a / (2 * p) == b / (2 * p) {
                            let (upper, lower) = self.0.split_at_mut(b);
                            for (x, y) in upper[a].iter_mut().zip(&mut lower[0]) {
                                let (least, most) = ((*x).min(*y), (*x).max(*y));
                                *x = least;
                                *y = most;
                            }
                        }
                    }
                    j += 2 * k;
                }
                k /= 2;
            }
            p *= 2;
        }
    }
}

/// Distance between the fourth and the thirteenth of sixteen normal samples, in standard deviations.
const SPREAD: f32 = 1.32;

/// The median of each column and its deviation.
pub(super) struct Refresh<'a> {
    pub(super) block: &'a mut [[i16; BLOCK]; SAMPLES],
    pub(super) median: &'a mut [f32],
    pub(super) deviation: &'a mut [f32],
}

impl Kernel for Refresh<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, s: S) {
        Sort(self.block).run(s);
        let (low, high) = (&self.block[7], &self.block[8]);
        for (median, (low, high)) in self.median.iter_mut().zip(low.iter().zip(high)) {
            *median = (i32::from(*low) + i32::from(*high)) as f32 / (2.0 * UNITS);
        }
        let (low, high) = (&self.block[3], &self.block[12]);
        for (deviation, (low, high)) in self.deviation.iter_mut().zip(low.iter().zip(high)) {
            *deviation = (i32::from(*high) - i32::from(*low)) as f32 / (SPREAD * UNITS);
        }
    }
}
