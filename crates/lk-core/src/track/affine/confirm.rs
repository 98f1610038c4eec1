//! What was found for points whose surroundings deform, held against the points around.

use crate::error::Result;
use crate::track::affine::deformed::{Deformed, FITTED, State};
use crate::track::affine::fit::Fit;
use crate::track::affine::warp::Warp;
use crate::track::consensus::{AGREEING, WITNESSES, agrees};
use crate::track::options::{PointStatus, TrackedPoint};
use crate::track::problem::Problem;

/// How far, in pixels, a window that lies partly outside may be from where the points around lead.
const MAX_SEPARATION: f64 = 0.5;

impl Deformed {
    /// Take back what the points around do not confirm.
    pub(super) fn confirm(
        &mut self,
        problem: &Problem<'_>,
        points: &[[f32; 2]],
        tracks: &mut [TrackedPoint],
    ) -> Result<()> {
        let states = &self.states;
        self.grid
            .fill(problem.size(), points, |index| states[index].warp.is_some())?;
        for (index, point) in points.iter().enumerate() {
            let State { warp, deformed, .. } = self.states[index];
            let Some(warp) = warp.filter(|_| deformed) else {
                continue;
            };
            let agrees = |near: usize| {
                let from = points[near];
                let offset = [from[0] - point[0], from[1] - point[1]].map(f64::from);
                let expected = warp.displacement(offset);
                // The point itself is no witness.
                near != index
                    && self.states[near]
                        .warp
                        .is_some_and(|seen| agrees(expected, seen.shift, offset))
            };
            let near = self.grid.nearest::<WITNESSES>(points, *point);
            if near.filter(|(_, near)| agrees(*near)).count() < AGREEING {
                tracks[index] = self.states[index].before;
            }
        }
        Ok(())
    }

    /// Take back displacements of windows that lie partly outside, where the points around turn, grow or shear: they are
    /// those of the middle of what is left, not of the point.
    pub(super) fn reject_partial(
        &self,
        problem: &Problem<'_>,
        points: &[[f32; 2]],
        tracks: &mut [TrackedPoint],
    ) {
        let half = 0.5 * problem.options.window_side() as f32 + 1.0;
        let (width, height) = problem.size();
        let last = [width as f32 - 1.0, height as f32 - 1.0];
        let partial = |at: [f32; 2]| {
            (0..2).any(|axis: usize| at[axis] < half || at[axis] > last[axis] - half)
        };
        for (index, point) in points.iter().enumerate() {
            let track = &tracks[index];
            let plain = track.is_valid() && !self.states[index].deformed;
            if !plain || !(partial(*point) || partial(track.position)) {
                continue;
            }
            let mut fit = Fit::default();
            for (_, near) in self.grid.nearest::<FITTED>(points, *point) {
                let State { warp, deformed, .. } = self.states[near];
                if let Some(warp) = warp.filter(|_| deformed) {
                    let from = points[near];
                    fit.add(
                        [from[0] - point[0], from[1] - point[1]].map(f64::from),
                        warp.shift,
                    );
                }
            }
            let own = track.displacement(*point);
            let differs = |warp: Warp| {
                (warp.shift[0] - own[0]).hypot(warp.shift[1] - own[1]) > MAX_SEPARATION
            };
            if fit.warp().is_some_and(differs) {
                tracks[index] = TrackedPoint {
                    residual: track.residual,
                    forward_backward: track.forward_backward,
                    ..TrackedPoint::lost(PointStatus::HighResidual)
                };
            }
        }
    }
}
