//! One evaluation of two frames at one displacement: both are sampled half a step towards each other, and the products that
//! the normal equations need are summed over tiles.
//!
//! A stripe of tiles is sampled into buffers that stay in the cache, then summed: the frames are read once an evaluation.

#![allow(clippy::needless_range_loop, reason = "lane indices")]

use std::cell::RefCell;

use super::coordinates::{Pair, WindowAxis};
use super::edges::Lines;
use super::filters::{RADIUS, Taps, noise_gain, taps};
use super::gain::KnownGain;
use super::gram::Light;
use super::matrix::Matrix;
use super::solve::{LightScope, Model, Solution, Solver};
use super::sums::{StripeSums, Tile, Tiling};
use crate::error::Result;
use crate::execution::Execution;
use crate::frame::Plane;
use crate::illumination::Illumination;
use crate::memory::resize;
use crate::parallel::{RowsMut, for_each_band};
use crate::simd::{EIGHT, Eight, EightKernel, Packed, dispatch_eight};

/// The displacement may be this far from the whole pixels at which the frames are compared; more than half a pixel, so
/// that an iteration near the half does not jump between two of them.
pub(super) const REACH: f64 = 0.52;

/// What an evaluation needs, kept from one to the next.
#[derive(Debug, Default)]
pub(super) struct Workspace {
    weight: Plane,
    tiles: Vec<Tile>,
    tiling: Tiling,
    weighted: bool,
    solver: Solver,
    pub(super) affine: super::affine::Workspace,
}

/// Where and how two frames are compared.
#[derive(Debug, Clone, Copy)]
pub(super) struct Evaluation {
    /// The displacement, within [`REACH`] of `whole`.
    pub(super) displacement: [f64; 2],
    /// The whole pixels at which the frames are compared.
    pub(super) whole: [f64; 2],
    /// How light may change within a tile.
    pub(super) illumination: Illumination,
    /// What is known of the light: taken out of the difference before it is summed.
    pub(super) gain: GainField,
    /// Pixels along a side of a tile.
    pub(super) tile: usize,
    /// Whether pixels count whose gradients reach over the border of the region, which is repeated there.
    pub(super) borders: bool,
    /// Over what part of the window one model of the light holds.
    pub(super) scope: LightScope,
    /// Whether what either frame shows is known to be in both.
    pub(super) common_structure: bool,
    /// Variance of the rounding of grey levels in one frame, in the unit of the planes.
    pub(super) rounding: f64,
}

/// A gain that varies with place and grey level: `next - prev = (c0 + c1 x + c2 y + c3 m / 2) m`, with m the mean of
/// both frames and x and y from -1 to 1 over the window, so that all levels share it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct GainField(pub(super) [f64; 4]);

impl GainField {
    fn is_none(self) -> bool {
        self == Self::default()
    }
}

/// A stripe of tiles, sampled: rows of the mean of both frames, with [`RADIUS`] more above, below and on each side, and
/// of their difference.
#[derive(Debug, Default)]
struct Stripe {
    mean: Plane,
    difference: Plane,
    temporary: [Vec<f32>; 2],
}

thread_local! {
    static STRIPE: RefCell<Stripe> = RefCell::default();
}

/// What the pair says; `None` if too few pixels are shown by both.
pub(super) fn evaluate(
    pair: Pair<'_>,
    params: Evaluation,
    workspace: &mut Workspace,
    execution: &Execution,
) -> Result<Option<Solution>> {
    let Some(view) = View::new(pair, params) else {
        return Ok(None);
    };
    let masked = pair.prev_weight.is_some() || pair.next_weight.is_some();
    let weighted = masked || !params.borders;
    sum_tiles(
        &view,
        params,
        [params.tile; 2],
        weighted,
        workspace,
        execution,
    )?;
    let Workspace {
        tiles,
        tiling,
        weighted,
        solver,
        ..
    } = workspace;
    solver.solve(tiles, tiling, *weighted, view.model(params))
}

/// What lines of pixels along one axis say against each other at a displacement; see [`Lines::scatter`].
pub(super) fn lines_scatter(
    pair: Pair<'_>,
    params: Evaluation,
    axis: usize,
    lines: Lines,
    workspace: &mut Workspace,
    execution: &Execution,
) -> Result<Option<Matrix>> {
    let Some(view) = View::new(pair, params) else {
        return Ok(None);
    };
    // A lane of a tile that is as wide as the lanes is a column.
    let sides = [[EIGHT, params.tile], [params.tile, 1]][axis];
    sum_tiles(&view, params, sides, true, workspace, execution)?;
    let Workspace { tiles, tiling, .. } = workspace;
    lines.scatter(tiles, tiling, axis, view.model(params))
}

/// The sums over tiles of these sides.
fn sum_tiles(
    view: &View<'_>,
    params: Evaluation,
    sides: [usize; 2],
    weighted: bool,
    workspace: &mut Workspace,
    execution: &Execution,
) -> Result<()> {
    let Workspace {
        weight,
        tiles,
        tiling,
        weighted: keeps_weight,
        ..
    } = workspace;
    *keeps_weight = weighted;
    if weighted {
        view.weigh(weight, params.borders)?;
    }
    tiling.cut(view.size, sides)?;
    tiles.clear();
    let count = tiling.across() * tiling.down();
    resize("tiles", tiles, count, Tile::ZERO)?;
    let level = execution.simd_level();
    let weight = weighted.then_some(&*weight);
    let tiling = &*tiling;
    for_each_band(
        execution,
        tiling.down(),
        (8192 / (view.size[0] * sides[1])).max(1),
        RowsMut::new(tiles, tiling.across()),
        |band, mut part| {
            STRIPE.with_borrow_mut(|buffers| {
                for (local, stripe) in band.enumerate() {
                    dispatch_eight(
                        level,
                        EvaluateStripe {
                            view,
                            tiling,
                            stripe,
                            weight,
                            follows: local > 0,
                            buffers,
                            tiles: part.row_mut(local),
                        },
                    )?;
                }
                Ok(())
            })
        },
    )
}

/// What the tiles of the last evaluation show of edges along the axes; see [`Solver::aligned_share`].
pub(super) fn aligned_share(workspace: &Workspace) -> f64 {
    workspace.solver.aligned_share()
}

/// Whether one model of the light holds for all of the window, as the last evaluation saw it.
pub(super) fn is_one_light(
    pair: Pair<'_>,
    params: Evaluation,
    workspace: &mut Workspace,
) -> Result<bool> {
    let Some(view) = View::new(pair, params) else {
        return Ok(false);
    };
    let Workspace { tiling, solver, .. } = workspace;
    solver.is_one_light(tiling, view.model(params))
}

/// How the gain varies linearly over a window in one light, as the last evaluation saw it; `None` if it does not.
pub(super) fn gain_ramp(
    pair: Pair<'_>,
    params: Evaluation,
    excess: f64,
    workspace: &Workspace,
) -> Option<GainField> {
    let view = View::new(pair, params)?;
    let Workspace { tiling, solver, .. } = workspace;
    let field = solver.gain_ramp(tiling, view.model(params), excess);
    field.map(GainField)
}

/// How the gain varies over the window, as the last evaluation saw it; none if it varies in another way.
pub(super) fn gain_field(
    pair: Pair<'_>,
    params: Evaluation,
    workspace: &mut Workspace,
) -> Result<GainField> {
    let Some(view) = View::new(pair, params) else {
        return Ok(GainField::default());
    };
    let Workspace { tiling, solver, .. } = workspace;
    let field = solver.gain_field(tiling, view.model(params))?;
    Ok(GainField(field))
}

/// The region that both frames show, and how each is sampled there.
struct View<'a> {
    pair: Pair<'a>,
    /// Its first pixel in each frame.
    starts: [[usize; 2]; 2],
    size: [usize; 2],
    /// Those of `next`, along x and along y; `prev` takes them in reverse.
    taps: [Taps; 2],
    place: [WindowAxis; 2],
    gain: GainField,
}

impl<'a> View<'a> {
    fn new(pair: Pair<'a>, params: Evaluation) -> Option<Self> {
        let half: [f64; 2] =
            std::array::from_fn(|axis| (params.displacement[axis] - params.whole[axis]) / 2.0);
        let shift = params.whole.map(|value| value as isize);
        let (columns, rows) = (pair.overlap(0, shift[0]), pair.overlap(1, shift[1]));
        if columns.len() < 4 || rows.len() < 4 {
            return None;
        }
        let start = [columns.start, rows.start];
        Some(Self {
            pair,
            starts: [
                start,
                std::array::from_fn(|axis| {
                    (start[axis] as isize + shift[axis] - pair.origin[axis]) as usize
                }),
            ],
            size: [columns.len(), rows.len()],
            taps: half.map(taps),
            place: std::array::from_fn(|axis| {
                WindowAxis::new(pair.window[axis], start[axis], shift[axis])
            }),
            gain: params.gain,
        })
    }

    /// What is known when its sums are solved.
    fn model(&self, params: Evaluation) -> Model {
        let noise = noise_gain(&self.taps);
        Model {
            light: Light::new(params.illumination),
            scope: params.scope,
            common_structure: params.common_structure,
            noise,
            floor: params.rounding * 2.0 * noise.sampled,
            known: KnownGain {
                field: self.gain.0,
                place: self.place,
            },
        }
    }

    /// Where both frames may be used.
    fn weigh(&self, weight: &mut Plane, borders: bool) -> Result<()> {
        let [width, height] = self.size;
        weight.resize(width.next_multiple_of(EIGHT), height)?;
        let planes = [self.pair.prev_weight, self.pair.next_weight];
        for y in 0..height {
            let row = weight.row_mut(y);
            row.fill(0.0);
            let margin = if borders { 0 } else { RADIUS };
            if y < margin || y + margin >= height || width < 2 * margin {
                continue;
            }
            row[margin..width - margin].fill(1.0);
            for (plane, start) in planes.into_iter().zip(self.starts) {
                if let Some(plane) = plane {
                    let other = &plane.row(start[1] + y)[start[0]..start[0] + width];
                    row.iter_mut().zip(other).for_each(|(to, from)| *to *= from);
                }
            }
        }
        Ok(())
    }

    /// The rows that the taps read for row `y` of the region, in one of the frames.
    #[inline(always)]
    fn rows(&self, plane: &'a Plane, start: [usize; 2], y: usize) -> [&'a [f32]; 2 * RADIUS + 1] {
        let columns = start[0] - RADIUS..start[0] + self.size[0] + RADIUS;
        std::array::from_fn(|k| &plane.row(start[1] + y + k - RADIUS)[columns.clone()])
    }
}

/// Sample a stripe of tiles, and sum it up.
struct EvaluateStripe<'a> {
    view: &'a View<'a>,
    tiling: &'a Tiling,
    stripe: usize,
    weight: Option<&'a Plane>,
    /// Whether the buffers hold the stripe before.
    follows: bool,
    buffers: &'a mut Stripe,
    tiles: &'a mut [Tile],
}

impl EightKernel for EvaluateStripe<'_> {
    type Output = Result<()>;

    #[inline(always)]
    fn run<L: Eight>(self) -> Result<()> {
        let [width, height] = self.view.size;
        let padded = width.next_multiple_of(EIGHT);
        let rows = self.tiling.rows(self.stripe);
        let Stripe {
            mean,
            difference,
            temporary,
        } = self.buffers;
        let shared = 2 * RADIUS;
        let first = if self.follows {
            for plane in [&mut *mean, &mut *difference] {
                let from = (plane.height() - shared) * plane.width();
                plane.data_mut().copy_within(from.., 0);
            }
            rows.start + RADIUS
        } else {
            rows.start.saturating_sub(RADIUS)
        };
        let last = (rows.end + RADIUS).min(height);
        mean.resize(padded + 2 * RADIUS, rows.len() + shared)?;
        difference.resize(padded, rows.len() + shared)?;
        for row in temporary.iter_mut() {
            resize("a row", row, padded + 2 * RADIUS, 0.0)?;
        }
        // Row y of the region stands here.
        let at = |y: usize| y + RADIUS - rows.start;
        for y in first..last {
            let (mean, difference) = (mean.row_mut(at(y)), difference.row_mut(at(y)));
            sample::<L>(self.view, y, temporary, mean, difference);
            if !self.view.gain.is_none() {
                relight::<L>(self.view, y, mean, difference);
            }
        }
        // Outside of the region its border counts.
        for missing in 0..RADIUS.saturating_sub(rows.start) {
            repeat(mean, at(0), missing);
        }
        for missing in last..rows.end + RADIUS {
            repeat(mean, at(last - 1), at(missing));
        }
        StripeSums {
            mean,
            difference,
            weight: self.weight,
            tiling: self.tiling,
            stripe: self.stripe,
        }
        .run::<L>(self.tiles);
        Ok(())
    }
}

/// Copy row `from` to row `to`.
fn repeat(plane: &mut Plane, from: usize, to: usize) {
    let width = plane.width();
    plane
        .data_mut()
        .copy_within(from * width..(from + 1) * width, to * width);
}

/// Row `y` of the region in both frames, moved towards each other: their mean, padded by its border, and their
/// difference.
#[inline(always)]
fn sample<L: Eight>(
    view: &View<'_>,
    y: usize,
    temporary: &mut [Vec<f32>; 2],
    mean: &mut [f32],
    difference: &mut [f32],
) {
    let width = view.size[0];
    let [across, taps] = view.taps;
    let [p, n] = temporary;
    let length = width + 2 * RADIUS;
    let [prev, next] = view.starts;
    down::<L>(
        view.rows(view.pair.prev, prev, y),
        reversed(taps),
        &mut p[..length],
    );
    down::<L>(view.rows(view.pair.next, next, y), taps, &mut n[..length]);
    let (ta, tb, tc) = (
        L::splat(across[0]),
        L::splat(across[1]),
        L::splat(across[2]),
    );
    let (td, te) = (L::splat(across[3]), L::splat(across[4]));
    let half = L::splat(0.5);
    let padded = difference.len();
    let (p, n) = (&p[..padded + 2 * RADIUS], &n[..padded + 2 * RADIUS]);
    let mut x = 0;
    while x < padded {
        let outer = te * L::load(p, x) + ta * L::load(p, x + 4);
        let inner = td * L::load(p, x + 1) + tb * L::load(p, x + 3);
        let prev = outer + inner + tc * L::load(p, x + 2);
        let outer = ta * L::load(n, x) + te * L::load(n, x + 4);
        let inner = tb * L::load(n, x + 1) + td * L::load(n, x + 3);
        let next = outer + inner + tc * L::load(n, x + 2);
        (half * (next + prev)).store(mean, x + RADIUS);
        (next - prev).store(difference, x);
        x += EIGHT;
    }
    let (first, last) = (mean[RADIUS], mean[RADIUS + width - 1]);
    mean[..RADIUS].fill(first);
    mean[RADIUS + width..].fill(last);
    difference[width..].fill(0.0);
}

/// Take the known light out of row `y` of the difference.
#[inline(always)]
fn relight<L: Eight>(view: &View<'_>, y: usize, mean: &[f32], difference: &mut [f32]) {
    let [constant, along_x, along_y, curve] = view.gain.0;
    let start = constant + along_y * view.place[1].at(y);
    let step = along_x * view.place[0].step();
    let curve = L::splat((curve / 2.0) as f32);
    let steps = L::splat(step as f32) * L::unpack(&Packed::STEPS);
    let mut x = 0;
    while x < difference.len() {
        let at = (start + along_x * view.place[0].at(x)) as f32;
        let m = L::load(mean, x + RADIUS);
        let left = L::load(difference, x) - (L::splat(at) + steps + curve * m) * m;
        left.store(difference, x);
        x += EIGHT;
    }
    difference[view.size[0]..].fill(0.0);
}

#[inline(always)]
fn reversed([a, b, c, d, e]: Taps) -> Taps {
    [e, d, c, b, a]
}

/// The taps down the columns; outer pairs first, so that reversed taps on a mirrored picture give the same bits.
#[inline(always)]
fn down<L: Eight>(rows: [&[f32]; 2 * RADIUS + 1], taps: Taps, to: &mut [f32]) {
    let length = to.len();
    let (ta, tb, tc) = (L::splat(taps[0]), L::splat(taps[1]), L::splat(taps[2]));
    let (td, te) = (L::splat(taps[3]), L::splat(taps[4]));
    let [a, b, c, d, e] = rows;
    let mut x = 0;
    while x < length {
        // The last lanes overlap those before them: they hold the same values.
        let at = x.min(length - EIGHT);
        let outer = ta * L::load(a, at) + te * L::load(e, at);
        let inner = tb * L::load(b, at) + td * L::load(d, at);
        (outer + inner + tc * L::load(c, at)).store(to, at);
        x += EIGHT;
    }
}
