//! What a shape cannot follow: by how much the neighbours stray from where a node's shape leads, and what that does to it.
//!
//! A field that bends more than its shape pulls the least squares away from the centre. Where the field is a polynomial of
//! one even degree more than the shape, that is a fixed share of what the shape misses some way off.
//!
//! `docs/explanation/algorithms.md`, section "Grid: displacement_grid".

use super::covariance::MOTION;
use super::node::Measured;
use super::spread::{NODES, Survey};
use crate::error::Result;
use crate::memory::resize;

/// A miss in the displacement is told from noise beyond so many of its deviations.
const TOLD: f64 = 3.0;
/// Neighbours see a motion that their own windows have smoothed: what it misses is more by so much.
const SMOOTHED: f64 = 1.3;

/// What is missed: of u, du/dx, du/dy per half window, and of v.
type Miss = [f64; MOTION];

impl Survey<'_> {
    /// Add to the covariance of each node what its shape cannot follow.
    ///
    /// # Errors
    ///
    /// Those of the memory.
    pub(super) fn add_model_error(&mut self) -> Result<()> {
        let mut misses = Vec::new();
        resize(NODES, &mut misses, self.nodes.len(), [0.0; MOTION])?;
        for (node, miss) in misses.iter_mut().enumerate() {
            if let Some(measured) = self.nodes[node].done() {
                *miss = self.missed(node, measured);
            }
        }
        for (known, miss) in self.nodes.iter_mut().zip(misses) {
            if let Some(found) = &mut known.found {
                for (i, row) in found.covariance.iter_mut().enumerate() {
                    for (j, value) in row.iter_mut().enumerate() {
                        *value += miss[i] * miss[j];
                    }
                }
            }
        }
        Ok(())
    }

    /// How far the least squares of a node may be from its centre's motion.
    fn missed(&self, node: usize, measured: &Measured) -> Miss {
        let half = self.fitting.pattern.half;
        let degree = self.fitting.degree;
        // Neighbours about half a window away, and how far that is in half windows: nearer ones tell little from noise.
        let away = ((half / self.lattice.step as f64).round() as isize).max(1);
        let step = away as f64 * self.lattice.step as f64 / half;
        // The share of x^2, and of x^4, that the least squares over -1 to 1 finds at the centre.
        let share = if degree < 2 {
            1.0 / (3.0 * step.powi(2))
        } else {
            3.0 / (35.0 * step.powi(4))
        };
        let mut miss = [0.0; MOTION];
        for along in 0..2 {
            let sides = [1isize, -1].map(|side| {
                let mut place = [0, 0];
                place[along] = side * away;
                let beside = self.lattice.beside(node, place)?;
                Some((side as f64 * step, self.nodes[beside].done()?))
            });
            for axis in 0..2 {
                let at = axis * (MOTION / 2);
                let strays = Strays::new(measured, sides, along, axis, degree);
                miss[at] += SMOOTHED * share * strays.value();
                if degree > 0 {
                    // The share of x^3 in the slope along x, and of x^2 y in that along y.
                    for term in 0..2 {
                        let share = if term == along { 1.0 / 5.0 } else { 1.0 / 3.0 };
                        miss[at + 1 + term] += SMOOTHED * share / step.powi(2) * strays.slope(term);
                    }
                }
            }
        }
        for (axis, bend) in measured.bend.into_iter().enumerate() {
            let miss = &mut miss[axis * (MOTION / 2)];
            *miss = if bend.abs() > miss.abs() { bend } else { *miss };
        }
        miss
    }
}

/// How far the neighbours on both sides along one axis are from where a node leads, in one component.
struct Strays {
    /// In displacement, and its variance; by what their slopes say; of the slopes along x and y.
    values: [f64; 2],
    variance: f64,
    slopes: [f64; 2],
    degree: usize,
}

impl Strays {
    fn new(
        measured: &Measured,
        sides: [Option<(f64, &Measured)>; 2],
        along: usize,
        axis: usize,
        degree: usize,
    ) -> Self {
        let at = axis * (MOTION / 2);
        let count = sides.iter().flatten().count().max(1) as f64;
        let mut strays = Self {
            values: [0.0; 2],
            variance: 0.0,
            slopes: [0.0; 2],
            degree,
        };
        for (offset, other) in sides.into_iter().flatten() {
            let mut place = [0.0; 2];
            place[along] = offset;
            let led = measured.warp.seen_from(place).0[axis];
            let seen = other.warp.0[axis];
            strays.values[0] += (seen[0] - led[0]) / count;
            // The slope of x^2 is 2 x, that of x^4 is 4 x^3.
            let parts = if degree < 2 { 2.0 } else { 4.0 };
            strays.values[1] += (seen[1 + along] - led[1 + along]) * offset / parts / count;
            for term in 0..2 {
                strays.slopes[term] += (seen[1 + term] - led[1 + term]) / count;
            }
            strays.variance += other.covariance[at][at] / (count * count);
            // On one side alone the node's own slope counts, on both it cancels.
            if count < 2.0 {
                strays.variance +=
                    offset * offset * measured.covariance[at + 1 + along][at + 1 + along];
            }
        }
        strays.variance += measured.covariance[at][at];
        strays
    }

    /// What the shape misses in displacement: by the slopes, which noise moves less, unless displacements say that it is
    /// more.
    fn value(&self) -> f64 {
        let [plain, by_slope] = self.values;
        let told = plain.abs() > TOLD * self.variance.sqrt();
        if self.degree == 0 || told && plain.abs() > by_slope.abs() {
            plain
        } else {
            by_slope
        }
    }

    fn slope(&self, term: usize) -> f64 {
        self.slopes[term]
    }
}
