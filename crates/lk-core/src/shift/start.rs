//! Where to start: candidates from phase correlation at a coarse level, judged by how well the frames then agree.
//!
//! `docs/explanation/algorithms.md`, section "Start: phase correlation and rivals".

use super::coordinates::Pair;
use super::correlation::Correlator;
use crate::error::Result;
use crate::execution::Execution;
use crate::frame::Plane;
use crate::memory::{replace, reserve_more};
use crate::phase::{correlate_rows, fast_length};
use crate::simd::SimdLevel;

/// Peaks of the correlation surface that are tried.
const PEAKS: usize = 6;
/// A candidate that correlates like this is taken without trying others.
const CONVINCING: f64 = 0.7;

/// A whole-pixel displacement and how well the frames agree there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Start {
    pub(super) displacement: [isize; 2],
    /// Correlation coefficient of the locally normalised frames.
    pub(super) correlation: f64,
    /// How surely: the correlations by Fisher's transform, times the root of the pixels that they rest on.
    score: f64,
}

impl Start {
    /// Whether the frames agree so well that chance is out of the question.
    pub(super) fn is_convincing(&self) -> bool {
        self.correlation >= CONVINCING
    }

    /// Whether the frames agree better here than at `other`, perhaps at another level.
    pub(super) fn better_than(&self, other: &Self) -> bool {
        self.correlation > other.correlation
    }
}

/// Peaks below this share of the highest are noise: nothing repeats there.
const RIVAL_PEAK: f32 = 0.3;
/// A rival correlates like this, and with this share of the best one's coefficient: it lies between whole pixels.
const RIVAL: [f64; 2] = [0.4, 0.6];
/// Structure repeats where the frames correlate with this share of the best coefficient.
const REPEAT: f64 = 0.7;
/// Between the two the coefficient falls below the second by this.
const RISE: f64 = 0.2;
/// Nearer than this in whole pixels it is the same displacement.
const RIVAL_DISTANCE: usize = 2;
/// As many are looked at.
const RIVALS: usize = 3;

/// Where the frames agree best, and where they agree almost as well.
#[derive(Debug, Clone)]
pub(super) struct Starts {
    pub(super) best: Start,
    pub(super) rivals: Vec<[isize; 2]>,
}

/// What the search needs, kept from call to call.
#[derive(Debug, Default)]
pub(super) struct Workspace {
    correlator: Correlator,
    surface: Plane,
    fades: [[Vec<f32>; 2]; 2],
}

/// The whole-pixel displacement, within `limit`, at which the pair agrees best; `None` if the frames share too little
/// at every displacement tried.
pub(super) fn best_start(
    pair: Pair<'_>,
    limit: [f64; 2],
    workspace: &mut Workspace,
    execution: &Execution,
) -> Result<Option<Starts>> {
    let level = execution.simd_level();
    workspace.correlator.take(pair, level)?;
    let mut search = Search {
        pair,
        workspace,
        limit,
        level,
        best: None,
        peaks: Vec::new(),
    };
    search.try_peaks(true)?;
    if search.best.is_none_or(|best| !best.is_convincing()) {
        execution.check()?;
        search.consider([0, 0]);
        search.try_peaks(false)?;
    }
    // Which of two neighbours the surface names first may hang on its rounding; the better one does not.
    search.climb();
    Ok(search.best.map(|best| Starts {
        best,
        rivals: search.rivals(&best),
    }))
}

struct Search<'a> {
    pair: Pair<'a>,
    workspace: &'a mut Workspace,
    limit: [f64; 2],
    level: SimdLevel,
    best: Option<Start>,
    /// Displacements at the high peaks of the last surface.
    peaks: Vec<[isize; 2]>,
}

impl Search<'_> {
    /// Consider the peaks of the phase correlation of the frames, locally normalised or as they are.
    fn try_peaks(&mut self, normalized: bool) -> Result<()> {
        let (pair, workspace) = (self.pair, &mut *self.workspace);
        let size = [
            fast_length(pair.prev.width().max(pair.next.width())),
            fast_length(pair.prev.height().max(pair.next.height())),
        ];
        let correlator = &workspace.correlator;
        let planes = if normalized {
            &correlator.normalized
        } else {
            &correlator.raw
        };
        let whole = [(0, pair.next.width()), (0, pair.next.height())];
        let [of_prev, of_next] = &mut workspace.fades;
        let weights = [pair.prev_weight, pair.next_weight];
        let mut prev = Tapered::new(&planes[0], weights[0], pair.window, of_prev)?;
        let mut next = Tapered::new(&planes[1], weights[1], whole, of_next)?;
        workspace.surface.resize(size[0], size[1])?;
        correlate_rows(
            |y, row| prev.write(y, row),
            |y, row| next.write(y, row),
            &mut workspace.surface,
        )?;
        self.peaks.clear();
        let found = peaks(&self.workspace.surface)?;
        let highest = found.first().map_or(0.0, |(height, _)| *height);
        for (height, peak) in &found {
            for wrap_y in [0, size[1] as isize] {
                for wrap_x in [0, size[0] as isize] {
                    let displacement = [
                        peak[0] as isize - wrap_x + pair.origin[0],
                        peak[1] as isize - wrap_y + pair.origin[1],
                    ];
                    if !self.in_reach(displacement) {
                        continue;
                    }
                    if *height >= RIVAL_PEAK * highest {
                        self.peaks.push(displacement);
                    }
                    if self.best.is_none_or(|best| !best.is_convincing()) {
                        self.consider(displacement);
                    }
                }
            }
        }
        Ok(())
    }

    fn in_reach(&self, displacement: [isize; 2]) -> bool {
        (0..2).all(|axis| displacement[axis].unsigned_abs() as f64 <= self.limit[axis])
    }

    /// The peaks away from `best` at which the frames agree almost as well.
    fn rivals(&self, best: &Start) -> Vec<[isize; 2]> {
        let away = |d: &&[isize; 2]| {
            (0..2).any(|axis| d[axis].abs_diff(best.displacement[axis]) > RIVAL_DISTANCE)
        };
        let least = RIVAL[0].max(RIVAL[1] * best.correlation);
        self.peaks
            .iter()
            .filter(away)
            .filter(|d| {
                let found = self.workspace.correlator.at(**d, self.level);
                found.is_some_and(|found| found.normalized >= least)
            })
            .take(RIVALS)
            .copied()
            .collect()
    }

    /// Go to the best neighbour as long as there is a better one.
    fn climb(&mut self) {
        const NEIGHBOURS: [[isize; 2]; 8] = [
            [-1, 0],
            [1, 0],
            [0, -1],
            [0, 1],
            [-1, -1],
            [1, 1],
            [-1, 1],
            [1, -1],
        ];
        for _ in 0..8 {
            let Some(here) = self.best else { return };
            for [dx, dy] in NEIGHBOURS {
                self.consider([here.displacement[0] + dx, here.displacement[1] + dy]);
            }
            if self
                .best
                .is_none_or(|best| best.displacement == here.displacement)
            {
                return;
            }
        }
    }

    fn consider(&mut self, displacement: [isize; 2]) {
        if !self.in_reach(displacement) {
            return;
        }
        let Some(found) = self.workspace.correlator.at(displacement, self.level) else {
            return;
        };
        let sure = |value: f64| value.clamp(-0.999, 0.999).atanh();
        let score = (sure(found.normalized) + 0.5 * sure(found.raw)) * found.count.sqrt();
        if self.best.is_none_or(|best| score > best.score) {
            self.best = Some(Start {
                displacement,
                correlation: found.normalized,
                score,
            });
        }
    }
}

/// Whether the frames agree at other displacements along `direction` as they do at `at`, within `limit`.
pub(super) fn repeats_along(
    pair: Pair<'_>,
    direction: [f64; 2],
    at: f64,
    limit: [f64; 2],
    workspace: &mut Workspace,
    level: SimdLevel,
) -> Result<bool> {
    let correlator = &mut workspace.correlator;
    correlator.take(pair, level)?;
    let correlation = |t: f64| {
        let displacement = direction.map(|value| (t * value).round() as isize);
        let inside = (0..2).all(|axis| displacement[axis].unsigned_abs() as f64 <= limit[axis]);
        inside
            .then(|| correlator.at(displacement, level))
            .flatten()
            .map_or(f64::NAN, |found| found.normalized)
    };
    let best = correlation(at);
    let reach = limit[0].hypot(limit[1]).ceil() as isize;
    let least = RIVAL[0].max(REPEAT * best);
    // Behind a trough it is another agreement, not the flank of this one.
    for sign in [-1.0, 1.0] {
        let mut trough = best;
        for step in 1..=2 * reach {
            let here = correlation(at + sign * step as f64);
            trough = trough.min(here);
            if here >= least && here > trough + RISE {
                return Ok(true);
            }
        }
    }
    Ok(false)
}

/// The highest local maxima of the surface, the highest first.
fn peaks(surface: &Plane) -> Result<Vec<(f32, [usize; 2])>> {
    let (width, height) = (surface.width(), surface.height());
    let highest = surface.data().iter().copied().fold(0.0, f32::max);
    let mut found: Vec<(f32, [usize; 2])> = Vec::new();
    for y in 0..height {
        for (x, value) in surface.row(y).iter().enumerate() {
            if *value < 0.2 * highest {
                continue;
            }
            let columns = [(x + width - 1) % width, x, (x + 1) % width];
            let rows = [(y + height - 1) % height, y, (y + 1) % height];
            let around = rows.map(|row| columns.map(|column| surface.row(row)[column]));
            if around.iter().flatten().all(|other| other <= value) {
                reserve_more("peaks", &mut found, 1)?;
                found.push((*value, [x, y]));
            }
        }
    }
    found.sort_unstable_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    found.truncate(PEAKS);
    Ok(found)
}

/// The part of a plane in a window, its mean taken out and faded to zero at its border.
struct Tapered<'a> {
    plane: &'a Plane,
    weight: Option<&'a Plane>,
    /// Columns and rows, from the first to the one after the last.
    window: [(usize, usize); 2],
    mean: f32,
    fades: &'a [Vec<f32>; 2],
}

impl<'a> Tapered<'a> {
    fn new(
        plane: &'a Plane,
        weight: Option<&'a Plane>,
        window: [(usize, usize); 2],
        fades: &'a mut [Vec<f32>; 2],
    ) -> Result<Self> {
        let (columns, rows) = (window[0].0..window[0].1, window[1].0..window[1].1);
        let (mut sum, mut count) = (0.0f64, 0.0f64);
        for y in rows {
            let row = &plane.row(y)[columns.clone()];
            if let Some(weight) = weight {
                for (value, w) in row.iter().zip(&weight.row(y)[columns.clone()]) {
                    sum += f64::from(value * w);
                    count += f64::from(*w);
                }
            } else {
                sum += f64::from(row.iter().sum::<f32>());
                count += row.len() as f64;
            }
        }
        for (fade, (low, high)) in fades.iter_mut().zip(window) {
            write_fade(fade, high - low)?;
        }
        Ok(Self {
            plane,
            weight,
            window,
            mean: (sum / count.max(1.0)) as f32,
            fades,
        })
    }

    /// Write row `y`, with zeros outside of the window; or say that it is zero.
    fn write(&mut self, y: usize, row: &mut [f32]) -> bool {
        let [(left, right), (top, bottom)] = self.window;
        if y < top || y >= bottom {
            return false;
        }
        row[..left].fill(0.0);
        row[right..].fill(0.0);
        let down = self.fades[1][y - top];
        let to = &mut row[left..right];
        let from = &self.plane.row(y)[left..right];
        for ((to, from), across) in to.iter_mut().zip(from).zip(&self.fades[0]) {
            *to = down * across * (from - self.mean);
        }
        if let Some(weight) = self.weight {
            for (to, w) in to.iter_mut().zip(&weight.row(y)[left..right]) {
                *to *= w;
            }
        }
        true
    }
}

/// Weights along `length` pixels: from 0 to 1 over the first quarter, and back over the last.
fn write_fade(fade: &mut Vec<f32>, length: usize) -> Result<()> {
    if fade.len() == length {
        return Ok(());
    }
    let border = (length as f32 / 4.0).max(1.0);
    let values = (0..length).map(|index| {
        let distance = (index as f32 + 0.5).min(length as f32 - index as f32 - 0.5);
        if distance >= border {
            1.0
        } else {
            0.5 - 0.5 * (std::f32::consts::PI * distance / border).cos()
        }
    });
    replace("a fade", fade, values)
}
