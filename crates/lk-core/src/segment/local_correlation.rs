//! Where a small window shows the same structure under another light, as in a shadow: a gain fits it.
//!
//! `docs/explanation/algorithms.md`, section "What moves: MotionSegmenter".

use crate::error::Result;
use crate::execution::Execution;
use crate::parallel::RowsMut;
use crate::simd::{Kernel, Simd, SimdLevel, dispatch};

use super::box_filter::{Window, window_means};
use super::morphology::Size;

/// The window in pixels of half the size.
const WINDOW: Window = Window { size: 5 };
/// Both pictures need structure of so many times the variance of their noise.
const TEXTURE: f32 = 6.0;
/// Shares of a mean square below this are rounding.
const ROUNDING: f32 = 1e-5;
/// Correlation, without the noise's part in the variances, from which on the structure is the same.
const SAME: f32 = 0.85;
/// A shadow or a lamp changes the mean by factors within this range; a dark coat on a bright path is beyond.
const GAINS: [f32; 2] = [0.35, 2.85];
/// Light changes the mean and the contrast alike, up to this factor.
const ALIKE: f32 = 2.5;

/// Write where `image` shows the structure of `reference` under another light.
///
/// Both are finite, and `centres` about their means ([`centre`]). `noise` is the standard deviation of the difference of two pictures of the same. Where there is no
/// structure beyond it nothing is explained: the mask is 0.
///
/// # Errors
///
/// Those of the execution; [`Error::Memory`](crate::Error::Memory).
pub(crate) fn explained_by_light(
    [reference, image]: [&[f32]; 2],
    centres: [f32; 2],
    size: Size,
    noise: f32,
    to: &mut [u8],
    execution: &Execution,
) -> Result<()> {
    let (width, height) = size;
    if width == 0 || height == 0 {
        return Ok(());
    }
    let half = (width.div_ceil(2), height.div_ceil(2));
    let level = execution.simd_level();
    let fill = |y: usize, channels: [&mut [f32]; 5]| {
        let [a, b, aa, bb, ab] = channels;
        for ((plane, centre), to) in [reference, image]
            .into_iter()
            .zip(centres)
            .zip([&mut *a, &mut *b])
        {
            let row = |y: usize| &plane[y.min(height - 1) * width..][..width];
            let rows = [row(2 * y), row(2 * y + 1)];
            dispatch(level, Half { rows, centre, to });
        }
        dispatch(
            level,
            Products {
                from: [a, b],
                to: [aa, bb, ab],
            },
        );
    };
    // Noise of one of two pictures, of the mean of four pixels.
    let noise = noise * noise / 8.0;
    let emit = |local: usize, _, means: [&[f32]; 5], to: &mut RowsMut<'_, u8>| {
        let start = local * to.stride;
        let end = to.data.len().min(start + to.stride);
        judge(
            level,
            means,
            centres,
            noise,
            &mut to.data[start..end],
            width,
        );
    };
    window_means(
        half,
        WINDOW,
        RowsMut::new(to, 2 * width),
        fill,
        emit,
        execution,
    )
}

/// About the mean of a plane: sums of squares of what lies around it lose less to rounding.
pub(crate) fn centre(plane: &[f32]) -> f32 {
    let step = (plane.len() / 1024).max(1);
    let (mut sum, mut count) = (0.0, 0.0);
    for value in plane.iter().step_by(step) {
        sum += f64::from(*value);
        count += 1.0;
    }
    (sum / count) as f32
}

/// Write two rows of a mask, or the last one, from a row of means.
fn judge(
    level: SimdLevel,
    means: [&[f32]; 5],
    centres: [f32; 2],
    noise: f32,
    to: &mut [u8],
    width: usize,
) {
    // The half row stands at the end of the first row until it is spread over it.
    let (first, second) = to.split_at_mut(width);
    let half = means[0].len();
    let at = width - half;
    dispatch(
        level,
        Judge {
            means,
            centres,
            noise,
            to: &mut first[at..],
        },
    );
    // From the left on: what is read lies at or after what is written.
    for x in 0..width {
        first[x] = first[at + x / 2];
    }
    if !second.is_empty() {
        second.copy_from_slice(first);
    }
}

/// Means of blocks of 2 x 2, or of what the frame has of them.
struct Half<'a> {
    rows: [&'a [f32]; 2],
    centre: f32,
    to: &'a mut [f32],
}

impl Kernel for Half<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let (top, last) = self.rows[0].as_chunks::<2>();
        let (bottom, last_bottom) = self.rows[1].as_chunks::<2>();
        for ((to, a), b) in self.to.iter_mut().zip(top).zip(bottom) {
            *to = ((a[0] + a[1]) + (b[0] + b[1])) * 0.25 - self.centre;
        }
        if let (Some(to), [a], [b]) = (self.to.last_mut(), last, last_bottom) {
            *to = (a + b) * 0.5 - self.centre;
        }
    }
}

/// The squares of two rows and their product.
struct Products<'a> {
    from: [&'a [f32]; 2],
    to: [&'a mut [f32]; 3],
}

impl Kernel for Products<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let [a, b] = self.from;
        let [aa, bb, ab] = self.to;
        let width = a.len();
        let b = &b[..width];
        let (aa, bb, ab) = (&mut aa[..width], &mut bb[..width], &mut ab[..width]);
        for x in 0..width {
            aa[x] = a[x] * a[x];
            bb[x] = b[x] * b[x];
            ab[x] = a[x] * b[x];
        }
    }
}

/// Whether the windows of a row show the same under another light.
struct Judge<'a> {
    means: [&'a [f32]; 5],
    centres: [f32; 2],
    noise: f32,
    to: &'a mut [u8],
}

impl Kernel for Judge<'_> {
    type Output = ();

    #[inline(always)]
    fn run<S: Simd>(self, _: S) {
        let width = self.to.len();
        let [a, b, aa, bb, ab] = self.means;
        let (a, b) = (&a[..width], &b[..width]);
        let (aa, bb, ab) = (&aa[..width], &bb[..width], &ab[..width]);
        for x in 0..width {
            // Variances without that of the noise.
            let va = aa[x] - a[x] * a[x] - self.noise;
            let vb = bb[x] - b[x] * b[x] - self.noise;
            let both = ab[x] - a[x] * b[x];
            let least = TEXTURE * self.noise;
            let textured = (va > least.max(ROUNDING * aa[x])) & (vb > least.max(ROUNDING * bb[x]));
            let same = (both > 0.0) & (both * both > SAME * SAME * va * vb);
            let (mean_a, mean_b) = (a[x] + self.centres[0], b[x] + self.centres[1]);
            let lit = (mean_b > GAINS[0] * mean_a) & (mean_b < GAINS[1] * mean_a);
            let (gain, mean) = (mean_a * mean_a * vb, mean_b * mean_b * va);
            let alike = (gain < ALIKE * ALIKE * mean) & (mean < ALIKE * ALIKE * gain);
            self.to[x] = u8::from(textured & same & lit & alike);
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::segment::made::{Numbers, every_way, greys, time};

    /// The same in f64, pixel by pixel of half the size: how far each condition is from its limit, the least of them.
    fn reference([a, b]: [&[f32]; 2], (w, h): Size, noise: f64) -> Vec<f64> {
        let (columns, rows) = (w.div_ceil(2), h.div_ceil(2));
        let half = |plane: &[f32], x: isize, y: isize| {
            let (x, y) = (
                x.clamp(0, columns as isize - 1) as usize,
                y.clamp(0, rows as isize - 1) as usize,
            );
            let at = |x: usize, y: usize| f64::from(plane[y.min(h - 1) * w + x.min(w - 1)]);
            (at(2 * x, 2 * y)
                + at(2 * x + 1, 2 * y)
                + at(2 * x, 2 * y + 1)
                + at(2 * x + 1, 2 * y + 1))
                / 4.0
        };
        let mut margins = Vec::new();
        for y in 0..rows as isize {
            for x in 0..columns as isize {
                let mut m = [0.0; 5];
                for v in y - 2..=y + 2 {
                    for u in x - 2..=x + 2 {
                        let (p, q) = (half(a, u, v), half(b, u, v));
                        for (m, value) in m.iter_mut().zip([p, q, p * p, q * q, p * q]) {
                            *m += value / 25.0;
                        }
                    }
                }
                let n = noise * noise / 8.0;
                let (va, vb, both) = (
                    m[2] - m[0] * m[0] - n,
                    m[3] - m[1] * m[1] - n,
                    m[4] - m[0] * m[1],
                );
                let contrast = (vb / va).sqrt() / (m[1] / m[0]);
                let conditions = [
                    va / n / 6.0 - 1.0,
                    vb / n / 6.0 - 1.0,
                    both / (va.max(0.0) * vb.max(0.0)).sqrt() - 0.85,
                    m[1] / m[0] - 0.35,
                    2.85 - m[1] / m[0],
                    contrast - 0.4,
                    2.5 - contrast,
                ];
                margins.push(
                    conditions
                        .into_iter()
                        .fold(f64::INFINITY, |least, c| if c < least { c } else { least }),
                );
            }
        }
        margins
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(32))]

        #[test]
        fn windows_are_judged_as_their_moments_say(
            w in 1usize..60, h in 1usize..30, seed in any::<u64>(), gain in 0.3f32..3.0, other in 0.0f32..0.6
        ) {
            let a = greys((w, h), seed);
            let b: Vec<f32> = a.iter().zip(greys((w, h), seed ^ 5)).map(|(a, c)| gain * (a + other * c)).collect();
            let want = reference([&a, &b], (w, h), 8.0);
            let mut first: Option<Vec<u8>> = None;
            for execution in every_way() {
                let mut to = vec![7; w * h];
                explained_by_light([&a, &b], [&a, &b].map(|plane| centre(plane)), (w, h), 8.0, &mut to, &execution).unwrap();
                for (at, got) in to.iter().enumerate() {
                    let margin = want[at / w / 2 * w.div_ceil(2) + at % w / 2];
                    prop_assert!(*got < 2 && (margin.abs() < 1e-3 || (*got == 1) == (margin > 0.0)));
                }
                prop_assert_eq!(first.get_or_insert(to.clone()), &to);
            }
        }
    }

    /// Structure of some pixels, with noise of its own in each picture.
    fn scene((w, h): Size, noise: f64, seed: u64, grey: impl Fn(f64, f64) -> f64) -> Vec<f32> {
        let mut numbers = Numbers::new(seed);
        (0..w * h)
            .map(|at| (grey((at % w) as f64, (at / w) as f64) + noise * numbers.normal()) as f32)
            .collect()
    }

    #[test]
    fn shadows_are_explained_and_things_and_plain_walls_are_not() {
        let size = (240, 160);
        let ground = |x: f64, y: f64| {
            120.0 + 25.0 * (0.7 * x + 0.2 * y).sin() + 25.0 * (0.55 * y - 0.3 * x).cos()
        };
        let thing = |x: f64, y: f64| {
            120.0 + 25.0 * (0.6 * x - 0.5 * y).cos() + 25.0 * (0.8 * y + 0.1 * x).sin()
        };
        let share = |a: &[f32], b: &[f32]| {
            let mut to = vec![0; a.len()];
            explained_by_light(
                [a, b],
                [a, b].map(centre),
                size,
                4.0,
                &mut to,
                &Execution::default(),
            )
            .unwrap();
            to.iter().map(|set| f64::from(*set)).sum::<f64>() / to.len() as f64
        };
        let noise = 4.0 / 2f64.sqrt();
        let before = scene(size, noise, 1, ground);
        for gain in [0.5, 0.7, 1.0, 1.6] {
            let now = scene(size, noise, 2, |x, y| gain * ground(x, y));
            let share = share(&before, &now);
            assert!(share > 0.95, "gain {gain}: {share}");
        }
        for (name, most, now) in [
            ("a thing", 0.03, scene(size, noise, 2, thing)),
            ("a plain thing", 0.0, scene(size, noise, 2, |_, _| 90.0)),
            (
                "a black coat",
                0.0,
                scene(size, noise, 2, |x, y| 0.2 * ground(x, y)),
            ),
        ] {
            let share = share(&before, &now);
            assert!(share <= most, "{name}: {share}");
        }
        let wall = |seed| scene(size, noise, seed, |_, _| 120.0);
        assert_eq!(share(&wall(3), &wall(4)), 0.0);
    }

    #[test]
    #[ignore = "figures for those who change the kernels"]
    fn time_of_light() {
        let size = (640, 480);
        let (a, mut to) = (greys(size, 1), vec![0; 640 * 480]);
        let one = Execution::default().threads(1);
        time("explained by light", size, &mut || {
            explained_by_light([&a, &a], [centre(&a); 2], size, 4.0, &mut to, &one).unwrap()
        });
    }
}
