//! What moves and what stands still, frame after frame: see the module.

use crate::error::{Error, Result};
use crate::execution::Execution;
use crate::frame::{Frame, Pixel};
use crate::memory::resize;
use crate::parallel::within_pool;

use super::MotionVector;
use super::align::Alignment;
use super::background::Background;
use super::camera::{CameraModel, CameraMotion};
use super::canvas::Canvas;
use super::components::Runs;
use super::difference::Difference;
use super::earlier::Earlier;
use super::flow_evidence::{FlowEvidence, MOST_PIXELS};
use super::flutter::{Flutter, Going};
use super::judge::Judge;
use super::light::Light;
use super::morphology::{Morphology, Size};
use super::parallax::Parallax;
use super::reduction::Reduction;
use super::regions::RegionWork;
use super::shadows::Shadows;
use super::slow::{Slow, SlowWork};
use super::transform::{IDENTITY, Map};

/// Gaps up to about this many pixels are closed.
pub(super) const GAP: usize = 5;

/// Frames of fewer pixels than this are the work of one thread: there is less of it than handing it over costs.
const ALONE: usize = 32_768;

/// How a segmenter works.
#[derive(Debug, Clone, Default)]
#[non_exhaustive]
pub struct SegmenterOptions {
    /// Whether the camera moves.
    pub camera_moves: bool,
    /// Things of fewer pixels are left out.
    pub min_area: usize,
    /// What grey levels are multiplied by so that they span about 0 to 255.
    pub scale: f32,
    /// Standard deviation of rounding, in scaled grey levels.
    pub rounding: f32,
}

impl SegmenterOptions {
    /// Of a camera that moves or not; things of fewer than `min_area` pixels are left out; grey levels times `scale` span
    /// about 0 to 255, and `rounding` is the standard deviation of their rounding.
    #[must_use]
    pub fn new(camera_moves: bool, min_area: usize, scale: f32, rounding: f32) -> Self {
        Self {
            camera_moves,
            min_area,
            scale,
            rounding,
        }
    }
}

/// The flow from the frame before, of the size of the frame or of
/// [`MotionSegmenter::reduced_size`](super::motion_segmenter::MotionSegmenter::reduced_size).
#[derive(Debug, Clone, Copy)]
pub struct GivenFlow<'a> {
    /// Motion of each pixel, x and y; not finite where it is not known.
    pub uv: &'a [f32],
    /// Whether it is trusted.
    pub valid: &'a [bool],
    /// Columns and rows.
    pub size: (usize, usize),
}

/// What is known of a frame after [`MotionSegmenter::update`](super::motion_segmenter::MotionSegmenter::update).
#[derive(Debug, Clone, Copy)]
pub struct Segmented {
    /// The camera's motion since the frame before, refined on the background where that could be.
    pub camera: CameraMotion,
    /// Whether the scene was seen to have depth.
    pub parallax: bool,
    /// Gain and offset of the whole frame against the background.
    pub light: [f32; 2],
    /// Standard deviation of the noise of a frame, in its own grey levels.
    pub noise: f32,
}

/// Tells what moves from what stands still in frames that are judged as they are: see
/// [`MotionSegmenter`](super::motion_segmenter::MotionSegmenter).
#[derive(Debug)]
pub(crate) struct Segmenter {
    pub(crate) options: SegmenterOptions,
    pub(crate) state: State,
    pub(super) work: Work,
}

/// What goes on from frame to frame.
#[derive(Debug, Clone)]
pub(crate) struct State {
    pub(crate) canvas: Canvas,
    pub(crate) background: Background,
    /// Frames in which each pixel showed the background and nothing moved.
    pub(crate) confirmed: Vec<u8>,
    pub(crate) heat: Vec<u8>,
    pub(crate) flutter: Flutter,
    /// What differs from the background and is explained by the shade of something.
    pub(crate) shaded: Vec<u8>,
    pub(crate) shadows: Shadows,
    pub(crate) slow: Slow,
    pub(crate) earlier: Earlier,
    /// What moved on the canvas, and the picture of it in the background's light, where it was seen.
    pub(crate) foreground: Vec<u8>,
    /// In how many frames what moves has moved at each place, one after the other.
    pub(crate) lived: Vec<u8>,
    pub(crate) picture: Vec<f32>,
    pub(crate) seen: Vec<u8>,
    /// The frame before, reduced, and what moved in it, as it was.
    pub(crate) prev: Vec<f32>,
    pub(crate) moving: Vec<u8>,
    pub(crate) frames: u64,
    pub(crate) noise: f32,
    pub(crate) spread: f32,
    pub(crate) light: [f32; 2],
    pub(crate) motion: Map,
    pub(crate) parallax: Option<Parallax>,
}

/// Memory that is kept.
#[derive(Debug, Default)]
pub(super) struct Work {
    pub(super) frame: Vec<f32>,
    pub(super) half: [Vec<f32>; 2],
    pub(super) uv: Vec<f32>,
    pub(super) given: Vec<u8>,
    /// Where the flow is trusted, and its columns and rows.
    pub(super) trusted: (Vec<u8>, Size),
    pub(super) counts: Vec<u8>,
    pub(super) kept: Vec<u8>,
    pub(super) vectors: Vec<MotionVector>,
    pub(super) evidence: FlowEvidence,
    pub(super) slow: SlowWork,
    /// What moves slowly, on the canvas.
    pub(super) by_slow: Vec<u8>,
    pub(super) raw: Vec<f32>,
    pub(super) by_flow: Vec<u8>,
    /// How what moves goes on the canvas.
    pub(super) going: Vec<Going>,
    /// What moves by its flow, or has just left.
    pub(super) hides: Vec<u8>,
    /// What begins to go to and fro.
    pub(super) begins: Vec<u8>,
    pub(super) away: Vec<u8>,
    /// What stopped where nothing is known, and stays as it was.
    pub(super) held: Vec<u8>,
    /// Sums over regions of what lived.
    pub(super) lives: Vec<u64>,
    /// Pixels of an outline that look like what is outside.
    pub(super) like: Vec<usize>,
    pub(super) still: Vec<u8>,
    pub(super) both: Vec<u8>,
    pub(super) changed: Vec<u8>,
    pub(super) mask: Vec<u8>,
    pub(super) spare: Vec<u8>,
    pub(super) counts_canvas: Vec<u8>,
    pub(super) values: Vec<f32>,
    pub(super) light: Light,
    /// Whether the picture has another light than the background, or that was taken over.
    pub(super) lit: bool,
    pub(super) alignment: Alignment,
    pub(super) difference: Difference,
    pub(super) judge: Judge,
    pub(super) morphology: Morphology,
    pub(super) regions: RegionWork,
    pub(super) runs: Runs,
    pub(super) sums: Vec<u64>,
}

/// How many times a frame is reduced for its flow to be judged.
fn factor_of((width, height): Size) -> usize {
    let mut factor = 1;
    while width * height > MOST_PIXELS * factor * factor {
        factor *= 2;
    }
    factor
}

impl Segmenter {
    /// For frames of `size`, columns and rows.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] for a frame without pixels; [`Error::Memory`].
    pub(super) fn new(options: SegmenterOptions, size: (usize, usize)) -> Result<Self> {
        if size.0 == 0 || size.1 == 0 {
            return Err(Error::shape(
                "image",
                format!("{size:?}"),
                "at least one pixel",
            ));
        }
        let canvas = Canvas::new(size, options.camera_moves);
        let mut segmenter = Self {
            options,
            state: State {
                canvas,
                background: Background::default(),
                confirmed: Vec::new(),
                heat: Vec::new(),
                flutter: Flutter::default(),
                shaded: Vec::new(),
                shadows: Shadows::default(),
                slow: Slow::default(),
                earlier: Earlier::default(),
                foreground: Vec::new(),
                lived: Vec::new(),
                picture: Vec::new(),
                seen: Vec::new(),
                prev: Vec::new(),
                moving: Vec::new(),
                frames: 0,
                noise: 2.0,
                spread: 0.0,
                light: [1.0, 0.0],
                motion: IDENTITY,
                parallax: None,
            },
            work: Work::default(),
        };
        segmenter.reset()?;
        Ok(segmenter)
    }

    /// Forget all frames.
    ///
    /// # Errors
    ///
    /// [`Error::Memory`].
    pub(super) fn reset(&mut self) -> Result<()> {
        let size = self.state.canvas.frame;
        self.state.canvas = Canvas::new(size, self.options.camera_moves);
        self.forget()?;
        self.state.frames = 0;
        self.state.prev.clear();
        self.state.spread = 0.0;
        resize("masks", &mut self.state.moving, size.0 * size.1, 0)?;
        self.state.moving.fill(0);
        Ok(())
    }

    /// Columns and rows of a frame.
    #[must_use]
    pub(super) fn frame_size(&self) -> (usize, usize) {
        self.state.canvas.frame
    }

    /// Forget what was seen, but for the frame before.
    pub(super) fn forget(&mut self) -> Result<()> {
        self.work.lit = false;
        let reduced = self.reduced_size();
        let state = &mut self.state;
        state.slow.reset(reduced)?;
        let pixels = state.canvas.size.0 * state.canvas.size.1;
        state.background.reset(state.canvas.size)?;
        state.earlier.reset(pixels)?;
        for mask in [
            &mut state.confirmed,
            &mut state.heat,
            &mut state.shaded,
            &mut state.foreground,
            &mut state.lived,
            &mut state.seen,
        ] {
            mask.clear();
            resize("masks", mask, pixels, 0)?;
        }
        state.flutter.reset(pixels)?;
        state.shadows = Shadows::default();
        state.picture.clear();
        resize("a picture", &mut state.picture, pixels, 0.0)?;
        state.light = [1.0, 0.0];
        state.parallax = None;
        state.motion = IDENTITY;
        Ok(())
    }

    /// How many times the frame is reduced for its flow to be judged: a power of two.
    #[must_use]
    pub(super) fn factor(&self) -> usize {
        factor_of(self.state.canvas.frame)
    }

    /// Columns and rows of what flow is judged on.
    #[must_use]
    pub(super) fn reduced_size(&self) -> (usize, usize) {
        let (mut size, mut factor) = (self.state.canvas.frame, self.factor());
        while factor > 1 {
            size = Reduction::Half.of(size);
            factor /= 2;
        }
        size
    }

    /// What moves in the last frame, 1 for each pixel that does.
    #[must_use]
    pub(super) fn moving(&self) -> &[u8] {
        &self.state.moving
    }

    /// What the camera's motion does not explain, x and y in pixels of the frame, for pixels of [`Self::reduced_size`], and 1
    /// where it is known.
    #[must_use]
    pub(super) fn residual(&self) -> (&[f32], &[u8]) {
        (&self.work.evidence.residual, &self.work.evidence.known)
    }

    /// Take the next frame, with the flow from the one before, which the first has not; `counts` is false where a pixel does
    /// not count.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] if the sizes do not fit together; those of the execution; [`Error::Memory`].
    pub(super) fn update<T: Pixel>(
        &mut self,
        frame: Frame<'_, T>,
        flow: Option<GivenFlow<'_>>,
        counts: Option<&[bool]>,
        execution: &Execution,
    ) -> Result<Segmented> {
        let size = self.state.canvas.frame;
        crate::frame::expect_size("image", frame.dim(), "the frames before", (size.1, size.0))?;
        if size.0 * size.1 < ALONE {
            let execution = &execution.clone().threads(1);
            return self.next(frame, flow, counts, execution);
        }
        within_pool(execution, || self.next(frame, flow, counts, execution))
    }

    fn next<T: Pixel>(
        &mut self,
        frame: Frame<'_, T>,
        flow: Option<GivenFlow<'_>>,
        counts: Option<&[bool]>,
        execution: &Execution,
    ) -> Result<Segmented> {
        let size = self.state.canvas.frame;
        self.take(frame, counts, execution)?;
        let flow = if self.state.frames == 0 { None } else { flow };
        self.state.frames += 1;
        let Some(flow) = flow else {
            self.start(execution)?;
            std::mem::swap(&mut self.state.prev, &mut self.work.half[0]);
            return Ok(self.result(CameraMotion::unknown()));
        };
        self.read_flow(&flow)?;
        let camera = self.find_camera(&flow);
        if camera.model == CameraModel::None && self.options.camera_moves {
            self.state.canvas = Canvas::new(size, true);
            self.forget()?;
            self.state.moving.fill(0);
            self.start(execution)?;
            std::mem::swap(&mut self.state.prev, &mut self.work.half[0]);
            return Ok(self.result(camera));
        }
        self.find_parallax(&flow, &camera);
        self.see_flow(&camera, execution)?;
        let refined = self.follow(&camera, execution)?;
        self.decide(execution)?;
        std::mem::swap(&mut self.state.prev, &mut self.work.half[0]);
        let mut camera = camera;
        camera.homography = refined;
        Ok(self.result(camera))
    }

    pub(super) fn result(&self, camera: CameraMotion) -> Segmented {
        Segmented {
            camera,
            parallax: self.has_depth(),
            light: self.state.light,
            noise: self.state.noise / self.options.scale,
        }
    }

    pub(super) fn has_depth(&self) -> bool {
        self.state
            .parallax
            .as_ref()
            .is_some_and(|parallax| parallax.depth)
    }

    pub(super) fn believed(&self) -> Option<&Parallax> {
        self.state
            .parallax
            .as_ref()
            .filter(|parallax| parallax.believed)
    }
}
