//! Bouguet's tracker as OpenCV has it: steps, stops and statuses of `cv2.calcOpticalFlowPyrLK`, for programs that were
//! tuned to it. It knows no light, no covariance and no doubt; [`super::track_points`] does.
//!
//! J.-Y. Bouguet, "Pyramidal implementation of the affine Lucas Kanade feature tracker", Intel, 2001.

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::frame::{Frame, Pixel, Plane, expect_size};
use crate::memory::resize;
use crate::options::setters;
use crate::parallel::{RowsMut, for_each_band};
use crate::pyramid::Pyramid;
use crate::simd::{SimdLevel, dispatch};
use crate::track::options::POINTS;
use crate::track::patch::{
    AbsoluteDifference, BorderScratch, BuildTemplate, Compare, Light, Sampling, Template, Window,
};

/// Steps of opposite direction that differ by less than this, in pixels, are an oscillation.
const OSCILLATION: f64 = 0.01;

/// OpenCV scales its eigenvalues by this: its gradients are 32 times, and its sums 2^-20 times, those of grey levels.
const EIGENVALUE_SCALE: f64 = 1.0 / 1024.0;

/// Points that one thread takes at least.
const MIN_POINTS: usize = 16;

/// The parameters of `cv2.calcOpticalFlowPyrLK`.
#[derive(Debug, Clone)]
pub struct PyrLkOptions {
    window: Window,
    max_level: usize,
    iterations: usize,
    epsilon: f64,
    min_eigenvalue: f64,
    eigenvalue_as_error: bool,
    execution: Execution,
}

impl Default for PyrLkOptions {
    fn default() -> Self {
        Self {
            window: Window::default(),
            max_level: 3,
            iterations: 30,
            epsilon: 0.01,
            min_eigenvalue: 1e-4,
            eigenvalue_as_error: false,
            execution: Execution::default(),
        }
    }
}

impl PyrLkOptions {
    /// Width and height of the window, 3 to 63 pixels; 21 by 21 by default.
    #[must_use]
    pub fn window_size(mut self, width: usize, height: usize) -> Self {
        self.window = Window { width, height };
        self
    }

    setters! {
        /// Index of the coarsest level; 3 by default.
        max_level(level: usize);

        /// The least smaller eigenvalue of the mean structure tensor, in 1/1024 of squared grey levels per pixel;
        /// 1e-4 by default.
        min_eigenvalue(threshold: f64);

        /// Give that eigenvalue as the error, in place of the mean absolute difference.
        eigenvalue_as_error(yes: bool);

        /// Threads, instructions and cancellation.
        execution(execution: Execution);
    }

    /// When to stop on a level: after so many steps, or one of this length in pixels; 30 and 0.01 by default.
    #[must_use]
    pub fn criteria(mut self, iterations: usize, epsilon: f64) -> Self {
        self.iterations = iterations;
        self.epsilon = epsilon;
        self
    }

    /// Levels that the window fits into.
    fn levels(&self, (mut height, mut width): (usize, usize)) -> usize {
        let mut levels = 1;
        while levels <= self.max_level {
            (height, width) = (height.div_ceil(2), width.div_ceil(2));
            if width <= self.window.width || height <= self.window.height {
                break;
            }
            levels += 1;
        }
        levels
    }
}

/// Where one point went, in OpenCV's terms.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub struct PyrLkPoint {
    /// Position (x, y) in `next`; where the search ended if the point was lost.
    pub position: [f32; 2],
    /// Whether it ended inside of the frame, on texture.
    pub found: bool,
    /// Mean absolute difference of the windows in grey levels, or the eigenvalue.
    pub error: f32,
}

/// Where each of `points` is in `next`; `initial` holds a first guess of each position.
///
/// # Errors
///
/// [`Error::Shape`] if the frames or `initial` do not fit together, [`Error::Option`] for a window outside of 3 to 63
/// pixels; those of the execution.
pub fn track_pyr_lk<T: Pixel>(
    prev: Frame<'_, T>,
    next: Frame<'_, T>,
    points: &[[f32; 2]],
    initial: Option<&[[f32; 2]]>,
    options: &PyrLkOptions,
) -> Result<Vec<PyrLkPoint>> {
    options.window.expect_allowed("winSize")?;
    expect_size("nextImg", next.dim(), "prevImg", prev.dim())?;
    if initial.is_some_and(|initial| initial.len() != points.len()) {
        return Err(Error::shape(
            "nextPts",
            format!("{} points", initial.map_or(0, <[[f32; 2]]>::len)),
            format!("one for each of the {} points of prevPts", points.len()),
        ));
    }
    let levels = options.levels(prev.dim());
    let prev = Pyramid::new(prev, levels, &options.execution)?;
    let next = Pyramid::new(next, levels, &options.execution)?;
    let lost = PyrLkPoint {
        position: [f32::NAN; 2],
        found: false,
        error: 0.0,
    };
    let mut tracks = Vec::new();
    resize(POINTS, &mut tracks, points.len(), lost)?;
    if prev.levels()[0].data().is_empty() {
        return Ok(tracks);
    }
    for_each_band(
        &options.execution,
        points.len(),
        MIN_POINTS,
        RowsMut::new(&mut tracks, 1),
        |range, part| {
            let mut search = Search {
                prev: prev.levels(),
                next: next.levels(),
                options,
                level: options.execution.simd_level(),
                template: Template::new(),
                scratch: BorderScratch::new(),
            };
            for (track, index) in part.data.iter_mut().zip(range) {
                let guess = initial.map_or(points[index], |initial| initial[index]);
                *track = search.track(points[index], guess);
            }
        },
    )?;
    Ok(tracks)
}

struct Search<'a> {
    prev: &'a [Plane],
    next: &'a [Plane],
    options: &'a PyrLkOptions,
    level: SimdLevel,
    template: Template,
    scratch: BorderScratch,
}

impl Search<'_> {
    fn track(&mut self, point: [f32; 2], guess: [f32; 2]) -> PyrLkPoint {
        let top = self.prev.len() - 1;
        let scale = 1.0 / f64::from(1u32 << top);
        let mut result = PyrLkPoint {
            position: guess,
            found: true,
            error: 0.0,
        };
        if !point.iter().chain(&guess).all(|value| value.is_finite()) {
            result.found = false;
            return result;
        }
        let mut position = guess.map(|coordinate| f64::from(coordinate) * scale);
        for level in (0..=top).rev() {
            if level < top {
                position = position.map(|coordinate| 2.0 * coordinate);
            }
            let centre = point.map(|coordinate| coordinate / (1u32 << level) as f32);
            let found = self.on_level(level, centre, &mut position, &mut result.error);
            if level == 0 {
                result.found = found;
            }
        }
        result.position = position.map(|coordinate| coordinate as f32);
        result
    }

    /// Move `position` on one level; whether the point stands.
    fn on_level(
        &mut self,
        level: usize,
        centre: [f32; 2],
        position: &mut [f64; 2],
        error: &mut f32,
    ) -> bool {
        let window = self.options.window;
        let area = window.area();
        if !self.reaches(level, centre) {
            return false;
        }
        dispatch(
            self.level,
            BuildTemplate {
                template: &mut self.template,
                prev: &self.prev[level],
                centre,
                window,
                sampling: Sampling::Bouguet,
                light: Light::STEADY,
                scratch: &mut self.scratch,
            },
        );
        self.template.flatten_outside(&self.prev[level], centre);
        let [.., xx, xy, yy] = self.template.sums.products;
        let determinant = xx * yy - xy * xy;
        let weakest = 0.5 * (xx + yy - ((xx - yy) * (xx - yy) + 4.0 * xy * xy).sqrt());
        let eigenvalue = weakest * EIGENVALUE_SCALE / area;
        if self.options.eigenvalue_as_error {
            *error = eigenvalue as f32;
        }
        let scaled = determinant * EIGENVALUE_SCALE * EIGENVALUE_SCALE;
        let textured =
            eigenvalue >= self.options.min_eigenvalue && scaled >= f64::from(f32::EPSILON);
        if !textured {
            return false;
        }
        let mut last = [0.0; 2];
        for iteration in 0..self.options.iterations {
            let Some(sums) = self.compare(level, *position) else {
                return false;
            };
            let [_, x, y] = sums.products;
            let by = [
                (xy * y - yy * x) / determinant,
                (xy * x - xx * y) / determinant,
            ];
            *position = [position[0] + by[0], position[1] + by[1]];
            if by[0] * by[0] + by[1] * by[1] <= self.options.epsilon * self.options.epsilon {
                break;
            }
            if iteration > 0
                && (by[0] + last[0]).abs() < OSCILLATION
                && (by[1] + last[1]).abs() < OSCILLATION
            {
                *position = [position[0] - 0.5 * by[0], position[1] - 0.5 * by[1]];
                break;
            }
            last = by;
        }
        if level > 0 || self.options.eigenvalue_as_error {
            return true;
        }
        let centre = position.map(|coordinate| coordinate as f32);
        let reached = self.reaches(level, centre);
        if reached {
            let compare = Compare {
                template: &self.template,
                next: &self.next[level],
                centre,
                squared: false,
                scratch: &mut self.scratch,
            };
            *error = (dispatch(self.level, AbsoluteDifference(compare)) / area) as f32;
        }
        reached
    }

    /// Whether some of the window around `centre` is near the plane: the same bounds as OpenCV's.
    fn reaches(&self, level: usize, centre: [f32; 2]) -> bool {
        let plane = &self.next[level];
        let window = self.options.window;
        let half = window.half();
        let near = |coordinate: f32, half: f32, side: usize, size: usize| {
            let first = (coordinate - half).floor();
            first >= -(side as f32) && first < size as f32
        };
        near(centre[0], half[0], window.width, plane.width())
            && near(centre[1], half[1], window.height, plane.height())
    }

    fn compare(&mut self, level: usize, at: [f64; 2]) -> Option<crate::track::patch::Sums> {
        let centre = at.map(|coordinate| coordinate as f32);
        self.reaches(level, centre).then(|| {
            dispatch(
                self.level,
                Compare {
                    template: &self.template,
                    next: &self.next[level],
                    centre,
                    squared: false,
                    scratch: &mut self.scratch,
                },
            )
        })
    }
}
