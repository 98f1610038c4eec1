//! A slope and a smooth change for each tile of a frame, by weighted least squares over the cells around it.
//!
//! First each tile is asked whether its cells show the same structure in both pictures. If so, what they differ by is light,
//! however much it is: its fit is the start. If the reference's structure is gone, something else is there, and it counts
//! little. Then the cells that are near the light so far are fitted again. Where few are, the light of what lies around
//! goes on.

use crate::error::Result;
use crate::execution::Execution;
use crate::memory::resize;
use crate::parallel::{RowsMut, even_bands, for_each_band};
use crate::scratch::with_scratch;
use crate::segment::morphology::Size;
use crate::simd::{SimdLevel, dispatch};

use super::cells::{CELLS, Cells};
use super::frame_light::{FrameLight, GAINS};
use super::tile_sums::{ALWAYS, Boxed, CHANNELS, Misfit, Model, TileSums};

/// Pixels of a tile along each axis.
pub(super) const TILE: usize = 4 * CELLS;
/// What differs by more than this share of the picture's range is things and not light; by half of it in the last round.
const LIMIT: f32 = 0.06;
const ROUNDS: [f32; 3] = [1.0, 1.0, 0.5];
/// A ridge, as a share of the limit: where a tile has less contrast the change is a share of the grey level.
const RIDGE: f32 = 0.33;
/// Share of the variance of a picture's difference below which the variance of cells may be noise: two of its sixteenths.
const CELL_NOISE: f32 = 0.125;
/// Grey levels below this share of the range are too dark for a change to be a share of them.
const DARK: f32 = 0.1;
/// So many cells in and around a tile, of 144, are enough without those further off.
const ENOUGH: f32 = 24.0;
/// What those further off count, and those of the whole frame.
const FURTHER: f32 = 0.03;
const ANYWHERE: f32 = 1e-3;
/// Tiles whose cells count, and those beside them that help where they do not.
const NEAR: usize = 1;
const WIDE: usize = 3;
/// Structure: what a Laplacian of cells has beyond this many times the variance of its noise, in so many cells.
const STRUCTURE: f32 = 4.0;
const LEAST_CELLS: f32 = 12.0;
/// Share of the variance of a picture's difference that the Laplacian of one's cells has of it: 20 / 16 / 2.
const LAPLACIAN_NOISE: f32 = 0.625;
/// From this correlation of the structure on it is the same, below the other one it is gone.
const SAME: f32 = 0.85;
const GONE: f32 = 0.4;
/// What a tile counts where it is gone.
const DISTRUST: f32 = 0.05;

/// The tiles of a frame.
#[derive(Debug, Default)]
pub(super) struct Tiles {
    size: Size,
    slope: Vec<f32>,
    smooth: Vec<f32>,
    trust: Vec<f32>,
    gains: Vec<f32>,
    offsets: Vec<f32>,
    sums: Vec<f32>,
    near: Vec<f32>,
    wide: Vec<f32>,
    spare: Vec<f32>,
}

impl Tiles {
    /// Take a frame's size, without any change of light.
    pub(super) fn reset(&mut self, frame: Size) -> Result<()> {
        let (columns, rows) = (frame.0.div_ceil(TILE), frame.1.div_ceil(TILE));
        self.size = (columns, rows);
        for (plane, value) in [
            (&mut self.slope, 0.0),
            (&mut self.smooth, 0.0),
            (&mut self.trust, 1.0),
            (&mut self.gains, 1.0),
            (&mut self.offsets, 0.0),
        ] {
            plane.clear();
            resize("tiles of light", plane, columns * rows, value)?;
        }
        for plane in [
            &mut self.sums,
            &mut self.near,
            &mut self.wide,
            &mut self.spare,
        ] {
            resize("tiles of light", plane, CHANNELS * columns * rows, 0.0)?;
        }
        Ok(())
    }

    /// What the reference is multiplied by at each tile's middle.
    pub(super) fn gains(&self) -> &[f32] {
        &self.gains
    }

    /// What is then added.
    pub(super) fn offsets(&self) -> &[f32] {
        &self.offsets
    }

    /// The rows of tiles around row `y` of the frame, and how far it is from the one to the other.
    pub(super) fn around<'a>(&self, y: usize, values: &'a [f32]) -> (&'a [f32], &'a [f32], f32) {
        let (columns, rows) = self.size;
        let at = (2 * y + 1) as f32 / (2 * TILE) as f32 - 0.5;
        let above = (at.max(0.0) as usize).min(rows - 1);
        let below = (above + 1).min(rows - 1);
        let row = |row: usize| &values[row * columns..][..columns];
        (row(above), row(below), (at - above as f32).clamp(0.0, 1.0))
    }

    /// Fit the light of each tile.
    pub(super) fn fit(
        &mut self,
        cells: &mut Cells,
        light: &FrameLight,
        noise: f32,
        execution: &Execution,
    ) -> Result<()> {
        let limit = noise.max(LIMIT * light.range).max(1e-6);
        let level = execution.simd_level();
        let ridge = RIDGE * limit;
        let prior = Prior {
            ridge: ridge * ridge,
            noise: CELL_NOISE * noise * noise,
            middle: light.middle,
            dark: (DARK * light.range).max(f32::MIN_POSITIVE),
        };
        self.sum(cells, None, execution)?;
        self.begin(noise, limit, &prior, level);
        for part in ROUNDS {
            self.sum(cells, Some(noise.max(part * limit)), execution)?;
            self.solve(&prior, level);
        }
        for at in 0..self.slope.len() {
            let (more, smooth) = (self.slope[at] + 1.0, self.smooth[at]);
            self.gains[at] = light.gain * more;
            self.offsets[at] = light.offset * more + smooth - self.slope[at] * light.middle;
        }
        self.judge(cells, execution)
    }

    /// Sum the cells of each tile: all of them where there is no limit, else those near the light so far.
    fn sum(&mut self, cells: &Cells, limit: Option<f32>, execution: &Execution) -> Result<()> {
        let (columns, rows) = self.size;
        let level = execution.simd_level();
        let model = Model {
            size: self.size,
            slope: &self.slope,
            smooth: &self.smooth,
            trust: &self.trust,
        };
        let memory = (CHANNELS + 2) * cells.size.0;
        for_each_band(
            execution,
            rows,
            even_bands(execution, rows, [1_024 / columns, 256 / columns]),
            RowsMut::new(&mut self.sums, CHANNELS * columns),
            |band, mut part| {
                with_scratch(memory, |memory| {
                    for (local, tile) in band.enumerate() {
                        let to = part.row_mut(local);
                        dispatch(
                            level,
                            TileSums {
                                cells,
                                model,
                                tile,
                                limit,
                                memory,
                                to,
                            },
                        );
                    }
                })
            },
        )
    }

    /// Begin with the light of the tiles that show the same in both pictures, and distrust those where it is gone.
    fn begin(&mut self, noise: f32, limit: f32, prior: &Prior, level: SimdLevel) {
        self.boxed(level, CHANNELS, false);
        let (columns, rows) = self.size;
        let unseen = LAPLACIAN_NOISE * noise * noise;
        for (row, x) in (0..rows).flat_map(|row| (0..columns).map(move |x| (row, x))) {
            let get = |channel: usize| self.near[(row * CHANNELS + channel) * columns + x];
            let at = row * columns + x;
            let [seen, aa, ab, bb] = [6, 7, 8, 9].map(get);
            let most = unseen.max(1e-6 * limit * limit);
            if seen < LEAST_CELLS || aa < STRUCTURE * most * seen {
                continue;
            }
            let [va, vb] = [aa, bb].map(|square| (square - unseen * seen).max(0.0));
            let correlation = if vb > 0.0 { ab / (va * vb).sqrt() } else { 0.0 };
            if correlation < GONE {
                self.trust[at] = DISTRUST;
            } else if correlation > SAME {
                let fit = Fit::of([0, 1, 2, 3, 4].map(get), prior);
                let left = get(5) / get(0) - fit.change * fit.change - fit.slope * fit.both;
                if left < limit * limit {
                    (self.slope[at], self.smooth[at]) = (fit.slope, fit.smooth);
                }
            }
        }
    }

    /// Sum the tiles around each, near ones or those further off too.
    fn boxed(&mut self, level: SimdLevel, channels: usize, is_wide: bool) {
        let Self {
            sums,
            spare,
            near,
            wide,
            size,
            ..
        } = self;
        let (to, reach) = if is_wide { (wide, WIDE) } else { (near, NEAR) };
        let size = *size;
        dispatch(
            level,
            Boxed {
                from: sums,
                spare,
                to,
                size,
                channels,
                reach,
            },
        );
    }

    /// Fit each tile again.
    fn solve(&mut self, prior: &Prior, level: SimdLevel) {
        let (columns, rows) = self.size;
        self.boxed(level, ALWAYS, false);
        let few = |row: &[f32]| row[..columns].iter().any(|weight| *weight < ENOUGH);
        if self.near.chunks_exact(CHANNELS * columns).any(few) {
            self.boxed(level, ALWAYS, true);
        }
        let mut all = [0.0f32; 5];
        for row in self.sums.chunks_exact(CHANNELS * columns) {
            for (sum, values) in all.iter_mut().zip(row.chunks_exact(columns)) {
                *sum += values.iter().sum::<f32>();
            }
        }
        let side = |reach: usize| (2 * reach + 1) as f32;
        let further = FURTHER * (side(NEAR) / side(WIDE)).powi(2);
        let anywhere = ANYWHERE * side(NEAR).powi(2) / (columns * rows) as f32;
        for row in 0..rows {
            for x in 0..columns {
                let at = |channel: usize| (row * CHANNELS + channel) * columns + x;
                let lacking = (1.0 - self.near[at(0)] / ENOUGH).max(0.0);
                let mut sums = [0.0; 5];
                for (channel, sum) in sums.iter_mut().enumerate() {
                    *sum = self.near[at(channel)];
                    if lacking > 0.0 {
                        let around = further * self.wide[at(channel)] + anywhere * all[channel];
                        *sum += lacking * around;
                    }
                }
                let fit = Fit::of(sums, prior);
                (
                    self.slope[row * columns + x],
                    self.smooth[row * columns + x],
                ) = (fit.slope, fit.smooth);
            }
        }
    }

    /// Write how far each cell is from this light.
    fn judge(&self, cells: &mut Cells, execution: &Execution) -> Result<()> {
        let level: SimdLevel = execution.simd_level();
        let (columns, rows) = cells.size;
        let model = Model {
            size: self.size,
            slope: &self.slope,
            smooth: &self.smooth,
            trust: &self.trust,
        };
        let Cells {
            weight,
            level: grey,
            change,
            misfit,
            ..
        } = cells;
        let [weight, grey, change] = [&*weight, &*grey, &*change];
        for_each_band(
            execution,
            rows,
            even_bands(execution, rows, [16_384 / columns, 4_096 / columns]),
            RowsMut::new(misfit, columns),
            |band, mut part| {
                with_scratch(2 * columns, |memory| {
                    for (local, y) in band.enumerate() {
                        let planes =
                            [weight, grey, change].map(|plane| &plane[y * columns..][..columns]);
                        dispatch(
                            level,
                            Misfit {
                                model,
                                planes,
                                y,
                                memory,
                                to: part.row_mut(local),
                            },
                        );
                    }
                })
            },
        )
    }
}

/// A weighted line: what the change is for each grey level.
struct Fit {
    slope: f32,
    smooth: f32,
    /// Mean of the change, and its covariance with the level.
    change: f32,
    both: f32,
}

impl Fit {
    /// Of the sums of weights, levels, changes, squares of levels, and products.
    fn of([weight, level, change, square, product]: [f32; 5], prior: &Prior) -> Self {
        if weight <= 1e-6 {
            return Self {
                slope: 0.0,
                smooth: 0.0,
                change: 0.0,
                both: 0.0,
            };
        }
        let share = weight.recip();
        let (level, change) = (level * share, change * share);
        let both = product * share - level * change;
        let variance = (square * share - level * level).max(0.0);
        let least = GAINS.map(|gain| gain - 1.0);
        // As a shadow or a lamp would have it, whose change is a share of the grey level.
        let usual = (change / (level + prior.middle).max(prior.dark)).clamp(least[0], least[1]);
        let ridge = prior.ridge + f32::MIN_POSITIVE;
        let slope = (both + ridge * usual) / (variance + ridge);
        let square = variance * variance;
        let sure = square / (square + prior.noise * prior.noise + f32::MIN_POSITIVE);
        let slope = (usual + sure * (slope - usual)).clamp(least[0], least[1]);
        Self {
            slope,
            smooth: change - slope * level,
            change,
            both,
        }
    }
}

/// What a line is held to where its cells say little.
struct Prior {
    /// What is added to the variance of levels.
    ridge: f32,
    /// A variance of levels that may be noise.
    noise: f32,
    /// The level that cells count from, and the least one that a change is a share of.
    middle: f32,
    dark: f32,
}
