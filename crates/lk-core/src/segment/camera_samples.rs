//! Maps that a few rows tell.

#![allow(clippy::needless_range_loop, reason = "matrix indices")]

use super::camera_rows::{Map, NUMBERS, Rows};

/// Whether the rectangle over which vectors stand is in front of the camera's picture plane after a map.
pub(super) fn in_front(map: &Map, rows: &Rows) -> bool {
    let ([left, top], [right, bottom]) = (rows.low, rows.high);
    [(left, top), (right, top), (left, bottom), (right, bottom)]
        .into_iter()
        .all(|(x, y)| map[6] * x + map[7] * y + 1.0 > 0.2)
}

/// The similarity that two rows tell.
pub(super) fn similarity(rows: &Rows, [i, j]: [usize; 2]) -> Option<Map> {
    let (dx, dy) = (rows.x[j] - rows.x[i], rows.y[j] - rows.y[i]);
    let (ex, ey) = (rows.to_x[j] - rows.to_x[i], rows.to_y[j] - rows.to_y[i]);
    let square = dx * dx + dy * dy;
    // Close together they tell no scale.
    if square < 0.25 {
        return None;
    }
    let (a, b) = ((dx * ex + dy * ey) / square, (dx * ey - dy * ex) / square);
    let tx = rows.to_x[i] - a * rows.x[i] + b * rows.y[i];
    let ty = rows.to_y[i] - b * rows.x[i] - a * rows.y[i];
    Some([a, -b, tx, b, a, ty, 0.0, 0.0])
}

/// The affine map that three rows tell.
pub(super) fn affine(rows: &Rows, [i, j, k]: [usize; 3]) -> Option<Map> {
    let at = |values: &[f64]| [values[j] - values[i], values[k] - values[i]];
    let ([x1, x2], [y1, y2]) = (at(&rows.x), at(&rows.y));
    let determinant = x1 * y2 - x2 * y1;
    if determinant.abs() < 0.5 {
        return None;
    }
    let solved = |[to1, to2]: [f64; 2]| {
        [
            (to1 * y2 - to2 * y1) / determinant,
            (to2 * x1 - to1 * x2) / determinant,
        ]
    };
    let ([a, b], [c, d]) = (solved(at(&rows.to_x)), solved(at(&rows.to_y)));
    let tx = rows.to_x[i] - a * rows.x[i] - b * rows.y[i];
    let ty = rows.to_y[i] - c * rows.x[i] - d * rows.y[i];
    Some([a, b, tx, c, d, ty, 0.0, 0.0])
}

/// The homography that four rows tell.
pub(super) fn homography(rows: &Rows, four: [usize; 4]) -> Option<Map> {
    let mut a = [[0.0; NUMBERS + 1]; NUMBERS];
    for (k, at) in four.into_iter().enumerate() {
        let (x, y, to_x, to_y) = (rows.x[at], rows.y[at], rows.to_x[at], rows.to_y[at]);
        a[2 * k] = [x, y, 1.0, 0.0, 0.0, 0.0, -x * to_x, -y * to_x, to_x];
        a[2 * k + 1] = [0.0, 0.0, 0.0, x, y, 1.0, -x * to_y, -y * to_y, to_y];
    }
    for k in 0..NUMBERS {
        let pivot = (k..NUMBERS).max_by(|&i, &j| a[i][k].abs().total_cmp(&a[j][k].abs()))?;
        a.swap(k, pivot);
        if a[k][k].abs() < 1e-3 {
            return None;
        }
        for i in k + 1..NUMBERS {
            let factor = a[i][k] / a[k][k];
            for j in k..=NUMBERS {
                a[i][j] -= factor * a[k][j];
            }
        }
    }
    let mut map = [0.0; NUMBERS];
    for i in (0..NUMBERS).rev() {
        let known: f64 = (i + 1..NUMBERS).map(|j| a[i][j] * map[j]).sum();
        map[i] = (a[i][NUMBERS] - known) / a[i][i];
    }
    Some(map)
}

/// The same numbers for the same input.
pub(super) struct Random(pub(super) u64);

impl Random {
    pub(super) fn places<const N: usize>(&mut self, count: usize) -> [usize; N] {
        std::array::from_fn(|_| self.below(count))
    }

    fn below(&mut self, count: usize) -> usize {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as usize) % count
    }
}
