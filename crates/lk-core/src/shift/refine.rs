//! One look at two frames at one displacement: both are sampled half a step towards each other, and the products that
//! the normal equations need are summed over tiles.

#![allow(clippy::needless_range_loop, reason = "matrix and filter indices")]

use std::ops::Range;

use super::solve::{
    DIFFERENCE, FEATURES, GX, GY, Gram, MEAN, NoiseGain, ONE, Solution, X, Y, solve,
};
use crate::error::Result;
use crate::execution::Execution;
use crate::frame::Plane;
use crate::illumination::Illumination;
use crate::parallel::{RowsMut, for_each_band};
use crate::simd::{Kernel, Level, dispatch};

/// Taps on each side of the interpolation and of the derivative.
const RADIUS: usize = 2;
/// Pixels along a side of a tile. Light may vary linearly within it.
const TILE: usize = 32;
/// The displacement may be this far from the whole pixels at which the frames are compared; more than half a pixel, so
/// that an iteration near the half does not jump between two of them.
pub(super) const REACH: f64 = 0.52;
/// The derivative of fourth order.
const DERIVATIVE: [f32; 5] = [1.0 / 12.0, -8.0 / 12.0, 0.0, 8.0 / 12.0, -1.0 / 12.0];

/// Two planes, and how they lie.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pair<'a> {
    pub(super) prev: &'a Plane,
    pub(super) next: &'a Plane,
    /// 1 where a pixel may be used, 0 where not; the sizes are those of the planes.
    pub(super) prev_weight: Option<&'a Plane>,
    pub(super) next_weight: Option<&'a Plane>,
    /// Where `next` begins, in pixels of `prev`.
    pub(super) origin: [isize; 2],
    /// The pixels of `prev` that may be used.
    pub(super) window: [(usize, usize); 2],
}

impl Pair<'_> {
    /// The pixels of `prev`, along one axis, that both planes show with room for the taps.
    fn overlap(&self, axis: usize, shift: isize) -> Range<usize> {
        let (prev, next) = if axis == 0 {
            (self.prev.width(), self.next.width())
        } else {
            (self.prev.height(), self.next.height())
        };
        let radius = RADIUS as isize;
        let offset = shift - self.origin[axis];
        let (low, high) = self.window[axis];
        let start = (low as isize).max(radius).max(radius - offset);
        let end = (high as isize)
            .min(prev as isize - radius)
            .min(next as isize - radius - offset);
        start as usize..end.max(start) as usize
    }
}

/// The even part of the taps: coefficients of 1, delta^2, delta^4, delta^6 for the taps 1 and 2 from the middle.
const EVEN: [[f64; 2]; 4] = [
    [0.215646278, 0.007313361],
    [0.393206985, -0.095004255],
    [-5.254674985, 3.876233824],
    [35.923271313, -26.894626937],
];
/// The odd part: coefficients of delta, delta^3, delta^5, delta^7.
const ODD: [[f64; 2]; 4] = [
    [0.424915308, 0.037542346],
    [0.00455665, -0.002278325],
    [-3.069134786, 1.534567393],
    [19.31072613, -9.655363065],
];

/// A filter that smooths and moves by `delta` at once, |delta| <= 0.26.
///
/// Two frames that are moved towards each other share its amplitude, so that only its phase can bias a displacement.
/// The coefficients are the least squares fit of the phase up to 2.6 radians a pixel, with the amplitude of a Gaussian
/// of standard deviation 0.71 as a weak second aim: textures of any scale are biased by less than 0.0002 px.
fn taps(delta: f64) -> [f32; 2 * RADIUS + 1] {
    let square = delta * delta;
    let even: [f64; 2] = std::array::from_fn(|k| {
        ((EVEN[3][k] * square + EVEN[2][k]) * square + EVEN[1][k]) * square + EVEN[0][k]
    });
    let odd: [f64; 2] = std::array::from_fn(|k| {
        (((ODD[3][k] * square + ODD[2][k]) * square + ODD[1][k]) * square + ODD[0][k]) * delta
    });
    [
        (even[1] - odd[1]) as f32,
        (even[0] - odd[0]) as f32,
        (1.0 - 2.0 * (even[0] + even[1])) as f32,
        (even[0] + odd[0]) as f32,
        (even[1] + odd[1]) as f32,
    ]
}

fn energy(taps: &[f32]) -> f64 {
    taps.iter().map(|tap| f64::from(tap * tap)).sum()
}

/// The energy of the derivative of what `taps` give.
fn slope_energy(taps: &[f32]) -> f64 {
    let mut both = vec![0.0f32; taps.len() + DERIVATIVE.len() - 1];
    for (i, a) in taps.iter().enumerate() {
        for (j, b) in DERIVATIVE.iter().enumerate() {
            both[i + j] += a * b;
        }
    }
    energy(&both)
}

/// Steps of the tiles along a length.
fn tiles(length: usize) -> Vec<usize> {
    let count = ((length + TILE / 2) / TILE).max(1);
    (0..=count)
        .map(|index| if index == count { length } else { index * TILE })
        .collect()
}

/// What the pair says at `displacement`, which is within [`REACH`] of the whole pixels `whole`; `None` if too few pixels
/// are shown by both.
pub(super) fn look(
    pair: Pair<'_>,
    displacement: [f64; 2],
    whole: [f64; 2],
    illumination: Illumination,
    execution: &Execution,
) -> Result<Option<Solution>> {
    let half = [
        (displacement[0] - whole[0]) / 2.0,
        (displacement[1] - whole[1]) / 2.0,
    ];
    let shift = whole.map(|value| value as isize);
    let columns = pair.overlap(0, shift[0]);
    let rows = pair.overlap(1, shift[1]);
    if columns.len() < 4 || rows.len() < 4 {
        return Ok(None);
    }
    let (width, height) = (columns.len(), rows.len());
    let level = execution.simd_level();
    let mut mean = Plane::new(width, height);
    let mut difference = Plane::new(width, height);
    let mut weight = (pair.prev_weight.is_some() || pair.next_weight.is_some())
        .then(|| Plane::new(width, height));
    let prev_taps = [taps(-half[0]), taps(-half[1])];
    let next_taps = [taps(half[0]), taps(half[1])];
    let next_start = [
        (columns.start as isize + shift[0] - pair.origin[0]) as usize,
        (rows.start as isize + shift[1] - pair.origin[1]) as usize,
    ];
    let min_rows = (8192 / width).max(1);
    let outputs = (mean.rows_mut(), difference.rows_mut());
    for_each_band(
        execution,
        height,
        min_rows,
        outputs,
        |band, (mut mean, mut difference)| {
            let mut p = vec![0.0; width];
            let mut n = vec![0.0; width];
            let mut temporary = vec![0.0; width + 2 * RADIUS];
            for (local, y) in band.enumerate() {
                sample(
                    level,
                    pair.prev,
                    [columns.start, rows.start + y],
                    &prev_taps,
                    &mut temporary,
                    &mut p,
                );
                sample(
                    level,
                    pair.next,
                    [next_start[0], next_start[1] + y],
                    &next_taps,
                    &mut temporary,
                    &mut n,
                );
                let (mean, difference) = (mean.row_mut(local), difference.row_mut(local));
                for x in 0..width {
                    mean[x] = 0.5 * (n[x] + p[x]);
                    difference[x] = n[x] - p[x];
                }
            }
        },
    )?;
    if let Some(weight) = &mut weight {
        for y in 0..height {
            let row = weight.row_mut(y);
            row.fill(1.0);
            for (plane, start) in [
                (pair.prev_weight, [columns.start, rows.start]),
                (pair.next_weight, next_start),
            ] {
                if let Some(plane) = plane {
                    let other = &plane.row(start[1] + y)[start[0]..start[0] + width];
                    row.iter_mut().zip(other).for_each(|(to, from)| *to *= from);
                }
            }
        }
    }
    let (across, down) = (tiles(width), tiles(height));
    let empty: Gram = [[0.0; FEATURES]; FEATURES];
    let stripes = across.len() - 1;
    let mut grams = vec![empty; stripes * (down.len() - 1)];
    let mean = &mean;
    let difference = &difference;
    let weight = weight.as_ref();
    for_each_band(
        execution,
        down.len() - 1,
        (8192 / (width * TILE)).max(1),
        RowsMut::new(&mut grams, stripes),
        |band, mut part| {
            let mut rows = Rows::new(width);
            for (local, stripe) in band.enumerate() {
                let grams = part.row_mut(local);
                for y in down[stripe]..down[stripe + 1] {
                    let centre = (down[stripe] + down[stripe + 1]) as f32 / 2.0;
                    let kernel = RowSums {
                        mean: std::array::from_fn(|k| clamped(mean, y as isize + k as isize - 2)),
                        difference: difference.row(y),
                        weight: weight.map(|plane| plane.row(y)),
                        y: (y as f32 + 0.5 - centre) / TILE as f32,
                        across: &across,
                        rows: &mut rows,
                        grams,
                    };
                    dispatch(level, kernel);
                }
            }
        },
    )?;
    let noise = NoiseGain {
        sampled: energy(&prev_taps[0]) * energy(&prev_taps[1]),
        gradient: [
            slope_energy(&prev_taps[0]) * energy(&prev_taps[1]),
            energy(&prev_taps[0]) * slope_energy(&prev_taps[1]),
        ],
    };
    Ok(solve(&grams, illumination, noise))
}

/// Write the interpolated row that begins at `start` of `plane` into `row`.
fn sample(
    level: Level,
    plane: &Plane,
    start: [usize; 2],
    taps: &[[f32; 2 * RADIUS + 1]; 2],
    temporary: &mut [f32],
    row: &mut [f32],
) {
    let columns = start[0] - RADIUS..start[0] - RADIUS + temporary.len();
    dispatch(
        level,
        Sample {
            rows: std::array::from_fn(|k| &plane.row(start[1] + k - RADIUS)[columns.clone()]),
            taps,
            temporary,
            row,
        },
    );
}

struct Sample<'a> {
    rows: [&'a [f32]; 2 * RADIUS + 1],
    taps: &'a [[f32; 2 * RADIUS + 1]; 2],
    temporary: &'a mut [f32],
    row: &'a mut [f32],
}

impl Kernel for Sample<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let width = self.temporary.len();
        let [a, b, c, d, e] = self.rows.map(|row| &row[..width]);
        let [ta, tb, tc, td, te] = self.taps[1];
        for x in 0..width {
            self.temporary[x] = (ta * a[x] + te * e[x]) + (tb * b[x] + td * d[x]) + tc * c[x];
        }
        let [ta, tb, tc, td, te] = self.taps[0];
        for (x, to) in self.row.iter_mut().enumerate() {
            let t = &self.temporary[x..x + 5];
            *to = (ta * t[0] + te * t[4]) + (tb * t[1] + td * t[3]) + tc * t[2];
        }
    }
}

/// Row `y`, or the nearest there is: at the border the derivative becomes one-sided, at reduced weight.
fn clamped(plane: &Plane, y: isize) -> &[f32] {
    plane.row(y.clamp(0, plane.height() as isize - 1) as usize)
}

/// The rows of all features, and the padded mean.
struct Rows {
    padded: Vec<f32>,
    features: [Vec<f32>; FEATURES],
}

impl Rows {
    fn new(width: usize) -> Self {
        Self {
            padded: vec![0.0; width + 4],
            features: std::array::from_fn(|_| vec![0.0; width]),
        }
    }
}

struct RowSums<'a> {
    /// Rows y - 2 to y + 2 of the mean of both frames.
    mean: [&'a [f32]; 5],
    difference: &'a [f32],
    weight: Option<&'a [f32]>,
    y: f32,
    across: &'a [usize],
    rows: &'a mut Rows,
    grams: &'a mut [Gram],
}

#[inline(always)]
fn dot(a: &[f32], b: &[f32]) -> f64 {
    let mut lanes = [0.0f32; 8];
    let (a_chunks, a_rest) = a.as_chunks::<8>();
    let (b_chunks, b_rest) = b.as_chunks::<8>();
    for (p, q) in a_chunks.iter().zip(b_chunks) {
        for k in 0..8 {
            lanes[k] += p[k] * q[k];
        }
    }
    for (k, (p, q)) in a_rest.iter().zip(b_rest).enumerate() {
        lanes[k] += p * q;
    }
    f64::from(
        ((lanes[0] + lanes[4]) + (lanes[1] + lanes[5]))
            + ((lanes[2] + lanes[6]) + (lanes[3] + lanes[7])),
    )
}

impl Kernel for RowSums<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let width = self.difference.len();
        let rows = self.rows;
        let m = self.mean.map(|row| &row[..width]);
        for x in 0..width {
            rows.features[GY][x] =
                DERIVATIVE[3] * (m[3][x] - m[1][x]) + DERIVATIVE[4] * (m[4][x] - m[0][x]);
        }
        rows.padded[2..width + 2].copy_from_slice(m[2]);
        rows.padded[..2].fill(m[2][0]);
        rows.padded[width + 2..].fill(m[2][width - 1]);
        for x in 0..width {
            let s = &rows.padded[x..x + 5];
            rows.features[GX][x] = DERIVATIVE[3] * (s[3] - s[1]) + DERIVATIVE[4] * (s[4] - s[0]);
        }
        rows.features[ONE].fill(1.0);
        rows.features[Y].fill(self.y);
        rows.features[MEAN].copy_from_slice(m[2]);
        rows.features[DIFFERENCE].copy_from_slice(self.difference);
        for pair in self.across.windows(2) {
            let centre = (pair[0] + pair[1]) as f32 / 2.0;
            for x in pair[0]..pair[1] {
                rows.features[X][x] = (x as f32 + 0.5 - centre) / TILE as f32;
            }
        }
        if let Some(weight) = self.weight {
            for feature in &mut rows.features {
                for (value, w) in feature.iter_mut().zip(weight) {
                    *value *= w;
                }
            }
        }
        for (pair, gram) in self.across.windows(2).zip(self.grams.iter_mut()) {
            let range = pair[0]..pair[1];
            for i in 0..FEATURES {
                for j in i..FEATURES {
                    let sum = dot(
                        &rows.features[i][range.clone()],
                        &rows.features[j][range.clone()],
                    );
                    gram[i][j] += sum;
                    if i != j {
                        gram[j][i] += sum;
                    }
                }
            }
        }
    }
}
