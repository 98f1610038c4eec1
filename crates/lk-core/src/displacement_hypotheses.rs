//! Where to look when points or windows do not find their way by themselves: displacements of the whole frame and of its
//! tiles, by phase correlation on a coarse level.
//!
//! `docs/explanation/algorithms.md`, section "A second try".

use crate::error::Result;
use crate::execution::Execution;
use crate::frame::Plane;
use crate::phase::phase_correlation;

/// Longest side, in pixels, of the level that is correlated: its transform takes well below a millisecond.
const MAX_SIDE: usize = 200;

/// Peaks taken from the surface of the frame, and from that of each tile.
const FRAME_PEAKS: usize = 3;
const TILE_PEAKS: usize = 2;

/// Tiles along x and y; each is as large as half the frame and overlaps its neighbours by half.
const TILES: usize = 3;

/// Tiles below this many pixels a side show no peak that is worth a look.
const MIN_TILE: usize = 16;

/// Displacements to try, in pixels of the frame.
#[derive(Debug, Default)]
pub(crate) struct Hypotheses {
    frame: Vec<[f64; 2]>,
    tiles: Vec<Vec<[f64; 2]>>,
    size: (usize, usize),
    /// The level that the hypotheses come from: they are right to about half a pixel there.
    level: usize,
}

impl Hypotheses {
    /// Forget all hypotheses.
    pub(crate) fn clear(&mut self) {
        self.frame.clear();
        self.tiles.clear();
        self.level = 0;
    }

    /// The level that the hypotheses come from.
    pub(crate) fn level(&self) -> usize {
        self.level
    }

    /// Correlate `prev` and `next`.
    pub(crate) fn find(prev: &[Plane], next: &[Plane], execution: &Execution) -> Result<Self> {
        let level = prev
            .iter()
            .position(|plane| plane.width().max(plane.height()) <= MAX_SIDE)
            .unwrap_or(prev.len() - 1);
        let (prev, next) = (&prev[level], &next[level]);
        let scale = f64::from(1u32 << level);
        let (width, height) = (prev.width(), prev.height());
        let frame = peaks(prev, next, (0, 0), (width, height), scale, FRAME_PEAKS)?;
        let (tile_width, tile_height) = (width / 2, height / 2);
        let mut tiles = Vec::new();
        if tile_width.min(tile_height) >= MIN_TILE {
            for row in 0..TILES {
                for column in 0..TILES {
                    execution.check()?;
                    let corner = (
                        column * (width - tile_width) / (TILES - 1),
                        row * (height - tile_height) / (TILES - 1),
                    );
                    let size = (tile_width, tile_height);
                    tiles.push(peaks(prev, next, corner, size, scale, TILE_PEAKS)?);
                }
            }
        }
        Ok(Self {
            frame,
            tiles,
            size: (width << level, height << level),
            level,
        })
    }

    /// All hypotheses that are at least `apart` pixels from those before them, those of the frame first.
    pub(crate) fn distinct(&self, apart: f64) -> Vec<[f64; 2]> {
        let mut found: Vec<[f64; 2]> = Vec::new();
        for hypothesis in self.frame.iter().chain(self.tiles.iter().flatten()) {
            let near = |other: &[f64; 2]| {
                (other[0] - hypothesis[0]).abs() < apart && (other[1] - hypothesis[1]).abs() < apart
            };
            if !found.iter().any(near) {
                found.push(*hypothesis);
            }
        }
        found
    }

    /// The hypotheses for a point.
    pub(crate) fn at(&self, [x, y]: [f32; 2]) -> impl Iterator<Item = [f64; 2]> {
        // The tile whose centre is nearest: centres stand at 1/4, 2/4 and 3/4 of the frame.
        let nearest = |coordinate: f32, size: usize| {
            let share = coordinate / size.max(1) as f32;
            (share * 4.0 - 0.5).clamp(0.0, (TILES - 1) as f32) as usize
        };
        let tile = nearest(y, self.size.1) * TILES + nearest(x, self.size.0);
        let local = self.tiles.get(tile).into_iter().flatten();
        self.frame.iter().chain(local).copied()
    }
}

/// The highest peaks of the correlation of two crops, in pixels of the frame.
fn peaks(
    prev: &Plane,
    next: &Plane,
    (left, top): (usize, usize),
    (width, height): (usize, usize),
    scale: f64,
    count: usize,
) -> Result<Vec<[f64; 2]>> {
    if width < 4 || height < 4 {
        return Ok(Vec::new());
    }
    let surface = phase_correlation(
        &faded(prev, (left, top), (width, height))?,
        &faded(next, (left, top), (width, height))?,
    )?;
    let mut found: Vec<(f32, usize, usize)> = Vec::new();
    for y in 0..height {
        let rows = [(y + height - 1) % height, y, (y + 1) % height].map(|row| surface.row(row));
        for x in 0..width {
            let value = rows[1][x];
            let worst = found.last().map_or(f32::MIN, |peak| peak.0);
            if found.len() == count && (value <= worst || value.is_nan()) {
                continue;
            }
            let columns = [(x + width - 1) % width, x, (x + 1) % width];
            let is_peak = rows
                .iter()
                .all(|row| columns.iter().all(|column| row[*column] <= value));
            if !is_peak {
                continue;
            }
            let place = found.partition_point(|peak| peak.0 >= value);
            found.insert(place, (value, x, y));
            found.truncate(count);
        }
    }
    let signed = |index: usize, size: usize| {
        let index = index as f64;
        let size = size as f64;
        if index > size / 2.0 {
            index - size
        } else {
            index
        }
    };
    Ok(found
        .into_iter()
        .map(|(_, x, y)| [signed(x, width) * scale, signed(y, height) * scale])
        .collect())
}

/// A crop without its mean, faded to zero at its border by a Hann window.
fn faded(
    plane: &Plane,
    (left, top): (usize, usize),
    (width, height): (usize, usize),
) -> Result<Plane> {
    let mut crop = Plane::new(width, height)?;
    let mut sum = 0.0f64;
    for y in 0..height {
        let row = &plane.row(top + y)[left..left + width];
        sum += row.iter().map(|value| f64::from(*value)).sum::<f64>();
    }
    let mean = (sum / (width * height) as f64) as f32;
    let hann = |index: usize, size: usize| {
        let phase = std::f32::consts::TAU * (index as f32 + 0.5) / size as f32;
        0.5 - 0.5 * phase.cos()
    };
    for y in 0..height {
        let weight = hann(y, height);
        let row = &plane.row(top + y)[left..left + width];
        for (x, (to, from)) in crop.row_mut(y).iter_mut().zip(row).enumerate() {
            *to = (from - mean) * weight * hann(x, width);
        }
    }
    Ok(crop)
}
