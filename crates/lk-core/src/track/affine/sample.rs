//! Sampling under an affine warp, eight pixels of a row at a time.
//!
//! The window turns little within eight pixels, so that the taps of all eight lie in a few columns and rows: they are
//! loaded side by side, and each lane has its own weights, 0 beyond its own taps.

use crate::frame::Plane;
use crate::pyramid::mirror;
use crate::simd::{EIGHT, Eight, Kernel, Packed, Simd};
use crate::track::affine::warp::Positions;

/// The most columns and rows of taps: a window may turn by 60 degrees, or be twice as large.
const MOST_TAPS: usize = 12;

/// The furthest that positions may drift from their lanes' own columns and rows, in pixels a column.
const MOST_DRIFT: f64 = (MOST_TAPS - 5) as f64 / (EIGHT - 1) as f64;

/// Pixels loaded of a row.
const REACH: usize = EIGHT + MOST_TAPS - 1;

/// Pixels that taps lie before the one that the first position is in, and after that of the last; one more for what single
/// precision rounds.
const BEFORE: isize = 2;
const AFTER: isize = 3;

/// Side of the largest region that is copied where a window reaches over the border.
const COPIED: usize = 224;

/// Memory for windows that reach over the border.
#[derive(Debug)]
pub(in crate::track) struct Copied([f32; COPIED * COPIED]);

impl Copied {
    pub(in crate::track) fn new() -> Self {
        Self([0.0; COPIED * COPIED])
    }
}

/// How grey levels between pixels are had.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::track) enum Filter {
    Linear,
    /// The cubic B-spline without its prefilter.
    Spline,
}

/// Sample a plane at `positions`, row by row. Whole lanes are written: `to` has seven more elements than that.
pub(in crate::track) struct SampleWarped<'a> {
    pub(in crate::track) plane: &'a Plane,
    pub(in crate::track) positions: Positions,
    pub(in crate::track) filter: Filter,
    pub(in crate::track) copied: &'a mut Copied,
    pub(in crate::track) to: &'a mut [f32],
    /// From row to row of `to`.
    pub(in crate::track) stride: usize,
}

/// Rows of pixels, the first of which has the coordinates `origin`.
#[derive(Clone, Copy)]
struct Source<'a> {
    data: &'a [f32],
    stride: usize,
    origin: [isize; 2],
}

impl Kernel for SampleWarped<'_> {
    /// Whether the positions are near enough to each other and to the plane.
    type Output = bool;

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> bool {
        let Self {
            plane,
            positions,
            filter,
            copied,
            to,
            stride,
        } = self;
        let Some(source) = source(plane, &positions, copied) else {
            return false;
        };
        // One count of taps for the whole window: what a branch in its midst costs is more than taps without weight.
        match (filter, positions.apart()) {
            (Filter::Linear, 0) => sample::<S::Eight, 2, false>(source, &positions, to, stride),
            (Filter::Linear, 1) => sample::<S::Eight, 3, false>(source, &positions, to, stride),
            (Filter::Linear, 2) => sample::<S::Eight, 4, false>(source, &positions, to, stride),
            (Filter::Linear, 3..=4) => sample::<S::Eight, 6, false>(source, &positions, to, stride),
            (Filter::Linear, _) => {
                sample::<S::Eight, MOST_TAPS, false>(source, &positions, to, stride)
            }
            (Filter::Spline, 0) => sample::<S::Eight, 4, true>(source, &positions, to, stride),
            (Filter::Spline, 1) => sample::<S::Eight, 5, true>(source, &positions, to, stride),
            (Filter::Spline, 2) => sample::<S::Eight, 6, true>(source, &positions, to, stride),
            (Filter::Spline, 3..=4) => sample::<S::Eight, 8, true>(source, &positions, to, stride),
            (Filter::Spline, _) => {
                sample::<S::Eight, MOST_TAPS, true>(source, &positions, to, stride)
            }
        }
        true
    }
}

/// The pixels around `positions`: the plane's own, or a mirrored copy.
fn source<'a>(
    plane: &'a Plane,
    positions: &Positions,
    copied: &'a mut Copied,
) -> Option<Source<'a>> {
    let [along, down] = positions.across;
    if !((along - 1.0).abs() <= MOST_DRIFT && down.abs() <= MOST_DRIFT) {
        return None;
    }
    let [x, y] = positions.bounds();
    if ![x, y].into_iter().flatten().all(|bound| bound.abs() < 1e6) {
        return None;
    }
    let [x, y] =
        [x, y].map(|[low, high]| (low.floor() as isize - BEFORE, high.floor() as isize + AFTER));
    // Where columns come closer, the first lane is loaded from before its own taps, as the last one needs it.
    let closer = (1.0 - along).max(0.0) * (EIGHT - 1) as f64;
    let x = (x.0 - closer.ceil() as isize, x.1);
    let (width, height) = (plane.width() as isize, plane.height() as isize);
    // Whole lanes are loaded: what stands beyond the taps has no weight, but one row more must be there.
    let wide = width >= REACH as isize;
    if wide && x.0 >= 0 && y.0 >= 0 && x.1 < width && y.1 + 1 < height {
        return Some(Source {
            data: plane.data(),
            stride: plane.width(),
            origin: [0, 0],
        });
    }
    let (columns, rows) = ((x.1 - x.0 + 1) as usize, (y.1 - y.0 + 1) as usize);
    if columns + REACH > COPIED || rows >= COPIED {
        return None;
    }
    // Columns that the plane has, from the first to the last but one; the others are mirrored.
    let first = (-x.0).clamp(0, columns as isize) as usize;
    let end = (width - x.0).clamp(first as isize, columns as isize) as usize;
    let mut mirrored = [0usize; COPIED];
    for column in (0..first).chain(end..columns) {
        mirrored[column] = mirror(x.0 + column as isize, plane.width());
    }
    let own = if first < end {
        let start = (x.0 + first as isize) as usize;
        start..start + end - first
    } else {
        0..0
    };
    for row in 0..rows {
        let from = plane.row(mirror(y.0 + row as isize, plane.height()));
        let to = &mut copied.0[row * COPIED..][..columns];
        to[first..end].copy_from_slice(&from[own.clone()]);
        for column in (0..first).chain(end..columns) {
            to[column] = from[mirrored[column]];
        }
    }
    Some(Source {
        data: &copied.0,
        stride: COPIED,
        origin: [x.0, y.0],
    })
}

#[inline(always)]
fn sample<L: Eight, const TAPS: usize, const SPLINE: bool>(
    source: Source<'_>,
    positions: &Positions,
    to: &mut [f32],
    stride: usize,
) {
    // Positions are counted from a whole pixel near the first: single precision is then fine enough.
    let base = positions.first.map(f64::floor);
    let first = [0, 1].map(|axis: usize| (positions.first[axis] - base[axis]) as f32);
    let across = positions.across.map(|step| step as f32);
    let down = positions.down.map(|step| step as f32);
    let base = [0, 1].map(|axis: usize| base[axis] as isize - source.origin[axis]);
    let lanes = L::unpack(&Packed::STEPS);
    // From lane to lane a pixel's own column goes on by one.
    let drift = [across[0] - 1.0, across[1]];
    for row in 0..positions.rows {
        let start = [
            first[0] + row as f32 * down[0],
            first[1] + row as f32 * down[1],
        ];
        for column in (0..positions.columns).step_by(EIGHT) {
            // Lanes beyond the row's end read what there is, for nobody.
            let lanes_used = EIGHT.min(positions.columns - column);
            let mut low = [0isize; 2];
            let mut within = [L::zero(); 2];
            for axis in 0..2 {
                let at = start[axis] + column as f32 * across[axis];
                let last = at + (lanes_used - 1) as f32 * drift[axis];
                let least = at.min(last).floor();
                low[axis] = base[axis] + least as isize;
                low[axis] = base[axis] + least as isize;
                within[axis] = L::splat(at - least) + lanes * L::splat(drift[axis]);
            }
            let taps = Taps { source, low };
            let value = taps.sum(
                isize::from(SPLINE),
                &weights::<L, TAPS, SPLINE>(within[0]),
                &weights::<L, TAPS, SPLINE>(within[1]),
            );
            value.store(to, row * stride + column);
        }
    }
}

/// The taps of eight positions.
struct Taps<'a> {
    source: Source<'a>,
    /// The least pixel that any of them is in, each counted from its own lane.
    low: [isize; 2],
}

impl Taps<'_> {
    /// From the pixel `before` the least one on.
    #[inline(always)]
    fn row(&self, before: isize, tap: usize) -> &[f32; REACH] {
        let Source { data, stride, .. } = self.source;
        let x = (self.low[0] - before) as usize;
        let y = (self.low[1] - before) as usize + tap;
        let at = y * stride + x;
        match data.get(at..).and_then(|rest| rest.first_chunk()) {
            Some(row) => row,
            // Only where no tap has weight, see `source`.
            None => &[0.0; REACH],
        }
    }

    /// Pixels from the one `before` the least one on, with these weights.
    #[allow(
        clippy::needless_range_loop,
        reason = "iterators over lanes may stay calls without the level's instructions"
    )]
    #[inline(always)]
    fn sum<L: Eight, const N: usize>(&self, before: isize, x: &[L; N], y: &[L; N]) -> L {
        let mut sum = L::zero();
        for down in 0..N {
            let row = self.row(before, down);
            let mut along = L::load(row, 0) * x[0];
            for across in 1..N {
                along += L::load(row, across) * x[across];
            }
            sum += along * y[down];
        }
        sum
    }
}

/// The weights of so many pixels for positions at `t` from the first one, or the second one of a spline.
#[inline(always)]
#[allow(
    clippy::needless_range_loop,
    reason = "iterators over lanes may stay calls without the level's instructions"
)]
fn weights<L: Eight, const N: usize, const SPLINE: bool>(t: L) -> [L; N] {
    let mut weights = [L::zero(); N];
    if SPLINE && N <= 5 {
        let one = L::splat(1.0);
        // All lie in the same pixel of their lane; or of five taps in the next one.
        let on = t.mask_from(one);
        let four = cubic(if N == 4 { t } else { t - one.keep(on) });
        for tap in 0..N {
            let here = if tap < 4 { four[tap] } else { L::zero() };
            let before = if tap > 0 { four[tap - 1] } else { L::zero() };
            weights[tap] = if N == 4 {
                here
            } else {
                on.choose(before, here)
            };
        }
        return weights;
    }
    for tap in 0..N {
        weights[tap] = weight_of::<L, SPLINE>(t, tap as isize - isize::from(SPLINE));
    }
    weights
}

/// The weight of a pixel at `tap` for positions `at`.
#[inline(always)]
fn weight_of<L: Eight, const SPLINE: bool>(at: L, tap: isize) -> L {
    // All bits but the sign's.
    let magnitude = L::splat(f32::from_bits(0x7fff_ffff));
    let away = (at - L::splat(tap as f32)).keep(magnitude);
    let inner = (L::splat(1.0) - away).larger(L::zero());
    if !SPLINE {
        return inner;
    }
    let outer = (L::splat(2.0) - away).larger(L::zero());
    (outer * outer * outer - L::splat(4.0) * (inner * inner * inner)) * L::splat(1.0 / 6.0)
}

/// The weights of the four pixels around positions `t` after the second of them.
#[inline(always)]
fn cubic<L: Eight>(t: L) -> [L; 4] {
    let s = L::splat(1.0) - t;
    let (sixth, half, most) = (L::splat(1.0 / 6.0), L::splat(0.5), L::splat(2.0 / 3.0));
    [
        s * s * s * sixth,
        most - t * t * (L::splat(1.0) - t * half),
        most - s * s * (L::splat(1.0) - s * half),
        t * t * t * sixth,
    ]
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::simd::{SimdLevel, dispatch};
    use crate::track::affine::warp::Warp;
    use crate::track::noise::cubic;
    use crate::track::patch::Window;

    fn picture() -> Plane {
        let mut plane = Plane::new(90, 70).unwrap();
        for y in 0..70 {
            for (x, to) in plane.row_mut(y).iter_mut().enumerate() {
                *to = 100.0 + 50.0 * (x as f32 * 0.7 + (y as f32 * 0.3).sin()).sin() + y as f32;
            }
        }
        plane
    }

    /// Linear between four pixels, in f64.
    fn linear_at(plane: &Plane, [x, y]: [f64; 2]) -> f64 {
        let (left, top) = (x.floor(), y.floor());
        let at = |row: usize, column: usize| {
            f64::from(plane.row(row.min(plane.height() - 1))[column.min(plane.width() - 1)])
        };
        let across = |row: usize| {
            let column = left as usize;
            at(row, column) + (x - left) * (at(row, column + 1) - at(row, column))
        };
        across(top as usize) + (y - top) * (across(top as usize + 1) - across(top as usize))
    }

    /// The definition in f64.
    fn spline_at(plane: &Plane, [x, y]: [f64; 2]) -> f64 {
        let (wx, wy) = (cubic((x - x.floor()) as f32), cubic((y - y.floor()) as f32));
        let mut sum = 0.0;
        for (j, wy) in wy.into_iter().enumerate() {
            let row = plane.row(mirror(y.floor() as isize + j as isize - 1, plane.height()));
            for (i, wx) in wx.into_iter().enumerate() {
                let column = mirror(x.floor() as isize + i as isize - 1, plane.width());
                sum += f64::from(wx) * f64::from(wy) * f64::from(row[column]);
            }
        }
        sum
    }

    proptest! {
        #[test]
        fn every_level_samples_as_defined(
            x in -20.0..110.0f64, y in -20.0..90.0f64, angle in -0.7..0.7f64, scale in 0.6..1.5f64,
            shear in -0.3..0.3f64, width in 3usize..30, height in 3usize..30,
        ) {
            let plane = picture();
            let (sin, cos) = angle.sin_cos();
            let matrix = [[scale * cos, -scale * sin + shear], [scale * sin, scale * cos]];
            let window = Window { width, height };
            let positions = Positions::around([x, y], matrix, window, 0);
            for filter in [Filter::Linear, Filter::Spline] {
                let mut want = None;
                for level in SimdLevel::available() {
                    let mut found = vec![0.0; width * height + 7];
                    let mut copied = Box::new(Copied::new());
                    let sampled = dispatch(level, SampleWarped {
                        plane: &plane, positions, filter, copied: &mut copied, to: &mut found, stride: width,
                    });
                    prop_assert!(sampled);
                    found.truncate(width * height);
                    let bits: Vec<u32> = found.iter().map(|value| value.to_bits()).collect();
                    prop_assert_eq!(&bits, want.get_or_insert(bits.clone()));
                    for row in 0..height {
                        for column in 0..width {
                            let corner = [-0.5 * (width as f64 - 1.0), -0.5 * (height as f64 - 1.0)];
                            let offset = [column as f64 + corner[0], row as f64 + corner[1]];
                            let turned = Warp { shift: [0.0; 2], matrix }.turn(offset);
                            let at = [x + turned[0], y + turned[1]];
                            let inside = at[0] >= 0.0 && at[1] >= 0.0 && at[0] <= 89.0 && at[1] <= 69.0;
                            let value = f64::from(found[row * width + column]);
                            if filter == Filter::Spline {
                                prop_assert!((value - spline_at(&plane, at)).abs() < 0.02);
                            } else if inside {
                                let linear = linear_at(&plane, at);
                                prop_assert!((value - linear).abs() < 0.02, "{} {}", value, linear);
                            }
                        }
                    }
                }
            }
        }
    }
}
