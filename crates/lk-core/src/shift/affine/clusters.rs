//! Sums over clusters of pixels of the products of their features.
#![allow(clippy::needless_range_loop, reason = "matrix indices")]

use super::view::{FEATURES, Match, Sample, Sampled, View};
use crate::error::Result;
use crate::execution::Execution;
use crate::memory::resize;
use crate::parallel::{RowsMut, for_each_band};
use crate::shift::filters::RADIUS;

/// Products of two features, each pair once.
const PRODUCTS: usize = FEATURES * (FEATURES + 1) / 2;

/// Pixels along a side of a cluster: what is left of its differences may pull together.
const CLUSTER: usize = 8;
/// Rows that a thread takes at least are as many as hold this many pixels.
const BAND_PIXELS: usize = 4096;

/// What is kept from evaluation to evaluation.
#[derive(Debug, Default)]
pub(in crate::shift) struct Workspace {
    values: Vec<([f32; 2], Match)>,
    clusters: Vec<Sums>,
}

/// Sums of products of all features, each once, row after row from the diagonal on.
pub(super) type Sums = [f64; PRODUCTS];

/// The index of the product of two features.
pub(super) fn index(i: usize, j: usize) -> usize {
    let (i, j) = (i.min(j), i.max(j));
    i * (2 * FEATURES - i - 1) / 2 + j
}

impl Workspace {
    /// The sums over each cluster of the last evaluation.
    pub(super) fn sums(&self) -> &[Sums] {
        &self.clusters
    }

    /// Sums over clusters of the window at one motion: no sum reaches over two of them, so that threads change no bit.
    pub(super) fn sum(&mut self, view: &View<'_>, execution: &Execution) -> Result<()> {
        let Self { values, clusters } = self;
        let [columns, rows] = view.pair.window.map(|(low, high)| high - low);
        let margin = RADIUS;
        let (width, height) = (columns + 2 * margin, rows + 2 * margin);
        let start = (view.pair.window).map(|(low, _)| low as isize - margin as isize);
        values.clear();
        let absent = ([f32::NAN; 2], Match::default());
        resize("samples", values, width.saturating_mul(height), absent)?;
        for_each_band(
            execution,
            height,
            (BAND_PIXELS / width).max(1),
            RowsMut::new(values, width),
            |band, mut part| {
                for (local, y) in band.enumerate() {
                    for (x, value) in part.row_mut(local).iter_mut().enumerate() {
                        let pixel = [start[0] + x as isize, start[1] + y as isize];
                        let whole = view.whole(pixel);
                        let found = view.sample(pixel, whole);
                        *value = (found.unwrap_or([f32::NAN; 2]), Match { whole });
                    }
                }
            },
        )?;
        let sampled = Sampled {
            start,
            width,
            values,
        };
        let (across, down) = (columns.div_ceil(CLUSTER), rows.div_ceil(CLUSTER));
        clusters.clear();
        resize("clusters", clusters, across * down, [0.0; PRODUCTS])?;
        for_each_band(
            execution,
            down,
            (BAND_PIXELS / (width * CLUSTER)).max(1),
            RowsMut::new(clusters, across),
            |band, mut part| {
                for (local, cluster) in band.enumerate() {
                    let sums = part.row_mut(local);
                    for y in cluster * CLUSTER..((cluster + 1) * CLUSTER).min(rows) {
                        for x in 0..columns {
                            if let Some((features, weight)) =
                                view.features(&sampled, x + margin, y + margin)
                            {
                                add(&mut sums[x / CLUSTER], &features, weight);
                            }
                        }
                    }
                }
            },
        )
    }
}

fn add(sums: &mut Sums, features: &Sample, weight: f64) {
    let mut next = 0;
    for i in 0..FEATURES {
        let weighted = weight * features[i];
        for j in i..FEATURES {
            sums[next] += weighted * features[j];
            next += 1;
        }
    }
}
