//! Rounds of robust least squares over the rows: where to begin, what is best, what is simplest.

use super::camera_model::{CameraModel, MODELS};
use super::camera_rows::{IDENTITY, Map, NUMBERS, Rows, mapped};
use super::camera_samples::{Random, affine, homography, in_front, similarity};

/// Tukey's biweight: 95 % efficiency for normal errors.
const TUKEY: f64 = 4.685;
/// Beyond this many squared deviations (99.9 % of two normal components) a vector no longer adds to the evidence.
const BOUND: f64 = 13.69;
/// Flow is not better than this, whatever the residuals say: interpolation and quantisation, in pixels.
const LEAST_SIGMA_PX: f64 = 0.02;
/// Samples of two, of three and of four vectors each, of the first so many, which are spread over the frame.
const SAMPLES: [usize; 3] = [8, 12, 56];
const SAMPLED: usize = 128;
/// All are judged by the first so many vectors, and so many of the best by all of these.
const GLANCE: usize = 48;
const LOOKED_AT: usize = 20;
/// Starts that are refined, each in so many rounds; and rounds of the best.
const STARTS: usize = 5;
const START_ROUNDS: usize = 3;
const ROUNDS: usize = 4;
/// Squared deviations from which a loss grows slowly: that of a start, and that of a refined one.
const START_SLOW: f64 = 16.0;
const SLOW: f64 = 9.0;
/// The scale is that of this share of the vectors: fewer follow nothing else.
const SCALE_SHARE: f64 = 0.35;
/// What a plane gains, beside the mean loss, by the logarithm of the area that its vectors span, and by going on as
/// before, within a pixel or this share of the motion.
const SPREAD_GAIN: f64 = 0.1;
const BEFORE_GAIN: f64 = 0.05;
const BEFORE_SHARE: f64 = 0.25;

/// The rows, and memory for the rounds.
pub(super) struct Fit<'a> {
    rows: &'a Rows,
    squares: Vec<f64>,
    sorted: Vec<f64>,
    weights: Vec<f64>,
}

impl<'a> Fit<'a> {
    pub(super) fn over(rows: &'a Rows) -> Self {
        Self {
            squares: vec![0.0; rows.len()],
            sorted: vec![0.0; rows.len()],
            weights: vec![0.0; rows.len()],
            rows,
        }
    }

    /// The map to begin with: the best of the starts after a few rounds each over the first rows.
    pub(super) fn start(&mut self, before: Option<&Map>) -> Map {
        let few = self.rows.len().min(SAMPLED);
        let mut starts: Vec<Map> = Vec::with_capacity(SAMPLES.iter().sum::<usize>() + 2);
        starts.push(self.median());
        starts.extend(before);
        let mut random = Random(0x9E37_79B9_7F4A_7C15);
        for _ in 0..SAMPLES[0] {
            starts.extend(similarity(self.rows, random.places(few)));
        }
        for _ in 0..SAMPLES[1] {
            starts.extend(affine(self.rows, random.places(few)));
        }
        for _ in 0..SAMPLES[2] {
            let four = homography(self.rows, random.places(few));
            starts.extend(four.filter(|map| in_front(map, self.rows)));
        }
        let mut losses = vec![0.0; LOOKED_AT * few];
        self.glance(&mut starts, few.min(GLANCE));
        for (map, losses) in starts.iter().zip(losses.chunks_mut(few)) {
            self.rows.squares(map, losses);
            for loss in losses {
                *loss /= *loss + START_SLOW;
            }
        }
        losses.truncate(starts.len() * few);
        let mut maps: Vec<Map> = Vec::with_capacity(STARTS);
        // The noise is what the best leaves, where that is more than the covariances say.
        let mut noise = f64::INFINITY;
        // What a start explains has no say in the choice of the next one, or all would be of the same plane.
        let mut left = vec![1.0; few];
        for _ in 0..STARTS {
            let of = |losses: &[f64]| -> f64 { losses.iter().zip(&left).map(|(l, w)| l * w).sum() };
            let chosen = losses
                .chunks(few)
                .map(of)
                .enumerate()
                .min_by(|a, b| a.1.total_cmp(&b.1));
            let Some((chosen, _)) = chosen else { break };
            for (left, loss) in left.iter_mut().zip(&losses[chosen * few..]) {
                *left *= loss;
            }
            let map = self.refined(starts[chosen], CameraModel::Homography, START_ROUNDS, few);
            maps.push(map);
            noise = noise.min(self.scale(&map, few));
        }
        let slow = SLOW * noise.max(1.0);
        let merits: Vec<f64> = maps
            .iter()
            .map(|map| self.merit(map, before, slow, few))
            .collect();
        let best = merits.iter().zip(&maps).max_by(|a, b| a.0.total_cmp(b.0));
        best.map_or(IDENTITY, |(_, map)| *map)
    }

    /// Keep the best starts by a few rows.
    fn glance(&mut self, starts: &mut Vec<Map>, few: usize) {
        let mut judged: Vec<(f64, usize)> = Vec::with_capacity(starts.len());
        for (k, map) in starts.iter().enumerate() {
            self.rows.squares(map, &mut self.squares[..few]);
            let loss = self.squares[..few]
                .iter()
                .map(|square| square / (square + START_SLOW));
            judged.push((loss.sum(), k));
        }
        judged.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        judged.truncate(LOOKED_AT);
        *starts = judged.iter().map(|&(_, k)| starts[k]).collect();
    }

    fn median(&mut self) -> Map {
        let mut map = IDENTITY;
        for axis in 0..2 {
            let (to, from) = if axis == 0 {
                (&self.rows.to_x, &self.rows.x)
            } else {
                (&self.rows.to_y, &self.rows.y)
            };
            for ((out, to), from) in self.sorted.iter_mut().zip(to).zip(from) {
                *out = to - from;
            }
            map[2 + 3 * axis] = quantile(&mut self.sorted, 0.5);
        }
        map
    }

    /// How well a map explains the frame: the mean of a slow loss, less for vectors that stand close together.
    fn merit(&mut self, map: &Map, before: Option<&Map>, slow: f64, few: usize) -> f64 {
        self.rows.squares(map, &mut self.squares[..few]);
        let (mut loss, mut whole) = (0.0, 0.0);
        let (mut inside, mut all) = (Moments::default(), Moments::default());
        for (k, square) in self.squares[..few].iter().enumerate() {
            let area = self.rows.area[k];
            loss += area * square / (square + slow);
            whole += area;
            inside.add(
                self.rows.x[k],
                self.rows.y[k],
                area * slow / (square + slow),
            );
            all.add(self.rows.x[k], self.rows.y[k], area);
        }
        let spread = (inside.area() / all.area().max(1e-12)).clamp(1e-3, 1.0);
        let goes_on = before.is_some_and(|before| {
            apart_px(before, map, self.rows)
                < (BEFORE_SHARE * apart_px(before, &IDENTITY, self.rows)).max(1.0)
        });
        let gain = if goes_on { BEFORE_GAIN } else { 0.0 };
        SPREAD_GAIN * spread.ln() + gain - loss / whole
    }

    /// Reweighted least squares with Tukey's weight and a scale that is fitted too.
    fn refined(&mut self, start: Map, model: CameraModel, rounds: usize, few: usize) -> Map {
        let mut map = start;
        for _ in 0..rounds {
            self.weigh(&map, few);
            let normal = self.rows.normal(&map, &self.weights[..few]);
            let Some(step) = normal.step(model.columns()) else {
                break;
            };
            let next: Map = std::array::from_fn(|k| map[k] + step[k]);
            if !in_front(&next, self.rows) {
                break;
            }
            map = next;
            if apart_px(&std::array::from_fn(|k| map[k] - step[k]), &map, self.rows) < 1e-4 {
                break;
            }
        }
        map
    }

    /// The variance of the residuals to a map, in those that they came with.
    fn scale(&mut self, map: &Map, few: usize) -> f64 {
        self.rows.squares(map, &mut self.squares[..few]);
        self.sorted[..few].copy_from_slice(&self.squares[..few]);
        let middle = quantile(&mut self.sorted[..few], SCALE_SHARE);
        // Squares of two normal components: -2 ln (1 - share). No less than what the covariances have at least.
        (middle / (-2.0 * (1.0 - SCALE_SHARE).ln())).max(1e-4)
    }

    fn weigh(&mut self, map: &Map, few: usize) {
        let most = 1.0 / (TUKEY * TUKEY * self.scale(map, few));
        for ((weight, square), area) in self.weights[..few]
            .iter_mut()
            .zip(&self.squares)
            .zip(&self.rows.area)
        {
            let left = (1.0 - square * most).max(0.0);
            *weight = left * left * area;
        }
    }

    /// The simplest model that explains as much as the richest one.
    pub(super) fn simplest(&mut self, start: Map) -> (CameraModel, Map) {
        let rows = self.rows;
        let count = rows.len() as f64;
        let richest = self.refined(start, CameraModel::Homography, ROUNDS, rows.len());
        self.weigh(&richest, rows.len());
        let normal = rows.normal(&IDENTITY, &self.weights);
        // The noise is what the richest model leaves.
        let free = 1.0 - NUMBERS as f64 / (2.0 * count);
        let sigma = self.noise(&richest).0 / free.max(0.2).sqrt();
        let mut fits: Vec<(f64, CameraModel, Map)> = Vec::with_capacity(MODELS.len());
        for model in MODELS {
            let columns = model.columns();
            let map = if model == CameraModel::Homography {
                richest
            } else {
                let Some(step) = normal.step(columns) else {
                    continue;
                };
                std::array::from_fn(|k| IDENTITY[k] + step[k])
            };
            rows.squares_px(&map, &mut self.squares);
            let bounded: f64 = self
                .squares
                .iter()
                .map(|square| (square / (sigma * sigma)).min(BOUND))
                .sum();
            let evidence = bounded + columns.len() as f64 * (2.0 * count).ln();
            fits.push((evidence, model, map));
        }
        let best = fits
            .iter()
            .min_by(|a, b| a.0.total_cmp(&b.0))
            .map_or(richest, |fit| fit.2);
        // Errors of neighbouring vectors are alike: what a richer model explains by less than flow can tell is no motion.
        let (model, map) = fits
            .iter()
            .find(|(_, _, map)| apart_px(map, &best, rows) < LEAST_SIGMA_PX)
            .map_or((CameraModel::Homography, richest), |fit| (fit.1, fit.2));
        if model == CameraModel::Homography {
            return (model, map);
        }
        (model, self.refined(map, model, 2, rows.len()))
    }

    /// Standard deviation of a component of the vectors that follow a map, in pixels, and the share of these.
    pub(super) fn noise(&mut self, map: &Map) -> (f64, f64) {
        self.rows.squares_px(map, &mut self.sorted);
        self.squares.copy_from_slice(&self.sorted);
        let scale = |value: f64, share: f64| (value / (-2.0 * (1.0_f64 - share).ln())).sqrt();
        let mut sigma =
            scale(quantile(&mut self.sorted, SCALE_SHARE), SCALE_SHARE).max(LEAST_SIGMA_PX);
        let mut share = 0.0;
        // The median of those that follow: three rounds are enough.
        for _ in 0..3 {
            let within = BOUND * sigma * sigma;
            self.sorted.clear();
            self.sorted
                .extend(self.squares.iter().filter(|&&square| square < within));
            share = self.sorted.len() as f64 / self.squares.len() as f64;
            sigma = scale(quantile(&mut self.sorted, 0.5), 0.5).max(LEAST_SIGMA_PX);
        }
        self.sorted.resize(self.squares.len(), 0.0);
        (sigma, share)
    }
}

/// Sums for the area over which weighted places spread.
#[derive(Default)]
struct Moments([f64; 6]);

impl Moments {
    fn add(&mut self, x: f64, y: f64, weight: f64) {
        let parts = [1.0, x, y, x * x, x * y, y * y];
        for (sum, part) in self.0.iter_mut().zip(parts) {
            *sum += weight * part;
        }
    }

    fn area(&self) -> f64 {
        let [whole, x, y, xx, xy, yy] = self.0;
        let (x, y) = (x / whole, y / whole);
        let (xx, xy, yy) = (xx / whole - x * x, xy / whole - x * y, yy / whole - y * y);
        (xx * yy - xy * xy).max(0.0).sqrt()
    }
}

/// A value that this share of the values is below; the values change places.
fn quantile(values: &mut [f64], share: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let at = ((values.len() - 1) as f64 * share).round() as usize;
    *values.select_nth_unstable_by(at, f64::total_cmp).1
}

/// How far two maps take the corners and the middle of the vectors' surroundings from each other, in pixels.
fn apart_px(a: &Map, b: &Map, rows: &Rows) -> f64 {
    let mut sum = 0.0;
    for (x, y) in [
        (-1.5, -1.5),
        (1.5, -1.5),
        (0.0, 0.0),
        (-1.5, 1.5),
        (1.5, 1.5),
    ] {
        let ([ax, ay], [bx, by]) = (mapped(a, x, y), mapped(b, x, y));
        sum += (ax - bx).powi(2) + (ay - by).powi(2);
    }
    (sum / 5.0).sqrt() * rows.size
}
