//! Where to begin: a window sought by phase correlation around displacements that the whole frames suggest.
//!
//! `docs/explanation/algorithms.md`, section "Grid: displacement_grid".

use super::frames::Frames;
use crate::error::Result;
use crate::frame::Plane;
use crate::phase::{correlate_rows, fast_length};

/// Pixels along a side of what is correlated, at least.
const LEAST_SIDE: usize = 64;
/// Peaks of a surface that are looked at.
const PEAKS: usize = 3;
/// A displacement that correlates as well as this needs no other hypothesis.
pub(super) const CERTAIN: f64 = 0.8;
/// A texture repeats where a displacement beyond so many pixels from the best correlates nearly as well: by this share.
const RIVAL_PX: f64 = 4.0;
const RIVAL: f64 = 0.85;

/// A displacement that was found, in whole pixels, and how well the window correlates there.
#[derive(Debug, Clone, Copy)]
pub(super) struct Found {
    pub(super) displacement: [f64; 2],
    pub(super) correlation: f64,
}

/// All displacements that were looked at.
#[derive(Debug, Default)]
struct Looks(Vec<Found>);

impl Looks {
    fn best(&self) -> Option<Found> {
        let better = |a: &Found, b: &Found| a.correlation.total_cmp(&b.correlation);
        self.0.iter().copied().max_by(better)
    }

    /// The best, unless another place is nearly as good.
    fn without_rival(&self) -> Option<Found> {
        let best = self.best()?;
        let rivals = |other: &Found| {
            let apart =
                (0..2).map(|axis| (other.displacement[axis] - best.displacement[axis]).abs());
            apart.fold(0.0, f64::max) > RIVAL_PX && other.correlation > RIVAL * best.correlation
        };
        (!self.0.iter().any(rivals)).then_some(best)
    }
}

/// A window that is sought.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sought<'a> {
    pub(super) frames: &'a Frames,
    /// Its first pixel, and its side.
    pub(super) corner: [usize; 2],
    pub(super) side: usize,
    /// The longest displacement along each axis.
    pub(super) reach: f64,
}

impl Sought<'_> {
    /// The best displacement near one of `hypotheses`; none where another one explains the window nearly as well.
    /// `surface` is memory.
    ///
    /// # Errors
    ///
    /// Those of the memory.
    pub(super) fn best(
        &self,
        hypotheses: impl Iterator<Item = [f64; 2]>,
        surface: &mut Plane,
    ) -> Result<Option<Found>> {
        let mut looks = Looks::default();
        let mut tried: Vec<[isize; 2]> = Vec::new();
        for hypothesis in hypotheses {
            let near = hypothesis.map(|value| value.round() as isize);
            // What stands within a quarter of the surface of one before has been seen.
            let seen =
                |other: &[isize; 2]| (0..2).all(|axis| near[axis].abs_diff(other[axis]) <= 8);
            if tried.iter().any(seen) {
                continue;
            }
            tried.push(near);
            self.around(near, surface, &mut looks)?;
            if looks.best().is_some_and(|best| best.correlation > CERTAIN) {
                break;
            }
        }
        Ok(looks.without_rival())
    }

    /// Look at the peaks of the correlation around `near`.
    fn around(&self, near: [isize; 2], surface: &mut Plane, looks: &mut Looks) -> Result<()> {
        let size = self.frames.size();
        let side = fast_length(LEAST_SIDE.max(2 * self.side));
        let sides = size.map(|size| size.min(side));
        let mut starts = [[0usize; 2]; 2];
        for axis in 0..2 {
            let most = (size[axis] - sides[axis]) as isize;
            let centre = (self.corner[axis] + self.side / 2) as isize - (sides[axis] / 2) as isize;
            starts[0][axis] = centre.clamp(0, most) as usize;
            starts[1][axis] = (starts[0][axis] as isize + near[axis]).clamp(0, most) as usize;
        }
        surface.resize(sides[0], sides[1])?;
        let faded = |plane: &Plane, start: [usize; 2], y: usize, row: &mut [f32]| {
            let weight = hann(y, sides[1]);
            let from = &plane.row(start[1] + y)[start[0]..][..sides[0]];
            for (x, (to, from)) in row.iter_mut().zip(from).enumerate() {
                *to = from * weight * hann(x, sides[0]);
            }
            true
        };
        correlate_rows(
            |y, row| faded(&self.frames.prev, starts[0], y, row),
            |y, row| faded(&self.frames.next, starts[1], y, row),
            surface,
        )?;
        let moved = [0, 1].map(|axis| starts[1][axis] as isize - starts[0][axis] as isize);
        for [x, y] in peaks(surface) {
            let signed = |at: usize, size: usize| {
                if 2 * at > size {
                    at as isize - size as isize
                } else {
                    at as isize
                }
            };
            let whole = [
                moved[0] + signed(x, sides[0]),
                moved[1] + signed(y, sides[1]),
            ];
            self.look(whole, looks);
        }
        Ok(())
    }

    /// Correlate the window at `whole` and beside it.
    fn look(&self, whole: [isize; 2], looks: &mut Looks) {
        for (dx, dy) in [(0, 0), (1, 0), (-1, 0), (0, 1), (0, -1)] {
            let place = [whole[0] + dx, whole[1] + dy];
            let displacement = place.map(|at| at as f64);
            if displacement.iter().any(|d| d.abs() > self.reach) {
                continue;
            }
            if let Some(correlation) = self.correlation(place) {
                looks.0.push(Found {
                    displacement,
                    correlation,
                });
            }
        }
    }

    /// The correlation coefficient of the window with what stands `moved` from it; `None` beyond the frame.
    fn correlation(&self, moved: [isize; 2]) -> Option<f64> {
        let size = self.frames.size();
        let mut at = [0usize; 2];
        for axis in 0..2 {
            let place = self.corner[axis] as isize + moved[axis];
            at[axis] = usize::try_from(place)
                .ok()
                .filter(|at| at + self.side <= size[axis])?;
        }
        let [mut p, mut n, mut pp, mut pn, mut nn] = [0.0f64; 5];
        for y in 0..self.side {
            let prev = &self.frames.prev.row(self.corner[1] + y)[self.corner[0]..][..self.side];
            let next = &self.frames.next.row(at[1] + y)[at[0]..][..self.side];
            let mut sums = [0.0f32; 5];
            for (a, b) in prev.iter().zip(next) {
                sums[0] += a;
                sums[1] += b;
                sums[2] += a * a;
                sums[3] += a * b;
                sums[4] += b * b;
            }
            p += f64::from(sums[0]);
            n += f64::from(sums[1]);
            pp += f64::from(sums[2]);
            pn += f64::from(sums[3]);
            nn += f64::from(sums[4]);
        }
        let count = (self.side * self.side) as f64;
        let (pp, pn, nn) = (pp - p * p / count, pn - p * n / count, nn - n * n / count);
        Some(pn / (pp.max(0.0) * nn.max(0.0)).sqrt().max(1e-9))
    }
}

/// The weight of a pixel of a window of `size` that fades to its border.
fn hann(at: usize, size: usize) -> f32 {
    let phase = std::f32::consts::TAU * (at as f32 + 0.5) / size as f32;
    0.5 - 0.5 * phase.cos()
}

/// The highest peaks of a surface that repeats, the best first.
fn peaks(surface: &Plane) -> Vec<[usize; 2]> {
    let (width, height) = (surface.width(), surface.height());
    let mut found: Vec<(f32, [usize; 2])> = Vec::new();
    for y in 0..height {
        let rows = [(y + height - 1) % height, y, (y + 1) % height].map(|row| surface.row(row));
        for x in 0..width {
            let value = rows[1][x];
            if found.len() == PEAKS && (value <= found[PEAKS - 1].0 || value.is_nan()) {
                continue;
            }
            let columns = [(x + width - 1) % width, x, (x + 1) % width];
            if rows
                .iter()
                .any(|row| columns.iter().any(|column| row[*column] > value))
            {
                continue;
            }
            let place = found.partition_point(|(peak, _)| *peak >= value);
            found.insert(place, (value, [x, y]));
            found.truncate(PEAKS);
        }
    }
    found.into_iter().map(|(_, place)| place).collect()
}
