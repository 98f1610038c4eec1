//! What moves in a reduced frame as the frame shows it: its edge goes where the grey levels change sides.

use crate::error::Result;
use crate::execution::Execution;
use crate::frame::{Frame, Pixel};
use crate::memory::resize;
use crate::parallel::{RowsMut, even_bands, for_each_band};

use super::enlarge::between;
use super::morphology::Size;

/// A pixel moves where the mask, linear between the centres of blocks, is at least this: a little below one half, as what is
/// found to move is rather too narrow than too wide.
const HALF: f32 = 0.4;
/// Between these shares the grey levels decide.
const UNSURE: [f32; 2] = [0.1, 0.9];
/// What moves and what is behind it differ by more grey levels of 0 to 255, or the levels tell nothing.
const CONTRAST: f32 = 12.0;
/// What moves is like the mean of what surely does within so many blocks.
const REACH: usize = 3;

/// What is known of a reduced frame.
pub(super) struct Reduced<'a> {
    /// What moves.
    pub(super) moving: &'a [u8],
    /// Its grey levels, and those of the still scene.
    pub(super) levels: &'a [f32],
    pub(super) scene: &'a [f32],
    /// Columns and rows.
    pub(super) size: Size,
    /// Pixels of a block along each side.
    pub(super) by: usize,
    /// What makes levels span 0 to 255.
    pub(super) scale: f32,
}

impl Reduced<'_> {
    /// Write what moves in `frame` into `to`, where `counts` is not false; `inside` is memory that is kept.
    ///
    /// # Errors
    ///
    /// Those of the execution; [`Error::Memory`](crate::Error::Memory).
    pub(super) fn finer<T: Pixel>(
        &self,
        frame: Frame<'_, T>,
        counts: Option<&[bool]>,
        inside: &mut Vec<u8>,
        to: &mut [u8],
        execution: &Execution,
    ) -> Result<()> {
        let (columns, rows) = self.size;
        let width = frame.dim().1;
        self.find_inside(inside)?;
        let bands = even_bands(execution, rows, [16_384 / columns, 8_192 / columns]);
        let outputs = RowsMut::new(to, self.by * width);
        for_each_band(execution, rows, bands, outputs, |band, part| {
            for (local, y) in band.enumerate() {
                let start = local * part.stride;
                let end = part.data.len().min(start + part.stride);
                let lines = &mut part.data[start..end];
                self.row(frame, inside, y, lines);
                if let Some(counts) = counts {
                    let counts = &counts[y * self.by * width..][..lines.len()];
                    for (moves, counts) in lines.iter_mut().zip(counts) {
                        *moves &= u8::from(*counts);
                    }
                }
            }
        })
    }

    /// Blocks around which all blocks move.
    fn find_inside(&self, inside: &mut Vec<u8>) -> Result<()> {
        let (columns, rows) = self.size;
        inside.clear();
        resize("masks", inside, columns * rows, 0)?;
        for y in 0..rows {
            let near = y.saturating_sub(1)..(y + 2).min(rows);
            let to = &mut inside[y * columns..(y + 1) * columns];
            to.fill(1);
            for row in near {
                let from = &self.moving[row * columns..(row + 1) * columns];
                for (to, moves) in to.iter_mut().zip(from) {
                    *to &= moves;
                }
            }
            let mut before = 1;
            for x in 0..columns {
                let (here, after) = (to[x], to[(x + 1).min(columns - 1)]);
                to[x] = before & here & after;
                before = here;
            }
        }
        Ok(())
    }

    /// The lines of one row of blocks.
    fn row<T: Pixel>(&self, frame: Frame<'_, T>, inside: &[u8], y: usize, lines: &mut [u8]) {
        let (columns, rows) = self.size;
        let near = y.saturating_sub(1)..(y + 2).min(rows);
        let around = &self.moving[near.start * columns..near.end * columns];
        lines.fill(0);
        if !around.contains(&1) {
            return;
        }
        let width = frame.dim().1;
        for x in 0..columns {
            let (left, right) = (x.saturating_sub(1), (x + 2).min(columns));
            let moving = around
                .chunks_exact(columns)
                .flat_map(|row| row[left..right].iter().map(|moves| usize::from(*moves)))
                .sum::<usize>();
            if moving == 0 {
                continue;
            }
            let pixels = x * self.by..((x + 1) * self.by).min(width);
            if moving == (right - left) * near.len() {
                for line in lines.chunks_exact_mut(width) {
                    line[pixels.clone()].fill(1);
                }
                continue;
            }
            let alike = self.alike(inside, (x, y));
            for (inside, line) in lines.chunks_exact_mut(width).enumerate() {
                let py = y * self.by + inside;
                for px in pixels.clone() {
                    line[px] = u8::from(self.moves(frame, (px, py), alike));
                }
            }
        }
    }

    /// The mean level of what surely moves near a block.
    fn alike(&self, inside: &[u8], (x, y): (usize, usize)) -> Option<f32> {
        let (columns, rows) = self.size;
        let (mut sum, mut count) = (0.0, 0);
        for row in y.saturating_sub(REACH)..(y + REACH + 1).min(rows) {
            for column in x.saturating_sub(REACH)..(x + REACH + 1).min(columns) {
                let at = row * columns + column;
                if inside[at] == 1 {
                    sum += self.levels[at];
                    count += 1;
                }
            }
        }
        (count > 0).then(|| sum / count as f32)
    }

    /// Whether a pixel moves; `alike` is the level of what does near it.
    fn moves<T: Pixel>(
        &self,
        frame: Frame<'_, T>,
        (x, y): (usize, usize),
        alike: Option<f32>,
    ) -> bool {
        let (columns, rows) = self.size;
        let ((l, r, s), (a, b, t)) = (between(x, self.by, columns), between(y, self.by, rows));
        let mean = |of: [f32; 4]| {
            let (top, low) = (of[0] + s * (of[1] - of[0]), of[2] + s * (of[3] - of[2]));
            top + t * (low - top)
        };
        let around = [
            a * columns + l,
            a * columns + r,
            b * columns + l,
            b * columns + r,
        ];
        let share = mean(around.map(|at| f32::from(self.moving[at])));
        if let Some(alike) = alike
            && share > UNSURE[0]
            && share < UNSURE[1]
        {
            let behind = mean(around.map(|at| self.scene[at]));
            if (alike - behind).abs() * self.scale > CONTRAST {
                let here = smooth(frame, (x, y));
                return (here - alike).abs() < (here - behind).abs();
            }
        }
        share >= HALF
    }
}

/// A grey level with those around it, of weights 1, 2, 1.
fn smooth<T: Pixel>(frame: Frame<'_, T>, (x, y): (usize, usize)) -> f32 {
    let (height, width) = frame.dim();
    let line = |row: usize| {
        let at = |column: usize| frame[(row, column)].to_f32();
        at(x.saturating_sub(1)) + 2.0 * at(x) + at((x + 1).min(width - 1))
    };
    (line(y.saturating_sub(1)) + 2.0 * line(y) + line((y + 1).min(height - 1))) / 16.0
}

#[cfg(test)]
mod tests {
    use ndarray::Array2;

    use super::*;
    use crate::segment::made::every_way;

    fn reduced<'a>(
        [levels, scene]: [&'a [f32]; 2],
        moving: &'a [u8],
        size: Size,
        by: usize,
    ) -> Reduced<'a> {
        Reduced {
            moving,
            levels,
            scene,
            size,
            by,
            scale: 1.0,
        }
    }

    /// A disc of one level before another, its blocks' means, and the blocks of which it covers more than half.
    fn disc(full: Size, by: usize, levels: [f32; 2]) -> (Array2<f32>, Vec<f32>, Vec<u8>, Size) {
        let (middle, radius) = ([20.3, 15.6], 9.4);
        let covers = |x: f32, y: f32| (x - middle[0]).hypot(y - middle[1]) < radius;
        let frame = Array2::from_shape_fn((full.1, full.0), |(y, x)| {
            levels[usize::from(covers(x as f32, y as f32))]
        });
        let size = (full.0.div_ceil(by), full.1.div_ceil(by));
        let mut means = vec![0.0; size.0 * size.1];
        let mut shares = vec![(0, 0); size.0 * size.1];
        for ((y, x), value) in frame.indexed_iter() {
            let at = y / by * size.0 + x / by;
            means[at] += value;
            shares[at].0 += usize::from(*value == levels[1]);
            shares[at].1 += 1;
        }
        for (mean, (_, count)) in means.iter_mut().zip(&shares) {
            *mean /= *count as f32;
        }
        let mask = shares
            .iter()
            .map(|(inside, count)| u8::from(2 * inside > *count))
            .collect();
        (frame, means, mask, size)
    }

    #[test]
    fn edges_go_where_the_levels_change() {
        for (full, by) in [((64, 48), 2), ((45, 33), 2), ((64, 48), 4)] {
            for (levels, most_wrong) in [([80.0, 150.0], 4), ([80.0, 85.0], usize::MAX)] {
                let (frame, means, moving, size) = disc(full, by, levels);
                let scene = vec![levels[0]; size.0 * size.1];
                let reduced = reduced([&means, &scene], &moving, size, by);
                let mut first = None;
                for execution in every_way() {
                    let mut to = vec![7; full.0 * full.1];
                    let mut inside = Vec::new();
                    reduced
                        .finer(frame.view(), None, &mut inside, &mut to, &execution)
                        .unwrap();
                    let wrong = frame
                        .iter()
                        .zip(&to)
                        .filter(|(level, moves)| (**level == levels[1]) != (**moves == 1))
                        .count();
                    // By the mask alone a seventh of the disc's rim is wrong.
                    let most = most_wrong.min(if by == 2 { 30 } else { 100 });
                    assert!(wrong <= most, "{wrong} of {full:?} at {by}");
                    assert_eq!(first.get_or_insert(to.clone()), &to);
                }
            }
        }
    }

    #[test]
    fn what_does_not_count_is_still() {
        let (full, by) = ((64, 48), 2);
        let (frame, means, moving, size) = disc(full, by, [80.0, 150.0]);
        let scene = vec![f32::NAN; size.0 * size.1];
        let counts: Vec<bool> = (0..full.0 * full.1).map(|at| at % full.0 < 20).collect();
        let reduced = reduced([&means, &scene], &moving, size, by);
        let mut to = vec![7; full.0 * full.1];
        let execution = &every_way()[0];
        reduced
            .finer(
                frame.view(),
                Some(&counts),
                &mut Vec::new(),
                &mut to,
                execution,
            )
            .unwrap();
        let moving = |counted: bool| {
            let pixels = to.iter().zip(&counts);
            pixels
                .filter(|(moves, counts)| **moves == 1 && **counts == counted)
                .count()
        };
        assert_eq!(moving(false), 0);
        assert!(moving(true) > 100);
    }
}
