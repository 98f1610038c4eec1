//! The affine motion that most of a flow follows.
//!
//! A turn, a zoom or a slanted surface has a flow that changes from pixel to pixel. Smoothness asks for that change, not for
//! none, and what changes so is no edge of motion.
//!
//! `docs/explanation/algorithms.md`, section "Trend: the affine motion of most of the flow".

use crate::error::Result;
use crate::memory::reserve;

use super::padded_plane::PaddedPlane;
use super::sureness::Sureness;

/// What u and what v change by along x and along y, from an element to the next.
pub(super) type Slopes = [[f32; 2]; 2];

/// Samples along the longer side; each is the mean of nine places, so that noise does not hide what is common.
const SAMPLES: usize = 24;
/// Samples this near the planes follow them, in pixels of the level: on coarse levels, and before it is smoothed, the flow of
/// an affine motion is no better.
const NEAR: f64 = 0.5;
/// Samples this near are on the planes.
const ON: f64 = 0.25;
/// Below this distance the weight of a sample does not grow any more, squared pixels.
const SOFT: f64 = 0.01;
/// Tiles along each axis whose own planes are tried.
const TILES: usize = 3;
/// Times that samples are weighed anew by their distances.
const PASSES: usize = 3;
/// Planes that move by less than this many pixels anywhere are found.
const STILL: f64 = 0.002;
/// Where more samples follow the planes through all of them no others are tried.
const PLENTY: f32 = 0.9;
/// Where fewer do there is no motion that most of the flow follows.
const ENOUGH: f32 = 0.4;

/// Slopes are needed where this much less of the flow is near one displacement.
const LEVEL: f32 = 0.03;
/// Flow is brought along the slopes where at least as many follow them.
const COMMON: f32 = 0.7;

/// What most of a flow does.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct Trend {
    /// Per pixel of the level; 0 where no affine motion has enough of the flow.
    pub(super) slopes: Slopes,
    /// The share of the flow that is nothing else.
    pub(super) affine: f32,
    /// The share of the flow that is near.
    share: f32,
    /// Whether fewer are near one displacement.
    sloped: bool,
}

/// Planes of u and v over coordinates of -1 to 1.
type Planes = [[f64; 3]; 2];

impl Trend {
    /// The trend of u and v; `halved` is what their values are multiplied by if they are of half the size of the level.
    /// `before` are slopes that were found earlier, on a coarser level say; samples that
    /// `sureness` lets not speak are left out; `memory` is kept from call to call.
    pub(super) fn of(
        flow: [&PaddedPlane; 2],
        halved: Option<f32>,
        before: Slopes,
        sureness: &Sureness,
        memory: &mut Samples,
    ) -> Result<Self> {
        let Samples { places, heights } = memory;
        let centre = [flow[0].width(), flow[0].height()].map(|size| 0.5 * size as f64);
        take(
            flow,
            f64::from(halved.unwrap_or(1.0)),
            centre,
            sureness,
            places,
        )?;
        let samples = &*places;
        heights.clear();
        // Another flow may have more samples that speak.
        reserve("heights of a flow", heights, places.capacity())?;
        let across = if halved.is_some() { 2.0 } else { 1.0 };
        let [x, y] = centre.map(|centre| 1.0 / (centre * across));
        let before =
            before.map(|[along_x, along_y]| [f64::from(along_x) / x, f64::from(along_y) / y]);
        let (planes, share) = fit(samples, before, heights);
        if share < ENOUGH {
            return Ok(Self::default());
        }
        let level = along(samples, [[0.0; 2]; 2], heights);
        let sloped = within(samples, &level, NEAR) < share - LEVEL;
        Ok(Self {
            slopes: planes
                .map(|[_, along_x, along_y]| [(along_x * x) as f32, (along_y * y) as f32]),
            affine: within(samples, &planes, ON),
            share,
            sloped,
        })
    }

    /// The slopes along which flow is carried to where nothing was measured: those that most of it cannot do without. What
    /// a few windows say of slopes would be far off at the other side of the picture.
    pub(super) fn carrying_slopes(&self) -> Slopes {
        if self.sloped {
            self.common_slopes()
        } else {
            Slopes::default()
        }
    }

    /// The slopes along which flow is brought from a pixel to another: those of a motion that nearly all of it follows.
    /// Beside other motions they would be wrong too often.
    pub(super) fn common_slopes(&self) -> Slopes {
        if self.share < COMMON {
            return Slopes::default();
        }
        self.slopes
    }
}

/// A place in coordinates of -1 to 1, and u and v there.
type Sample = [f64; 4];

/// Samples of a flow, and memory for what is left of them.
#[derive(Debug, Default)]
pub(super) struct Samples {
    places: Vec<Sample>,
    heights: Vec<f64>,
}

fn take(
    [u, v]: [&PaddedPlane; 2],
    scale: f64,
    [x0, y0]: [f64; 2],
    sureness: &Sureness,
    samples: &mut Vec<Sample>,
) -> Result<()> {
    samples.clear();
    let (width, height) = (u.width(), u.height());
    let step = (width.max(height) / SAMPLES).max(1);
    let apart = step / 3;
    reserve(
        "samples of a flow",
        samples,
        width.div_ceil(step) * height.div_ceil(step),
    )?;
    let scale = scale / 9.0;
    for y in (step / 2..height).step_by(step) {
        let rows = [y.saturating_sub(apart), y, (y + apart).min(height - 1)];
        for x in (step / 2..width).step_by(step) {
            let columns = [x.saturating_sub(apart), x, (x + apart).min(width - 1)];
            let mean = |grid: &PaddedPlane| {
                let sum: f32 = rows
                    .map(|y| {
                        let row = grid.row(y);
                        (row[columns[0]] + row[columns[1]]) + row[columns[2]]
                    })
                    .iter()
                    .sum();
                f64::from(sum) * scale
            };
            let place = [(x as f64 - x0) / x0, (y as f64 - y0) / y0];
            if sureness.speaks(place) {
                samples.push([place[0], place[1], mean(u), mean(v)]);
            }
        }
    }
    Ok(())
}

/// The planes that most samples are near, and the share of them. Planes through all samples lie between two motions; those
/// through a ninth of the picture are of one of them somewhere.
fn fit(samples: &[Sample], before: [[f64; 2]; 2], heights: &mut Vec<f64>) -> (Planes, f32) {
    let rated = |planes: Planes| (planes, within(samples, &planes, NEAR));
    let mut best = rated(along(samples, before, heights));
    if best.1 < PLENTY
        && let Some(whole) = least_squares(samples, |_| 1.0).map(rated)
        && whole.1 >= best.1
    {
        best = whole;
    }
    if best.1 < PLENTY {
        let mut tiles = [Sums::default(); TILES * TILES];
        for sample in samples {
            let [column, row] = [sample[0], sample[1]].map(|place| {
                let tile = (0.5 * (place + 1.0) * TILES as f64) as usize;
                tile.min(TILES - 1)
            });
            tiles[TILES * row + column].add(sample, 1.0);
        }
        for tile in tiles {
            if let Some(found) = tile.planes().map(rated)
                && found.1 > best.1
            {
                best = found;
            }
        }
    }
    for _ in 0..PASSES {
        let before = best.0;
        let found = least_squares(samples, |sample| {
            1.0 / (SOFT + squared_distance(&before, sample))
        });
        let Some(found) = found else { break };
        best = rated(found);
        let moved = (before.as_flattened().iter()).zip(best.0.as_flattened());
        if moved.fold(0.0, |most: f64, (a, b)| most.max((a - b).abs())) < STILL {
            break;
        }
    }
    best
}

/// Planes of these slopes at the height of the middle sample.
fn along(samples: &[Sample], slopes: [[f64; 2]; 2], heights: &mut Vec<f64>) -> Planes {
    [0, 1].map(|axis| {
        let [along_x, along_y] = slopes[axis];
        heights.clear();
        heights.extend(
            samples
                .iter()
                .map(|sample| sample[2 + axis] - along_x * sample[0] - along_y * sample[1]),
        );
        let middle = heights.len() / 2;
        let height = if heights.is_empty() {
            0.0
        } else {
            *heights.select_nth_unstable_by(middle, f64::total_cmp).1
        };
        [height, along_x, along_y]
    })
}

/// The share of samples within a distance of the planes.
fn within(samples: &[Sample], planes: &Planes, distance: f64) -> f32 {
    let near = |sample: &&Sample| squared_distance(planes, sample) < distance * distance;
    samples.iter().filter(near).count() as f32 / samples.len().max(1) as f32
}

fn least_squares(samples: &[Sample], weight: impl Fn(&Sample) -> f64) -> Option<Planes> {
    let mut sums = Sums::default();
    for sample in samples {
        sums.add(sample, weight(sample));
    }
    sums.planes()
}

/// Weighted sums of samples: of 1, x, y, xx, xy, yy, then of u and of v times 1, x and y.
#[derive(Debug, Clone, Copy, Default)]
struct Sums([f64; 12]);

impl Sums {
    fn add(&mut self, [x, y, u, v]: &Sample, weight: f64) {
        let (wx, wy) = (weight * x, weight * y);
        let terms = [
            weight,
            wx,
            wy,
            wx * x,
            wx * y,
            wy * y,
            weight * u,
            wx * u,
            wy * u,
            weight * v,
            wx * v,
            wy * v,
        ];
        for (sum, term) in self.0.iter_mut().zip(terms) {
            *sum += term;
        }
    }

    /// The planes of least squares, if the samples tell them.
    fn planes(&self) -> Option<Planes> {
        let [n, x, y, xx, xy, yy, u, ux, uy, v, vx, vy] = self.0;
        let (mx, my) = (x / n, y / n);
        let (cxx, cxy, cyy) = (xx / n - mx * mx, xy / n - mx * my, yy / n - my * my);
        let determinant = cxx * cyy - cxy * cxy;
        // A flow that is not a number, or too few samples: not above either.
        let solvable = n > 0.0 && determinant > 1e-9;
        let plane = |value: f64, along_x: f64, along_y: f64| {
            let mean = value / n;
            let (cx, cy) = (along_x / n - mx * mean, along_y / n - my * mean);
            let sx = (cyy * cx - cxy * cy) / determinant;
            let sy = (cxx * cy - cxy * cx) / determinant;
            [mean - sx * mx - sy * my, sx, sy]
        };
        let planes = [plane(u, ux, uy), plane(v, vx, vy)];
        let finite = planes.as_flattened().iter().all(|value| value.is_finite());
        (solvable && finite).then_some(planes)
    }
}

fn squared_distance(planes: &Planes, [x, y, u, v]: &Sample) -> f64 {
    let off =
        |[value, along_x, along_y]: &[f64; 3], at: f64| at - (value + along_x * x + along_y * y);
    let (u, v) = (off(&planes[0], *u), off(&planes[1], *v));
    u * u + v * v
}

#[cfg(test)]
mod tests {
    use super::super::padded_plane::{PAD, extend};
    use super::*;

    fn flow(width: usize, height: usize, at: impl Fn(f32, f32) -> f32) -> PaddedPlane {
        let mut grid = PaddedPlane::default();
        grid.resize(width, height).unwrap();
        for y in 0..height {
            let row = grid.padded_mut(y);
            for x in 0..width {
                row[PAD + x] = at(x as f32, y as f32);
            }
            extend(row, width);
        }
        grid
    }

    fn trend(flow: [&PaddedPlane; 2], halved: Option<f32>) -> Trend {
        Trend::of(
            flow,
            halved,
            Slopes::default(),
            &Sureness::default(),
            &mut Samples::default(),
        )
        .unwrap()
    }

    fn close(found: Slopes, want: Slopes) -> bool {
        let pairs = found.as_flattened().iter().zip(want.as_flattened());
        pairs.into_iter().all(|(a, b)| (a - b).abs() < 3e-3)
    }

    #[test]
    fn the_slopes_of_most_of_the_flow_are_found() {
        for (width, height) in [(160, 120), (41, 90), (9, 7)] {
            // Two motions, one of which has more of the picture.
            for share in [0.0, 0.25, 0.4] {
                let other = |x: f32| x < share * width as f32;
                let u = flow(width, height, |x, y| {
                    if other(x) {
                        9.0
                    } else {
                        1.0 + 0.02 * x - 0.1 * y
                    }
                });
                let v = flow(width, height, |x, y| {
                    if other(x) { -4.0 } else { 0.1 * x + 0.03 * y }
                });
                let found = trend([&u, &v], None);
                let want = [[0.02, -0.1], [0.1, 0.03]];
                assert!(close(found.slopes, want), "{width} {share}: {found:?}");
                assert!((found.affine - (1.0 - share)).abs() < 0.1, "{found:?}");
                let halved = trend([&u, &v], Some(2.0));
                assert!(close(halved.slopes, want), "{halved:?}");
            }
        }
    }

    #[test]
    fn where_nothing_is_common_there_are_no_slopes() {
        let wild = |x: f32, y: f32| 7.0 * (x * x + 3.1 * y * y).sin();
        let (u, v) = (flow(80, 60, wild), flow(80, 60, |x, y| wild(y, x)));
        assert_eq!(trend([&u, &v], None), Trend::default());
        for value in [f32::NAN, f32::INFINITY] {
            let bad = flow(30, 20, |_, _| value);
            assert_eq!(trend([&bad, &bad], None), Trend::default());
        }
        let thin = flow(30, 1, |x, _| x);
        assert_eq!(trend([&thin, &thin], None), Trend::default());
    }
}
