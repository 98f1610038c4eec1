//! Where to start: candidates from phase correlation at a coarse level, judged by how well the frames then agree.

use std::ops::Range;

use super::refine::Pair;
use crate::error::Result;
use crate::execution::Execution;
use crate::frame::Plane;
use crate::phase::{fast_length, phase_correlation};
use crate::simd::{Kernel, Level, dispatch};

/// Peaks of the correlation surface that are tried.
const PEAKS: usize = 6;
/// The least share of the window that both frames must show.
const MIN_SHARE: f64 = 0.08;
/// Pixels on each side that local normalisation looks at.
const RADIUS: usize = 4;
/// A candidate that correlates like this is taken without trying others.
const CONVINCING: f64 = 0.7;
/// Pixels summed side by side.
const LANES: usize = 8;

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
    pub(super) fn convinces(&self) -> bool {
        self.correlation >= CONVINCING
    }

    /// Whether the frames agree better here than at `other`, perhaps at another level.
    pub(super) fn better_than(&self, other: &Self) -> bool {
        self.correlation > other.correlation
    }
}

/// The whole-pixel displacement, within `limit`, at which the pair agrees best; `None` if the frames share too little
/// at every displacement tried.
///
/// Light is taken out by local normalisation: each pixel less the mean around it, over the deviation around it.
pub(super) fn best_start(
    pair: Pair<'_>,
    limit: [f64; 2],
    execution: &Execution,
) -> Result<Option<Start>> {
    let level = execution.simd_level();
    let prev = normalised(pair.prev, level);
    let next = normalised(pair.next, level);
    let flat = Pair {
        prev: &prev,
        next: &next,
        ..pair
    };
    let mut search = Search {
        pair,
        flat,
        limit,
        level,
        best: None,
    };
    search.try_peaks_of(flat)?;
    if search.best.is_none_or(|best| !best.convinces()) {
        execution.check()?;
        search.consider([0, 0]);
        search.try_peaks_of(pair)?;
    }
    // Which of two neighbours the surface names first may hang on its rounding; the better one does not.
    search.climb();
    Ok(search.best)
}

struct Search<'a> {
    pair: Pair<'a>,
    /// The same frames, locally normalised.
    flat: Pair<'a>,
    limit: [f64; 2],
    level: Level,
    best: Option<Start>,
}

impl Search<'_> {
    fn try_peaks_of(&mut self, pair: Pair<'_>) -> Result<()> {
        let size = [
            fast_length(pair.prev.width().max(pair.next.width())),
            fast_length(pair.prev.height().max(pair.next.height())),
        ];
        let [columns, rows] = pair.window.map(|(low, high)| low..high);
        let prev = tapered(pair.prev, pair.prev_weight, columns, rows, size);
        let (columns, rows) = (0..pair.next.width(), 0..pair.next.height());
        let next = tapered(pair.next, pair.next_weight, columns, rows, size);
        let surface = phase_correlation(&prev, &next)?;
        for peak in peaks(&surface) {
            for wrap_y in [0, size[1] as isize] {
                for wrap_x in [0, size[0] as isize] {
                    self.consider([
                        peak[0] as isize - wrap_x + pair.origin[0],
                        peak[1] as isize - wrap_y + pair.origin[1],
                    ]);
                }
            }
            if self.best.is_some_and(|best| best.convinces()) {
                return Ok(());
            }
        }
        Ok(())
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
        if (0..2).any(|axis| displacement[axis].unsigned_abs() as f64 > self.limit[axis]) {
            return;
        }
        let Some((correlation, count)) = correlate(self.flat, displacement, self.level) else {
            return;
        };
        let (raw, _) = correlate(self.pair, displacement, self.level).unwrap_or((0.0, 0.0));
        let sure = |value: f64| value.clamp(-0.999, 0.999).atanh();
        let score = (sure(correlation) + 0.5 * sure(raw)) * count.sqrt();
        if self.best.is_none_or(|best| score > best.score) {
            self.best = Some(Start {
                displacement,
                correlation,
                score,
            });
        }
    }
}

/// The highest local maxima of the surface, the highest first.
fn peaks(surface: &Plane) -> Vec<[usize; 2]> {
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
                found.push((*value, [x, y]));
            }
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    found.truncate(PEAKS);
    found.into_iter().map(|(_, at)| at).collect()
}

/// The part of `plane` in `columns` and `rows`, its mean taken out and faded to zero at its border, padded to `size`.
fn tapered(
    plane: &Plane,
    weight: Option<&Plane>,
    columns: Range<usize>,
    rows: Range<usize>,
    size: [usize; 2],
) -> Plane {
    let mut result = Plane::new(size[0], size[1]);
    let (mut sum, mut count) = (0.0f64, 0.0f64);
    for y in rows.clone() {
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
    let mean = (sum / count.max(1.0)) as f32;
    let fade = |index: usize, length: usize| {
        let border = (length as f32 / 4.0).max(1.0);
        let distance = (index as f32 + 0.5).min(length as f32 - index as f32 - 0.5);
        if distance >= border {
            1.0
        } else {
            0.5 - 0.5 * (std::f32::consts::PI * distance / border).cos()
        }
    };
    let across: Vec<f32> = (0..columns.len()).map(|x| fade(x, columns.len())).collect();
    for y in rows.clone() {
        let down = fade(y - rows.start, rows.len());
        let to = &mut result.row_mut(y)[columns.clone()];
        let from = &plane.row(y)[columns.clone()];
        for ((to, from), across) in to.iter_mut().zip(from).zip(&across) {
            *to = down * across * (from - mean);
        }
        if let Some(weight) = weight {
            for (to, w) in to.iter_mut().zip(&weight.row(y)[columns.clone()]) {
                *to *= w;
            }
        }
    }
    result
}

/// Each pixel less the mean around it, over the deviation around it.
fn normalised(plane: &Plane, level: Level) -> Plane {
    let (width, height) = (plane.width(), plane.height());
    let mut result = Plane::new(width, height);
    let total: f64 = plane.data().iter().map(|v| f64::from(v * v)).sum();
    // A deviation of a twentieth of the frame's is taken for noise.
    let floor = (0.0025 * total / (width * height) as f64) as f32 + 1e-6;
    let mut sums = [vec![0.0; width + 2 * RADIUS], vec![0.0; width + 2 * RADIUS]];
    let across: Vec<f32> = (0..width)
        .map(|x| (x.min(RADIUS) + (width - 1 - x).min(RADIUS) + 1) as f32)
        .collect();
    for y in 0..height {
        let rows = y.saturating_sub(RADIUS)..(y + RADIUS + 1).min(height);
        dispatch(
            level,
            Normalise {
                plane,
                rows,
                y,
                floor,
                across: &across,
                sums: &mut sums,
                row: result.row_mut(y),
            },
        );
    }
    result
}

struct Normalise<'a> {
    plane: &'a Plane,
    rows: Range<usize>,
    y: usize,
    floor: f32,
    /// Columns that the sum around each column has.
    across: &'a [f32],
    sums: &'a mut [Vec<f32>; 2],
    row: &'a mut [f32],
}

impl Kernel for Normalise<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let width = self.row.len();
        let [plain, squares] = self.sums;
        {
            let plain = &mut plain[RADIUS..RADIUS + width];
            let squares = &mut squares[RADIUS..RADIUS + width];
            plain.fill(0.0);
            squares.fill(0.0);
            for y in self.rows.clone() {
                let row = &self.plane.row(y)[..width];
                for x in 0..width {
                    plain[x] += row[x];
                    squares[x] += row[x] * row[x];
                }
            }
        }
        let down = self.rows.len() as f32;
        let centre = &self.plane.row(self.y)[..width];
        let across = &self.across[..width];
        for x in 0..width {
            let (a, b) = (&plain[x..x + 9], &squares[x..x + 9]);
            let sum = ((a[0] + a[8]) + (a[1] + a[7])) + ((a[2] + a[6]) + (a[3] + a[5])) + a[4];
            let square = ((b[0] + b[8]) + (b[1] + b[7])) + ((b[2] + b[6]) + (b[3] + b[5])) + b[4];
            let count = 1.0 / (down * across[x]);
            let mean = sum * count;
            let variance = (square * count - mean * mean).max(0.0);
            self.row[x] = (centre[x] - mean) / (variance + self.floor).sqrt();
        }
    }
}

/// The correlation coefficient at displacement `d` and the pixels that it rests on; `None` if they are too few.
fn correlate(pair: Pair<'_>, d: [isize; 2], level: Level) -> Option<(f64, f64)> {
    let columns = shared(pair.window[0], pair.next.width(), d[0] - pair.origin[0])?;
    let rows = shared(pair.window[1], pair.next.height(), d[1] - pair.origin[1])?;
    let window = (pair.window[0].1 - pair.window[0].0) * (pair.window[1].1 - pair.window[1].0);
    let enough = (MIN_SHARE * window as f64).max(9.0);
    if ((columns.len() * rows.len()) as f64) < enough {
        return None;
    }
    let mut sums = [0.0f64; 6];
    for y in rows {
        let other_y = (y as isize + d[1] - pair.origin[1]) as usize;
        let start = (columns.start as isize + d[0] - pair.origin[0]) as usize;
        let other = start..start + columns.len();
        let found = dispatch(
            level,
            RowCorrelation {
                a: &pair.prev.row(y)[columns.clone()],
                b: &pair.next.row(other_y)[other.clone()],
                weight_a: pair.prev_weight.map(|plane| &plane.row(y)[columns.clone()]),
                weight_b: pair.next_weight.map(|plane| &plane.row(other_y)[other]),
            },
        );
        for (sum, value) in sums.iter_mut().zip(found) {
            *sum += f64::from(value);
        }
    }
    let [count, p, n, pp, pn, nn] = sums;
    if count < enough {
        return None;
    }
    let (pp, pn, nn) = (pp - p * p / count, pn - p * n / count, nn - n * n / count);
    Some((pn / (pp.max(0.0) * nn.max(0.0)).sqrt().max(1e-9), count))
}

struct RowCorrelation<'a> {
    a: &'a [f32],
    b: &'a [f32],
    weight_a: Option<&'a [f32]>,
    weight_b: Option<&'a [f32]>,
}

impl Kernel for RowCorrelation<'_> {
    type Output = [f32; 6];

    #[inline(always)]
    fn run(self) -> [f32; 6] {
        let mut sums = [[0.0f32; LANES]; 6];
        let length = self.a.len();
        let mut x = 0;
        while x < length {
            let inside = (length - x).min(LANES);
            let (mut p, mut n, mut w) = ([0.0f32; LANES], [0.0f32; LANES], [0.0f32; LANES]);
            if let (Some(a), Some(b)) = (
                self.a[x..].first_chunk::<LANES>(),
                self.b[x..].first_chunk::<LANES>(),
            ) {
                (p, n, w) = (*a, *b, [1.0; LANES]);
            } else {
                p[..inside].copy_from_slice(&self.a[x..x + inside]);
                n[..inside].copy_from_slice(&self.b[x..x + inside]);
                w[..inside].fill(1.0);
            }
            for weight in [self.weight_a, self.weight_b].into_iter().flatten() {
                for (w, other) in w.iter_mut().zip(&weight[x..]) {
                    *w *= other;
                }
            }
            for k in 0..LANES {
                sums[0][k] += w[k];
                sums[1][k] += w[k] * p[k];
                sums[2][k] += w[k] * n[k];
                sums[3][k] += w[k] * (p[k] * p[k]);
                sums[4][k] += w[k] * (p[k] * n[k]);
                sums[5][k] += w[k] * (n[k] * n[k]);
            }
            x += LANES;
        }
        sums.map(|l| ((l[0] + l[4]) + (l[1] + l[5])) + ((l[2] + l[6]) + (l[3] + l[7])))
    }
}

fn shared(window: (usize, usize), length: usize, offset: isize) -> Option<Range<usize>> {
    let start = (window.0 as isize).max(-offset);
    let end = (window.1 as isize).min(length as isize - offset);
    (start < end).then_some(start as usize..end as usize)
}
