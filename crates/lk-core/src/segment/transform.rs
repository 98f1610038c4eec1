//! Maps of the plane, and pictures and masks that are moved by them.

use crate::error::Result;
use crate::execution::Execution;
use crate::parallel::{RowsMut, even_bands, for_each_band};

use super::morphology::Size;

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
    let [a, b, c] = m.map(|row| row[0] * x + row[1] * y + row[2]);
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
    // Pixel centres: X = (x + 0.5) k - 0.5.
    let (k, s) = (factor as f64, (factor as f64 - 1.0) / 2.0);
    let up = [[k, 0.0, s], [0.0, k, s], [0.0, 0.0, 1.0]];
    let down = [
        [1.0 / k, 0.0, -s / k],
        [0.0, 1.0 / k, -s / k],
        [0.0, 0.0, 1.0],
    ];
    product(&down, &product(map, &up))
}

/// Call `work(x, place)` along row `y` with where the map takes each pixel.
#[inline(always)]
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
fn cubic(t: f32) -> [f32; 4] {
    let (t2, t3) = (t * t, t * t * t);
    [
        -0.5 * t3 + t2 - 0.5 * t,
        1.5 * t3 - 2.5 * t2 + 1.0,
        -1.5 * t3 + 2.0 * t2 + 0.5 * t,
        0.5 * t3 - 0.5 * t2,
    ]
}

/// A row of a picture seen at places of it, and whether it has each.
pub(crate) struct Moved<'a> {
    /// The picture, and its columns and rows.
    pub(crate) from: (&'a [f32], Size),
    /// From pixels of what is written to those of the picture.
    pub(crate) map: &'a Map,
}

impl Moved<'_> {
    /// Write row `y` with cubic interpolation. Beyond the picture stands its border, and `inside` is 0.
    pub(crate) fn row(&self, y: usize, to: &mut [f32], inside: &mut [u8]) {
        let (from, (width, height)) = self.from;
        let (last_x, last_y) = ((width - 1) as f32, (height - 1) as f32);
        along_row(self.map, y, to.len(), |x, px, py| {
            let within = px >= -0.01 && py >= -0.01 && px <= last_x + 0.01 && py <= last_y + 0.01;
            inside[x] = u8::from(within);
            // A place that is no number is beyond.
            let (px, py) = (px.max(0.0).min(last_x), py.max(0.0).min(last_y));
            let (left, top) = (px as usize, py as usize);
            let (wx, wy) = (cubic(px - left as f32), cubic(py - top as f32));
            if left >= 1 && top >= 1 && left + 2 < width && top + 2 < height {
                let mut sum = 0.0;
                for (k, wy) in wy.into_iter().enumerate() {
                    let start = (top + k - 1) * width + left - 1;
                    if let Some([a, b, c, d]) = from[start..].first_chunk::<4>() {
                        sum += wy * ((wx[0] * a + wx[1] * b) + (wx[2] * c + wx[3] * d));
                    }
                }
                to[x] = sum;
            } else {
                let mut sum = 0.0;
                for (k, wy) in wy.into_iter().enumerate() {
                    let row = (top + k).saturating_sub(1).min(height - 1) * width;
                    for (l, wx) in wx.into_iter().enumerate() {
                        sum += wy * wx * from[row + (left + l).saturating_sub(1).min(width - 1)];
                    }
                }
                to[x] = sum;
            }
        });
    }
}

/// Write what `from` has at the nearest pixel of where `map` takes each pixel of `to`; `missing` beyond.
///
/// # Errors
///
/// Those of the execution.
pub(crate) fn nearest<T: Copy + Send + Sync>(
    (from, (width, height)): (&[T], Size),
    map: &Map,
    (to, to_size): (&mut [T], Size),
    missing: T,
    execution: &Execution,
) -> Result<()> {
    if to_size.0 == 0 {
        return Ok(());
    }
    let rows = even_bands(
        execution,
        to_size.1,
        [65_536 / to_size.0, 16_384 / to_size.0],
    );
    for_each_band(
        execution,
        to_size.1,
        rows,
        RowsMut::new(to, to_size.0),
        |band, mut part| {
            for (local, y) in band.enumerate() {
                let row = part.row_mut(local);
                along_row(map, y, to_size.0, |x, px, py| {
                    let (px, py) = (px + 0.5, py + 0.5);
                    let within = px >= 0.0 && py >= 0.0 && px < width as f32 && py < height as f32;
                    row[x] = if within {
                        from[(py as usize) * width + px as usize]
                    } else {
                        missing
                    };
                });
            }
        },
    )
}

/// Write where a mask covers at least half of what is around the place that `map` takes each pixel of `to` to.
///
/// # Errors
///
/// Those of the execution.
pub(crate) fn covered(
    (from, (width, height)): (&[u8], Size),
    map: &Map,
    (to, to_size): (&mut [u8], Size),
    execution: &Execution,
) -> Result<()> {
    if to_size.0 == 0 {
        return Ok(());
    }
    let rows = even_bands(
        execution,
        to_size.1,
        [65_536 / to_size.0, 16_384 / to_size.0],
    );
    for_each_band(
        execution,
        to_size.1,
        rows,
        RowsMut::new(to, to_size.0),
        |band, mut part| {
            for (local, y) in band.enumerate() {
                let row = part.row_mut(local);
                along_row(map, y, to_size.0, |x, px, py| {
                    let within = px > -1.0 && py > -1.0 && px < width as f32 && py < height as f32;
                    if !within {
                        row[x] = 0;
                        return;
                    }
                    let (left, top) = (px.max(0.0) as usize, py.max(0.0) as usize);
                    let (right, down) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
                    let at = |y: usize, x: usize| from[y * width + x];
                    let corners = [
                        at(top, left),
                        at(top, right),
                        at(down, left),
                        at(down, right),
                    ];
                    row[x] = match corners {
                        [0, 0, 0, 0] => 0,
                        [1, 1, 1, 1] => 1,
                        corners => {
                            let (fx, fy) = (px - left as f32, py - top as f32);
                            let [a, b, c, d] = corners.map(f32::from);
                            let (upper, lower) = (a + fx * (b - a), c + fx * (d - c));
                            u8::from(upper + fy * (lower - upper) >= 0.5)
                        }
                    };
                });
            }
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

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

    #[test]
    fn whole_pixels_move_without_a_change() {
        let size = (7, 5);
        let from: Vec<f32> = (0..35).map(|k| (k * k % 13) as f32).collect();
        let map = shift(2.0, 1.0);
        let moved = Moved {
            from: (&from, size),
            map: &map,
        };
        for y in 0..4 {
            let (mut row, mut inside) = (vec![0.0; 7], vec![0; 7]);
            moved.row(y, &mut row, &mut inside);
            assert_eq!(row[..5], from[(y + 1) * 7 + 2..(y + 2) * 7]);
            assert_eq!(inside, [1, 1, 1, 1, 1, 0, 0]);
        }
    }
}
