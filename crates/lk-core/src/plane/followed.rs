//! Where the search for a motion ended, and what follows from it.

use super::PlaneResponse;
use super::fit::{Equation, Normal, Step, median};
use super::motion::PlaneMotion;
use super::seen::Seen;

/// Where the rounds ended.
#[derive(Debug, Clone)]
pub(super) struct Followed {
    pub(super) motion: PlaneMotion,
    pub(super) tiles: Vec<Seen>,
    /// Tiles in a row.
    pub(super) across: usize,
    /// Which tile each equation is of.
    pub(super) places: Vec<usize>,
    pub(super) equations: Vec<Equation>,
    pub(super) step: Step,
    /// Mean square of what noise leaves in a tile.
    pub(super) noise: f64,
    pub(super) settled: bool,
    /// Variance that neighbours which err alike add, in parts of that of chance; see [`Followed::widen`].
    pub(super) widened: f64,
}

/// Correlation of neighbours up to which chance may bring it.
const BY_CHANCE: f64 = 0.06;
/// Largest correlation of neighbours that is made good.
const MOST_ALIKE: f64 = 0.7;

impl Followed {
    /// Widen the covariance where neighbouring tiles err alike: what coding, light or uneven ground leave does not average
    /// out as noise does.
    pub(super) fn widen(&mut self) {
        let mut whitened = vec![None; self.tiles.len()];
        for ((equation, index), weight) in
            (self.equations.iter().zip(&self.places)).zip(&self.step.weights)
        {
            if *weight > 0.0 {
                let left = equation.left(&self.step.step);
                let size = (equation.information[0] + equation.information[2]).sqrt();
                whitened[*index] = Some(left.map(|value| size * value));
            }
        }
        let (mut alike, mut own, mut pairs) = (0.0, 0.0, 0usize);
        for (index, one) in whitened.iter().enumerate() {
            let Some([x, y]) = one else { continue };
            let right = (index + 1) % self.across.max(1) != 0;
            let others = [right.then_some(index + 1), Some(index + self.across)];
            for other in others.into_iter().flatten() {
                if let Some(Some([u, v])) = whitened.get(other) {
                    alike += x * u + y * v;
                    own += 0.5 * (x * x + y * y + u * u + v * v);
                    pairs += 1;
                }
            }
        }
        if pairs < 12 || own <= 0.0 {
            return;
        }
        let share = (alike / own - BY_CHANCE).clamp(0.0, MOST_ALIKE);
        // As of a field whose correlation falls by this share from tile to tile, along x and y.
        let factor = ((1.0 + share) / (1.0 - share)).powi(2);
        for value in self.step.normal.iter_mut().flatten() {
            *value /= factor;
        }
        self.widened = factor;
    }

    /// Root mean square of what the step moves the tiles by, in pixels.
    pub(super) fn moved_px(&self) -> f64 {
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
        let variance = self.widened * self.step.scale.powi(2);
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

    /// Right side of the normal equations of the displacements alone, from where the motion is.
    pub(super) fn pull(&self) -> PlaneMotion {
        let variance = self.widened * self.step.scale.powi(2);
        let mut pull = PlaneMotion::default();
        for (equation, weight) in self.equations.iter().zip(&self.step.weights) {
            let left = equation.left(&self.step.step);
            let [x, y] = equation
                .informed(left)
                .map(|value| weight / variance * value);
            for (k, value) in pull.iter_mut().enumerate() {
                *value += equation.slopes[0][k] * x + equation.slopes[1][k] * y;
            }
        }
        pull
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
