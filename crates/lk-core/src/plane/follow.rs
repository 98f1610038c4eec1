//! The motion over a plane from two frames themselves: tiles that move as the motion says, and what each of them says
//! against it, from coarse to fine.
//!
//! `docs/explanation/algorithms.md`, section "Tiles of a plane".

use std::cell::RefCell;

use super::fit::{Equation, Known, robust};
use super::followed::Followed;
use super::lattice::Lattice;
use super::lens::Lens;
use super::motion::{PlaneInterval, PlaneMotion, UNKNOWNS, View};
use super::seen::{Seen, correlation, freed_of_noise};
use super::tile::{Buffers, Place, REACH, Solved, SumTile};
use super::weights::weigh;
use crate::error::Result;
use crate::execution::Execution;
use crate::frame::Plane;
use crate::memory::resize;
use crate::parallel::{RowsMut, for_each_band};
use crate::pyramid::Pyramid;
use crate::simd::dispatch;

/// Tiles that one thread takes at least.
const MIN_TILES: usize = 24;
/// Step of a number of the motion for its slopes.
const VARIED: f64 = 1e-6;
/// Steps below this, in pixels, end the rounds.
const SETTLED_PX: f64 = 0.004;
/// So many times that is settled all the same where no round is left: noise keeps small frames moving.
const NEARLY: f64 = 5.0;
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
                for (value, by) in motion.iter_mut().zip(found.step.step) {
                    *value += by;
                }
                let enough = SETTLED_PX * f64::from(1u32 << level);
                found.settled = moved < NEARLY * enough;
                found.motion = motion;
                let done = moved < enough || (level > 0 && round > 0 && moved < 8.0 * enough);
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
        Ok(self
            .solve(tiles, motion, known, scale)
            .map(|found| Followed {
                across: lattice.across(),
                ..found
            }))
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
            across: 0,
            places,
            equations,
            step,
            noise,
            settled: false,
            widened: 1.0,
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
