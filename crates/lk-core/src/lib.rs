//! Motion between two pictures on a CPU: the displacement of a window, of many points, of every pixel, in changing
//! light and over large displacements.
//!
//! Motion is from `prev` to `next`: what was at (x, y) in `prev` is at (x + u, y + v) in `next`, with x to the right,
//! y down and pixel centres at integers. Frames are [`ndarray::ArrayView2`] of `u8`, `u16` or `f32` with any strides,
//! see also [`frame_from_slice`]; grey levels are never rescaled. The same input gives the same bits for any number of
//! threads and on every CPU level of one architecture.
#![deny(missing_docs)]

#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;

mod corners;
mod dense;
mod displacement_hypotheses;
mod error;
mod execution;
mod frame;
mod grey;
mod grid;
mod illumination;
mod ink;
mod memory;
mod options;
mod parallel;
mod phase;
mod plane;
mod presmooth;
mod pyramid;
mod scratch;
mod segment;
mod shift;
mod simd;
mod support;
mod threads;
mod track;

/// The crate whose views frames, masks and results are, in the version that this crate takes.
pub use ndarray;

pub use corners::{Corner, CornerDetector, CornerOptions, detect_corners};
pub use dense::{
    DenseFlow, DenseHints, DenseOptions, DenseSnapshot, FlowField, Preset, dense_flow,
};
pub use error::{Error, Result};
pub use execution::Execution;
pub use frame::{Frame, Pixel, Plane, frame_from_slice};
pub use grid::{Grid, GridNode, GridOptions, GridShape, GridStatus, displacement_grid};
pub use illumination::Illumination;
pub use ink::{Ink, lay_ink};
#[doc(hidden)]
pub use memory::zero_floats;
pub use parallel::set_num_threads;
pub use plane::{
    Distortion, Lens, PlaneFit, PlaneInterval, PlaneMatch, PlaneMotion, PlaneNormal, PlaneNumber,
    PlaneOptions, PlaneResponse, PlaneTile, PlaneTileStatus, PlaneTracker, fit_plane,
};
pub use pyramid::Pyramid;
pub use segment::MotionVector;
pub use segment::camera::{CameraModel, CameraMotion, fit_camera};
pub use segment::motion_segmenter::MotionSegmenter;
pub use segment::parallax::{Parallax, find_parallax};
pub use segment::picture_motion::{RIDE_STARTS, Ridden, Riders, ride};
pub use segment::seen_regions::{
    REGION_BINS, REGION_SAMPLES, SAMPLE_PARTS, SeenBeside, SeenRegion, SeenRegions, see_regions,
};
pub use segment::segmenter::{GivenFlow, Segmented, SegmenterOptions};
pub use segment::snapshot::SegmenterSnapshot;
pub use shift::{Roi, Shift, ShiftDeformation, ShiftOptions, ShiftStatus, estimate_shift};
pub use simd::SimdLevel;
pub use support::Masks;
pub use threads::{MAX_THREADS, num_threads};
pub use track::{
    Deformation, PointStatus, PointTracker, PyrLkOptions, PyrLkPoint, StreamPoint, TrackOptions,
    TrackedPoint, TrackerSnapshot, track_points, track_pyr_lk, track_pyramids,
};
