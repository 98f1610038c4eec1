//! From node to node: each is led by the neighbour that is done and surest, which hands on its motion.
//!
//! B. Pan, "Reliability-guided digital image correlation for image deformation measurement", Applied Optics 2009; here
//! sureness is the standard deviation, and a round of the surest is measured at the same time.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

use super::fit::Fitting;
use super::lattice::Lattice;
use super::node::{Measured, Workspace};
use super::result::GridStatus;
use super::shape::Warp;
use crate::displacement_hypotheses::Hypotheses;
use crate::error::Result;
use crate::execution::Execution;
use crate::memory::{replace, reserve, reserve_more, resize};
use crate::parallel::{RowsMut, for_each_band};

/// Nodes of a round; whatever the number of threads, so that results do not depend on it.
pub(super) const ROUND: usize = 32;
/// Nodes that a thread takes at least: some 100 us of work.
pub(super) const LEAST_NODES: usize = 2;
/// Starts of one node, and how far they are apart at least, in pixels.
const TRIES: u8 = 4;
const APART: f64 = 0.25;

/// What memory for nodes holds.
pub(super) const NODES: &str = "nodes";

/// What is known of a node.
#[derive(Debug, Clone, Copy)]
pub(super) struct Known {
    /// What was found, whether it may stand or not.
    pub(super) found: Option<Measured>,
    /// Why there is nothing that may stand.
    pub(super) status: GridStatus,
    pub(super) tries: u8,
    pub(super) sought: bool,
    /// Where the last try began.
    started: [f64; 2],
}

impl Known {
    pub(super) const NOTHING: Self = Self {
        found: None,
        status: GridStatus::NotFound,
        tries: 0,
        sought: false,
        started: [f64::INFINITY; 2],
    };

    /// Whether there is something that may stand.
    pub(super) fn is_done(&self) -> bool {
        self.status == GridStatus::Measured
    }

    /// What may stand.
    pub(super) fn done(&self) -> Option<&Measured> {
        self.found.as_ref().filter(|_| self.is_done())
    }

    /// Take what a try came to; the best correlation of all tries is kept.
    fn take(&mut self, outcome: std::result::Result<Measured, GridStatus>) {
        match outcome {
            Ok(measured) => {
                let better = self
                    .found
                    .is_none_or(|found| measured.correlation > found.correlation);
                if better || measured.status == GridStatus::Measured {
                    self.found = Some(measured);
                    self.status = measured.status;
                }
            }
            Err(status) if self.found.is_none() => self.status = status,
            Err(_) => {}
        }
    }
}

/// A node that waits for its turn, the surest leader's first.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Waiting {
    deviation: f64,
    node: usize,
    leader: usize,
}

impl Eq for Waiting {}

impl Ord for Waiting {
    fn cmp(&self, other: &Self) -> Ordering {
        let sure = other.deviation.total_cmp(&self.deviation);
        sure.then(other.node.cmp(&self.node))
            .then(other.leader.cmp(&self.leader))
    }
}

impl PartialOrd for Waiting {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// One try at a node.
#[derive(Debug, Clone, Copy)]
pub(super) struct Try {
    pub(super) node: usize,
    pub(super) start: Warp,
    pub(super) outcome: std::result::Result<Measured, GridStatus>,
}

/// All nodes of a grid, under way.
pub(super) struct Survey<'a> {
    pub(super) fitting: Fitting<'a>,
    pub(super) lattice: Lattice,
    pub(super) execution: &'a Execution,
    pub(super) hypotheses: &'a Hypotheses,
    /// Displacements to begin with, not finite where there is none.
    pub(super) initial: Option<&'a [[f32; 2]]>,
    pub(super) nodes: Vec<Known>,
    /// How much texture each window has.
    pub(super) texture: Vec<f32>,
    waiting: BinaryHeap<Waiting>,
}

impl<'a> Survey<'a> {
    /// # Errors
    ///
    /// Those of the memory.
    pub(super) fn new(
        fitting: Fitting<'a>,
        lattice: Lattice,
        execution: &'a Execution,
        hypotheses: &'a Hypotheses,
        initial: Option<&'a [[f32; 2]]>,
    ) -> Result<Self> {
        let mut nodes = Vec::new();
        resize(NODES, &mut nodes, lattice.len(), Known::NOTHING)?;
        let mut texture = Vec::new();
        let textures = (0..lattice.len()).map(|node| fitting.texture(lattice.corner(node)));
        replace(NODES, &mut texture, textures)?;
        // A node that is done leads four at most.
        let mut waiting = Vec::new();
        reserve(NODES, &mut waiting, 4 * lattice.len())?;
        Ok(Self {
            fitting,
            lattice,
            execution,
            hypotheses,
            initial,
            nodes,
            texture,
            waiting: BinaryHeap::from(waiting),
        })
    }

    /// Measure the nodes that wait, round by round.
    ///
    /// # Errors
    ///
    /// Those of the memory and of the execution.
    pub(super) fn follow(&mut self) -> Result<()> {
        let mut tries: Vec<Try> = Vec::new();
        let mut later: Vec<Waiting> = Vec::new();
        loop {
            self.execution.check()?;
            tries.clear();
            while tries.len() < ROUND
                && let Some(waiting) = self.waiting.pop()
            {
                if tries.iter().any(|a_try| a_try.node == waiting.node) {
                    later.push(waiting);
                } else if let Some(start) = self.start(waiting) {
                    let outcome = Err(GridStatus::NotFound);
                    tries.push(Try {
                        node: waiting.node,
                        start,
                        outcome,
                    });
                }
            }
            self.waiting.extend(later.drain(..));
            if tries.is_empty() {
                return Ok(());
            }
            self.try_all(&mut tries)?;
            for a_try in tries.drain(..) {
                self.finish(a_try);
            }
        }
    }

    /// Fit all of `tries`.
    fn try_all(&self, tries: &mut [Try]) -> Result<()> {
        let rows = tries.len();
        for_each_band(
            self.execution,
            rows,
            LEAST_NODES,
            RowsMut::new(tries, 1),
            |_, part| {
                Workspace::with(|workspace| {
                    part.data.iter_mut().try_for_each(|a_try| {
                        let corner = self.lattice.corner(a_try.node);
                        a_try.outcome =
                            self.fitting
                                .measure(corner, a_try.start, false, workspace)?;
                        Ok(())
                    })
                })
            },
        )
    }

    /// Where the leader says that a node is, unless it is done or that has been tried.
    fn start(&self, waiting: Waiting) -> Option<Warp> {
        let known = &self.nodes[waiting.node];
        if known.is_done() || known.tries >= TRIES {
            return None;
        }
        let leader = self.nodes[waiting.leader].done()?;
        let start = self.seen_from(leader, waiting.leader, waiting.node);
        let apart = start.displacement().into_iter().zip(known.started);
        let is_new = apart.fold(0.0f64, |most, (a, b)| most.max((a - b).abs())) > APART;
        is_new.then_some(start)
    }

    /// What `measured` at one node says of another.
    pub(super) fn seen_from(&self, measured: &Measured, from: usize, to: usize) -> Warp {
        let (a, b) = (self.lattice.corner(from), self.lattice.corner(to));
        let half = self.fitting.pattern.half;
        let offset = [0, 1].map(|axis| (b[axis] as f64 - a[axis] as f64) / half);
        measured.warp.up_to(1).seen_from(offset)
    }

    /// Take what a try came to; what may stand leads its neighbours.
    pub(super) fn finish(&mut self, a_try: Try) {
        let known = &mut self.nodes[a_try.node];
        known.tries += 1;
        known.started = a_try.start.displacement();
        known.take(a_try.outcome);
        let Some(deviation) = known.done().map(Measured::deviation) else {
            return;
        };
        for beside in [[1, 0], [-1, 0], [0, 1], [0, -1]] {
            if let Some(node) = self.lattice.beside(a_try.node, beside)
                && !self.nodes[node].is_done()
            {
                self.waiting.push(Waiting {
                    deviation,
                    node,
                    leader: a_try.node,
                });
            }
        }
    }

    /// Try nodes again from these starts; a result that may stand is taken.
    ///
    /// # Errors
    ///
    /// Those of the memory and of the execution.
    pub(super) fn retry(&mut self, starts: &[(usize, Warp)]) -> Result<()> {
        let mut tries = Vec::new();
        reserve_more(NODES, &mut tries, starts.len())?;
        let outcome = Err(GridStatus::NotFound);
        tries.extend(starts.iter().map(|(node, start)| Try {
            node: *node,
            start: *start,
            outcome,
        }));
        self.try_all(&mut tries)?;
        for a_try in tries {
            if let Ok(measured) = a_try.outcome
                && measured.status == GridStatus::Measured
            {
                let known = &mut self.nodes[a_try.node];
                (known.found, known.status) = (Some(measured), GridStatus::Measured);
            }
        }
        Ok(())
    }
}
