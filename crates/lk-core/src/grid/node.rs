//! One node: its window fitted from a start, and whether what was found may stand.

use super::cholesky::MOST;
use super::covariance::{Covariance, MOTION, TilePull};
use super::fit::{Failure, Fitted, Fitting};
use super::result::{GridNode, GridStatus};
use super::shape::Warp;
use super::window::Window;
use crate::error::Result;
use crate::frame::Plane;

/// Least correlation with what was found: four windows in five of particles of which two in five are others have more,
/// of unrelated ones one in twenty.
const LEAST_CORRELATION: f64 = 0.45;
/// The greatest standard deviation, in pixels.
const MOST_DEVIATION: f64 = 0.3;

/// Pixels from one that is looked at for texture to the next.
const SPARSE: usize = 4;

/// What was found at a node.
#[derive(Debug, Clone, Copy)]
pub(super) struct Measured {
    pub(super) warp: Warp,
    /// Of u and its derivatives per half window, and of v.
    pub(super) covariance: Covariance,
    /// How far a quadratic shape would be from this one, in u and v.
    pub(super) bend: [f64; 2],
    pub(super) correlation: f64,
    pub(super) variance: f64,
    /// Gain, and offset in grey levels at the node.
    pub(super) light: [f64; 2],
    /// Why it may not stand; [`GridStatus::Measured`] where it may.
    pub(super) status: GridStatus,
}

impl Measured {
    /// The standard deviation of the displacement, along the axis where it is greater.
    pub(super) fn deviation(&self) -> f64 {
        let [u, v] = [0, 1].map(|axis| {
            let at = axis * (MOTION / 2);
            self.covariance[at][at] + self.bend[axis].powi(2)
        });
        u.max(v).sqrt()
    }

    /// As a caller gets it; `half` is what the window reaches, and a shape of degree 0 has no slopes.
    pub(super) fn node(&self, half: f64, degree: usize) -> GridNode {
        // From u, du/dx, du/dy, v, dv/dx, dv/dy per half window to u, v and the derivatives per pixel.
        const ORDER: [usize; MOTION] = [0, 3, 1, 2, 4, 5];
        let unit = |at: usize| {
            if ORDER[at].is_multiple_of(3) {
                1.0
            } else {
                1.0 / half
            }
        };
        let mut covariance = [[0.0; MOTION]; MOTION];
        for (i, row) in covariance.iter_mut().enumerate() {
            for (j, to) in row.iter_mut().enumerate() {
                *to = (self.covariance[ORDER[i]][ORDER[j]] * unit(i) * unit(j)) as f32;
            }
        }
        let mut gradient = self.warp.gradient(half).map(|row| row.map(|d| d as f32));
        if degree == 0 {
            gradient = [[f32::NAN; 2]; 2];
            for (at, row) in covariance.iter_mut().enumerate().skip(2) {
                row[at] = f32::INFINITY;
            }
        }
        let node = GridNode {
            status: self.status,
            displacement: self.warp.displacement().map(|d| d as f32),
            gradient,
            covariance,
            residual: self.variance.max(0.0).sqrt() as f32,
            correlation: self.correlation as f32,
            gain: self.light[0] as f32,
            offset: self.light[1] as f32,
        };
        if self.status == GridStatus::Measured {
            node
        } else {
            node.refused(self.status)
        }
    }
}

/// What a thread keeps from node to node.
#[derive(Debug, Default)]
pub(super) struct Workspace {
    window: Window,
    pulls: Vec<TilePull>,
    pub(super) surface: Plane,
}

thread_local! {
    static KEPT: std::cell::Cell<Workspace> = std::cell::Cell::default();
}

impl Workspace {
    /// Call `work` with the memory of this thread.
    pub(super) fn with<R>(work: impl FnOnce(&mut Self) -> R) -> R {
        let mut kept = KEPT.take();
        let found = work(&mut kept);
        KEPT.set(kept);
        found
    }
}

impl Fitting<'_> {
    /// Measure the window whose first pixel is at `corner`, from the first of `starts` on: each is fitted by its degree
    /// and hands its result to the next.
    ///
    /// # Errors
    ///
    /// Those of the memory.
    pub(super) fn measure(
        &self,
        corner: [usize; 2],
        start: Warp,
        by_steps: bool,
        workspace: &mut Workspace,
    ) -> Result<std::result::Result<Measured, GridStatus>> {
        let Workspace { window, pulls, .. } = workspace;
        window.take(self.frames, self.pattern, corner)?;
        let mut start = start;
        if by_steps && self.degree > 1 {
            // A shape of fewer unknowns finds its way from further off.
            let plain = Self {
                degree: 1,
                robust: false,
                ..*self
            };
            match plain.fit(window, corner, start) {
                Ok(fitted) => start = fitted.warp,
                Err(failure) => return Ok(Err(status_of(failure))),
            }
        }
        let fitted = match self.fit(window, corner, start) {
            Ok(fitted) => fitted,
            Err(failure) => return Ok(Err(status_of(failure))),
        };
        let covariance = self.covariance(&fitted, window, pulls)?;
        let [variance, explained] = shares(window, fitted.light[0]);
        let light = [fitted.light[0], self.offset(&fitted)];
        let mut measured = Measured {
            warp: fitted.warp,
            covariance,
            bend: if self.degree < 2 {
                self.bend(window, &fitted)
            } else {
                [0.0; 2]
            },
            correlation: (explained / (explained + variance).max(1e-30)).sqrt(),
            variance,
            light,
            status: GridStatus::Measured,
        };
        measured.status = judged(&measured);
        Ok(Ok(measured))
    }

    /// Why the window at `corner` was not even tried.
    ///
    /// # Errors
    ///
    /// Those of the memory.
    pub(super) fn reason_at(
        &self,
        corner: [usize; 2],
        workspace: &mut Workspace,
    ) -> Result<GridStatus> {
        let window = &mut workspace.window;
        window.take(self.frames, self.pattern, corner)?;
        let reason = self.reason(window, corner);
        Ok(reason.map_or(GridStatus::NotFound, status_of))
    }

    /// How much texture the window at `corner` has: the mean square of its slopes at some of its pixels that count.
    pub(super) fn texture(&self, corner: [usize; 2]) -> f32 {
        let some = |at: usize| (corner[at]..corner[at] + self.pattern.side).step_by(SPARSE);
        let mut sum = 0.0;
        for y in some(1) {
            let support = self.frames.prev_support.row(y);
            let slopes = self.frames.slopes.each_ref().map(|plane| plane.row(y));
            for x in some(0) {
                if support.get(x).is_none_or(|byte| *byte > 0) {
                    sum += slopes[0][x] * slopes[0][x] + slopes[1][x] * slopes[1][x];
                }
            }
        }
        sum
    }

    /// The offset of the light at the window's centre, in grey levels as they came.
    fn offset(&self, fitted: &Fitted) -> f64 {
        let level = self.frames.level;
        fitted.light[1] + level - fitted.light[0] * level
    }
}

fn status_of(failure: Failure) -> GridStatus {
    match failure {
        Failure::Support => GridStatus::LowSupport,
        Failure::Texture => GridStatus::LowTexture,
        Failure::Diverged => GridStatus::NotConverged,
    }
}

/// Whether it may stand by itself.
fn judged(measured: &Measured) -> GridStatus {
    // Both are false for NaN.
    let alike = measured.correlation >= LEAST_CORRELATION;
    let sure = measured.deviation() <= MOST_DEVIATION;
    match (alike, sure) {
        (true, true) => GridStatus::Measured,
        (true, false) => GridStatus::Unsure,
        (false, _) => GridStatus::LowCorrelation,
    }
}

/// The mean square of what is left, and the variance of the template times the gain: of all pixels that count, however
/// they are weighted.
fn shares(window: &Window, gain: f64) -> [f64; 2] {
    let mut sums = [[0.0f32; MOST]; 4];
    let lanes = window.met.as_chunks::<MOST>().0.iter();
    let lanes = lanes
        .zip(window.template.as_chunks::<MOST>().0)
        .zip(window.residual.as_chunks::<MOST>().0);
    for ((met, template), residual) in lanes {
        for lane in 0..MOST {
            let (m, t, r) = (met[lane], template[lane], residual[lane]);
            sums[0][lane] += m;
            sums[1][lane] += m * t;
            sums[2][lane] += m * t * t;
            sums[3][lane] += m * r * r;
        }
    }
    let [count, level, square, left] =
        sums.map(|lanes| lanes.into_iter().map(f64::from).sum::<f64>());
    let count = count.max(1.0);
    [
        left / count,
        gain * gain * (square / count - (level / count).powi(2)).max(0.0),
    ]
}
