//! Point tracking of lk-core beside the crates `optical-flow-lk` and `kornia-imgproc`: time and accuracy on the same
//! frames, pyramids included, one thread, window of 21 pixels, four levels.
//!
//!     cargo run --release --manifest-path rivals/Cargo.toml

use std::error::Error;
use std::f64::consts::TAU;
use std::time::{Duration, Instant};

use image::GrayImage;
use kornia_image::{Image, ImageSize};
use kornia_imgproc::optical_flow_pyr_lk::{PyrLKParams, calc_optical_flow_pyr_lk};
use lk_core::{Execution, Illumination, Masks, TrackOptions, track_points};
use ndarray::Array2;
use optical_flow_lk::{
    DEFAULT_FB_THRESHOLD, DEFAULT_MIN_EIGEN_THRESHOLD, TrackParams, TrackResult, TrackStatus,
    TrackerContext,
};

const WIDTH: usize = 640;
const HEIGHT: usize = 480;
const WINDOW: usize = 21;
const LEVELS: usize = 4;
const ITERATIONS: usize = 30;
const ROUNDS: usize = 15;

/// Displacement of every pair, in pixels.
const SHIFT: (f64, f64) = (5.3, -3.7);

/// Waves for each band of a texture.
const WAVES: usize = 90;

/// Numbers without a pattern; the same in every run.
struct Random(u64);

impl Random {
    fn uniform(&mut self) -> f64 {
        self.0 = self
            .0
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        ((self.0 >> 33) as f64 + 0.5) / f64::from(1_u32 << 31)
    }

    fn normal(&mut self) -> f64 {
        (-2.0 * self.uniform().ln()).sqrt() * (TAU * self.uniform()).cos()
    }
}

/// A texture as a sum of plane waves, distributed as in noise that Gaussians have smoothed.
struct Texture(Vec<[f64; 4]>);

impl Texture {
    fn new(bands: &[(f64, f64)]) -> Self {
        let mut random = Random(7);
        let total: f64 = bands.iter().map(|(weight, _)| weight * weight).sum();
        let mut waves = Vec::new();
        for (weight, sigma) in bands {
            let deviation = 1.0 / (sigma * 2f64.sqrt());
            let amplitude = 20.0 * weight * (2.0 / WAVES as f64 / total).sqrt();
            for _ in 0..WAVES {
                waves.push([
                    amplitude,
                    deviation * random.normal(),
                    deviation * random.normal(),
                    TAU * random.uniform(),
                ]);
            }
        }
        Self(waves)
    }

    /// The texture moved by (dx, dy), in other light, with noise of one grey level.
    fn frame(&self, (dx, dy): (f64, f64), light: Light, seed: u64) -> Array2<u8> {
        let mut random = Random(seed);
        Array2::from_shape_fn((HEIGHT, WIDTH), |(y, x)| {
            let (x, y) = (x as f64 - dx, y as f64 - dy);
            let level: f64 = self
                .0
                .iter()
                .map(|[amplitude, wx, wy, phase]| amplitude * (wx * x + wy * y + phase).cos())
                .sum();
            (light(105.0 + level) + random.normal())
                .round()
                .clamp(0.0, 255.0) as u8
        })
    }
}

/// A change of light, by grey level.
type Light = fn(f64) -> f64;

/// Where points went; `None` where they were lost.
type Tracks = Vec<Option<[f32; 2]>>;

/// One tracker on one pair of frames.
type Tracker = Box<dyn FnMut(&[[f32; 2]]) -> Result<Tracks, Box<dyn Error>>>;

fn lk_core(prev: &Array2<u8>, next: &Array2<u8>, options: TrackOptions) -> Tracker {
    let (prev, next) = (prev.clone(), next.clone());
    let options = options
        .levels(Some(LEVELS))
        .execution(Execution::default().threads(1));
    Box::new(move |points| {
        let tracks = track_points(
            prev.view(),
            next.view(),
            points,
            None,
            Masks::default(),
            &options,
        )?;
        Ok(tracks
            .iter()
            .map(|track| track.is_valid().then_some(track.position))
            .collect())
    })
}

fn optical_flow_lk(prev: &Array2<u8>, next: &Array2<u8>, check: bool) -> Tracker {
    let gray = |frame: &Array2<u8>| {
        GrayImage::from_fn(WIDTH as u32, HEIGHT as u32, |x, y| {
            image::Luma([frame[(y as usize, x as usize)]])
        })
    };
    let (prev, next) = (gray(prev), gray(next));
    let params = TrackParams {
        window_size: WINDOW,
        max_iterations: ITERATIONS,
        min_eigen_threshold: DEFAULT_MIN_EIGEN_THRESHOLD,
    };
    let mut context = TrackerContext::new();
    let found = |result: &TrackResult| {
        let (x, y) = result.pos;
        (result.status == TrackStatus::Tracked).then_some([x, y])
    };
    Box::new(move |points| {
        let points: Vec<(f32, f32)> = points.iter().map(|[x, y]| (*x, *y)).collect();
        context.prepare(&prev, &next, LEVELS);
        let results = if check {
            context.track_fb(&points, None, params, DEFAULT_FB_THRESHOLD)
        } else {
            context.track(&points, None, params)
        };
        Ok(results.iter().map(found).collect())
    })
}

fn kornia(prev: &Array2<u8>, next: &Array2<u8>) -> Result<Tracker, Box<dyn Error>> {
    let float = |frame: &Array2<u8>| {
        let size = ImageSize {
            width: WIDTH,
            height: HEIGHT,
        };
        Image::<f32, 1>::new(size, frame.iter().map(|level| f32::from(*level)).collect())
    };
    let (prev, next) = (float(prev)?, float(next)?);
    let params = PyrLKParams {
        max_level: LEVELS - 1,
        max_iter: ITERATIONS,
        ..PyrLKParams::default()
    };
    Ok(Box::new(move |points| {
        let result = calc_optical_flow_pyr_lk(&prev, &next, points, None, &params)?;
        Ok(result
            .next_pts
            .iter()
            .zip(&result.status)
            .map(|(position, status)| (*status == 1).then_some(*position))
            .collect())
    }))
}

/// Median error, share of the found that are wrong by more than a pixel, share found.
fn accuracy(points: &[[f32; 2]], tracks: &Tracks) -> (f64, f64, f64) {
    let mut errors: Vec<f64> = points
        .iter()
        .zip(tracks)
        .filter_map(|(from, to)| {
            let to = (*to)?;
            let dx = f64::from(to[0] - from[0]) - SHIFT.0;
            let dy = f64::from(to[1] - from[1]) - SHIFT.1;
            Some(dx.hypot(dy))
        })
        .collect();
    errors.sort_by(f64::total_cmp);
    let count = errors.len().max(1) as f64;
    let wrong = errors.iter().filter(|error| **error > 1.0).count() as f64;
    (
        errors.get(errors.len() / 2).copied().unwrap_or(f64::NAN),
        wrong / count,
        errors.len() as f64 / points.len() as f64,
    )
}

fn main() -> Result<(), Box<dyn Error>> {
    rayon::ThreadPoolBuilder::new()
        .num_threads(1)
        .build_global()?;
    let textures = [
        ("fine", Texture::new(&[(1.0, 1.2), (0.8, 3.0), (0.7, 10.0)])),
        (
            "smooth",
            Texture::new(&[(0.25, 1.5), (0.5, 6.0), (0.9, 25.0)]),
        ),
    ];
    let lights: [(&str, Light); 2] = [("steady", |level| level), ("1.1 x", |level| 1.1 * level)];
    println!("| texture, light, points | tracker | ms | median error, px | wrong | found |");
    println!("|---|---|---|---|---|---|");
    for (texture, scene) in &textures {
        let prev = scene.frame((0.0, 0.0), |level| level, 1);
        for (light, relight) in lights {
            let next = scene.frame(SHIFT, relight, 2);
            let lean = TrackOptions::default()
                .illumination(Illumination::None)
                .max_forward_backward(None);
            let mut trackers: Vec<(&str, Tracker)> = vec![
                ("lk-core", lk_core(&prev, &next, TrackOptions::default())),
                ("lk-core, no checks, no light", lk_core(&prev, &next, lean)),
                (
                    "optical-flow-lk, forward-backward",
                    optical_flow_lk(&prev, &next, true),
                ),
                ("optical-flow-lk", optical_flow_lk(&prev, &next, false)),
                ("kornia-imgproc", kornia(&prev, &next)?),
            ];
            for step in [20, 12] {
                let points: Vec<[f32; 2]> = (64..HEIGHT - 64)
                    .step_by(step)
                    .flat_map(|y| {
                        (64..WIDTH - 64)
                            .step_by(step)
                            .map(move |x| [x as f32, y as f32])
                    })
                    .collect();
                let mut times = vec![Vec::new(); trackers.len()];
                let mut results = Vec::new();
                for round in 0..=ROUNDS {
                    for (index, (_, tracker)) in trackers.iter_mut().enumerate() {
                        let start = Instant::now();
                        let tracks = tracker(&points)?;
                        if round == 0 {
                            results.push(accuracy(&points, &tracks));
                        } else {
                            times[index].push(start.elapsed());
                        }
                    }
                }
                for (index, (name, _)) in trackers.iter().enumerate() {
                    let taken: &mut Vec<Duration> = &mut times[index];
                    taken.sort();
                    let (error, wrong, found) = results[index];
                    println!(
                        "| {texture}, {light}, {} | {name} | {:.2} | {error:.4} | {:.1} % | {:.1} % |",
                        points.len(),
                        taken[taken.len() / 2].as_secs_f64() * 1e3,
                        100.0 * wrong,
                        100.0 * found,
                    );
                }
            }
        }
    }
    Ok(())
}
