//! A measuring grid: displacement and its gradient on a regular grid of windows, with their covariance, for particles in a
//! fluid and texture on a material.
//!
//! `docs/explanation/algorithms.md`, section "Grid: displacement_grid".

mod cholesky;
mod covariance;
mod equations;
mod fit;
mod frames;
mod judge;
mod kernels;
mod lattice;
mod model;
mod node;
mod options;
mod result;
mod robust;
mod search;
mod seek;
mod shape;
mod spline;
mod spread;
#[cfg(test)]
mod tests;
mod window;

pub use options::GridOptions;
pub use result::{Grid, GridNode, GridStatus};
pub use shape::GridShape;

use crate::displacement_hypotheses::Hypotheses;
use crate::error::{Error, Result};
use crate::frame::{Frame, Pixel, expect_size};
use crate::memory::reserve;
use crate::parallel::within_pool;
use crate::pyramid::Pyramid;
use crate::support::Masks;
use fit::Fitting;
use frames::Frames;
use lattice::Lattice;
use spread::{NODES, Survey};
use window::Pattern;

/// Levels of the pyramid that hypotheses come from, at most.
const LEVELS: usize = 16;

/// The displacement of each node of a regular grid from `prev` to `next`.
///
/// `initial` holds a first guess of the displacement of each node, row by row, not finite where there is none.
///
/// # Errors
///
/// [`Error::Shape`] if the frames, `initial` or `masks` do not fit together; those of [`GridOptions::validate`] and of the
/// execution.
///
/// ```
/// use lk_core::ndarray::Array2;
/// use lk_core::{GridOptions, Masks, displacement_grid};
///
/// let scene = |x: f32, y: f32| 120.0 + 60.0 * (0.9 * x + 0.2 * y).sin() * (0.7 * y).cos() + 20.0 * (0.4 * x - 0.5 * y).sin();
/// let prev = Array2::from_shape_fn((96, 128), |(y, x)| scene(x as f32, y as f32));
/// // Stretched by 1 % along x, and shifted.
/// let next = Array2::from_shape_fn((96, 128), |(y, x)| scene((x as f32 - 0.3) / 1.01, y as f32 + 0.6));
///
/// let grid = displacement_grid(prev.view(), next.view(), None, Masks::default(), &GridOptions::default())?;
/// assert_eq!((grid.columns, grid.rows, grid.first), (7, 5, [15.5, 15.5]));
/// let node = &grid.nodes[2 * grid.columns + 3];
/// let [x, _] = grid.place(3, 2);
/// assert!(node.is_valid());
/// assert!((f64::from(node.displacement[0]) - (0.01 * x + 0.3)).abs() < 0.02);
/// assert!((node.gradient[0][0] - 0.01).abs() < 0.002);
/// # Ok::<(), lk_core::Error>(())
/// ```
pub fn displacement_grid<T: Pixel>(
    prev: Frame<'_, T>,
    next: Frame<'_, T>,
    initial: Option<&[[f32; 2]]>,
    masks: Masks<'_>,
    options: &GridOptions,
) -> Result<Grid> {
    options.validate()?;
    let (height, width) = prev.dim();
    expect_size("next", next.dim(), "prev", prev.dim())?;
    masks.expect_size(prev.dim())?;
    let (columns, rows) = options.nodes(width, height);
    if let Some(initial) = initial
        && initial.len() != columns * rows
    {
        return Err(Error::shape(
            "initial",
            format!("{} displacements", initial.len()),
            format!("one for each of {rows} x {columns} nodes"),
        ));
    }
    let pattern = Pattern::new(options.window_size)?;
    let corner = [width, height].map(|size| options.first(size));
    let mut grid = Grid {
        first: corner.map(|at| at as f64 + pattern.half),
        step: options.step,
        columns,
        rows,
        nodes: Vec::new(),
    };
    if columns == 0 {
        return Ok(grid);
    }
    reserve(NODES, &mut grid.nodes, columns * rows)?;
    let execution = &options.execution;
    within_pool(execution, || {
        let mut frames = Frames::default();
        frames.take([prev, next], masks, execution)?;
        let hypotheses = {
            let prev = Pyramid::masked(prev, masks.of_prev(), LEVELS, execution)?;
            let next = Pyramid::masked(next, masks.of_next(), LEVELS, execution)?;
            Hypotheses::find(prev.levels(), next.levels(), execution)?
        };
        let fitting = Fitting {
            frames: &frames,
            pattern: &pattern,
            degree: options.shape.degree(),
            illumination: options.illumination,
            robust: options.robust,
            reach: options
                .max_displacement
                .map_or(width.max(height) as f64, f64::from),
            level: execution.simd_level(),
        };
        let lattice = Lattice {
            columns,
            rows,
            first: corner,
            step: options.step,
        };
        let mut survey = Survey::new(fitting, lattice, execution, &hypotheses, initial)?;
        survey.measure()?;
        survey.judge()?;
        survey.add_model_error()?;
        grid.nodes
            .extend(survey.nodes.iter().map(|known| match known.found {
                Some(mut measured) => {
                    measured.status = known.status;
                    measured.node(pattern.half, options.shape.degree())
                }
                None => GridNode::lost(known.status),
            }));
        Ok(())
    })?;
    Ok(grid)
}
