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
    /// Which tile each equation is of.
    pub(super) places: Vec<usize>,
    pub(super) equations: Vec<Equation>,
    pub(super) step: Step,
    /// Mean square of what noise leaves in a tile.
    pub(super) noise: f64,
    pub(super) settled: bool,
}

impl Followed {
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
