//! Motion vectors as rows of a least-squares problem over the eight numbers of a homography.

#![allow(clippy::needless_range_loop, reason = "matrix indices")]

use super::MotionVector;

/// Flow is not better than this, whatever its covariance says: a standard deviation in pixels.
const LEAST_STD_PX: f64 = 0.1;
/// The frame is divided into so many tiles along each side; none has more say than another because it has more vectors.
const TILES: usize = 8;

/// Numbers of a homography whose last one is 1.
pub(super) const NUMBERS: usize = 8;
/// A homography by rows, without its last number, which is 1.
pub(super) type Map = [f64; NUMBERS];
pub(super) const IDENTITY: Map = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0];

/// Where a map takes a point.
#[inline]
pub(super) fn mapped(map: &Map, x: f64, y: f64) -> [f64; 2] {
    let w = map[6] * x + map[7] * y + 1.0;
    let upper = map[0] * x + map[1] * y + map[2];
    let lower = map[3] * x + map[4] * y + map[5];
    [upper / w, lower / w]
}

/// Vectors in coordinates of about unit size, ordered so that each stretch of them is spread over the frame.
#[derive(Debug, Default)]
pub(super) struct Rows {
    pub(super) x: Vec<f64>,
    pub(super) y: Vec<f64>,
    /// Where the vectors lead.
    pub(super) to_x: Vec<f64>,
    pub(super) to_y: Vec<f64>,
    /// Inverse covariances, per unit squared: xx, xy, yy.
    information: [Vec<f64>; 3],
    /// How much of the frame each stands for, 1 at most.
    pub(super) area: Vec<f64>,
    pub(super) centre: [f64; 2],
    /// Pixels of a unit.
    pub(super) size: f64,
    /// The rectangle over which the vectors stand.
    pub(super) low: [f64; 2],
    pub(super) high: [f64; 2],
}

impl Rows {
    pub(super) fn len(&self) -> usize {
        self.x.len()
    }

    /// Rows of those among vectors that can be reckoned with.
    pub(super) fn of(vectors: &[MotionVector]) -> Self {
        let vectors: Vec<&MotionVector> = vectors.iter().filter(|v| v.usable()).collect();
        let count = vectors.len().max(1) as f64;
        let (mut sum, mut square) = ([0.0; 2], [0.0; 2]);
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for v in &vectors {
            for (axis, value) in [v.x, v.y].into_iter().enumerate() {
                sum[axis] += value;
                square[axis] += value * value;
                low[axis] = low[axis].min(value);
                high[axis] = high[axis].max(value);
            }
        }
        let centre = sum.map(|sum| sum / count);
        let variance = [0, 1].map(|k: usize| square[k] / count - centre[k] * centre[k]);
        let size = variance[0].max(variance[1]).max(1.0).sqrt();
        let tile = |v: &MotionVector| {
            let part = |at: f64, axis: usize| {
                let whole = (high[axis] - low[axis]).max(1e-9);
                ((at - low[axis]) / whole * (TILES as f64 - 1e-6)) as usize
            };
            let (column, row) = (part(v.x, 0), part(v.y, 1));
            row.min(TILES - 1) * TILES + column.min(TILES - 1)
        };
        let mut counts = [0_usize; TILES * TILES];
        // The how-manieth of its tile each is: in this order they are taken.
        let ranked: Vec<(usize, usize, usize)> = mixed(vectors.len())
            .map(|k| {
                let tile = tile(vectors[k]);
                counts[tile] += 1;
                (counts[tile] - 1, tile, k)
            })
            .collect();
        let mut starts = vec![0_usize; vectors.len() + 1];
        for &(rank, _, _) in &ranked {
            starts[rank + 1] += 1;
        }
        for k in 1..starts.len() {
            starts[k] += starts[k - 1];
        }
        let mut order = vec![(0_usize, 0_usize); vectors.len()];
        for (rank, tile, k) in ranked {
            order[starts[rank]] = (tile, k);
            starts[rank] += 1;
        }
        let filled = counts.iter().filter(|&&count| count > 0).count().max(1) as f64;
        let usual = count / filled;
        let mut rows = Self {
            centre,
            size,
            low: [0, 1].map(|k: usize| (low[k] - centre[k]) / size),
            high: [0, 1].map(|k: usize| (high[k] - centre[k]) / size),
            ..Self::default()
        };
        for (tile, k) in order {
            rows.push(vectors[k], (usual / counts[tile] as f64).min(1.0));
        }
        rows
    }

    fn push(&mut self, v: &MotionVector, area: f64) {
        let unit = |value: f64, axis: usize| (value - self.centre[axis]) / self.size;
        let ([x, y], [to_x, to_y]) = (
            [unit(v.x, 0), unit(v.y, 1)],
            [unit(v.x + v.u, 0), unit(v.y + v.v, 1)],
        );
        self.x.push(x);
        self.y.push(y);
        self.to_x.push(to_x);
        self.to_y.push(to_y);
        let [xx, xy, yy] = v.covariance;
        let (xx, yy) = (
            xx.max(0.0) + LEAST_STD_PX * LEAST_STD_PX,
            yy.max(0.0) + LEAST_STD_PX * LEAST_STD_PX,
        );
        let most = 0.99 * (xx * yy).sqrt();
        let xy = xy.clamp(-most, most);
        let scale = self.size * self.size / (xx * yy - xy * xy);
        for (part, value) in self.information.iter_mut().zip([yy, -xy, xx]) {
            part.push(value * scale);
        }
        self.area.push(area);
    }

    /// Squared lengths of the first residuals to a map, each in the standard deviations of its own covariance.
    pub(super) fn squares(&self, map: &Map, out: &mut [f64]) {
        let [xx, xy, yy] = &self.information;
        let count = out.len();
        let (x, y) = (&self.x[..count], &self.y[..count]);
        let (to_x, to_y) = (&self.to_x[..count], &self.to_y[..count]);
        let (xx, xy, yy) = (&xx[..count], &xy[..count], &yy[..count]);
        for k in 0..count {
            let [at_x, at_y] = mapped(map, x[k], y[k]);
            let (u, v) = (to_x[k] - at_x, to_y[k] - at_y);
            out[k] = xx[k] * u * u + 2.0 * xy[k] * u * v + yy[k] * v * v;
        }
    }

    /// Squared lengths of the residuals to a map, in pixels.
    pub(super) fn squares_px(&self, map: &Map, out: &mut [f64]) {
        for (k, out) in out.iter_mut().enumerate() {
            let [x, y] = mapped(map, self.x[k], self.y[k]);
            let (u, v) = (self.to_x[k] - x, self.to_y[k] - y);
            *out = (u * u + v * v) * self.size * self.size;
        }
    }

    /// The normal equations of a step from a map, with a weight for each row.
    pub(super) fn normal(&self, map: &Map, weights: &[f64]) -> Normal {
        let [xx, xy, yy] = &self.information;
        // Products of the place with itself, times what the parameters share.
        let mut sums = [[0.0; 6]; 6];
        let mut right = [[0.0; 3]; 3];
        for (k, &weight) in weights.iter().enumerate() {
            if weight <= 0.0 {
                continue;
            }
            let (x, y) = (self.x[k], self.y[k]);
            let w = 1.0 / (map[6] * x + map[7] * y + 1.0);
            let at_x = (map[0] * x + map[1] * y + map[2]) * w;
            let at_y = (map[3] * x + map[4] * y + map[5]) * w;
            let (xx, xy, yy) = (xx[k] * weight, xy[k] * weight, yy[k] * weight);
            let (u, v) = (self.to_x[k] - at_x, self.to_y[k] - at_y);
            let g = [x * w, y * w, w];
            let products = [
                g[0] * g[0],
                g[0] * g[1],
                g[0] * g[2],
                g[1] * g[1],
                g[1] * g[2],
                g[2] * g[2],
            ];
            let (down_x, down_y) = (xx * at_x + xy * at_y, xy * at_x + yy * at_y);
            let factors = [xx, xy, yy, -down_x, -down_y, down_x * at_x + down_y * at_y];
            for (sums, factor) in sums.iter_mut().zip(factors) {
                for (sum, product) in sums.iter_mut().zip(products) {
                    *sum += factor * product;
                }
            }
            let (pull_x, pull_y) = (xx * u + xy * v, xy * u + yy * v);
            let pulls = [pull_x, pull_y, -(at_x * pull_x + at_y * pull_y)];
            for (right, pull) in right.iter_mut().zip(pulls) {
                for (right, g) in right.iter_mut().zip(g) {
                    *right += pull * g;
                }
            }
        }
        Normal::of(&sums, &right)
    }
}

/// All numbers below a count, neighbours far from each other: whatever order vectors come in says nothing.
fn mixed(count: usize) -> impl Iterator<Item = usize> {
    let common = |mut a: usize, mut b: usize| {
        while b != 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    let mut step = (count as f64 * 0.618) as usize;
    while step > 1 && common(step, count) > 1 {
        step -= 1;
    }
    (0..count).map(move |k| (k * step.max(1)) % count)
}

/// Normal equations of a step of a map.
#[derive(Debug, Clone, Copy)]
pub(super) struct Normal {
    matrix: [[f64; NUMBERS]; NUMBERS],
    right: [f64; NUMBERS],
}

impl Normal {
    fn of(sums: &[[f64; 6]; 6], right: &[[f64; 3]; 3]) -> Self {
        // Which of the products the product of two parts of the place is.
        const PRODUCT: [[usize; 3]; 3] = [[0, 1, 2], [1, 3, 4], [2, 4, 5]];
        // Which factor two rows of the homography share.
        const FACTOR: [[usize; 3]; 3] = [[0, 1, 3], [1, 2, 4], [3, 4, 5]];
        let mut normal = Self {
            matrix: [[0.0; NUMBERS]; NUMBERS],
            right: [0.0; NUMBERS],
        };
        for i in 0..NUMBERS {
            normal.right[i] = right[i / 3][i % 3];
            for j in 0..NUMBERS {
                normal.matrix[i][j] = sums[FACTOR[i / 3][j / 3]][PRODUCT[i % 3][j % 3]];
            }
        }
        normal
    }

    /// The step within what columns span; none where the rows leave it open.
    pub(super) fn step(&self, columns: &[Map]) -> Option<Map> {
        let count = columns.len();
        let mut a = [[0.0; NUMBERS + 1]; NUMBERS];
        for (i, left) in columns.iter().enumerate() {
            let row: Map =
                std::array::from_fn(|j| (0..NUMBERS).map(|k| left[k] * self.matrix[k][j]).sum());
            for (j, column) in columns.iter().enumerate() {
                a[i][j] = (0..NUMBERS).map(|k| row[k] * column[k]).sum();
            }
            a[i][NUMBERS] = (0..NUMBERS).map(|k| left[k] * self.right[k]).sum();
        }
        // A touch of damping: what the vectors do not tell stays as it is instead of running away.
        let damping = 1e-12 * (0..count).map(|k| a[k][k]).sum::<f64>();
        for k in 0..count {
            a[k][k] += damping;
        }
        // Cholesky's factors in place, below the diagonal.
        for i in 0..count {
            for j in 0..=i {
                let sum = a[i][j] - (0..j).map(|k| a[i][k] * a[j][k]).sum::<f64>();
                if i == j {
                    if sum.is_nan() || sum <= 0.0 {
                        return None;
                    }
                    a[i][i] = sum.sqrt();
                } else {
                    a[i][j] = sum / a[j][j];
                }
            }
        }
        let mut solved = [0.0; NUMBERS];
        for i in 0..count {
            let sum: f64 = (0..i).map(|k| a[i][k] * solved[k]).sum();
            solved[i] = (a[i][NUMBERS] - sum) / a[i][i];
        }
        for i in (0..count).rev() {
            let sum: f64 = (i + 1..count).map(|k| a[k][i] * solved[k]).sum();
            solved[i] = (solved[i] - sum) / a[i][i];
        }
        let step: Map =
            std::array::from_fn(|k| (0..count).map(|i| solved[i] * columns[i][k]).sum());
        step.iter().all(|value| value.is_finite()).then_some(step)
    }
}
