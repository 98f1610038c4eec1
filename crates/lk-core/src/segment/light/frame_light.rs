//! One gain and one offset for a whole frame, by least trimmed squares over a sample of its pixels.
//!
//! Lines through pairs of samples, and some that are likely, are held to a part of the sample: the line from which the
//! nearest third of it is least far starts the fit. So a switched lamp is found from any distance, and where half of the frame has
//! another light the fit is of one half and not of neither.

use crate::error::Result;
use crate::memory::reserve;

use super::pair::Pair;

/// About so many pixels are enough, on rows each of which begins elsewhere.
const SAMPLES: usize = 2000;
/// Fewer tell too little.
const FEWEST: usize = 64;
/// Lines are held to so many of them.
const JUDGES: usize = 160;
/// Lines through pairs.
const PAIRS: usize = 16;
/// What comes of a pair must have this share of the spread of what is likely, or less.
const BETTER: f32 = 0.9;
/// What a camera's exposure and a lamp do from frame to frame; beyond is not light.
pub(super) const GAINS: [f32; 2] = [0.3, 3.0];
/// Rounds of least squares, and how many standard deviations from the line count.
const ROUNDS: usize = 4;
const REACH: f32 = 3.0;
/// This share of the sample, the nearest, says how far the rest may be: most of it may be things. Of a normal distribution
/// it lies within the inverse of this many standard deviations.
const NEAREST: f32 = 0.35;
const DEVIATION: f32 = 2.2037;
/// A share of the range of grey levels to which light is known at best.
const LEAST_SPREAD: f32 = 2e-3;

/// What a whole frame's light is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct FrameLight {
    /// What the reference is multiplied by.
    pub(crate) gain: f32,
    /// What is then added.
    pub(crate) offset: f32,
    /// Standard deviation of what is left of the pixels that it fits; infinite where there were too few.
    pub(crate) spread: f32,
    /// Share of the sample that it fits.
    pub(crate) share: f32,
    /// Range of most of the reference's grey levels in this light.
    pub(crate) range: f32,
    /// The middle of it.
    pub(crate) middle: f32,
}

impl FrameLight {
    /// Where nothing is known.
    pub(super) const NONE: Self = Self {
        gain: 1.0,
        offset: 0.0,
        spread: f32::INFINITY,
        share: 0.0,
        range: 0.0,
        middle: 0.0,
    };
}

/// Memory of the fit.
#[derive(Debug, Default)]
pub(super) struct Sample {
    pairs: Vec<[f32; 2]>,
    ordered: Vec<[f32; 2]>,
    values: Vec<f32>,
}

impl Sample {
    /// Fit the light in which the reference looks as the image does. `start` is a light that is likely.
    pub(super) fn fit(&mut self, pair: &Pair<'_>, start: [f32; 2]) -> Result<FrameLight> {
        self.take(pair)?;
        if self.pairs.len() < FEWEST {
            return Ok(FrameLight::NONE);
        }
        let [likely, paired] = self.begin(start);
        let (mut line, mut spread) = self.refined(likely.unwrap_or(start));
        if let Some(paired) = paired {
            let other = self.refined(paired);
            if other.1 < BETTER * spread {
                (line, spread) = other;
            }
        }
        let (mut near, mut square) = (0.0f32, 0.0);
        for pair in &self.pairs {
            let distance = far(line, *pair);
            if distance <= REACH * spread {
                near += 1.0;
                square += distance * distance;
            }
        }
        let last = self.ordered.len() - 1;
        let [low, high] = [last / 50, last - last / 50].map(|at| self.ordered[at][0]);
        Ok(FrameLight {
            gain: line[0],
            offset: line[1],
            spread: (square / near.max(1.0)).sqrt().max(f32::MIN_POSITIVE),
            share: near / self.pairs.len() as f32,
            range: line[0] * (high - low),
            middle: line[0] * (low + high) * 0.5 + line[1],
        })
    }

    /// A line after rounds of least squares, and the spread around it.
    fn refined(&mut self, mut line: [f32; 2]) -> ([f32; 2], f32) {
        let mut spread = self.spread(line);
        for _ in 0..ROUNDS {
            line = self.least_squares(line, spread);
            spread = self.spread(line);
        }
        (line, spread)
    }

    /// Take pixels that count, all over the frame.
    fn take(&mut self, pair: &Pair<'_>) -> Result<()> {
        let (width, height) = pair.size;
        let step = (width * height / SAMPLES).isqrt().max(1);
        let most = (height / step + 1) * (width / step + 1);
        self.pairs.clear();
        self.ordered.clear();
        self.values.clear();
        reserve("samples of light", &mut self.pairs, most)?;
        reserve("samples of light", &mut self.ordered, most)?;
        reserve("samples of light", &mut self.values, most)?;
        for (index, y) in (step / 2..height).step_by(step).enumerate() {
            // By the golden section: no column and no period of the picture is met in every row.
            let first = index * 79 % 128 * step / 128;
            for x in (first..width).step_by(step) {
                if let Some(values) = pair.at(y * width + x) {
                    self.pairs.push(values);
                }
            }
        }
        Ok(())
    }

    /// The best of the lines that are likely, and the best through a pair, by how far the nearest are.
    fn begin(&mut self, start: [f32; 2]) -> [Option<[f32; 2]>; 2] {
        let count = self.pairs.len();
        self.ordered.extend_from_slice(&self.pairs);
        self.ordered.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]));
        self.values
            .extend(self.pairs.iter().map(|pair| pair[1] - pair[0]));
        let steady = [1.0, quantile(&mut self.values, 0.5)];
        // Where the sample's order is kept the light is what brings one's tenths to the other's.
        self.values.clear();
        self.values.extend(self.pairs.iter().map(|pair| pair[1]));
        self.values.sort_unstable_by(f32::total_cmp);
        let [tenths, quarters] = [10, 4].map(|part| {
            let ends = [count / part, count - 1 - count / part];
            through(ends.map(|at| [self.ordered[at][0], self.values[at]]))
        });
        // Pairs of a dark one and a bright one, spread over both thirds.
        let third = count / 3;
        let pairs = (0..PAIRS).map(|index| {
            let [dark, bright] =
                [index * 11 % PAIRS, index * 7 % PAIRS].map(|part| part * third / PAIRS);
            through([self.ordered[dark], self.ordered[count - 1 - bright]])
        });
        let likely = [Some(steady), Some(start), tenths, quarters];
        [self.nearest(likely.into_iter()), self.nearest(pairs)]
    }

    /// The first of the lines from which the nearest of the sample are least far.
    fn nearest(&self, lines: impl Iterator<Item = Option<[f32; 2]>>) -> Option<[f32; 2]> {
        let judged = lines.flatten().map(|line| (self.judged(line), line));
        judged
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map(|(_, line)| line)
    }

    /// How far the nearest of some of the sample are from a line.
    fn judged(&self, line: [f32; 2]) -> f32 {
        let step = (self.pairs.len() / JUDGES).max(1);
        let mut distances = [f32::INFINITY; JUDGES];
        let mut count = 0;
        for (distance, pair) in distances.iter_mut().zip(self.pairs.iter().step_by(step)) {
            *distance = far(line, *pair);
            count += 1;
        }
        quantile(&mut distances[..count], NEAREST)
    }

    /// The robust standard deviation around a line.
    fn spread(&mut self, line: [f32; 2]) -> f32 {
        self.values.clear();
        self.values
            .extend(self.pairs.iter().map(|pair| far(line, *pair)));
        // Pictures of whole grey levels may differ by nothing in most of their pixels.
        let least = LEAST_SPREAD * (self.ordered[self.ordered.len() - 1][0] - self.ordered[0][0]);
        let near = quantile(&mut self.values, NEAREST);
        (DEVIATION * near).max(least).max(f32::MIN_POSITIVE)
    }

    /// The line through what lies near one.
    fn least_squares(&self, line: [f32; 2], spread: f32) -> [f32; 2] {
        let near = || {
            self.pairs
                .iter()
                .filter(|pair| far(line, **pair) <= REACH * spread)
        };
        let (mut count, mut sums) = (0.0f64, [0.0f64; 2]);
        for [a, b] in near() {
            count += 1.0;
            sums[0] += f64::from(*a);
            sums[1] += f64::from(*b);
        }
        if count == 0.0 {
            return line;
        }
        let [mean_a, mean_b] = sums.map(|sum| sum / count);
        let (mut square, mut product) = (0.0, 0.0);
        for [a, b] in near() {
            let x = f64::from(*a) - mean_a;
            square += x * x;
            product += x * (f64::from(*b) - mean_b);
        }
        // Without contrast beyond the noise, of one picture of two, a gain cannot be told from an offset.
        let noise = f64::from(spread * spread);
        let contrast = (square / count - 0.5 * noise).max(0.0);
        let share = contrast * contrast / (contrast * contrast + noise * noise);
        let [least, most] = GAINS.map(f64::from);
        let gain = if share > 0.0 {
            1.0 + share * (product / square - 1.0)
        } else {
            1.0
        };
        let gain = gain.clamp(least, most);
        [gain as f32, (mean_b - gain * mean_a) as f32]
    }
}

/// How far the second of a pair is from a line over the first.
fn far([gain, offset]: [f32; 2], [a, b]: [f32; 2]) -> f32 {
    (b - gain * a - offset).abs()
}

/// The line through two pairs, if light makes such ones.
fn through([[a, b], [c, d]]: [[f32; 2]; 2]) -> Option<[f32; 2]> {
    let gain = (d - b) / (c - a);
    (GAINS[0]..=GAINS[1])
        .contains(&gain)
        .then_some([gain, b - gain * a])
}

/// The value below which this share of others lies.
fn quantile(values: &mut [f32], share: f32) -> f32 {
    let at = (share * values.len() as f32) as usize;
    *values.select_nth_unstable_by(at, f32::total_cmp).1
}
