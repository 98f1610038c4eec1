//! Nodes that no neighbour leads to: some of them are sought, and lead the others.
//!
//! `docs/explanation/algorithms.md`, section "Grid: displacement_grid".

use super::lattice::spaced;
use super::node::{Measured, Workspace};
use super::result::GridStatus;
use super::seek::{CERTAIN, Sought};
use super::shape::Warp;
use super::spread::{LEAST_NODES, NODES, ROUND, Survey, Try};
use crate::error::Result;
use crate::memory::reserve_more;
use crate::parallel::{RowsMut, for_each_band};

/// Rounds of searches at least, and for how many nodes there is one more.
const ROUNDS: usize = 4;
const NODES_A_ROUND: usize = 256;
/// A window is worth a search that has this share of the most texture of all.
const TEXTURED: f32 = 0.25;

impl Survey<'_> {
    /// Measure all nodes that a search or a neighbour leads to.
    ///
    /// # Errors
    ///
    /// Those of the memory and of the execution.
    pub(super) fn measure(&mut self) -> Result<()> {
        for _ in 0..ROUNDS + self.lattice.len() / NODES_A_ROUND {
            let nodes = self.to_seek();
            if nodes.is_empty() {
                break;
            }
            self.seek(&nodes)?;
            self.follow()?;
        }
        self.say_why()
    }

    /// Say of nodes that were never tried what would have become of them.
    fn say_why(&mut self) -> Result<()> {
        let (fitting, lattice) = (self.fitting, self.lattice);
        let min_rows = LEAST_NODES * ROUND;
        let rows = RowsMut::new(&mut self.nodes, 1);
        for_each_band(
            self.execution,
            lattice.len(),
            min_rows,
            rows,
            |range, part| {
                Workspace::with(|workspace| {
                    part.data
                        .iter_mut()
                        .zip(range)
                        .try_for_each(|(known, node)| {
                            if known.tries == 0 {
                                known.status =
                                    fitting.reason_at(lattice.corner(node), workspace)?;
                            }
                            Ok(())
                        })
                })
            },
        )
    }

    /// Nodes to search for, far from each other: of those that no neighbour led to, or else of those that it led astray.
    fn to_seek(&self) -> Vec<usize> {
        for lost in [false, true] {
            let wanted = |node: &usize| {
                let known = &self.nodes[*node];
                let open = !known.is_done() && !known.sought;
                open && known.status != GridStatus::LowSupport && lost == (known.tries > 0)
            };
            let all = (0..self.nodes.len()).filter(wanted);
            let texture = |node: usize| self.texture[node];
            let most = all.clone().map(texture).fold(0.0, f32::max);
            let textured = all.filter(|node| texture(*node) >= TEXTURED * most);
            let nodes = spaced(textured, self.lattice);
            if most > 0.0 && !nodes.is_empty() {
                return nodes;
            }
        }
        Vec::new()
    }

    /// Search for the windows of `nodes`.
    fn seek(&mut self, nodes: &[usize]) -> Result<()> {
        let lost = Err(GridStatus::NotFound);
        let mut tries = Vec::new();
        reserve_more(NODES, &mut tries, nodes.len())?;
        tries.extend(nodes.iter().map(|node| Try {
            node: *node,
            start: Warp::default(),
            outcome: lost,
        }));
        let survey = &*self;
        for_each_band(
            self.execution,
            tries.len(),
            1,
            RowsMut::new(&mut tries, 1),
            |_, part| {
                Workspace::with(|workspace| {
                    part.data
                        .iter_mut()
                        .try_for_each(|a_try| survey.seek_one(a_try, workspace))
                })
            },
        )?;
        for a_try in tries {
            self.nodes[a_try.node].sought = true;
            self.finish(a_try);
        }
        Ok(())
    }

    fn seek_one(&self, a_try: &mut Try, workspace: &mut Workspace) -> Result<()> {
        let corner = self.lattice.corner(a_try.node);
        let given = self
            .initial
            .map(|initial| initial[a_try.node].map(f64::from));
        let given = given.filter(|given| given.iter().all(|value| value.is_finite()));
        if let Some(given) = given {
            a_try.start = shifted(given);
            a_try.outcome = self.fitting.measure(corner, a_try.start, true, workspace)?;
            if a_try.outcome.is_ok_and(|found| found.correlation > CERTAIN) {
                return Ok(());
            }
        }
        let sought = Sought {
            frames: self.fitting.frames,
            corner,
            side: self.fitting.pattern.side,
            reach: self.fitting.reach,
        };
        let half = self.fitting.pattern.half;
        let centre = corner.map(|at| (at as f64 + half) as f32);
        let hypotheses = given
            .into_iter()
            .chain([[0.0; 2]])
            .chain(self.hypotheses.at(centre));
        let mut surface = std::mem::take(&mut workspace.surface);
        let found = sought.best(hypotheses, &mut surface);
        workspace.surface = surface;
        if let Some(found) = found? {
            let start = shifted(found.displacement);
            let outcome = self.fitting.measure(corner, start, true, workspace)?;
            let correlation = |outcome: &std::result::Result<Measured, GridStatus>| {
                outcome.as_ref().map_or(-1.0, |found| found.correlation)
            };
            if correlation(&outcome) > correlation(&a_try.outcome) || a_try.outcome.is_err() {
                (a_try.start, a_try.outcome) = (start, outcome);
            }
        }
        Ok(())
    }
}

/// The motion of a window that is shifted.
fn shifted(displacement: [f64; 2]) -> Warp {
    let mut warp = Warp::default();
    (warp.0[0][0], warp.0[1][0]) = (displacement[0], displacement[1]);
    warp
}
