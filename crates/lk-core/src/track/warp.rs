//! Affine warps of a window, and sampling under them.

use crate::frame::Plane;
use crate::pyramid::mirror;
use crate::sample::cubic;
use crate::simd::Kernel;
use crate::track::patch::{MAX_SIDE, Window};

/// Samples along a side: a template has one more on each side, for its gradient.
const SIDE: usize = MAX_SIDE + 2;

/// Pixels that the spline reaches before and after the one that a position is in.
const BEFORE: isize = 1;
const AFTER: isize = 2;

/// Areas of a window after the warp, as shares of those before, beyond which it is not the same window.
const AREA_RANGE: (f64, f64) = (0.3, 3.0);

/// The longer axis of a warped circle over the shorter, beyond which too little of the shape is left.
const MAX_STRETCH: f64 = 2.0;

/// Where a window went, and how it is turned, scaled and sheared there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Warp {
    /// Displacement of the point.
    pub(super) shift: [f64; 2],
    /// The offset in `next` of what has the offset (1, 0) and (0, 1) from the point in `prev`, as columns.
    pub(super) matrix: [[f64; 2]; 2],
}

impl Warp {
    pub(super) const IDENTITY: [[f64; 2]; 2] = [[1.0, 0.0], [0.0, 1.0]];

    /// A displacement alone.
    pub(super) fn shift(shift: [f64; 2]) -> Self {
        Self {
            shift,
            matrix: Self::IDENTITY,
        }
    }

    /// What was at `offset` from the point is at this offset from where the point went.
    pub(super) fn turn(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [[a, b], [c, d]] = self.matrix;
        [a * x + b * y, c * x + d * y]
    }

    /// The displacement of what was at `offset` from the point.
    pub(super) fn displacement(&self, offset: [f64; 2]) -> [f64; 2] {
        let turned = self.turn(offset);
        [
            self.shift[0] + turned[0] - offset[0],
            self.shift[1] + turned[1] - offset[1],
        ]
    }

    /// The warp of a point at `offset` from this one, if the motion goes on alike.
    pub(super) fn moved(&self, offset: [f64; 2]) -> Self {
        Self {
            shift: self.displacement(offset),
            matrix: self.matrix,
        }
    }

    /// The same in pixels that are `factor` times as many.
    pub(super) fn scaled(&self, factor: f64) -> Self {
        Self {
            shift: [self.shift[0] * factor, self.shift[1] * factor],
            matrix: self.matrix,
        }
    }

    fn determinant(&self) -> f64 {
        let [[a, b], [c, d]] = self.matrix;
        a * d - b * c
    }

    /// Distances after the warp, as a share of those before.
    pub(super) fn scale(&self) -> f64 {
        self.determinant().abs().sqrt()
    }

    /// The warp from `next` to `prev`, around where the point went.
    pub(super) fn inverse(&self) -> Self {
        Self {
            shift: [-self.shift[0], -self.shift[1]],
            matrix: inverted(self.matrix),
        }
    }

    /// Whether a window keeps about its size and shape.
    pub(super) fn is_plausible(&self) -> bool {
        let [[a, b], [c, d]] = self.matrix;
        let determinant = self.determinant();
        // For singular values s and t: s^2 + t^2 over s t is r + 1 / r for the ratio r.
        let squares = a * a + b * b + c * c + d * d;
        determinant > AREA_RANGE.0
            && determinant < AREA_RANGE.1
            && squares < (MAX_STRETCH + 1.0 / MAX_STRETCH) * determinant
    }
}

pub(super) fn inverted([[a, b], [c, d]]: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
    let determinant = a * d - b * c;
    [
        [d / determinant, -b / determinant],
        [-c / determinant, a / determinant],
    ]
}

pub(super) fn product(left: [[f64; 2]; 2], right: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
    let mut result = [[0.0; 2]; 2];
    for (row, to) in result.iter_mut().enumerate() {
        for (column, to) in to.iter_mut().enumerate() {
            *to = left[row][0] * right[0][column] + left[row][1] * right[1][column];
        }
    }
    result
}

/// A grid of positions: a first one, and the steps from column to column and from row to row.
#[derive(Debug, Clone, Copy)]
pub(super) struct Positions {
    pub(super) first: [f64; 2],
    pub(super) across: [f64; 2],
    pub(super) down: [f64; 2],
    pub(super) columns: usize,
    pub(super) rows: usize,
}

impl Positions {
    /// The pixels of a window around `centre`, turned by `matrix`, with so many more on each side.
    pub(super) fn around(
        centre: [f64; 2],
        matrix: [[f64; 2]; 2],
        window: Window,
        more: usize,
    ) -> Self {
        let (columns, rows) = (window.width + 2 * more, window.height + 2 * more);
        let corner = [-0.5 * (columns as f64 - 1.0), -0.5 * (rows as f64 - 1.0)];
        let turned = Warp {
            shift: centre,
            matrix,
        }
        .turn(corner);
        Self {
            first: [centre[0] + turned[0], centre[1] + turned[1]],
            across: [matrix[0][0], matrix[1][0]],
            down: [matrix[0][1], matrix[1][1]],
            columns,
            rows,
        }
    }

    /// The last column and row.
    fn spans(&self) -> [f64; 2] {
        [self.columns as f64 - 1.0, self.rows as f64 - 1.0]
    }

    /// The least and the largest coordinate of any of them, along x and y.
    fn bounds(&self) -> [[f64; 2]; 2] {
        let [across, down] = self.spans();
        let along = |axis: usize| {
            let (a, b) = (self.across[axis] * across, self.down[axis] * down);
            let first = self.first[axis];
            [
                first + a.min(0.0) + b.min(0.0),
                first + a.max(0.0) + b.max(0.0),
            ]
        };
        [along(0), along(1)]
    }
}

/// Sample a plane by the cubic B-spline without its prefilter at `positions`, row by row.
pub(super) struct SampleWarped<'a> {
    pub(super) plane: &'a Plane,
    pub(super) positions: Positions,
    pub(super) to: &'a mut [f32],
}

impl Kernel for SampleWarped<'_> {
    type Output = ();

    #[inline(always)]
    fn run(self) {
        let Self {
            plane,
            positions,
            to,
        } = self;
        let (width, height) = (plane.width(), plane.height());
        let [[left, right], [top, bottom]] = positions.bounds();
        // One pixel more than the spline reaches, for what single precision rounds.
        let inside = left >= (BEFORE + 1) as f64
            && top >= (BEFORE + 1) as f64
            && right < width as f64 - (AFTER + 1) as f64
            && bottom < height as f64 - (AFTER + 1) as f64;
        // Positions are counted from a whole pixel near the first: single precision is then fine enough.
        let base = [positions.first[0].floor(), positions.first[1].floor()];
        let first = [
            (positions.first[0] - base[0]) as f32,
            (positions.first[1] - base[1]) as f32,
        ];
        let across = [positions.across[0] as f32, positions.across[1] as f32];
        let down = [positions.down[0] as f32, positions.down[1] as f32];
        let base = [base[0] as isize, base[1] as isize];
        let data = plane.data();
        let mut taps = Taps::new();
        for row in 0..positions.rows {
            let start = [
                first[0] + row as f32 * down[0],
                first[1] + row as f32 * down[1],
            ];
            taps.fill(start, across, positions.columns);
            let line = &mut to[row * positions.columns..][..positions.columns];
            for (column, to) in line.iter_mut().enumerate() {
                let place = [
                    base[0] + taps.whole[0][column] as isize - BEFORE,
                    base[1] + taps.whole[1][column] as isize - BEFORE,
                ];
                // Down the columns first: four pixels of a row lie side by side.
                let mut sums = [0.0f32; 4];
                for tap in 0..4 {
                    let pixels = if inside {
                        let at = (place[1] as usize + tap) * width + place[0] as usize;
                        data.get(at..).and_then(|rest| rest.first_chunk::<4>())
                    } else {
                        None
                    };
                    let weight = taps.weights[1][tap][column];
                    if let Some(pixels) = pixels {
                        for (sum, pixel) in sums.iter_mut().zip(pixels) {
                            *sum += weight * pixel;
                        }
                    } else {
                        let pixels = plane.row(mirror(place[1] + tap as isize, height));
                        for (offset, sum) in sums.iter_mut().enumerate() {
                            *sum += weight * pixels[mirror(place[0] + offset as isize, width)];
                        }
                    }
                }
                let [a, b, c, d] = &taps.weights[0];
                *to = (sums[1] * b[column] + sums[2] * c[column])
                    + (sums[0] * a[column] + sums[3] * d[column]);
            }
        }
    }
}

/// Where the samples of a row lie: the whole part of both coordinates, and the weights of the pixels around.
struct Taps {
    whole: [[f32; SIDE]; 2],
    weights: [[[f32; SIDE]; 4]; 2],
}

impl Taps {
    #[inline(always)]
    fn new() -> Self {
        Self {
            whole: [[0.0; SIDE]; 2],
            weights: [[[0.0; SIDE]; 4]; 2],
        }
    }

    #[inline(always)]
    fn fill(&mut self, start: [f32; 2], across: [f32; 2], columns: usize) {
        for axis in 0..2 {
            let whole = &mut self.whole[axis][..columns];
            let [a, b, c, d] = &mut self.weights[axis];
            let (a, b) = (&mut a[..columns], &mut b[..columns]);
            let (c, d) = (&mut c[..columns], &mut d[..columns]);
            for column in 0..columns {
                let at = start[axis] + column as f32 * across[axis];
                whole[column] = at.floor();
                [a[column], b[column], c[column], d[column]] = cubic(at - whole[column]);
            }
        }
    }
}
