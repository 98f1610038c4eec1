//! Where the picture repeats around a point: displacements within `prev` at which its surroundings are like themselves.

use crate::simd::{Kernel, dispatch};
use crate::track::solve::Problem;

/// Lags that are kept, of opposite ones only one.
pub(super) const MAX_LAGS: usize = FOUND + 2;

/// Of those found, the shortest are kept.
const FOUND: usize = 4;

/// Sine of the angle between two lags of different directions, and the share of the shorter one to which two are the same.
const ACROSS: f64 = 0.3;
const SAME: f64 = 0.25;

/// Levels that are looked at, and on each the shortest and the longest lag, in its own pixels.
const LOOKS: [(isize, isize); 3] = [(3, 8), (4, 12), (5, 16)];

/// How far the last of the levels is looked at.
const REACH: isize = 16;
const LAGS: usize = 2 * REACH as usize + 1;

/// Lags of a row in groups: the loop over one is of a length that the compiler knows.
const GROUP: usize = 8;
const GROUPS: usize = LAGS.div_ceil(GROUP);

/// Sides of the patch that is compared with its surroundings: as large as the window, within these bounds.
const SIDES: (usize, usize) = (7, 13);

/// Mean square difference of two patches, as a share of twice their variance, below which one may be the other.
const LEAST_ALIKE: f32 = 0.25;

/// At a whole lag beside the one of a pattern, patches differ by up to so many times as much.
const BETWEEN: f32 = 2.5;

/// A lag is worth a closer look if its patch differs at most so much more than that of the best one.
const NEARLY: (f32, f32) = (2.0, 0.05);

/// What a patch may differ by more than the window does that it stands for: as a share of that, and of its variance.
const MARGIN: (f32, f32) = (1.5, 0.04);

/// Rows of the patch after which lags that differ too much already are given up.
const ROWS_AT_ONCE: usize = 4;

/// Lags in pixels of the frame, the shortest first.
#[derive(Debug, Default, Clone, Copy)]
pub(super) struct Lags {
    list: [[f64; 2]; MAX_LAGS],
    count: usize,
}

impl Lags {
    pub(super) fn list(&self) -> &[[f64; 2]] {
        &self.list[..self.count]
    }

    /// Whether one of them, or its opposite, is like `lag`.
    fn has(&self, lag: [f64; 2], apart: f64) -> bool {
        let near = |x: f64, y: f64| x.abs().max(y.abs()) <= apart;
        self.list()
            .iter()
            .any(|[x, y]| near(x - lag[0], y - lag[1]) || near(x + lag[0], y + lag[1]))
    }

    /// What repeats by two lags repeats by their sum and their difference.
    fn complete(&mut self) {
        let list = self.list;
        let (Some(first), rest) = (self.list().first().copied(), 1..self.count) else {
            return;
        };
        let across = |[x, y]: [f64; 2]| (first[0] * y - first[1] * x).abs();
        let length = |[x, y]: [f64; 2]| x.hypot(y);
        let second = rest
            .map(|index| list[index])
            .find(|lag| across(*lag) > ACROSS * length(first) * length(*lag));
        for sign in [1.0, -1.0] {
            if let Some(second) = second {
                let lag = [first[0] + sign * second[0], first[1] + sign * second[1]];
                if !self.has(lag, SAME * length(first)) {
                    self.list[self.count] = lag;
                    self.count += 1;
                }
            }
        }
    }

    /// Keep `lag` if it is among the shortest ones and none of them is like it, or its opposite.
    fn add(&mut self, lag: [f64; 2], apart: f64) {
        let known = self.has(lag, apart);
        let length = |[x, y]: [f64; 2]| x * x + y * y;
        let place = self
            .list()
            .partition_point(|other| length(*other) <= length(lag));
        if known || place == FOUND {
            return;
        }
        self.count = (self.count + 1).min(FOUND);
        self.list[place..self.count].rotate_right(1);
        self.list[place] = lag;
    }
}

/// Likely lags of one level: the best ones.
struct Minima {
    list: [(f32, [isize; 2]); Self::MOST],
}

impl Minima {
    const MOST: usize = 12;
}

impl Problem<'_> {
    /// The lags at which the surroundings of `point` repeat: windows there differ by at most `alike` of twice their
    /// variance.
    pub(super) fn lags(&self, point: [f32; 2], alike: f32) -> Lags {
        let mut lags = Lags::default();
        let alike = LEAST_ALIKE.min(MARGIN.0 * alike + MARGIN.1);
        let looks = LOOKS.len().min(self.prev.len());
        let mut found: [Option<Minima>; LOOKS.len()] = [const { None }; LOOKS.len()];
        let mut best = f32::INFINITY;
        for (level, (least, reach)) in LOOKS.into_iter().take(looks).enumerate() {
            let reach = if level + 1 == looks { REACH } else { reach };
            let minima = self.minima(
                point,
                level,
                (least, reach),
                LEAST_ALIKE.min(BETWEEN * alike),
            );
            if let Some(minima) = &minima {
                best = best.min(minima.list[0].0);
            }
            found[level] = minima;
        }
        let limit = alike.min(NEARLY.0 * best + NEARLY.1);
        for (level, minima) in found.into_iter().enumerate() {
            let factor = f64::from(1u32 << level);
            for (value, lag) in minima.into_iter().flat_map(|minima| minima.list) {
                if value < limit {
                    lags.add(lag.map(|part| factor * part as f64), 1.5 * factor);
                }
            }
        }
        lags.complete();
        lags
    }

    /// The lags of one level whose patches differ least, and less than those beside them.
    fn minima(
        &self,
        point: [f32; 2],
        level: usize,
        (least, reach): (isize, isize),
        limit: f32,
    ) -> Option<Minima> {
        let plane = &self.prev[level];
        let factor = (1u32 << level) as f32;
        let side = ((self.options.window_side() >> level) | 1).clamp(SIDES.0, SIDES.1);
        let half = (side / 2) as isize;
        let (width, height) = (plane.width() as isize, plane.height() as isize);
        if width < side as isize || height < side as isize {
            return None;
        }
        // A patch that would leave the frame stands at its border.
        let [x, y] = point.map(|coordinate| (coordinate / factor).round() as isize);
        let (x, y) = (
            x.clamp(half, width - 1 - half),
            y.clamp(half, height - 1 - half),
        );
        let surface = dispatch(
            self.level,
            Differences {
                pixels: plane.data(),
                width: plane.width(),
                height: plane.height(),
                centre: [x, y],
                side,
                reach,
                limit,
            },
        )?;
        let at = |dx: isize, dy: isize| surface[(dy + REACH) as usize][(dx + REACH) as usize];
        let mut minima = Minima {
            list: [(f32::INFINITY, [0; 2]); Minima::MOST],
        };
        for dy in -reach + 1..reach {
            for dx in -reach + 1..reach {
                let value = at(dx, dy);
                let worst = minima.list[Minima::MOST - 1].0;
                if value >= limit.min(worst) || dx.abs().max(dy.abs()) < least {
                    continue;
                }
                let beside = (-1..=1isize).flat_map(|y| (-1..=1isize).map(move |x| (x, y)));
                if beside.into_iter().all(|(x, y)| at(dx + x, dy + y) >= value) {
                    // Between whole lags it is less.
                    let sides = [
                        (at(dx - 1, dy), at(dx + 1, dy)),
                        (at(dx, dy - 1), at(dx, dy + 1)),
                    ];
                    let value = (value - dip(value, sides[0]) - dip(value, sides[1])).max(0.0);
                    let place = minima.list.partition_point(|(other, _)| *other <= value);
                    if place < Minima::MOST {
                        minima.list[place..].rotate_right(1);
                        minima.list[place] = (value, [dx, dy]);
                    }
                }
            }
        }
        (minima.list[0].0 < f32::INFINITY).then_some(minima)
    }
}

/// How far below a lowest value of three the parabola through them goes.
fn dip(value: f32, (left, right): (f32, f32)) -> f32 {
    let curvature = left + right - 2.0 * value;
    if curvature > 0.0 && curvature.is_finite() {
        (right - left) * (right - left) / (8.0 * curvature)
    } else {
        0.0
    }
}

/// For each lag the mean square difference of the patch around `centre` and the one there, as a share of twice the
/// patch's variance; infinite where that is more than the limit, or outside.
struct Differences<'a> {
    pixels: &'a [f32],
    width: usize,
    height: usize,
    centre: [isize; 2],
    side: usize,
    reach: isize,
    limit: f32,
}

impl Kernel for Differences<'_> {
    type Output = Option<[[f32; LAGS]; LAGS]>;

    #[inline(always)]
    fn run(self) -> Self::Output {
        let half = (self.side / 2) as isize;
        let [x, y] = self.centre;
        let row = |y: isize| &self.pixels[y as usize * self.width..][..self.width];
        let (mut sum, mut squares) = (0.0f32, 0.0f32);
        let middle = row(y)[x as usize];
        for line in y - half..=y + half {
            for value in &row(line)[(x - half) as usize..=(x + half) as usize] {
                let value = value - middle;
                sum += value;
                squares += value * value;
            }
        }
        let energy = squares - sum * sum / (self.side * self.side) as f32;
        if !(energy.is_finite() && energy > 0.0) {
            return None;
        }
        let scale = 0.5 / energy;
        let limit = self.limit / scale;
        // Lags whose patch leaves the frame are none.
        let first = (-self.reach).max(half - x);
        let last = self.reach.min(self.width as isize - 1 - half - x);
        let mut surface = [[f32::INFINITY; LAGS]; LAGS];
        if last < first {
            return None;
        }
        let count = (last - first + 1) as usize;
        let groups = count.div_ceil(GROUP);
        // What lies beyond the last lag is never looked at.
        let mut other = [0.0f32; GROUPS * GROUP + SIDES.1];
        for dy in -self.reach..=self.reach {
            if y + dy < half || y + dy + half >= self.height as isize {
                continue;
            }
            let mut sums = [[0.0f32; GROUP]; GROUPS];
            let mut alike = true;
            for turn in 0..self.side {
                // In an order that takes in all of the patch soon: 5 has no factor in common with any side but its own.
                let line = (turn * 5 % self.side) as isize - half;
                let own = &row(y + line)[(x - half) as usize..][..self.side];
                let length = count + self.side - 1;
                other[..length]
                    .copy_from_slice(&row(y + dy + line)[(x - half + first) as usize..][..length]);
                for (group, sums) in sums[..groups].iter_mut().enumerate() {
                    let near = &other[group * GROUP..][..self.side + GROUP - 1];
                    let mut kept = *sums;
                    for (own, other) in own.iter().zip(near.windows(GROUP)) {
                        let Some(other) = other.first_chunk::<GROUP>() else {
                            continue;
                        };
                        for (sum, other) in kept.iter_mut().zip(other) {
                            let difference = other - own;
                            *sum += difference * difference;
                        }
                    }
                    *sums = kept;
                }
                if turn % ROWS_AT_ONCE == ROWS_AT_ONCE - 1 {
                    let sums = &sums.as_flattened()[..count];
                    let least = sums.iter().fold(f32::INFINITY, |a, b| a.min(*b));
                    if least > limit {
                        alike = false;
                        break;
                    }
                }
            }
            if alike {
                let start = (first + REACH) as usize;
                let to = &mut surface[(dy + REACH) as usize][start..][..count];
                for (to, sum) in to.iter_mut().zip(sums.as_flattened()) {
                    *to = sum * scale;
                }
            }
        }
        Some(surface)
    }
}
