//! Sums over clusters of pixels of the products of their features.
#![allow(clippy::needless_range_loop, reason = "matrix indices")]

use super::stripe::SumStripe;
use super::sums::{CLUSTER, PRODUCTS, Sums};
use super::view::View;
use crate::error::Result;
use crate::execution::Execution;
use crate::memory::resize;
use crate::parallel::{RowsMut, for_each_band};
use crate::shift::robust_covariance::Cell;
use crate::simd::dispatch;

/// Rows that a thread takes at least are as many as hold this many pixels.
const BAND_PIXELS: usize = 4096;

/// What is kept from evaluation to evaluation.
#[derive(Debug, Default)]
pub(in crate::shift) struct Workspace {
    clusters: Vec<Sums>,
    across: usize,
    /// What the clusters pull.
    cells: Vec<Cell>,
}

/// The sums over each cluster of the last evaluation, rows of `across`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Clusters<'a> {
    pub(super) sums: &'a [Sums],
    pub(super) across: usize,
}

impl Workspace {
    /// The sums over each cluster of the last evaluation, and room for what they pull.
    pub(super) fn last(&mut self) -> (Clusters<'_>, &mut Vec<Cell>) {
        let clusters = Clusters {
            sums: &self.clusters,
            across: self.across,
        };
        (clusters, &mut self.cells)
    }

    /// Sums over clusters of the window at one motion: no sum reaches over two of them, so that threads change no bit.
    /// Where about `enough` clusters tell what is asked, those of one row in so many are summed.
    pub(super) fn sum(
        &mut self,
        view: &View<'_>,
        enough: usize,
        execution: &Execution,
    ) -> Result<()> {
        let [(left, right), (top, bottom)] = view.pair.window;
        let (columns, rows) = (right - left, bottom - top);
        let across = columns.div_ceil(CLUSTER);
        let each = (across * rows.div_ceil(CLUSTER) / enough).max(1);
        let down = rows.div_ceil(CLUSTER * each);
        self.across = across;
        self.clusters.clear();
        resize(
            "clusters",
            &mut self.clusters,
            across * down,
            [0.0; PRODUCTS],
        )?;
        let level = execution.simd_level();
        for_each_band(
            execution,
            down,
            (BAND_PIXELS / (columns * CLUSTER).max(1)).max(1),
            RowsMut::new(&mut self.clusters, across),
            |band, mut part| {
                for (local, stripe) in band.enumerate() {
                    let y = top + stripe * each * CLUSTER;
                    let stripe = SumStripe {
                        view,
                        y: y as isize,
                        rows: CLUSTER.min(bottom - y),
                        clusters: part.row_mut(local),
                    };
                    dispatch(level, stripe);
                }
            },
        )
    }
}

#[cfg(test)]
mod tests {
    use super::super::reference;
    use super::*;
    use crate::frame::Plane;
    use crate::shift::coordinates::Pair;
    use crate::simd::SimdLevel;

    fn textured(width: usize, height: usize, phase: f64) -> Plane {
        let mut plane = Plane::new(width, height).unwrap();
        for y in 0..height {
            for (x, value) in plane.row_mut(y).iter_mut().enumerate() {
                let (x, y) = (x as f64, y as f64);
                let wave = (0.61 * x + 0.23 * y + phase).sin() + (0.37 * y - 0.11 * x).cos();
                *value = (0.2 * wave + 0.5) as f32;
            }
        }
        plane
    }

    #[test]
    fn eight_pixels_at_a_time_are_summed_as_one_at_a_time() {
        let (prev, next) = (textured(83, 61, 0.0), textured(90, 70, 0.4));
        let mut holes = Plane::new(90, 70).unwrap();
        for y in 0..70 {
            for (x, value) in holes.row_mut(y).iter_mut().enumerate() {
                *value = f32::from(u8::from((x * y) % 7 != 0));
            }
        }
        let windows = [[(0, 83), (0, 61)], [(9, 71), (5, 50)], [(40, 52), (33, 44)]];
        let motions = [
            [0.0; 6],
            [0.3, -0.4, 1e-3, -2e-3, 5e-4, 0.0],
            [-3.7, 2.2, 0.03, -0.02, 0.02, 0.01],
            [1.5, 0.5, -0.2, 0.3, -0.3, 0.25],
        ];
        for (window, motion) in windows.iter().flat_map(|w| motions.map(|m| (*w, m))) {
            for weight in [None, Some(&holes)] {
                let pair = Pair {
                    prev: &prev,
                    next: &next,
                    prev_weight: None,
                    next_weight: weight,
                    origin: [-4, -3],
                    window,
                };
                let view = View {
                    pair,
                    motion,
                    center: [41.0, 30.0],
                    unit: 41.0,
                };
                let want = reference::sums(&view);
                let mut bits: Option<Vec<Sums>> = None;
                for level in SimdLevel::available() {
                    let execution = Execution::default().level(level);
                    let mut workspace = Workspace::default();
                    workspace.sum(&view, usize::MAX, &execution).unwrap();
                    assert_eq!(workspace.clusters.len(), want.len());
                    for (got, want) in workspace.clusters.iter().zip(&want) {
                        for (got, want) in got.iter().zip(want) {
                            let off = (got - want).abs();
                            assert!(off < 2e-5 * (1.0 + want.abs()), "{got}, not {want}");
                        }
                    }
                    let first = bits.get_or_insert_with(|| workspace.clusters.clone());
                    assert_eq!(first, &workspace.clusters, "{level:?}");
                }
            }
        }
    }
}
