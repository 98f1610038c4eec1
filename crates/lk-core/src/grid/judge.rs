//! Whether neighbours agree, each seen with its gradient; and what they say where a node was lost.
//!
//! J. Westerweel and F. Scarano, "Universal outlier detection for PIV data", Experiments in Fluids 2005, compares a vector
//! with the median of its neighbours; where the motion bends that rejects what is right. Here two nodes agree if the mean
//! of their gradients leads from one to the other.

use super::covariance::MOTION;
use super::node::Measured;
use super::result::GridStatus;
use super::shape::Warp;
use super::spread::{NODES, Survey};
use crate::error::Result;
use crate::memory::{reserve, resize};

/// Nodes around one.
pub(super) const AROUND: [[isize; 2]; 8] = [
    [-1, -1],
    [0, -1],
    [1, -1],
    [-1, 0],
    [1, 0],
    [-1, 1],
    [0, 1],
    [1, 1],
];

/// How far nodes may disagree: so many pixels, and so many standard deviations.
const FLOOR: f64 = 0.25;
const DEVIATIONS: f64 = 3.0;
/// The least share of the neighbours that must agree, one of so many; and how many do where there are so many.
const SHARE: usize = 3;
/// A node that stands alone must correlate as well as this.
const ALONE: f64 = 0.7;

impl Survey<'_> {
    /// Refuse nodes that their neighbours contradict, after they have been tried once more where the neighbours say that
    /// they are.
    ///
    /// # Errors
    ///
    /// Those of the memory and of the execution.
    pub(super) fn judge(&mut self) -> Result<()> {
        self.refuse()?;
        let mut starts = Vec::new();
        let lost = self.nodes.iter().filter(|known| !known.is_done()).count();
        reserve(NODES, &mut starts, lost)?;
        starts.extend(
            (0..self.nodes.len())
                .filter(|node| !self.nodes[*node].is_done())
                .filter_map(|node| Some((node, self.said(node)?)))
                .take(lost),
        );
        if starts.is_empty() {
            return Ok(());
        }
        self.retry(&starts)?;
        self.refuse()
    }

    /// Refuse what the neighbours contradict.
    fn refuse(&mut self) -> Result<()> {
        let mut contradicted = Vec::new();
        resize(NODES, &mut contradicted, self.nodes.len(), false)?;
        for (node, contradicted) in contradicted.iter_mut().enumerate() {
            *contradicted = self.is_contradicted(node);
        }
        for (known, contradicted) in self.nodes.iter_mut().zip(contradicted) {
            if contradicted {
                known.status = GridStatus::Contradicted;
            }
        }
        Ok(())
    }

    fn is_contradicted(&self, node: usize) -> bool {
        let Some(measured) = self.nodes[node].done() else {
            return false;
        };
        let (mut agreeing, mut all) = (0usize, 0usize);
        for place in AROUND {
            let Some(beside) = self.lattice.beside(node, place) else {
                continue;
            };
            if let Some(other) = self.nodes[beside].done() {
                all += 1;
                agreeing += usize::from(self.agree(measured, other, place));
            }
        }
        if all == 0 {
            return measured.correlation < ALONE;
        }
        agreeing < all.div_ceil(SHARE)
    }

    /// Whether the mean gradient of both leads from `measured` to what stands at `place` beside it.
    fn agree(&self, measured: &Measured, other: &Measured, place: [isize; 2]) -> bool {
        let half = self.fitting.pattern.half;
        let offset = place.map(|at| at as f64 * self.lattice.step as f64 / half);
        (0..2).all(|axis| {
            let (a, b) = (&measured.warp.0[axis], &other.warp.0[axis]);
            let led = 0.5 * ((a[1] + b[1]) * offset[0] + (a[2] + b[2]) * offset[1]);
            let variance = variance(measured, axis, offset) + variance(other, axis, offset);
            (b[0] - a[0] - led).abs() <= FLOOR + DEVIATIONS * variance.sqrt()
        })
    }

    /// What the neighbours of a node say of it: the median of each factor.
    fn said(&self, node: usize) -> Option<Warp> {
        let said: Vec<Warp> = AROUND
            .iter()
            .filter_map(|place| {
                let beside = self.lattice.beside(node, *place)?;
                let measured = self.nodes[beside].done()?;
                Some(self.seen_from(measured, beside, node))
            })
            .collect();
        if said.is_empty() {
            return None;
        }
        let mut warp = Warp::default();
        for axis in 0..2 {
            for term in 0..MOTION / 2 {
                let mut values: Vec<f64> = said.iter().map(|warp| warp.0[axis][term]).collect();
                values.sort_by(f64::total_cmp);
                let middle = values.len() / 2;
                warp.0[axis][term] = 0.5 * (values[middle] + values[(values.len() - 1) / 2]);
            }
        }
        Some(warp)
    }
}

/// The variance of what a node says half way to `offset`.
fn variance(measured: &Measured, axis: usize, offset: [f64; 2]) -> f64 {
    let at = axis * (MOTION / 2);
    let c = &measured.covariance;
    let weights = [1.0, 0.5 * offset[0], 0.5 * offset[1]];
    let mut sum = measured.bend[axis].powi(2);
    for (i, a) in weights.iter().enumerate() {
        for (j, b) in weights.iter().enumerate() {
            sum += a * b * c[at + i][at + j];
        }
    }
    sum.max(0.0)
}
