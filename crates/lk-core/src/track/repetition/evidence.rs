//! What tells two displacements of a window apart that explain it equally well: pixels around it that only one of them
//! explains, like the border of a board or a stain on a wall.

use crate::frame::Plane;
use crate::illumination::Illumination;
use crate::support::Support;
use crate::track::problem::Problem;

/// The level whose pixels are asked, and every which of them.
const LEVEL: usize = 1;
const STEP: isize = 2;

/// How far from the point pixels are asked, in steps, and how many that is.
const RINGS: isize = 16;
const SIDE: usize = 2 * RINGS as usize + 1;

/// So many rings are the window itself.
const OWN_RINGS: isize = 3;

/// Pixels of a level beside the border of the frame, which are not made of the frame alone.
const MARGIN: isize = 3;

/// A pixel is explained where it differs at most so many times as much as the worst one of the window itself, and is not
/// where it differs so many times as much.
const EXPLAINED: f32 = 1.5;
const NOT_EXPLAINED: f32 = 3.0;

/// The least that counts as a difference, as a share of the window's deviation, and in pixels of the level times the slope
/// there: no displacement is exact.
const LEAST_DIFFERENCE: f32 = 0.05;
const LEAST_SLIP: f32 = 0.1;

/// Share of the window's pixels that must be there to say how much they differ.
const LEAST_THERE: f32 = 0.6;

/// Of a pixel and those beside it, so many must be like those a lag away for it to be a part of the pattern.
const PART: usize = 6;

/// Pixels that decide, of the pattern and of the rest, and how many times as many there must be as of those that say the
/// opposite: some are explained by chance.
const DECIDING: u32 = 12;
const REST_DECIDING: u32 = 24;
const MAJORITY: u32 = 8;

/// What the surroundings say of a displacement other than the one that was found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    /// Nothing.
    Open,
    /// It is not this one.
    Excluded,
    /// It is this one.
    Favoured,
}

/// How much each pixel around a point differs under one displacement; NaN where it cannot be said.
struct Differences {
    values: [f32; SIDE * SIDE],
    /// How much a slip changes each of them.
    slips: [f32; SIDE * SIDE],
    /// The largest difference in the window itself.
    own: f32,
}

/// What the pixels around a point say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Evidence {
    /// Those that repeat as the window does: where the pattern ends, they tell how it moves.
    pub(super) pattern: Verdict,
    /// The others. They may move otherwise than the pattern does.
    pub(super) rest: Verdict,
}

impl Problem<'_> {
    /// What the surroundings of `point` say of displacements that are each a lag from the one that was found.
    pub(super) fn decide(
        &self,
        point: [f32; 2],
        found: [f64; 2],
        lags: impl ExactSizeIterator<Item = [f64; 2]>,
        mut say: impl FnMut(usize, Evidence),
    ) {
        if lags.len() == 0 {
            return;
        }
        let level = LEVEL.min(self.prev.len() - 1);
        let target = [0, 1].map(|axis: usize| (f64::from(point[axis]) + found[axis]) as f32);
        let (there, back) = (self.forward(), self.backward());
        let sides = [
            (there, point, found),
            (back, target, found.map(|part| -part)),
        ];
        let own = sides.map(|(direction, at, shift)| {
            self.differences(
                (direction.from, direction.from_support),
                (direction.to, direction.to_support),
                level,
                at,
                shift,
            )
        });
        for (index, lag) in lags.enumerate() {
            let others = [0, 1].map(|side: usize| {
                let (direction, at, shift) = sides[side];
                let lag = lag.map(|part| if side == 0 { part } else { -part });
                let by = [shift[0] + lag[0], shift[1] + lag[1]];
                self.differences(
                    (direction.from, direction.from_support),
                    (direction.to, direction.to_support),
                    level,
                    at,
                    by,
                )
            });
            let telling = |side: usize| {
                let says = own[side].says(&others[side]);
                says.filter(|(_, says)| says[0] || says[1]).count() as u32
            };
            if telling(0) + telling(1) < DECIDING {
                let nothing = Verdict::Open;
                say(
                    index,
                    Evidence {
                        pattern: nothing,
                        rest: nothing,
                    },
                );
                continue;
            }
            let mut votes = [[[0u32; 3]; RINGS as usize + 1]; 2];
            for side in 0..2 {
                let (direction, at, _) = sides[side];
                let repeats = [1.0, -1.0].map(|share| {
                    let from = (direction.from, direction.from_support);
                    self.differences(from, from, level, at, lag.map(|part| share * part))
                });
                count(&own[side], &others[side], &repeats, &mut votes);
            }
            let evidence = Evidence {
                pattern: nearest(&votes[0]),
                rest: together(&votes[1]),
            };
            say(index, evidence);
        }
    }

    fn differences(
        &self,
        (from, from_support): (&[Plane], &[Support]),
        (to, to_support): (&[Plane], &[Support]),
        level: usize,
        point: [f32; 2],
        displacement: [f64; 2],
    ) -> Differences {
        let scale = 1.0 / f64::from(1u32 << level);
        let shift = displacement.map(|part| part * scale);
        let centre = point.map(|part| (f64::from(part) * scale).round() as isize);
        let planes = (&from[level], &to[level]);
        let supports = (&from_support[level], &to_support[level]);
        let steady = self.options.illumination == Illumination::None;
        Differences::new(planes, supports, centre, shift, steady)
    }
}

impl Differences {
    fn new(
        (from, to): (&Plane, &Plane),
        (from_support, to_support): (&Support, &Support),
        centre: [isize; 2],
        shift: [f64; 2],
        steady: bool,
    ) -> Self {
        let mut own = [f32::NAN; SIDE * SIDE];
        let mut values = [f32::NAN; SIDE * SIDE];
        let mut slips = [0.0; SIDE * SIDE];
        let whole = shift.map(|part| part.floor() as isize);
        let [fx, fy] = [0, 1].map(|axis: usize| (shift[axis] - whole[axis] as f64) as f32);
        let (width, height) = (from.width() as isize, from.height() as isize);
        let within = |x: isize, y: isize| {
            x >= MARGIN && y >= MARGIN && x + MARGIN < width && y + MARGIN < height
        };
        let span = 2 * STEP * RINGS + 1;
        let corner = centre.map(|middle| middle - STEP * RINGS);
        let place = (corner[0] + whole[0], corner[1] + whole[1]);
        // Where all of it counts, no pixel is asked.
        let all = from_support.has_all((corner[0], corner[1]), span as usize, span as usize)
            && to_support.has_all(place, span as usize + 1, span as usize + 1);
        for row in 0..SIDE as isize {
            let y = centre[1] + STEP * (row - RINGS);
            let below = y + whole[1];
            if !(within(MARGIN, y) && within(MARGIN, below) && within(MARGIN, below + 1)) {
                continue;
            }
            let source = from.row(y as usize);
            let beside_source = [y - 1, y + 1].map(|y| from.row(y as usize));
            let (upper, lower) = (to.row(below as usize), to.row(below as usize + 1));
            for column in 0..SIDE as isize {
                let x = centre[0] + STEP * (column - RINGS);
                let beside = x + whole[0];
                if !(within(x, MARGIN) && within(beside, MARGIN) && within(beside + 1, MARGIN))
                    || !(all
                        || from_support.has_all((x, y), 1, 1)
                            && to_support.has_all((beside, below), 2, 2))
                {
                    continue;
                }
                let at = beside as usize;
                let top = upper[at] + fx * (upper[at + 1] - upper[at]);
                let bottom = lower[at] + fx * (lower[at + 1] - lower[at]);
                let place = row as usize * SIDE + column as usize;
                own[place] = source[x as usize];
                let [above, under] = beside_source.map(|row| row[x as usize]);
                let along = source[x as usize + 1] - source[x as usize - 1];
                slips[place] = LEAST_SLIP * 0.5 * (along.abs() + (under - above).abs());
                values[place] = top + fy * (bottom - top);
            }
        }
        // The light as the window has it.
        let (count, gain, offset, deviation) = light_of(&own, &values, steady);
        for (value, own) in values.iter_mut().zip(&own) {
            *value = (*value - offset - gain * own).abs();
        }
        let worst = window().fold(0.0f32, |worst, place| worst.max(values[place]));
        if count < LEAST_THERE * window().count() as f32 {
            values.fill(f32::NAN);
        }
        Self {
            values,
            slips,
            own: worst.max(LEAST_DIFFERENCE * deviation),
        }
    }
}

/// The pixels of the window itself.
fn window() -> impl Iterator<Item = usize> {
    (RINGS - OWN_RINGS..=RINGS + OWN_RINGS).flat_map(|row| {
        (RINGS - OWN_RINGS..=RINGS + OWN_RINGS)
            .map(move |column| row as usize * SIDE + column as usize)
    })
}

/// How many pixels of the window both frames have, the gain and the offset from one to the other there, unless the light
/// is steady, and the deviation of the first.
fn light_of(
    own: &[f32; SIDE * SIDE],
    values: &[f32; SIDE * SIDE],
    steady: bool,
) -> (f32, f32, f32, f32) {
    let (mut count, mut sums, mut products) = (0.0f32, [0.0f32; 2], [0.0f32; 2]);
    for place in window().filter(|place| values[*place].is_finite()) {
        count += 1.0;
        sums[0] += own[place];
        sums[1] += values[place];
    }
    let mean = sums.map(|sum| sum / count.max(1.0));
    for place in window().filter(|place| values[*place].is_finite()) {
        let a = own[place] - mean[0];
        products[0] += a * a;
        products[1] += a * (values[place] - mean[1]);
    }
    let (gain, offset) = if steady || products[0] <= 0.0 {
        (1.0, 0.0)
    } else {
        let gain = products[1] / products[0];
        (gain, mean[1] - gain * mean[0])
    };
    (count, gain, offset, (products[0] / count.max(1.0)).sqrt())
}

impl Differences {
    /// For each pixel whether only this, only `other`, or neither explains it.
    fn says<'a>(&'a self, other: &'a Self) -> impl Iterator<Item = (usize, [bool; 3])> + 'a {
        let own = self.own.max(other.own);
        let both = self.values.iter().zip(&other.values).zip(&self.slips);
        both.map(move |((a, b), slip)| {
            let (most, least) = (EXPLAINED * (own + slip), NOT_EXPLAINED * (own + slip));
            [
                *a <= most && *b > least,
                *b <= most && *a > least,
                *a > least && *b > least,
            ]
        })
        .enumerate()
    }
}

/// Count the pixels of each ring that only `found`, only `other`, and neither explains: those that are like the pixels a lag away,
/// as `repeats` says, and the others.
fn count(
    found: &Differences,
    other: &Differences,
    repeats: &[Differences; 2],
    votes: &mut [[[u32; 3]; RINGS as usize + 1]; 2],
) {
    for (place, says) in found.says(other).filter(|(_, says)| says.contains(&true)) {
        let (row, column) = (place / SIDE, place % SIDE);
        let own = found.own.max(other.own) + found.slips[place];
        let part = repeats.iter().any(|repeats| {
            let limit = EXPLAINED * own.max(repeats.own + found.slips[place]);
            let rows = row.saturating_sub(1)..(row + 2).min(SIDE);
            let columns = column.saturating_sub(1)..(column + 2).min(SIDE);
            let like = rows.flat_map(|row| repeats.values[row * SIDE..][columns.clone()].iter());
            like.filter(|value| **value <= limit).count() >= PART
        });
        let ring = row
            .abs_diff(RINGS as usize)
            .max(column.abs_diff(RINGS as usize));
        for (vote, said) in votes[usize::from(!part)][ring].iter_mut().zip(says) {
            *vote += u32::from(said);
        }
    }
}

/// What the nearest pixels that decide say, of the pixels of each ring.
fn nearest(votes: &[[u32; 3]]) -> Verdict {
    let mut sums = [0; 2];
    for ring in votes {
        sums[0] += ring[0];
        sums[1] += ring[1];
        let verdict = verdict(sums, DECIDING);
        if verdict != Verdict::Open {
            return verdict;
        }
    }
    Verdict::Open
}

/// What all pixels say together, if most of them are explained at all.
fn together(votes: &[[u32; 3]]) -> Verdict {
    let mut sums = [0; 3];
    for ring in votes {
        for (sum, vote) in sums.iter_mut().zip(ring) {
            *sum += vote;
        }
    }
    verdict([sums[0], sums[1]], REST_DECIDING.max(sums[2]))
}

fn verdict([found, other]: [u32; 2], least: u32) -> Verdict {
    if found + other < least {
        Verdict::Open
    } else if found >= MAJORITY * other {
        Verdict::Excluded
    } else if other >= MAJORITY * found {
        Verdict::Favoured
    } else {
        Verdict::Open
    }
}
