//! Affine warps of a window, and where its pixels go.

use crate::simd::EIGHT;
use crate::track::patch::Window;

/// Areas of a window after the warp, as shares of those before, beyond which it is not the same window.
const AREA_RANGE: (f64, f64) = (0.3, 3.0);

/// The longer axis of a warped circle over the shorter, beyond which too little of the shape is left.
const MAX_STRETCH: f64 = 2.0;

/// Where a window went, and how it is turned, scaled and sheared there.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(in crate::track) struct Warp {
    /// Displacement of the point.
    pub(in crate::track) shift: [f64; 2],
    /// The offset in `next` of what has the offset (1, 0) and (0, 1) from the point in `prev`, as columns.
    pub(in crate::track) matrix: [[f64; 2]; 2],
}

impl Warp {
    pub(in crate::track) const IDENTITY: [[f64; 2]; 2] = [[1.0, 0.0], [0.0, 1.0]];

    /// A displacement alone.
    pub(in crate::track) fn shift(shift: [f64; 2]) -> Self {
        Self {
            shift,
            matrix: Self::IDENTITY,
        }
    }

    /// What was at `offset` from the point is at this offset from where the point went.
    pub(in crate::track) fn turn(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [[a, b], [c, d]] = self.matrix;
        [a * x + b * y, c * x + d * y]
    }

    /// The displacement of what was at `offset` from the point.
    pub(in crate::track) fn displacement(&self, offset: [f64; 2]) -> [f64; 2] {
        let turned = self.turn(offset);
        [
            self.shift[0] + turned[0] - offset[0],
            self.shift[1] + turned[1] - offset[1],
        ]
    }

    /// The warp of a point at `offset` from this one, if the motion goes on alike.
    pub(in crate::track) fn moved(&self, offset: [f64; 2]) -> Self {
        Self {
            shift: self.displacement(offset),
            matrix: self.matrix,
        }
    }

    /// The same in pixels that are `factor` times as many.
    pub(in crate::track) fn scaled(&self, factor: f64) -> Self {
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
    pub(in crate::track) fn scale(&self) -> f64 {
        self.determinant().abs().sqrt()
    }

    /// The warp from `next` to `prev`, around where the point went.
    pub(in crate::track) fn inverse(&self) -> Self {
        Self {
            shift: [-self.shift[0], -self.shift[1]],
            matrix: inverted(self.matrix),
        }
    }

    /// Whether a window keeps about its size and shape.
    pub(in crate::track) fn is_plausible(&self) -> bool {
        let [[a, b], [c, d]] = self.matrix;
        let determinant = self.determinant();
        // For singular values s and t: s^2 + t^2 over s t is r + 1 / r for the ratio r.
        let squares = a * a + b * b + c * c + d * d;
        determinant > AREA_RANGE.0
            && determinant < AREA_RANGE.1
            && squares < (MAX_STRETCH + 1.0 / MAX_STRETCH) * determinant
    }
}

pub(in crate::track) fn inverted([[a, b], [c, d]]: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
    let determinant = a * d - b * c;
    [
        [d / determinant, -b / determinant],
        [-c / determinant, a / determinant],
    ]
}

pub(in crate::track) fn product(left: [[f64; 2]; 2], right: [[f64; 2]; 2]) -> [[f64; 2]; 2] {
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
pub(in crate::track) struct Positions {
    pub(in crate::track) first: [f64; 2],
    pub(in crate::track) across: [f64; 2],
    pub(in crate::track) down: [f64; 2],
    pub(in crate::track) columns: usize,
    pub(in crate::track) rows: usize,
}

impl Positions {
    /// The pixels of a window around `centre`, turned by `matrix`, with so many more on each side.
    pub(in crate::track) fn around(
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

    /// The position of a sample.
    pub(in crate::track) fn at(&self, column: usize, row: usize) -> [f64; 2] {
        let (column, row) = (column as f64, row as f64);
        [0, 1].map(|axis: usize| {
            self.first[axis] + column * self.across[axis] + row * self.down[axis]
        })
    }

    /// How many pixels on any of eight neighbours in a row may be, at most, from where its own column and row lead.
    pub(in crate::track) fn apart(&self) -> usize {
        let drift = (self.across[0] - 1.0).abs().max(self.across[1].abs());
        let apart = drift * (EIGHT - 1) as f64;
        // A little for what single precision rounds.
        if apart > 0.0 {
            (apart + 1e-3).ceil() as usize
        } else {
            0
        }
    }

    /// The last column and row.
    fn spans(&self) -> [f64; 2] {
        [self.columns as f64 - 1.0, self.rows as f64 - 1.0]
    }

    /// The least and the largest coordinate of any of them, along x and y.
    pub(in crate::track) fn bounds(&self) -> [[f64; 2]; 2] {
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
