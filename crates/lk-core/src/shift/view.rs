//! Where and how two frames are compared.

use super::coordinates::{Pair, WindowAxis};
use super::filters::{RADIUS, Taps, noise_gain, taps};
use super::gain::KnownGain;
use super::gram::Light;
use super::model::{LightScope, Model};
use crate::error::Result;
use crate::frame::Plane;
use crate::illumination::Illumination;
use crate::simd::EIGHT;

/// The displacement may be this far from the whole pixels at which the frames are compared; more than half a pixel, so
/// that an iteration near the half does not jump between two of them.
pub(super) const REACH: f64 = 0.52;

/// Where and how two frames are compared.
#[derive(Debug, Clone, Copy)]
pub(super) struct Evaluation {
    /// The displacement, within [`REACH`] of `whole`.
    pub(super) displacement: [f64; 2],
    /// The whole pixels at which the frames are compared.
    pub(super) whole: [f64; 2],
    /// How light may change within a tile.
    pub(super) illumination: Illumination,
    /// What is known of the light: taken out of the difference before it is summed.
    pub(super) gain: GainField,
    /// Pixels along a side of a tile.
    pub(super) tile: usize,
    /// Whether pixels count whose gradients reach over the border of the region, which is repeated there.
    pub(super) borders: bool,
    /// Over what part of the window one model of the light holds.
    pub(super) scope: LightScope,
    /// Whether what either frame shows is known to be in both.
    pub(super) common_structure: bool,
    /// Variance of the rounding of grey levels in one frame, in the unit of the planes.
    pub(super) rounding: f64,
}

/// A gain that varies with place and grey level: `next - prev = (c0 + c1 x + c2 y + c3 m / 2) m`, with m the mean of
/// both frames and x and y from -1 to 1 over the window, so that all levels share it.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub(super) struct GainField(pub(super) [f64; 4]);

impl GainField {
    pub(super) fn is_none(self) -> bool {
        self == Self::default()
    }
}

/// The region that both frames show, and how each is sampled there.
pub(super) struct View<'a> {
    pub(super) pair: Pair<'a>,
    /// Its first pixel in each frame.
    pub(super) starts: [[usize; 2]; 2],
    pub(super) size: [usize; 2],
    /// Those of `next`, along x and along y; `prev` takes them in reverse.
    pub(super) taps: [Taps; 2],
    pub(super) place: [WindowAxis; 2],
    pub(super) gain: GainField,
}

impl<'a> View<'a> {
    pub(super) fn new(pair: Pair<'a>, params: Evaluation) -> Option<Self> {
        let half: [f64; 2] =
            std::array::from_fn(|axis| (params.displacement[axis] - params.whole[axis]) / 2.0);
        let shift = params.whole.map(|value| value as isize);
        let (columns, rows) = (pair.overlap(0, shift[0]), pair.overlap(1, shift[1]));
        if columns.len() < 4 || rows.len() < 4 {
            return None;
        }
        let start = [columns.start, rows.start];
        Some(Self {
            pair,
            starts: [
                start,
                std::array::from_fn(|axis| {
                    (start[axis] as isize + shift[axis] - pair.origin[axis]) as usize
                }),
            ],
            size: [columns.len(), rows.len()],
            taps: half.map(taps),
            place: std::array::from_fn(|axis| {
                WindowAxis::new(pair.window[axis], start[axis], shift[axis])
            }),
            gain: params.gain,
        })
    }

    /// What is known when its sums are solved.
    pub(super) fn model(&self, params: Evaluation) -> Model {
        let noise = noise_gain(&self.taps);
        Model {
            light: Light::new(params.illumination),
            scope: params.scope,
            common_structure: params.common_structure,
            noise,
            floor: params.rounding * 2.0 * noise.sampled,
            known: KnownGain {
                field: self.gain.0,
                place: self.place,
            },
        }
    }

    /// Where both frames may be used.
    pub(super) fn weigh(&self, weight: &mut Plane, borders: bool) -> Result<()> {
        let [width, height] = self.size;
        weight.resize(width.next_multiple_of(EIGHT), height)?;
        let planes = [self.pair.prev_weight, self.pair.next_weight];
        for y in 0..height {
            let row = weight.row_mut(y);
            row.fill(0.0);
            let margin = if borders { 0 } else { RADIUS };
            if y < margin || y + margin >= height || width < 2 * margin {
                continue;
            }
            row[margin..width - margin].fill(1.0);
            for (plane, start) in planes.into_iter().zip(self.starts) {
                if let Some(plane) = plane {
                    let other = &plane.row(start[1] + y)[start[0]..start[0] + width];
                    row.iter_mut().zip(other).for_each(|(to, from)| *to *= from);
                }
            }
        }
        Ok(())
    }

    /// The rows that the taps read for row `y` of the region, in one of the frames.
    #[inline(always)]
    pub(super) fn rows(
        &self,
        plane: &'a Plane,
        start: [usize; 2],
        y: usize,
    ) -> [&'a [f32]; 2 * RADIUS + 1] {
        let columns = start[0] - RADIUS..start[0] + self.size[0] + RADIUS;
        std::array::from_fn(|k| &plane.row(start[1] + y + k - RADIUS)[columns.clone()])
    }
}
