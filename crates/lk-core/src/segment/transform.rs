//! Maps of the plane.

/// A homography: rows of a matrix over (x, y, 1).
pub(crate) type Map = [[f64; 3]; 3];

/// Nothing moves.
pub(crate) const IDENTITY: Map = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

/// First `b`, then `a`.
pub(crate) fn product(a: &Map, b: &Map) -> Map {
    let mut out = [[0.0; 3]; 3];
    for (row, of) in out.iter_mut().zip(a) {
        for (column, value) in row.iter_mut().enumerate() {
            *value = (0..3).map(|k| of[k] * b[k][column]).sum();
        }
    }
    normalised(out)
}

/// The same map with 1 in its last place, where it has not 0 there.
pub(crate) fn normalised(map: Map) -> Map {
    let last = map[2][2];
    if last.abs() < 1e-12 || !last.is_finite() {
        return map;
    }
    map.map(|row| row.map(|value| value / last))
}

/// The way back; `None` where there is none.
pub(crate) fn inverse(m: &Map) -> Option<Map> {
    let minor = |i: usize, j: usize| {
        let ([a, b], [c, d]) = ([(i + 1) % 3, (i + 2) % 3], [(j + 1) % 3, (j + 2) % 3]);
        m[a][c] * m[b][d] - m[a][d] * m[b][c]
    };
    let determinant = (0..3).map(|j| m[0][j] * minor(0, j)).sum::<f64>();
    if !determinant.is_finite() || determinant.abs() < 1e-12 {
        return None;
    }
    let mut out = [[0.0; 3]; 3];
    for (i, row) in out.iter_mut().enumerate() {
        for (j, value) in row.iter_mut().enumerate() {
            *value = minor(j, i) / determinant;
        }
    }
    Some(normalised(out))
}

/// Where a place goes.
#[inline]
pub(crate) fn applied(m: &Map, [x, y]: [f64; 2]) -> [f64; 2] {
    let [p, q, r] = m;
    let a = p[0] * x + p[1] * y + p[2];
    let b = q[0] * x + q[1] * y + q[2];
    let c = r[0] * x + r[1] * y + r[2];
    [a / c, b / c]
}

/// By so many whole pixels.
pub(crate) fn shift(dx: f64, dy: f64) -> Map {
    [[1.0, 0.0, dx], [0.0, 1.0, dy], [0.0, 0.0, 1.0]]
}

/// What `map` is of pixels that are `factor` times larger.
pub(crate) fn reduced(map: &Map, factor: usize) -> Map {
    if factor == 1 {
        return *map;
    }
    let [up, down] = scaled(factor);
    product(&down, &product(map, &up))
}

/// What `map` is of pixels that are `factor` times smaller.
pub(crate) fn enlarged(map: &Map, factor: usize) -> Map {
    let [up, down] = scaled(factor);
    product(&up, &product(map, &down))
}

/// From pixels that are `factor` times larger, and to them.
fn scaled(factor: usize) -> [Map; 2] {
    // Pixel centres: X = (x + 0.5) k - 0.5.
    let (k, s) = (factor as f64, (factor as f64 - 1.0) / 2.0);
    [
        [[k, 0.0, s], [0.0, k, s], [0.0, 0.0, 1.0]],
        [
            [1.0 / k, 0.0, -s / k],
            [0.0, 1.0 / k, -s / k],
            [0.0, 0.0, 1.0],
        ],
    ]
}

/// Call `work(x, place)` along row `y` with where the map takes each pixel: what [`Places`] are held to.
#[cfg(test)]
pub(crate) fn along_row(map: &Map, y: usize, width: usize, mut work: impl FnMut(usize, f32, f32)) {
    let y = y as f64;
    let start = map.map(|row| row[1] * y + row[2]);
    let straight = map[2][0] == 0.0 && map[2][1] == 0.0;
    for x in 0..width {
        let at = x as f64;
        let (px, py) = (map[0][0] * at + start[0], map[1][0] * at + start[1]);
        let (px, py) = if straight {
            (px, py)
        } else {
            let w = 1.0 / (map[2][0] * at + start[2]);
            (px * w, py * w)
        };
        work(x, px as f32, py as f32);
    }
}

/// Catmull and Rom's weights of the four pixels around a fraction.
#[inline(always)]
pub(super) fn cubic(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [
        -0.5 * t3 + t2 - 0.5 * t,
        1.5 * t3 - 2.5 * t2 + 1.0,
        -1.5 * t3 + 2.0 * t2 + 0.5 * t,
        0.5 * t3 - 0.5 * t2,
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn smaller_pixels_and_back_are_the_same() {
        let map = [[1.02, 0.03, 4.0], [-0.02, 0.97, -3.0], [1e-4, -2e-4, 1.0]];
        for factor in [1, 2, 4] {
            let back = reduced(&enlarged(&map, factor), factor);
            for (value, want) in back.iter().flatten().zip(map.iter().flatten()) {
                assert!((value - want).abs() < 1e-12);
            }
        }
        let [x, y] = applied(&enlarged(&shift(3.0, -1.0), 2), [5.0, 7.0]);
        assert!((x - 11.0).abs() < 1e-12 && (y - 5.0).abs() < 1e-12);
    }

    #[test]
    fn there_and_back_is_nowhere() {
        let map = [[1.02, 0.03, 4.0], [-0.02, 0.97, -3.0], [1e-4, -2e-4, 1.0]];
        let back = inverse(&map).unwrap();
        for (row, want) in product(&map, &back).iter().zip(IDENTITY) {
            for (value, want) in row.iter().zip(want) {
                assert!((value - want).abs() < 1e-12);
            }
        }
        assert!(inverse(&[[1.0, 2.0, 3.0], [2.0, 4.0, 6.0], [0.0, 0.0, 1.0]]).is_none());
    }
}
