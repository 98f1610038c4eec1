//! Both pyramids, and one window of them: built, and compared at a displacement.

use std::cell::Cell;

use crate::frame::Plane;
use crate::simd::{SimdLevel, dispatch};
use crate::support::Support;
use crate::track::normal::Normal;
use crate::track::options::{PointStatus, TrackOptions};
use crate::track::patch::{
    BorderScratch, BuildTemplate, Compare, Light, Place, Sampling, SumAgain, Sums, Template, Window,
};

/// Memory of one thread.
#[derive(Debug)]
pub(crate) struct Workspace {
    pub(super) template: Template,
    scratch: BorderScratch,
}

thread_local! {
    static KEPT: Cell<Option<Box<Workspace>>> = const { Cell::new(None) };
}

impl Workspace {
    /// Call `work` with memory that the next call of this thread has again.
    pub(crate) fn with<R>(work: impl FnOnce(&mut Self) -> R) -> R {
        let mut workspace = KEPT.take().unwrap_or_else(|| Box::new(Self::new()));
        let result = work(&mut workspace);
        KEPT.set(Some(workspace));
        result
    }

    fn new() -> Self {
        Self {
            template: Template::new(),
            scratch: BorderScratch::new(),
        }
    }
}

/// Both pyramids and how to compare them.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Problem<'a> {
    pub(crate) prev: &'a [Plane],
    pub(crate) next: &'a [Plane],
    /// Which pixels of each level count.
    pub(crate) prev_support: &'a [Support],
    pub(crate) next_support: &'a [Support],
    /// Whether a mask says which pixels of `next` count.
    pub(crate) masked: bool,
    pub(crate) options: &'a TrackOptions,
    pub(crate) level: SimdLevel,
}

/// Pyramids in the order of the search.
#[derive(Debug, Clone, Copy)]
pub(super) struct Direction<'a> {
    pub(super) from: &'a [Plane],
    pub(super) to: &'a [Plane],
    pub(super) from_support: &'a [Support],
    pub(super) to_support: &'a [Support],
}

impl Problem<'_> {
    /// Width and height of the frames.
    pub(crate) fn size(&self) -> (usize, usize) {
        (self.prev[0].width(), self.prev[0].height())
    }

    /// Whether `point` is inside of the frame.
    pub(crate) fn holds(&self, point: [f32; 2]) -> bool {
        inside(&self.prev[0], point)
    }

    pub(super) fn forward(&self) -> Direction<'_> {
        Direction {
            from: self.prev,
            to: self.next,
            from_support: self.prev_support,
            to_support: self.next_support,
        }
    }

    pub(super) fn backward(&self) -> Direction<'_> {
        Direction {
            from: self.next,
            to: self.prev,
            from_support: self.next_support,
            to_support: self.prev_support,
        }
    }

    /// How far the steps that are left out may lead, in pixels.
    pub(super) fn tolerance(&self) -> f64 {
        0.5 * f64::from(self.options.epsilon)
    }

    /// Build the template; where its centre is.
    #[allow(
        clippy::too_many_arguments,
        reason = "a level, a window, how to read it"
    )]
    pub(super) fn build(
        &self,
        direction: Direction<'_>,
        level: usize,
        centre: [f32; 2],
        window: Window,
        sampling: Sampling,
        light: Light,
        workspace: &mut Workspace,
    ) -> [f32; 2] {
        let centre = dispatch(
            self.level,
            BuildTemplate {
                template: &mut workspace.template,
                prev: &direction.from[level],
                centre,
                window,
                sampling,
                light,
                scratch: &mut workspace.scratch,
            },
        );
        workspace
            .template
            .belongs_to(&direction.from_support[level]);
        centre
    }

    /// The sums at `displacement`, over the pixels that count there; `normal` becomes theirs.
    #[allow(clippy::too_many_arguments, reason = "a level, a place, what to sum")]
    pub(super) fn compare(
        &self,
        direction: Direction<'_>,
        level: usize,
        centre: [f32; 2],
        displacement: [f64; 2],
        squared: bool,
        normal: &mut Normal,
        workspace: &mut Workspace,
    ) -> Result<Sums, PointStatus> {
        let to = &direction.to[level];
        let at = [
            (f64::from(centre[0]) + displacement[0]) as f32,
            (f64::from(centre[1]) + displacement[1]) as f32,
        ];
        let template = &mut workspace.template;
        let half = template.window.half();
        let near = at[0] >= -half[0]
            && at[1] >= -half[1]
            && at[0] <= to.width() as f32 - 1.0 + half[0]
            && at[1] <= to.height() as f32 - 1.0 + half[1];
        if !near {
            return Err(PointStatus::OutOfFrame);
        }
        match template.meets(&direction.to_support[level], at) {
            Place::Same => {}
            Place::Other => {
                dispatch(self.level, SumAgain(template));
                *normal = Normal::new(template, normal.model()).ok_or(PointStatus::LowTexture)?;
            }
            Place::Bare if !inside(to, at) => return Err(PointStatus::OutOfFrame),
            Place::Bare => {
                let [x, y] = at.map(|coordinate| coordinate.round() as isize);
                let stands = direction.to_support[level].has_all((x, y), 1, 1);
                return Err(if self.masked && !stands {
                    PointStatus::Masked
                } else {
                    PointStatus::LowSupport
                });
            }
        }
        Ok(dispatch(
            self.level,
            Compare {
                template: &workspace.template,
                next: to,
                centre: at,
                squared,
                scratch: &mut workspace.scratch,
            },
        ))
    }
}

/// Whether a point is inside of a plane.
pub(super) fn inside(plane: &Plane, [x, y]: [f32; 2]) -> bool {
    x >= 0.0 && y >= 0.0 && x <= plane.width() as f32 - 1.0 && y <= plane.height() as f32 - 1.0
}
