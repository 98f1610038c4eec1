//! One evaluation of two frames at one displacement: both are sampled half a step towards each other, and the products that
//! the normal equations need are summed over tiles.
//!
//! A stripe of tiles is sampled into buffers that stay in the cache, then summed: the frames are read once an evaluation.

use std::cell::RefCell;

use super::coordinates::Pair;
use super::lines::Lines;
use super::matrix::Matrix;
use super::solution::Solution;
use super::solve::Solver;
use super::stripe::{EvaluateStripe, Stripe};
use super::sums::{Tile, Tiling};
use super::view::{Evaluation, GainField, View};
use crate::error::Result;
use crate::execution::Execution;
use crate::frame::Plane;
use crate::memory::resize;
use crate::parallel::{RowsMut, for_each_band};
use crate::simd::{EIGHT, dispatch};

thread_local! {
    static STRIPE: RefCell<Stripe> = RefCell::default();
}

/// What an evaluation needs, kept from one to the next.
#[derive(Debug, Default)]
pub(super) struct Workspace {
    weight: Plane,
    tiles: Vec<Tile>,
    tiling: Tiling,
    weighted: bool,
    solver: Solver,
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
                    dispatch(
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

/// How far one light for the window leads from the last evaluation without what moves on its own; `None` where that may be
/// what moves as a whole.
pub(super) fn step_in_one_light(
    pair: Pair<'_>,
    params: Evaluation,
    workspace: &Workspace,
) -> Option<[f64; 2]> {
    let view = View::new(pair, params)?;
    let Workspace { tiling, solver, .. } = workspace;
    solver.step_in_one_light(tiling, &view.model(params))
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
