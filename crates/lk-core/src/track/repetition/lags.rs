//! Where the picture repeats around a point: displacements within `prev` at which its surroundings are like themselves.

use std::ops::RangeInclusive;

use crate::frame::Plane;
use crate::simd::{EIGHT, Eight, Kernel, Simd, dispatch};
use crate::track::problem::Problem;

/// Lags that are kept, of opposite ones only one.
pub(super) const MAX_LAGS: usize = FOUND + 2;

/// Of those found, the shortest are kept.
const FOUND: usize = 4;

/// Sine of the angle between two lags of different directions, and the share of the shorter one to which two are the same.
const ACROSS: f64 = 0.3;
const SAME: f64 = 0.25;

/// Levels that are looked at, and on each the shortest and the longest lag, in its own pixels.
const LAG_RANGES: [(isize, isize); 3] = [(3, 8), (4, 12), (5, 16)];

/// How far the last of the levels is looked at.
const REACH: isize = 16;
const LAGS: usize = 2 * REACH as usize + 1;

/// Lags of a row in groups of whole lanes.
const GROUPS: usize = LAGS.div_ceil(EIGHT);

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
const ROWS_AT_ONCE: usize = 2;

/// Which lags are looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Half {
    Both,
    /// Of opposite ones the one that points down: where a pattern goes on to both sides, one says so as well.
    Lower,
}

impl Half {
    /// The first row of lags, from those beside which a lowest value is told.
    fn first(self, reach: isize) -> isize {
        match self {
            Self::Both => -reach,
            Self::Lower => -1,
        }
    }
}

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
    pub(super) fn lags(&self, point: [f32; 2], alike: f32, half: Half) -> Lags {
        let mut lags = Lags::default();
        let mut surface = Surface {
            values: [[f32::INFINITY; LAGS]; LAGS],
            alike: [0; LAGS],
            first: 0,
        };
        let alike = LEAST_ALIKE.min(MARGIN.0 * alike + MARGIN.1);
        let levels = LAG_RANGES.len().min(self.prev.len());
        let mut found: [Option<Minima>; LAG_RANGES.len()] = [const { None }; LAG_RANGES.len()];
        let mut best = f32::INFINITY;
        for (level, (least, reach)) in LAG_RANGES.into_iter().take(levels).enumerate() {
            let reach = if level + 1 == levels { REACH } else { reach };
            let minima = self.minima(
                point,
                level,
                (least, reach, half),
                LEAST_ALIKE.min(BETWEEN * alike),
                &mut surface,
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
        (least, reach, half): (isize, isize, Half),
        limit: f32,
        surface: &mut Surface,
    ) -> Option<Minima> {
        let plane = &self.prev[level];
        let factor = (1u32 << level) as f32;
        let side = ((self.options.window_side() >> level) | 1).clamp(SIDES.0, SIDES.1);
        let rim = (side / 2) as isize;
        let (width, height) = (plane.width() as isize, plane.height() as isize);
        if width < side as isize || height < side as isize {
            return None;
        }
        // A patch that would leave the frame stands at its border.
        let [x, y] = point.map(|coordinate| (coordinate / factor).round() as isize);
        let (x, y) = (
            x.clamp(rim, width - 1 - rim),
            y.clamp(rim, height - 1 - rim),
        );
        let compared = dispatch(
            self.level,
            Differences {
                plane,
                centre: [x, y],
                side,
                reach,
                half,
                limit,
                surface,
            },
        );
        if !compared {
            return None;
        }
        let mut minima = Minima {
            list: [(f32::INFINITY, [0; 2]); Minima::MOST],
        };
        let at = |dx: isize, dy: isize| surface.at(dx, dy);
        for [dx, dy] in surface.alike(half.first(reach) + 1..=reach - 1) {
            if dx <= -reach || dx >= reach || dx.abs().max(dy.abs()) < least {
                continue;
            }
            let value = at(dx, dy);
            let worst = minima.list[Minima::MOST - 1].0;
            let beside = (-1..=1isize).flat_map(|y| (-1..=1isize).map(move |x| (x, y)));
            if value < limit.min(worst)
                && beside.into_iter().all(|(x, y)| at(dx + x, dy + y) >= value)
            {
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
    plane: &'a Plane,
    centre: [isize; 2],
    side: usize,
    reach: isize,
    half: Half,
    limit: f32,
    surface: &'a mut Surface,
}

/// What is compared, by the lag.
struct Surface {
    values: [[f32; LAGS]; LAGS],
    /// For each row a bit for each group of lags of which one is alike, and the first lag of the first group.
    alike: [u8; LAGS],
    first: isize,
}

impl Surface {
    fn at(&self, dx: isize, dy: isize) -> f32 {
        self.values[(dy + REACH) as usize][(dx + REACH) as usize]
    }

    /// Lags of which one in eight at least is alike.
    fn alike(&self, rows: RangeInclusive<isize>) -> impl Iterator<Item = [isize; 2]> {
        rows.flat_map(move |dy| {
            let groups = self.alike[(dy + REACH) as usize];
            let there = (0..GROUPS).filter(move |group| groups >> group & 1 == 1);
            there.flat_map(move |group| {
                let first = self.first + (group * EIGHT) as isize;
                (first..first + EIGHT as isize).map(move |dx| [dx, dy])
            })
        })
    }
}

/// Pixels of a row of what the patch is compared with, in whole groups, and its rows.
const WIDE: usize = GROUPS * EIGHT + SIDES.1;
const HIGH: usize = LAGS + SIDES.1 - 1;

impl Kernel for Differences<'_> {
    /// Whether there is anything to compare.
    type Output = bool;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> Self::Output {
        match self.side {
            0..=7 => self.compare::<S::Eight, 7>(),
            8..=9 => self.compare::<S::Eight, 9>(),
            10..=11 => self.compare::<S::Eight, 11>(),
            _ => self.compare::<S::Eight, 13>(),
        }
    }
}

impl Differences<'_> {
    #[inline(always)]
    fn compare<L: Eight, const SIDE: usize>(self) -> bool {
        let half = (SIDE / 2) as isize;
        let ([x, y], reach) = (self.centre, self.reach);
        let (width, height) = (self.plane.width() as isize, self.plane.height() as isize);
        let mut lines = [0; SIDE];
        let mut patch = [[0.0f32; SIDE]; SIDE];
        for (turn, (line, own)) in lines.iter_mut().zip(&mut patch).enumerate() {
            // In an order that takes in all of the patch soon: 5 has no factor in common with any side.
            *line = turn * 5 % SIDE;
            let row = self.plane.row((y - half) as usize + *line);
            own.copy_from_slice(&row[(x - half) as usize..][..SIDE]);
        }
        let energy = energy(patch.as_flattened());
        if !(energy.is_finite() && energy > 0.0) {
            return false;
        }
        let scale = 0.5 / energy;
        let limit = L::splat(self.limit / scale);
        // Lags whose patch leaves the frame are none.
        let within = |least: isize, at: isize, size: isize| {
            let first = least.max(half - at);
            (first, reach.min(size - 1 - half - at))
        };
        let (columns, rows) = (
            within(-reach, x, width),
            within(self.half.first(reach), y, height),
        );
        if columns.1 < columns.0 || rows.1 < rows.0 {
            return false;
        }
        // What the patch is compared with, side by side. What lies beyond the last lag is never looked at.
        let mut around = [[0.0f32; WIDE]; HIGH];
        let high = (rows.1 - rows.0) as usize + SIDE;
        let length = (columns.1 - columns.0) as usize + SIDE;
        for (line, to) in around[..high].iter_mut().enumerate() {
            let row = self.plane.row((y + rows.0 - half) as usize + line);
            to[..length].copy_from_slice(&row[(x + columns.0 - half) as usize..][..length]);
        }
        let count = length - SIDE + 1;
        let Surface { values, alike, .. } = self.surface;
        *values = [[f32::INFINITY; LAGS]; LAGS];
        *alike = [0; LAGS];
        self.surface.first = columns.0;
        for (lag, dy) in (rows.0..=rows.1).enumerate() {
            let to = &mut values[(dy + REACH) as usize][(columns.0 + REACH) as usize..][..count];
            for (group, to) in to.chunks_mut(EIGHT).enumerate() {
                let first = group * EIGHT;
                // Two sums, so that one does not wait for the other.
                let mut sums = [L::zero(); 2];
                let mut given_up = false;
                for turn in 0..SIDE {
                    let other = &around[lag + lines[turn]][first..][..SIDE + EIGHT - 1];
                    for tap in 0..SIDE {
                        let difference = L::load(other, tap) - L::splat(patch[turn][tap]);
                        sums[tap % 2] += difference * difference;
                    }
                    if turn % ROWS_AT_ONCE == ROWS_AT_ONCE - 1
                        && (sums[0] + sums[1]).at_least(limit) == u8::MAX
                    {
                        given_up = true;
                        break;
                    }
                }
                if !given_up {
                    alike[(dy + REACH) as usize] |= 1 << group;
                    let all = (sums[0] + sums[1]).pack();
                    for (to, sum) in to.iter_mut().zip(all.0) {
                        *to = sum * scale;
                    }
                }
            }
        }
        true
    }
}

/// The sum of the squares of grey levels without their mean.
#[inline(always)]
fn energy(patch: &[f32]) -> f32 {
    let (mut sum, mut squares) = (0.0f32, 0.0f32);
    let middle = patch[0];
    for value in patch {
        let value = value - middle;
        sum += value;
        squares += value * value;
    }
    squares - sum * sum / patch.len() as f32
}
