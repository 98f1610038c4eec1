//! One look at two frames at one displacement: both are sampled half a step towards each other, and the products that
//! the normal equations need are summed over tiles.

#![allow(clippy::needless_range_loop, reason = "matrix and filter indices")]

use std::ops::Range;

use super::solve::{NoiseGain, Solution, solve};
use super::sums::{LANES, Light, StripeSums, Tile, Tiling};
use crate::error::Result;
use crate::execution::Execution;
use crate::frame::Plane;
use crate::illumination::Illumination;
use crate::parallel::{RowsMut, for_each_band};
use crate::simd::{Kernel, dispatch};

/// Taps on each side of the interpolation and of the derivative.
const RADIUS: usize = 2;
/// The displacement may be this far from the whole pixels at which the frames are compared; more than half a pixel, so
/// that an iteration near the half does not jump between two of them.
pub(super) const REACH: f64 = 0.52;
/// The derivative of fourth order.
pub(super) const DERIVATIVE: [f32; 5] = [1.0 / 12.0, -8.0 / 12.0, 0.0, 8.0 / 12.0, -1.0 / 12.0];

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

/// The frames sampled at one displacement, kept from look to look.
#[derive(Debug, Default)]
pub(super) struct Workspace {
    mean: Plane,
    difference: Plane,
    weight: Plane,
    tiles: Vec<Tile>,
}

/// How to look.
#[derive(Debug, Clone, Copy)]
pub(super) struct Look {
    /// The displacement, within [`REACH`] of `whole`.
    pub(super) displacement: [f64; 2],
    /// The whole pixels at which the frames are compared.
    pub(super) whole: [f64; 2],
    /// How light may change within a tile.
    pub(super) illumination: Illumination,
    /// What is known of the light: taken out of the difference before it is summed.
    pub(super) gain: GainField,
    /// Pixels along a side of a tile.
    pub(super) tile: usize,
}

/// A gain that varies with place and grey level: `next - prev = (c0 + c1 x + c2 y + c3 m / 2) m`, with m the mean of
/// both frames and x and y from -1 to 1 over the window, so that all levels share it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct GainField(pub(super) [f64; 4]);

/// What the pair says; `None` if too few pixels are shown by both.
pub(super) fn look(
    pair: Pair<'_>,
    how: Look,
    workspace: &mut Workspace,
    execution: &Execution,
) -> Result<Option<Solution>> {
    let half: [f64; 2] =
        std::array::from_fn(|axis| (how.displacement[axis] - how.whole[axis]) / 2.0);
    let shift = how.whole.map(|value| value as isize);
    let columns = pair.overlap(0, shift[0]);
    let rows = pair.overlap(1, shift[1]);
    if columns.len() < 4 || rows.len() < 4 {
        return Ok(None);
    }
    let (width, height) = (columns.len(), rows.len());
    let padded = width.next_multiple_of(LANES) + 2 * RADIUS;
    let level = execution.simd_level();
    let next_start = [
        (columns.start as isize + shift[0] - pair.origin[0]) as usize,
        (rows.start as isize + shift[1] - pair.origin[1]) as usize,
    ];
    let taps = half.map(taps);
    let place = [
        Place::new(pair.window[0], columns.start, shift[0]),
        Place::new(pair.window[1], rows.start, shift[1]),
    ];
    let min_rows = (8192 / width).max(1);
    workspace.mean.resize(padded, height);
    workspace.difference.resize(padded, height);
    for_each_band(
        execution,
        height,
        min_rows,
        (workspace.mean.rows_mut(), workspace.difference.rows_mut()),
        |band, (mut mean, mut difference)| {
            let mut temporary = [vec![0.0; width + 2 * RADIUS], vec![0.0; width + 2 * RADIUS]];
            let mut ramp = vec![0.0; width];
            for (local, y) in band.enumerate() {
                let kernel = Sample {
                    prev: taps_rows(pair.prev, [columns.start, rows.start + y], width),
                    next: taps_rows(pair.next, [next_start[0], next_start[1] + y], width),
                    taps: &taps,
                    temporary: &mut temporary,
                    mean: mean.row_mut(local),
                    difference: difference.row_mut(local),
                };
                dispatch(level, kernel);
                if how.gain != GainField::default() {
                    let [constant, along_x, along_y, curve] = how.gain.0;
                    let start = constant + along_y * place[1].at(y);
                    for (x, value) in ramp.iter_mut().enumerate() {
                        *value = (start + along_x * place[0].at(x)) as f32;
                    }
                    let kernel = Relight {
                        ramp: &ramp,
                        curve: (curve / 2.0) as f32,
                        mean: &mean.row_mut(local)[RADIUS..],
                        difference: difference.row_mut(local),
                    };
                    dispatch(level, kernel);
                }
            }
        },
    )?;
    let weighted = pair.prev_weight.is_some() || pair.next_weight.is_some();
    if weighted {
        let starts = [[columns.start, rows.start], next_start];
        weigh(pair, starts, width, height, &mut workspace.weight);
    }
    let tiling = Tiling::new(width, height, how.tile);
    workspace.tiles.clear();
    workspace
        .tiles
        .resize(tiling.across() * tiling.down(), Tile::default());
    let (mean, difference) = (&workspace.mean, &workspace.difference);
    let weight = weighted.then_some(&workspace.weight);
    for_each_band(
        execution,
        tiling.down(),
        (8192 / (width * how.tile)).max(1),
        RowsMut::new(&mut workspace.tiles, tiling.across()),
        |band, mut part| {
            for (local, stripe) in band.enumerate() {
                let kernel = StripeSums {
                    mean,
                    difference,
                    weight,
                    tiling: &tiling,
                    stripe,
                    tiles: part.row_mut(local),
                };
                dispatch(level, kernel);
            }
        },
    )?;
    let light = Light::new(how.illumination);
    Ok(solve(
        &workspace.tiles,
        &tiling,
        weighted,
        light,
        noise_gain(&taps),
        place,
    ))
}

/// From pixels of the region to the place in the window, -1 to 1, halfway between the two frames.
#[derive(Debug, Clone, Copy)]
pub(super) struct Place {
    start: f64,
    step: f64,
}

impl Place {
    fn new(window: (usize, usize), start: usize, shift: isize) -> Self {
        let middle = (window.0 + window.1) as f64 / 2.0;
        let step = 2.0 / (window.1 - window.0) as f64;
        // Half of the displacement, so that swapping the frames changes nothing.
        Self {
            start: (start as f64 + 0.5 + shift as f64 / 2.0 - middle) * step,
            step,
        }
    }

    /// The place of pixel `index` of the region.
    pub(super) fn at(&self, index: usize) -> f64 {
        self.start + self.step * index as f64
    }

    /// The same for a position in pixels, from the border of the first.
    pub(super) fn of(&self, position: f64) -> f64 {
        self.start + self.step * (position - 0.5)
    }
}

/// Take the known light out of a row of differences.
struct Relight<'a> {
    ramp: &'a [f32],
    curve: f32,
    mean: &'a [f32],
    difference: &'a mut [f32],
}

impl Kernel for Relight<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        for ((to, m), ramp) in self.difference.iter_mut().zip(self.mean).zip(self.ramp) {
            *to -= (ramp + self.curve * m) * m;
        }
    }
}

/// What the filters do to white noise.
fn noise_gain(taps: &[[f32; 2 * RADIUS + 1]; 2]) -> NoiseGain {
    let (across, down) = (energy(&taps[0]), energy(&taps[1]));
    // The Laplacian is the second difference along x plus that along y; its cross term is the product of the two
    // correlations of a filter with its own second difference.
    let second = |taps: &[f32]| convolved(taps, &[1.0, -2.0, 1.0]);
    let cross = |taps: &[f32]| -> f64 {
        second(taps)[1..]
            .iter()
            .zip(taps)
            .map(|(a, b)| f64::from(a * b))
            .sum()
    };
    NoiseGain {
        sampled: across * down,
        gradient: [
            energy(&convolved(&taps[0], &DERIVATIVE)) * down,
            across * energy(&convolved(&taps[1], &DERIVATIVE)),
        ],
        laplacian: energy(&second(&taps[0])) * down
            + across * energy(&second(&taps[1]))
            + 2.0 * cross(&taps[0]) * cross(&taps[1]),
    }
}

fn energy(taps: &[f32]) -> f64 {
    taps.iter().map(|tap| f64::from(tap * tap)).sum()
}

fn convolved(taps: &[f32], other: &[f32]) -> Vec<f32> {
    let mut both = vec![0.0f32; taps.len() + other.len() - 1];
    for (i, a) in taps.iter().enumerate() {
        for (j, b) in other.iter().enumerate() {
            both[i + j] += a * b;
        }
    }
    both
}

/// Where both frames may be used, beginning at `starts` in each.
fn weigh(pair: Pair<'_>, starts: [[usize; 2]; 2], width: usize, height: usize, weight: &mut Plane) {
    weight.resize(width.next_multiple_of(LANES), height);
    for y in 0..height {
        let row = weight.row_mut(y);
        row[..width].fill(1.0);
        row[width..].fill(0.0);
        for (plane, start) in [pair.prev_weight, pair.next_weight].into_iter().zip(starts) {
            if let Some(plane) = plane {
                let other = &plane.row(start[1] + y)[start[0]..start[0] + width];
                row.iter_mut().zip(other).for_each(|(to, from)| *to *= from);
            }
        }
    }
}

/// The rows that the taps read for the row that begins at `start`.
fn taps_rows(plane: &Plane, start: [usize; 2], width: usize) -> [&[f32]; 2 * RADIUS + 1] {
    let columns = start[0] - RADIUS..start[0] + width + RADIUS;
    std::array::from_fn(|k| &plane.row(start[1] + k - RADIUS)[columns.clone()])
}

/// A row of both frames, moved towards each other: their mean, padded by its border, and their difference.
struct Sample<'a> {
    prev: [&'a [f32]; 2 * RADIUS + 1],
    next: [&'a [f32]; 2 * RADIUS + 1],
    /// Those of `next`, along x and along y; `prev` takes them in reverse.
    taps: &'a [[f32; 2 * RADIUS + 1]; 2],
    temporary: &'a mut [Vec<f32>; 2],
    mean: &'a mut [f32],
    difference: &'a mut [f32],
}

impl Kernel for Sample<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let [p, n] = self.temporary;
        let length = p.len();
        let width = length - 2 * RADIUS;
        down(self.prev, reversed(self.taps[1]), p);
        down(self.next, self.taps[1], n);
        let p = shifted(p, width);
        let n = shifted(n, width);
        let [ta, tb, tc, td, te] = self.taps[0];
        let mean = &mut self.mean[RADIUS..RADIUS + width];
        let difference = &mut self.difference[..width];
        for x in 0..width {
            let prev = (te * p[0][x] + ta * p[4][x]) + (td * p[1][x] + tb * p[3][x]) + tc * p[2][x];
            let next = (ta * n[0][x] + te * n[4][x]) + (tb * n[1][x] + td * n[3][x]) + tc * n[2][x];
            mean[x] = 0.5 * (next + prev);
            difference[x] = next - prev;
        }
        let (first, last) = (mean[0], mean[width - 1]);
        self.mean[..RADIUS].fill(first);
        self.mean[RADIUS + width..].fill(last);
        self.difference[width..].fill(0.0);
    }
}

#[inline(always)]
fn reversed([a, b, c, d, e]: [f32; 2 * RADIUS + 1]) -> [f32; 2 * RADIUS + 1] {
    [e, d, c, b, a]
}

/// The taps down the columns; outer pairs first, so that reversed taps on a mirrored picture give the same bits.
#[inline(always)]
fn down(rows: [&[f32]; 2 * RADIUS + 1], taps: [f32; 2 * RADIUS + 1], to: &mut [f32]) {
    let length = to.len();
    let [a, b, c, d, e] = rows.map(|row| &row[..length]);
    for x in 0..length {
        to[x] =
            (taps[0] * a[x] + taps[4] * e[x]) + (taps[1] * b[x] + taps[3] * d[x]) + taps[2] * c[x];
    }
}

/// The row from each of the taps' places on.
#[inline(always)]
fn shifted(row: &[f32], width: usize) -> [&[f32]; 2 * RADIUS + 1] {
    std::array::from_fn(|k| &row[k..k + width])
}
