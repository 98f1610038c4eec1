//! The motion over a plane from points that were followed by other means.

use super::fit::{Equation, Known, Step, robust};
use super::followed::Followed;
use super::lens::Lens;
use super::motion::{PlaneInterval, PlaneMotion, UNKNOWNS, View};
use super::{PlaneFit, PlaneOptions, PlaneTile, PlaneTileStatus, expect_motion};
use crate::error::Result;

/// Step of a number of the motion for its slopes.
const VARIED: f64 = 1e-6;
/// Steps at most; the model is nearly linear.
const ROUNDS: usize = 12;
/// Steps below this, in heights and in radians, end them.
const SETTLED: f64 = 1e-9;

/// A point of the plane in both frames.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PlaneMatch {
    /// Its pixel in the first frame.
    pub prev: [f64; 2],
    /// Its pixel in the second one.
    pub next: [f64; 2],
    /// Covariance of the displacement in square pixels: xx, xy, yy.
    pub covariance: [f64; 3],
}

/// The motion that carries points of a plane from frame to frame, robustly against points that move otherwise; none where
/// they do not determine it.
///
/// `rows` are those of a frame. See [`PlaneTracker`](super::PlaneTracker) for the motion from the frames themselves,
/// which is more exact.
///
/// # Errors
///
/// Those of [`PlaneInterval::validate`] and [`PlaneOptions::validate`].
///
/// ```
/// use lk_core::{Distortion, Lens, PlaneInterval, PlaneMatch, PlaneOptions, fit_plane};
///
/// let lens = Lens::new([300.0; 2], [159.5, 119.5], Distortion::Brown([0.0; 12]))?;
/// // Level, a hundredth of the height to the right: the picture goes 3 px to the left.
/// let matches: Vec<_> = (0..40)
///     .map(|k| {
///         let prev = [(37 * k % 300) as f64, (53 * k % 230) as f64];
///         PlaneMatch { prev, next: [prev[0] - 3.0, prev[1]], covariance: [1e-4, 0.0, 1e-4] }
///     })
///     .collect();
/// let options = PlaneOptions::default().rotation_std([1e-6; 3]);
/// let fit = fit_plane(&matches, 240, &lens, &PlaneInterval::default(), &[0.0; 6], &options)?.unwrap();
/// assert!((fit.motion[0] - 0.01).abs() < 1e-6 && fit.motion[1].abs() < 1e-6);
/// # Ok::<(), lk_core::Error>(())
/// ```
pub fn fit_plane(
    matches: &[PlaneMatch],
    rows: usize,
    lens: &Lens,
    interval: &PlaneInterval,
    start: &PlaneMotion,
    options: &PlaneOptions,
) -> Result<Option<PlaneFit>> {
    interval.validate()?;
    options.validate()?;
    expect_motion(start)?;
    let known = options.known();
    let mut motion = *start;
    let mut last = None;
    for _ in 0..ROUNDS {
        let (equations, places) = equations(matches, rows, lens, interval, &motion);
        let from = Known {
            at: std::array::from_fn(|k| known.at[k] - motion[k]),
            ..known
        };
        let Some(step) = robust(&equations, &from, [10, 10]) else {
            return Ok(None);
        };
        for (value, by) in motion.iter_mut().zip(step.step) {
            *value += by;
        }
        let moved = step
            .step
            .iter()
            .fold(0.0f64, |most, value| most.max(value.abs()));
        last = Some((equations, places, step));
        if moved < SETTLED {
            break;
        }
    }
    let Some((equations, places, step)) = last else {
        return Ok(None);
    };
    let tiles = tiles(matches, &equations, &places, &step);
    let followed = Followed {
        motion,
        tiles: Vec::new(),
        across: 0,
        places,
        equations,
        step,
        noise: f64::NAN,
        settled: true,
        widened: 1.0,
    };
    Ok(Some(PlaneFit {
        motion,
        normal: followed.normal(),
        pull: followed.pull(),
        responses: Vec::new(),
        scale: followed.step.scale,
        widened: followed.widened,
        residual: f64::NAN,
        correlation: f64::NAN,
        settled: followed.settled,
        tiles,
    }))
}

/// Each match as a tile.
fn tiles(
    matches: &[PlaneMatch],
    equations: &[Equation],
    places: &[usize],
    step: &Step,
) -> Vec<PlaneTile> {
    let mut tiles: Vec<PlaneTile> = matches
        .iter()
        .map(|point| PlaneTile {
            middle: std::array::from_fn(|k| 0.5 * (point.prev[k] + point.next[k])),
            displacement: std::array::from_fn(|k| point.next[k] - point.prev[k]),
            residual: [f64::NAN; 2],
            weight: 0.0,
            information: [0.0; 3],
            correlation: 0.0,
            status: PlaneTileStatus::Outside,
        })
        .collect();
    for ((equation, index), weight) in equations.iter().zip(places).zip(&step.weights) {
        let tile = &mut tiles[*index];
        tile.residual = equation.left(&step.step);
        tile.information = equation.information;
        tile.weight = *weight;
        tile.status = if *weight > 0.0 {
            PlaneTileStatus::Plane
        } else {
            PlaneTileStatus::Outlier
        };
    }
    tiles
}

/// What each match says against a motion, and which it is; none of what the motion does not show.
fn equations(
    matches: &[PlaneMatch],
    rows: usize,
    lens: &Lens,
    interval: &PlaneInterval,
    motion: &PlaneMotion,
) -> (Vec<Equation>, Vec<usize>) {
    let view = View::new(lens, interval, rows, motion);
    let varied: [View<'_>; UNKNOWNS] = std::array::from_fn(|k| {
        let mut other = *motion;
        other[k] += VARIED;
        View::new(lens, interval, rows, &other)
    });
    let mut equations = Vec::with_capacity(matches.len());
    let mut places = Vec::with_capacity(matches.len());
    'matches: for (index, point) in matches.iter().enumerate() {
        let Some(at) = view.carried(point.prev) else {
            continue;
        };
        let mut slopes = [[0.0; UNKNOWNS]; 2];
        for (k, other) in varied.iter().enumerate() {
            let Some(there) = other.carried(point.prev) else {
                continue 'matches;
            };
            for axis in 0..2 {
                slopes[axis][k] = (there[axis] - at[axis]) / VARIED;
            }
        }
        let [xx, xy, yy] = point.covariance;
        let determinant = xx * yy - xy * xy;
        let residual = [point.next[0] - at[0], point.next[1] - at[1]];
        let sane =
            determinant > 0.0 && xx > 0.0 && residual[0].is_finite() && residual[1].is_finite();
        if !sane {
            continue;
        }
        equations.push(Equation {
            residual,
            information: [yy / determinant, -xy / determinant, xx / determinant],
            slopes,
        });
        places.push(index);
    }
    (equations, places)
}
