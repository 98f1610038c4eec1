//! A frame and its flow as a segmenter takes them: grey levels, motion vectors, what the camera and depth explain.

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::frame::{Frame, Pixel};
use crate::memory::{replace, resize};
use crate::parallel::{RowsMut, even_bands, for_each_band};

use super::MotionVector;
use super::camera::{CameraModel, CameraMotion, fit_camera};
use super::flow_evidence::quantile;
use super::flow_kernels::Frames;
use super::parallax::find_parallax;
use super::placed::nearest_mask;
use super::reduction::{Reduction, reduce};
use super::segmenter::{GivenFlow, Segmenter, Work};
use super::transform::{IDENTITY, inverse, product, reduced};

/// Vectors for the camera's motion stand this far apart in pixels of the flow: about the reach of its own smoothness.
const VECTOR_STEP: usize = 12;
/// The frame is divided into so many tiles along each side, and each gives at most so many vectors.
const TILES: usize = 8;
const VECTORS_A_TILE: usize = 8;
/// Motion below this many pixels per frame, or deviations of the camera's, is not told from rest by the flow.
const LEAST_MOTION_PX: f64 = 0.3;
const LEAST_SIGMAS: f64 = 3.0;
/// The same where the scene has depth.
const LEAST_IN_DEPTH_PX: f64 = 0.33;
/// Flow is not better than this, in pixels, however still the camera; nor is a camera at rest taken to move.
const LEAST_SIGMA_PX: f64 = 0.05;
const MOST_SIGMA_AT_REST_PX: f64 = 0.3;

impl Segmenter {
    /// Read the frame as grey levels of about 0 to 255, and reduce it.
    pub(super) fn take<T: Pixel>(
        &mut self,
        frame: Frame<'_, T>,
        counts: Option<&[bool]>,
        execution: &Execution,
    ) -> Result<()> {
        let (width, height) = self.state.canvas.frame;
        let scale = self.options.scale;
        resize("a frame", &mut self.work.frame, width * height, 0.0)?;
        let rows = even_bands(execution, height, [65_536 / width, 32_768 / width]);
        for_each_band(
            execution,
            height,
            rows,
            RowsMut::new(&mut self.work.frame, width),
            |band, mut part| {
                for (local, y) in band.enumerate() {
                    let row = part.row_mut(local);
                    crate::frame::read_row(frame, y, row);
                    for value in row.iter_mut() {
                        *value = if value.is_finite() {
                            *value * scale
                        } else {
                            0.0
                        };
                    }
                }
            },
        )?;
        let (mut size, mut factor) = ((width, height), self.factor());
        let Work { frame, half, .. } = &mut self.work;
        if factor == 1 {
            replace("a frame", &mut half[0], frame.iter().copied())?;
        }
        while factor > 1 {
            let next = Reduction::Half.of(size);
            let [here, to] = &mut *half;
            resize("a frame", to, next.0 * next.1, 0.0)?;
            let from = if size == (width, height) {
                &*frame
            } else {
                &*here
            };
            let view = crate::frame::frame_from_slice(from, size.0, size.1, size.0)?;
            reduce(view, Reduction::Half, to, execution)?;
            half.swap(0, 1);
            (size, factor) = (next, factor / 2);
        }
        let (columns, rows, step) = (size.0, size.1, self.factor());
        self.work.counts.clear();
        resize("masks", &mut self.work.counts, columns * rows, 1)?;
        if let Some(counts) = counts {
            for y in 0..height {
                for x in 0..width {
                    if !counts[y * width + x] {
                        self.work.counts[(y / step) * columns + x / step] = 0;
                    }
                }
            }
        }
        let pixels = width * height;
        self.work.counts_canvas.clear();
        resize("masks", &mut self.work.counts_canvas, pixels, 1)?;
        if let Some(counts) = counts {
            for (to, counts) in self.work.counts_canvas.iter_mut().zip(counts) {
                *to = u8::from(*counts);
            }
        }
        Ok(())
    }

    /// The background is what the frame shows.
    pub(super) fn start(&mut self, execution: &Execution) -> Result<()> {
        self.warp(execution)?;
        let pixels = self.work.raw.len();
        for mask in [&mut self.work.away, &mut self.work.spare] {
            mask.clear();
            resize("masks", mask, pixels, 0)?;
        }
        let masks = [
            &self.state.seen[..],
            &self.work.away[..],
            &self.work.spare[..],
        ];
        self.state
            .background
            .learn(&self.work.raw, masks, execution)?;
        self.state.picture.clone_from(&self.work.raw);
        Ok(())
    }

    /// Bring the flow to the reduced size.
    pub(super) fn read_flow(&mut self, flow: &GivenFlow<'_>) -> Result<()> {
        let (columns, rows) = self.reduced_size();
        let full = self.state.canvas.frame;
        if flow.size != full && flow.size != (columns, rows) {
            let expected = format!("{full:?} or {:?}", (columns, rows));
            return Err(Error::shape("flow", format!("{:?}", flow.size), expected));
        }
        let step = if flow.size == full { self.factor() } else { 1 };
        resize("a flow", &mut self.work.uv, 2 * columns * rows, 0.0)?;
        resize("a flow", &mut self.work.given, columns * rows, 0)?;
        let trusted = flow.valid.iter().map(|valid| u8::from(*valid));
        replace("masks", &mut self.work.trusted.0, trusted)?;
        self.work.trusted.1 = flow.size;
        let share = 1.0 / step as f32;
        for y in 0..rows {
            let from_y = (y * step + step / 2).min(flow.size.1 - 1);
            for x in 0..columns {
                let from = from_y * flow.size.0 + (x * step + step / 2).min(flow.size.0 - 1);
                let [u, v] = [flow.uv[2 * from] * share, flow.uv[2 * from + 1] * share];
                let at = y * columns + x;
                // Where nothing counts no motion is given either.
                let given = (u + v).is_finite() && self.work.counts[at] == 1;
                self.work.given[at] = u8::from(given);
                (self.work.uv[2 * at], self.work.uv[2 * at + 1]) =
                    if given { (u, v) } else { (0.0, 0.0) };
            }
        }
        Ok(())
    }

    /// Vectors spread evenly over the frame, so that the camera's motion is not that of what has texture.
    pub(super) fn find_camera(&mut self, flow: &GivenFlow<'_>) -> CameraMotion {
        let full = self.state.canvas.frame;
        let scale = full.0 as f64 / flow.size.0 as f64;
        let scale = if flow.size == full {
            1.0
        } else {
            scale.round()
        };
        self.gather(flow, VECTOR_STEP, scale, true);
        if self.options.camera_moves {
            let before = (self.state.frames > 2).then_some(&self.state.motion);
            let camera = fit_camera(&self.work.vectors, before);
            self.state.motion = camera.homography;
            return camera;
        }
        let lengths = self
            .work
            .vectors
            .iter()
            .map(|vector| vector.u.hypot(vector.v) as f32);
        self.work.values.clear();
        self.work.values.extend(lengths);
        let median = if self.work.values.is_empty() {
            0.0
        } else {
            quantile(&mut self.work.values, 0.5)
        };
        CameraMotion {
            homography: IDENTITY,
            model: CameraModel::None,
            sigma_px: (f64::from(median) / 1.1774).clamp(LEAST_SIGMA_PX, MOST_SIGMA_AT_REST_PX),
            explained: 1.0,
        }
    }

    pub(super) fn gather(&mut self, flow: &GivenFlow<'_>, step: usize, scale: f64, even: bool) {
        let (columns, rows) = flow.size;
        let full = self.state.canvas.frame;
        let shift = (scale - 1.0) / 2.0;
        let step = (step as f64 / scale).round().max(1.0) as usize;
        let vectors = &mut self.work.vectors;
        vectors.clear();
        let mut tiles: Vec<Vec<MotionVector>> = vec![Vec::new(); TILES * TILES];
        for y in (step / 2..rows).step_by(step) {
            for x in (step / 2..columns).step_by(step) {
                let at = y * columns + x;
                let [u, v] =
                    [flow.uv[2 * at], flow.uv[2 * at + 1]].map(|value| f64::from(value) * scale);
                let (px, py) = (x as f64 * scale + shift, y as f64 * scale + shift);
                let counts = self.work.counts_canvas
                    [(py as usize).min(full.1 - 1) * full.0 + (px as usize).min(full.0 - 1)];
                if !flow.valid[at] || !(u + v).is_finite() || counts == 0 {
                    continue;
                }
                let vector = MotionVector {
                    x: px,
                    y: py,
                    u,
                    v,
                    covariance: [0.01, 0.0, 0.01],
                };
                if even {
                    tiles[(y * TILES / rows) * TILES + x * TILES / columns].push(vector);
                } else {
                    vectors.push(vector);
                }
            }
        }
        for tile in tiles.iter().filter(|tile| !tile.is_empty()) {
            vectors.extend(tile.iter().step_by(tile.len().div_ceil(VECTORS_A_TILE)));
        }
    }

    pub(super) fn find_parallax(&mut self, flow: &GivenFlow<'_>, camera: &CameraMotion) {
        if !self.options.camera_moves {
            return;
        }
        let full = self.state.canvas.frame;
        let scale = (full.0 as f64 / flow.size.0 as f64).round();
        let step = ((full.0 * full.1) as f64 / 3000.0).sqrt().round().max(2.0) as usize;
        self.gather(flow, step, scale, false);
        self.state.parallax =
            find_parallax(&self.work.vectors, camera, self.state.parallax.as_ref());
    }

    /// What the flow says of what moves.
    pub(super) fn see_flow(&mut self, camera: &CameraMotion, execution: &Execution) -> Result<()> {
        let (size, full, factor) = (self.reduced_size(), self.state.canvas.frame, self.factor());
        let scale = factor as f64;
        let by_camera = reduced(&camera.homography, factor);
        // From pixels of the reduced current frame to the frame before.
        let s = (scale - 1.0) / 2.0;
        let up = [[scale, 0.0, s], [0.0, scale, s], [0.0, 0.0, 1.0]];
        let back = product(&inverse(&camera.homography).unwrap_or(IDENTITY), &up);
        resize("masks", &mut self.work.kept, size.0 * size.1, 0)?;
        nearest_mask(
            (&self.state.moving, full),
            &back,
            (&mut self.work.kept, size),
            execution,
        )?;
        let parallax = self.believed().map(|parallax| {
            let mut parallax = *parallax;
            let [x, y, w] = parallax.epipole;
            parallax.epipole = [(x - s * w) / scale, (y - s * w) / scale, w];
            let [t, tx, ty] = parallax.travel;
            parallax.travel = [t + s * (tx + ty), scale * tx, scale * ty];
            parallax
        });
        self.work.evidence.spread = self.state.spread;
        let least = if parallax.is_some() {
            LEAST_IN_DEPTH_PX
        } else {
            LEAST_MOTION_PX
        };
        let frames = Frames {
            size,
            prev: &self.state.prev,
            current: &self.work.half[0],
            uv: &self.work.uv,
            given: &self.work.given,
            counts: &self.work.counts,
            kept: &self.work.kept,
            camera: &by_camera,
            sigma_px: camera.sigma_px.max(LEAST_SIGMA_PX) / scale,
            parallax: parallax.as_ref(),
            least_px: (least.max(LEAST_SIGMAS * camera.sigma_px) / scale) as f32,
            scale: scale as f32,
            rounding: self.options.rounding / scale as f32,
            range: [f32::NEG_INFINITY, f32::INFINITY],
        };
        self.work.evidence.update(&frames, execution)?;
        self.state.spread = self.work.evidence.spread;
        let mut slow = std::mem::take(&mut self.work.slow);
        let found = self
            .state
            .slow
            .update(&mut self.work.evidence, &frames, &mut slow, execution);
        self.work.slow = slow;
        found?;
        for value in &mut self.work.evidence.residual {
            *value *= factor as f32;
        }
        Ok(())
    }
}
