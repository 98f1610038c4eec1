//! The motion over a plane from two frames themselves: tiles that move as the motion says, and what each of them says
//! against it, from coarse to fine.
//!
//! `docs/algorithms.md`, section "Tiles of a plane".

use std::cell::RefCell;

use super::PlaneResponse;
use super::fit::{Equation, Known, Normal, Step, median, robust};
use super::lattice::Lattice;
use super::lens::Lens;
use super::motion::{PlaneInterval, PlaneMotion, UNKNOWNS, View};
use super::tile::{Buffers, Place, REACH, Solved, SumTile};
use crate::error::Result;
use crate::execution::Execution;
use crate::frame::Plane;
use crate::memory::resize;
use crate::parallel::{RowsMut, for_each_band};
use crate::pyramid::Pyramid;
use crate::simd::dispatch;
use crate::support::{COUNTS, Support};

/// Tiles that one thread takes at least.
const MIN_TILES: usize = 24;
/// Step of a number of the motion for its slopes.
const VARIED: f64 = 1e-6;
/// What is left in a tile is correlated between neighbouring pixels, as both frames were smoothed: so much less do they
/// tell than if each stood for itself.
const SHARED: f64 = 2.6;
/// Standard deviation of a tile's displacement, in pixels of its level, that the residual does not show.
const FLOOR_PX: f64 = 0.0015;
/// Mean square of a gradient of what is noise in the difference, as part of the mean square of that.
const NOISE_GRADIENT: f64 = 0.19;
/// Least part of a tile's gradients that must not be noise.
const LEAST_TRUE: f64 = 0.05;
/// A step is made longer by at most so much where gradients are noise.
const MOST_LONGER: f64 = 4.0;
/// Correlation of both frames above which a tile shows the same in both.
const MATCHED: f64 = 0.35;
/// So does one that is left with no more than this much of what noise leaves.
const AS_NOISE: f64 = 2.0;
/// Steps below this, in pixels, end the rounds.
const SETTLED_PX: f64 = 0.004;
/// Rounds on a coarse level and on the finest one.
const ROUNDS: [usize; 2] = [3, 6];
/// Longest motion of a tile, in pixels, at which what is fixed to the sensor could be told from the plane.
const FIXED_PX: f64 = 1.0;
/// Largest step, in pixels, of a tile that does not move.
const STILL_PX: f64 = 0.35;
/// And the least correlation.
const STILL_MATCHED: f64 = 0.6;

thread_local! {
    static BUFFERS: RefCell<Box<Buffers>> = RefCell::default();
}

/// How the frames are laid over each other.
#[derive(Debug, Clone)]
pub(super) struct Task<'a> {
    pub(super) frames: [&'a Pyramid; 2],
    pub(super) lens: &'a Lens,
    pub(super) interval: &'a PlaneInterval,
    pub(super) execution: &'a Execution,
}

/// One tile at the end of a round.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Seen {
    /// Half-way between its places in both frames, in pixels of the frame.
    pub(super) middle: [f64; 2],
    /// At which it was sampled.
    pub(super) displacement: [f64; 2],
    /// What the motion says, on average over the tile.
    pub(super) predicted: [f64; 2],
    pub(super) slopes: [[f64; UNKNOWNS]; 2],
    /// Whether it is within both frames.
    pub(super) inside: bool,
    pub(super) solved: Option<Solved>,
    /// Correlation of both frames, motion and light taken out.
    pub(super) correlation: f64,
}

impl Seen {
    /// Whether both frames show the same there, as far as noise lets it be seen.
    pub(super) fn is_matched(&self, noise: f64) -> bool {
        let quiet = |solved: &Solved| solved.left < AS_NOISE * noise;
        self.correlation >= MATCHED || self.solved.as_ref().is_some_and(quiet)
    }

    pub(super) fn measured(&self) -> Option<[f64; 2]> {
        let solved = self.solved?;
        Some(std::array::from_fn(|k| {
            self.displacement[k] + solved.step[k]
        }))
    }
}

/// Where the rounds ended.
#[derive(Debug, Clone)]
pub(super) struct Followed {
    pub(super) motion: PlaneMotion,
    pub(super) tiles: Vec<Seen>,
    /// Which tile each equation is of.
    pub(super) places: Vec<usize>,
    pub(super) equations: Vec<Equation>,
    pub(super) step: Step,
    /// Mean square of what noise leaves in a tile.
    pub(super) noise: f64,
    pub(super) settled: bool,
}

impl Task<'_> {
    fn size(&self, level: usize) -> [usize; 2] {
        let plane = &self.frames[0].levels()[level];
        [plane.width(), plane.height()]
    }

    /// From a start at level `top` down to the finest one; none where the frames do not hold together.
    pub(super) fn follow(
        &self,
        start: &PlaneMotion,
        known: &Known,
        top: usize,
    ) -> Result<Option<Followed>> {
        let mut motion = *start;
        let mut last = None;
        for level in (0..=top.min(self.frames[0].levels().len() - 1)).rev() {
            for round in 0..ROUNDS[usize::from(level == 0)] {
                self.execution.check()?;
                let Some(mut found) = self.round(level, &motion, known)? else {
                    if level == 0 {
                        return Ok(None);
                    }
                    // Too few tiles on a coarse level: the next one has more.
                    break;
                };
                let moved = found.moved_px();
                for k in 0..UNKNOWNS {
                    motion[k] += found.step.step[k];
                }
                let enough = SETTLED_PX * f64::from(1u32 << level);
                found.settled = moved < enough;
                found.motion = motion;
                let done = found.settled || (level > 0 && round > 0 && moved < 8.0 * enough);
                last = Some(found);
                if done {
                    break;
                }
            }
        }
        Ok(last)
    }

    /// Sample all tiles of a level at a motion, and solve for what is missing.
    fn round(&self, level: usize, motion: &PlaneMotion, known: &Known) -> Result<Option<Followed>> {
        let [width, height] = self.size(level);
        let rows = self.size(0)[1];
        let scale = f64::from(1u32 << level);
        let view = View::new(self.lens, self.interval, rows, motion);
        let varied: [View<'_>; UNKNOWNS] = std::array::from_fn(|k| {
            let mut other = *motion;
            other[k] += VARIED;
            View::new(self.lens, self.interval, rows, &other)
        });
        let whole = self.size(0).map(|size| 0.5 * (size as f64 - 1.0));
        // Where the middle does not show the plane, what does is near the border.
        let [p, q] = view.places(whole).unwrap_or([whole; 2]);
        let lattice = Lattice::new([width, height], [0, 1].map(|k| (q[k] - p[k]) / scale));
        let mut tiles = Vec::new();
        resize("tiles", &mut tiles, lattice.len(), Seen::default())?;
        for_each_band(
            self.execution,
            lattice.len(),
            MIN_TILES,
            RowsMut::new(&mut tiles, 1),
            |range, part| {
                BUFFERS.with_borrow_mut(|buffers| {
                    for (tile, index) in part.data.iter_mut().zip(range) {
                        let middle = lattice.middle(index).map(|value| scale * value);
                        *tile = self
                            .predict(&view, &varied, middle, lattice.side as f64 * scale)
                            .map_or_else(Seen::default, |seen| {
                                self.measure(seen.0, seen.1, level, lattice.side, buffers)
                            });
                    }
                });
            },
        )?;
        Ok(self.solve(tiles, motion, known, scale))
    }

    /// What a motion says of a tile: middle, displacement on average over the tile, its gradient and its slopes.
    fn predict(
        &self,
        view: &View<'_>,
        varied: &[View<'_>; UNKNOWNS],
        middle: [f64; 2],
        side: f64,
    ) -> Option<(Seen, [f64; 4])> {
        // Pixels of a tile scatter by this much about its middle: the mean over four such places is that over the tile of
        // anything quadratic.
        let spread = side / 12f64.sqrt();
        let mut corners = [[[0.0; 2]; 2]; 4];
        for (index, corner) in corners.iter_mut().enumerate() {
            let x = if index & 1 == 0 { -spread } else { spread };
            let y = if index & 2 == 0 { -spread } else { spread };
            let [p, q] = view.places([middle[0] + x, middle[1] + y])?;
            *corner = [
                [0.5 * (p[0] + q[0]), 0.5 * (p[1] + q[1])],
                [q[0] - p[0], q[1] - p[1]],
            ];
        }
        let mean = |what: usize, axis: usize| {
            0.25 * (corners[0][what][axis]
                + corners[1][what][axis]
                + corners[2][what][axis]
                + corners[3][what][axis])
        };
        let along = |what: usize, axis: usize| {
            let [a, b, c, d] = corners.map(|corner| corner[what][axis]);
            [(b - a) + (d - c), (c - a) + (d - b)]
        };
        let (wide, high) = (along(0, 0)[0], along(0, 1)[1]);
        let (u, v) = (along(1, 0), along(1, 1));
        let gradient = [u[0] / wide, u[1] / high, v[0] / wide, v[1] / high];
        let (centre, predicted) = ([mean(0, 0), mean(0, 1)], [mean(1, 0), mean(1, 1)]);
        let base = view.places(middle)?;
        let mut slopes = [[0.0; UNKNOWNS]; 2];
        for (k, other) in varied.iter().enumerate() {
            let [p, q] = other.places(middle)?;
            for axis in 0..2 {
                let change = (q[axis] - base[1][axis]) - (p[axis] - base[0][axis]);
                slopes[axis][k] = change / VARIED;
            }
        }
        let seen = Seen {
            middle: centre,
            predicted,
            slopes,
            ..Seen::default()
        };
        Some((seen, gradient))
    }

    /// Sample a tile where the motion puts it.
    fn measure(
        &self,
        mut seen: Seen,
        gradient: [f64; 4],
        level: usize,
        side: usize,
        buffers: &mut Buffers,
    ) -> Seen {
        let scale = f64::from(1u32 << level);
        let half = 0.5 * (side as f64 - 1.0);
        let displacement = seen.predicted.map(|value| value / scale);
        let whole = displacement.map(f64::round);
        let fraction: [f64; 2] = std::array::from_fn(|k| displacement[k] - whole[k]);
        let corner: [f64; 2] =
            std::array::from_fn(|k| (seen.middle[k] / scale - 0.5 * whole[k] - half).round());
        // Where the tile really is, for the frames are sampled at whole pixels and half of a fraction.
        let at: [f64; 2] = std::array::from_fn(|k| (corner[k] + half + 0.5 * whole[k]) * scale);
        let off = [at[0] - seen.middle[0], at[1] - seen.middle[1]];
        seen.predicted[0] += gradient[0] * off[0] + gradient[1] * off[1];
        seen.predicted[1] += gradient[2] * off[0] + gradient[3] * off[1];
        seen.middle = at;
        seen.displacement = displacement.map(|value| value * scale);
        let corners = [corner, [corner[0] + whole[0], corner[1] + whole[1]]];
        let Some(solved) = self.sums(level, corners, fraction, gradient, side, buffers) else {
            return seen;
        };
        seen.inside = true;
        seen.solved = solved;
        if let Some(solved) = solved {
            seen.correlation = correlation(&solved);
        }
        seen
    }

    /// What a tile at these places says; none where it is not in both frames.
    fn sums(
        &self,
        level: usize,
        corners: [[f64; 2]; 2],
        fraction: [f64; 2],
        gradient: [f64; 4],
        side: usize,
        buffers: &mut Buffers,
    ) -> Option<Option<Solved>> {
        let footprint = side + 2 * REACH;
        let mut weighted = false;
        let mut places = [[0usize; 2]; 2];
        for (frame, corner) in corners.iter().enumerate() {
            let planes = self.frames[frame].levels();
            let (plane, support) = (&planes[level], &self.frames[frame].support()[level]);
            let first = corner.map(|value| value - REACH as f64);
            let fits = first[0] >= 0.0
                && first[1] >= 0.0
                && first[0] + footprint as f64 <= plane.width() as f64
                && first[1] + footprint as f64 <= plane.height() as f64;
            if !fits {
                return None;
            }
            let place = first.map(|value| value as isize);
            weighted |= !support.holds((place[0], place[1]), footprint, footprint);
            places[frame] = corner.map(|value| value as usize);
        }
        if weighted {
            let supports = [0, 1].map(|frame| &self.frames[frame].support()[level]);
            let counted = weigh(supports, places, side, buffers);
            // An eighth of a tile tells little, and not where.
            if counted * 4 < side * side {
                return None;
            }
        }
        let place = Place {
            corners: places,
            fraction,
            gradient,
        };
        let frames: [&Plane; 2] = [0, 1].map(|frame| &self.frames[frame].levels()[level]);
        let sums = dispatch(
            self.execution.simd_level(),
            SumTile {
                frames,
                place,
                side,
                weighted,
                buffers,
            },
        );
        Some(sums.solve())
    }

    /// A step of the motion from what the tiles say.
    fn solve(
        &self,
        tiles: Vec<Seen>,
        motion: &PlaneMotion,
        known: &Known,
        scale: f64,
    ) -> Option<Followed> {
        let mut left: Vec<f64> = tiles.iter().filter_map(|t| Some(t.solved?.left)).collect();
        if left.len() < 3 {
            return None;
        }
        let quarter = left.len() / 4;
        let noise = *left.select_nth_unstable_by(quarter, f64::total_cmp).1;
        let mut equations = Vec::with_capacity(tiles.len());
        let mut places = Vec::with_capacity(tiles.len());
        for (index, tile) in tiles.iter().enumerate() {
            let Some(solved) = tile.solved else { continue };
            let Some((information, step)) = freed_of_noise(&solved, noise) else {
                continue;
            };
            let square = 1.0 / (scale * scale);
            // What a coarse tile says is in its own pixels.
            let residual =
                std::array::from_fn(|k| tile.displacement[k] + scale * step[k] - tile.predicted[k]);
            equations.push(Equation {
                residual,
                information: information.map(|value| value * square),
                slopes: tile.slopes,
            });
            places.push(index);
        }
        let from = Known {
            at: std::array::from_fn(|k| known.at[k] - motion[k]),
            ..*known
        };
        let step = robust(&equations, &from, [6, 10])?;
        Some(Followed {
            motion: *motion,
            tiles,
            places,
            equations,
            step,
            noise,
            settled: false,
        })
    }

    /// Whether a tile that does not move with the plane is fixed to the sensor.
    pub(super) fn is_fixed(&self, tile: &Seen) -> bool {
        if tile.predicted[0].hypot(tile.predicted[1]) < FIXED_PX {
            return false;
        }
        let side = Lattice::new(self.size(0), [0.0; 2]).side;
        let half = 0.5 * (side as f64 - 1.0);
        let corner = tile.middle.map(|value| (value - half).round());
        let still = BUFFERS.with_borrow_mut(|buffers| {
            self.sums(0, [corner; 2], [0.0; 2], [0.0; 4], side, buffers)
        });
        still.flatten().is_some_and(|solved| {
            let matched = correlation(&solved);
            solved.step[0].hypot(solved.step[1]) < STILL_PX
                && matched > STILL_MATCHED
                && matched > tile.correlation
        })
    }
}

impl Followed {
    /// Root mean square of what the step moves the tiles by, in pixels.
    fn moved_px(&self) -> f64 {
        let mut sum = 0.0;
        for equation in &self.equations {
            let left = equation.left(&self.step.step);
            sum += (0..2)
                .map(|k| (left[k] - equation.residual[k]).powi(2))
                .sum::<f64>();
        }
        (sum / self.equations.len().max(1) as f64).sqrt()
    }

    /// What numbers do that displace each tile by what `by` says of a number and a tile.
    pub(super) fn responses(
        &self,
        count: usize,
        by: impl Fn(usize, &Seen) -> Option<[f64; 2]>,
    ) -> Vec<PlaneResponse> {
        let variance = self.step.scale.powi(2);
        let moved: Vec<Vec<[f64; 2]>> = (0..count)
            .map(|number| {
                let tiles = self.places.iter().map(|index| &self.tiles[*index]);
                tiles
                    .map(|tile| by(number, tile).unwrap_or_default())
                    .collect()
            })
            .collect();
        moved
            .iter()
            .map(|own| {
                let mut response = PlaneResponse {
                    curvature: vec![0.0; count],
                    ..PlaneResponse::default()
                };
                for (place, equation) in self.equations.iter().enumerate() {
                    let weight = self.step.weights[place] / variance;
                    let [x, y] = equation.informed(own[place]).map(|value| weight * value);
                    for (k, value) in response.right.iter_mut().enumerate() {
                        *value += equation.slopes[0][k] * x + equation.slopes[1][k] * y;
                    }
                    let left = equation.left(&self.step.step);
                    response.score += x * left[0] + y * left[1];
                    for (value, other) in response.curvature.iter_mut().zip(&moved) {
                        *value += x * other[place][0] + y * other[place][1];
                    }
                }
                response
            })
            .collect()
    }

    /// Normal matrix of the unknowns, of the displacements alone.
    pub(super) fn normal(&self) -> Normal {
        self.step.normal
    }

    /// Median correlation of the tiles that were weighed.
    pub(super) fn correlation(&self) -> f64 {
        let mut all: Vec<f64> = self
            .places
            .iter()
            .map(|k| self.tiles[*k].correlation)
            .collect();
        median(&mut all)
    }
}

/// Correlation of both frames over a tile, from what is left of its texture: 1 where they show the same, 0 where they
/// have nothing in common.
pub(super) fn correlation(solved: &Solved) -> f64 {
    let (texture, left) = (solved.texture, 0.25 * solved.left);
    if texture + left > 0.0 {
        ((texture - left) / (texture + left)).max(-1.0)
    } else {
        0.0
    }
}

/// Inverse covariance of a tile's displacement, in its own pixels: xx, xy, yy, and its step; none where its gradients are
/// noise.
fn freed_of_noise(solved: &Solved, noise: f64) -> Option<([f64; 3], [f64; 2])> {
    let [xx, xy, yy] = solved.structure;
    // Gradients of noise raise the sums, but say nothing of the displacement.
    let false_part = NOISE_GRADIENT * noise.min(solved.left) * solved.count;
    let [a, b, c] = [xx - false_part, xy, yy - false_part];
    let (trace, determinant) = (a + c, a * c - b * b);
    let whole = xx + yy;
    if trace < 2.0 * LEAST_TRUE * whole || determinant <= 0.0 || a <= 0.0 {
        return None;
    }
    // The displacement is where the sums of gradients times differences vanish: these have the noise of all gradients,
    // and the slope of the true ones.
    let left = SHARED * solved.left.max(noise) + 1e-4;
    let inverse = [c / determinant, -b / determinant, a / determinant];
    let times = |[a, b, c]: [f64; 3], [x, y]: [f64; 2]| [a * x + b * y, b * x + c * y];
    let column = |unit: [f64; 2]| {
        let spread = times(inverse, unit);
        times(inverse, times([xx, xy, yy], spread))
    };
    let ([vx, vxy], [_, vy]) = (column([1.0, 0.0]), column([0.0, 1.0]));
    let floor = FLOOR_PX * FLOOR_PX;
    let (vx, vxy, vy) = (left * vx + floor, left * vxy, left * vy + floor);
    let determinant = vx * vy - vxy * vxy;
    if determinant <= 0.0 {
        return None;
    }
    let information = [vy / determinant, -vxy / determinant, vx / determinant];
    // Sums that noise raises make steps too short.
    let step = times(inverse, times([xx, xy, yy], solved.step));
    let length = |[x, y]: [f64; 2]| x.hypot(y);
    let most = MOST_LONGER * length(solved.step);
    let shorter = if length(step) > most {
        most / length(step)
    } else {
        1.0
    };
    Some((information, step.map(|value| shorter * value)))
}

/// Say of each pixel of a tile whether all that its filters reach counts in both frames; how many do.
fn weigh(
    supports: [&Support; 2],
    corners: [[usize; 2]; 2],
    side: usize,
    buffers: &mut Buffers,
) -> usize {
    const MOST: usize = super::tile::LARGEST + 2 * REACH;
    let footprint = side + 2 * REACH;
    let mut counts = [[true; MOST]; MOST];
    for (support, [x, y]) in supports.into_iter().zip(corners) {
        let [(left, right), (top, bottom)] = support.inner();
        for (row, counts) in counts[..footprint].iter_mut().enumerate() {
            let y = y + row - REACH;
            let bytes = support.row(y);
            for (column, counts) in counts[..footprint].iter_mut().enumerate() {
                let x = x + column - REACH;
                let inside = (left..right).contains(&x) && (top..bottom).contains(&y);
                *counts &= inside && (bytes.is_empty() || bytes[x] == COUNTS);
            }
        }
    }
    // All within the reach, along rows, then along columns.
    let mut across = [[true; MOST]; MOST];
    for (row, to) in counts[..footprint].iter().zip(&mut across) {
        for (column, to) in to[..side].iter_mut().enumerate() {
            *to = row[column..=column + 2 * REACH]
                .iter()
                .all(|counts| *counts);
        }
    }
    let mut total = 0;
    for row in 0..side {
        for column in 0..side {
            let counts = (row..=row + 2 * REACH).all(|y| across[y][column]);
            buffers.weight[row][column] = f32::from(u8::from(counts));
            total += usize::from(counts);
        }
    }
    total
}
