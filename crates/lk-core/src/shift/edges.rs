//! Edges that are too sharp for the samples, or that only the border of the window makes look like more than one.
//!
//! `docs/explanation/algorithms.md`, section "Covariance of a shift".

use super::evaluate::{aligned_share, evaluate, lines_scatter};
use super::gauss_newton::{Found, Problem};
use super::lines::Lines;
use super::matrix::Matrix;
use super::solution::Solution;
use super::view::Evaluation;
use crate::error::Result;

/// Above this share of the gradients in tiles that show edges along the pixels, all samples along an edge may have the
/// same error of interpolation.
const ALIGNED: f64 = 0.5;
/// Below this damping by smoothness edges may be too sharp for the samples.
const SMOOTH: f64 = 0.87;
impl Problem<'_> {
    /// What the gradients tell where none reaches over the border of the window.
    pub(super) fn inside(&mut self, found: &Found) -> Result<Option<Solution>> {
        let params = Evaluation {
            borders: false,
            ..self.evaluation_of(found)
        };
        let execution = &self.options.execution;
        evaluate(self.inputs.pair(0), params, self.workspace, execution)
    }

    /// What is added to the covariance by edges along the pixels that are too sharp for the samples; with a direction,
    /// where that is the only one in which the displacement may move.
    pub(super) fn aliasing(
        &mut self,
        found: &Found,
        direction: Option<[f64; 2]>,
    ) -> Result<Matrix> {
        let mut sum = [[0.0; 2]; 2];
        let sharp = found.solution.damping < SMOOTH;
        if !sharp || aligned_share(self.workspace) < ALIGNED {
            return Ok(sum);
        }
        let lines = Lines {
            direction,
            damping: found.solution.damping,
        };
        let params = self.evaluation_of(found);
        for axis in 0..2 {
            let pair = self.inputs.pair(0);
            let execution = &self.options.execution;
            let scatter = lines_scatter(pair, params, axis, lines, self.workspace, execution)?;
            for (to, from) in sum
                .iter_mut()
                .flatten()
                .zip(scatter.iter().flatten().flatten())
            {
                *to += from;
            }
        }
        Ok(sum)
    }

    /// The last evaluation of what was found at the finest level, once more.
    fn evaluation_of(&self, found: &Found) -> Evaluation {
        Evaluation {
            displacement: found.displacement,
            whole: found.displacement.map(f64::round),
            scope: found.scope,
            common_structure: true,
            ..self.evaluation(0, found.gain)
        }
    }
}
