//! What dense flow keeps from call to call, and the flows of it that are held against each other.

use crate::error::Result;
use crate::frame::Plane;
use crate::pyramid::Pyramid;

use super::block_matching::Matching;
use super::chance::Count;
use super::confidence::Judged;
use super::covariance::Cells;
use super::fill::Fill;
use super::light::Light;
use super::looks::Looks;
use super::options::DenseHints;
use super::padded_plane::{self, PaddedPlane};
use super::sureness::Sureness;
use super::trend::{Samples, Trend};

/// Planes that are kept from call to call.
#[derive(Debug, Default)]
pub(super) struct Workspace {
    pub(super) flow: [PaddedPlane; 2],
    /// If the flow is of half the size of the level: what its values are multiplied by.
    pub(super) halved: Option<f32>,
    pub(super) spare: [PaddedPlane; 2],
    /// The best flow of the coarse levels so far, and its light.
    pub(super) best: [PaddedPlane; 2],
    pub(super) best_light: Light,
    best_trend: Trend,
    /// The flow of the coarse levels in steady light.
    steady: [PaddedPlane; 2],
    steady_trend: Trend,
    /// A level of `prev` as it came.
    pub(super) finer: Plane,
    /// The coarse levels of `prev` as they came.
    pub(super) coarse: Vec<Plane>,
    pub(super) energy: PaddedPlane,
    pub(super) judged: Judged,
    /// What a coarse level says of the flow.
    pub(super) support: Judged,
    /// What most of the flow does.
    pub(super) trend: Trend,
    pub(super) samples: Samples,
    pub(super) counts: Vec<Count>,
    pub(super) cells: Cells,
    /// What the windows of the level that was filled in last say.
    pub(super) sureness: Sureness,
    pub(super) fill: Fill,
    /// What is filled in of a flow of all pixels.
    pub(super) gains: [PaddedPlane; 2],
    /// The flow of the displacements that fit best, and how well they do.
    pub(super) found: [PaddedPlane; 2],
    pub(super) found_energy: PaddedPlane,
    pub(super) found_trend: Trend,
    pub(super) light: Light,
    pub(super) matching: Matching,
    pub(super) looks: Looks,
    pub(super) weights: Vec<Plane>,
    /// 0 at pixels of `prev` that are masked or not finite.
    pub(super) given: Plane,
    /// 0 at pixels that count for nothing, clipped ones among them.
    pub(super) unclipped: Plane,
    /// Not 0 at pixels of `next` that are clipped, or beside one that is.
    pub(super) near: Vec<u8>,
}

impl Workspace {
    /// How badly the windows fitted before the last step: the mean root of their energies.
    pub(super) fn misfit(&self) -> f64 {
        let (mut sum, mut count) = (0.0, 0.0);
        for y in 0..self.energy.height() {
            for energy in self
                .energy
                .row(y)
                .iter()
                .filter(|energy| **energy < f32::MAX)
            {
                sum += f64::from(energy.max(0.0).sqrt());
                count += 1.0;
            }
        }
        if count > 0.0 { sum / count } else { 0.0 }
    }

    /// Keep the flow as the best so far; what is in `flow` afterwards is unspecified.
    pub(super) fn keep_flow(&mut self) {
        std::mem::swap(&mut self.flow, &mut self.best);
        self.best_trend = self.trend;
    }

    /// Keep the flow in steady light.
    pub(super) fn keep_steady(&mut self) -> Result<()> {
        self.steady_trend = self.trend;
        for (steady, flow) in self.steady.iter_mut().zip(&self.flow) {
            steady.copy_from(flow)?;
        }
        Ok(())
    }

    /// Take the flow in steady light again.
    pub(super) fn take_steady(&mut self) -> Result<()> {
        self.trend = self.steady_trend;
        for (flow, steady) in self.flow.iter_mut().zip(&self.steady) {
            flow.copy_from(steady)?;
        }
        Ok(())
    }

    /// Take the best flow again.
    pub(super) fn take_best_flow(&mut self) {
        std::mem::swap(&mut self.flow, &mut self.best);
        self.trend = self.best_trend;
    }

    /// Set the flow on `level`, the one to begin with.
    pub(super) fn start(
        &mut self,
        pyramid: &Pyramid,
        level: usize,
        hints: DenseHints<'_>,
    ) -> Result<()> {
        self.halved = None;
        self.trend = Trend::default();
        self.sureness.forget();
        let plane = &pyramid.levels()[level];
        // What went further than the frame reaches is not in it; NaN is not within either.
        let reach = pyramid.levels()[0]
            .width()
            .max(pyramid.levels()[0].height()) as f32;
        for (axis, grid) in self.flow.iter_mut().enumerate() {
            grid.resize(plane.width(), plane.height())?;
            grid.fill(0.0);
            let Some(initial) = hints.initial else {
                continue;
            };
            let scale = 1usize << level;
            for y in 0..plane.height() {
                let row = grid.padded_mut(y);
                for x in 0..plane.width() {
                    let value = initial[(y * scale, x * scale, axis)];
                    row[padded_plane::PAD + x] = if value.abs() <= reach {
                        value / scale as f32
                    } else {
                        0.0
                    };
                }
                padded_plane::extend(row, plane.width());
            }
        }
        Ok(())
    }
}
