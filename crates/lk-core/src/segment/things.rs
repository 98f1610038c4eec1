//! Things that a camera's motion does not explain: groups of neighbouring cells that move alike against it.

use super::MotionVector;
use super::camera::CameraMotion;

/// Beyond this many squared deviations (99.9 % of two normal components), and pixels, a vector is off the plane.
const OFF: f64 = 13.69;
const LEAST_OFF_PX: f64 = 0.2;
/// The most that a covariance counts, as a standard deviation in pixels.
const MOST_STD_PX: f64 = 0.12;
/// Vectors of a cell, about, and cells at most.
const VECTORS_A_CELL: f64 = 6.0;
const MOST_CELLS: f64 = 432.0;
/// A cell is of a thing where so many vectors and this share are off the plane, and their directions are alike: the
/// square of their mean against the mean of their squares.
const FEWEST_OFF: usize = 2;
const LEAST_SHARE: f64 = 0.3;
const LEAST_ALIKE: f64 = 0.7;
/// Flow is wrong by this much in a cell, in pixels, whatever covariances say: neighbours err alike.
const CELL_STD_PX: f64 = 0.1;
/// Neighbouring cells are of one thing where their motions differ by less than this share of them, and pixels.
const ALIKE_SHARE: f64 = 0.35;
const ALIKE_PX: f64 = 0.3;
/// Or where they go the same way within 14 degrees.
const ALIKE_COSINE: f64 = 0.97;
/// Surroundings of a thing are within so many cells of it, move less by this factor, and have not so many times its cells.
const REACH: usize = 2;
const FURTHER: f64 = 1.4;
const LARGER: f64 = 2.0;

/// A cell of a thing.
#[derive(Debug, Clone, Copy)]
pub(super) struct Cell {
    /// Mean place of its vectors in `next`, in units.
    pub(super) place: [f64; 2],
    /// Their mean motion against the plane, in units.
    pub(super) motion: [f64; 2],
    /// Variance of a component of that, in units squared.
    pub(super) variance: f64,
    /// Which thing it is of.
    pub(super) thing: usize,
    /// Where it is in the grid of cells.
    at: usize,
}

/// What is off the plane, in coordinates of about unit size.
#[derive(Debug)]
pub(super) struct Things {
    pub(super) cells: Vec<Cell>,
    pub(super) count: usize,
    /// Cells of the whole picture.
    pub(super) all_cells: usize,
    /// Of each thing, whether it is no more than the surroundings of one that moves further: windows of a flow reach
    /// over its edges.
    pub(super) surrounds: Vec<bool>,
    pub(super) centre: [f64; 2],
    /// Pixels of a unit.
    pub(super) size: f64,
    /// Half the width and the height over which vectors stand, in units.
    pub(super) reach: [f64; 2],
}

#[derive(Clone, Copy, Default)]
struct Sums {
    all: usize,
    off: usize,
    weight: f64,
    place: [f64; 2],
    motion: [f64; 2],
    square: f64,
    variance: f64,
}

impl Things {
    pub(super) fn of(vectors: &[MotionVector], camera: &CameraMotion) -> Self {
        let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
        for v in vectors.iter().filter(|v| v.usable()) {
            for (axis, value) in [v.x, v.y].into_iter().enumerate() {
                low[axis] = low[axis].min(value);
                high[axis] = high[axis].max(value);
            }
        }
        let half = [0, 1].map(|k: usize| ((high[k] - low[k]) / 2.0).max(1.0));
        let centre = [0, 1].map(|k: usize| f64::midpoint(high[k], low[k]));
        let size = half[0].max(half[1]);
        let cells = (vectors.len() as f64 / VECTORS_A_CELL).clamp(1.0, MOST_CELLS);
        let side = (4.0 * half[0] * half[1] / cells).sqrt();
        let [columns, rows] = half.map(|half| (2.0 * half / side).ceil().max(1.0) as usize);
        let mut sums = vec![Sums::default(); columns * rows];
        for v in vectors.iter().filter(|v| v.usable()) {
            let column = (((v.x - low[0]) / side) as usize).min(columns - 1);
            let row = (((v.y - low[1]) / side) as usize).min(rows - 1);
            add(&mut sums[row * columns + column], v, camera);
        }
        let mut things = Self {
            cells: Vec::new(),
            count: 0,
            all_cells: sums.len(),
            surrounds: Vec::new(),
            centre,
            size,
            reach: half.map(|half| half / size),
        };
        things.gather(&sums, columns);
        things
    }

    /// Cells whose vectors are off the plane, joined with their like neighbours.
    fn gather(&mut self, sums: &[Sums], columns: usize) {
        let mut number = vec![usize::MAX; sums.len()];
        for (k, s) in sums.iter().enumerate() {
            let mean = s.motion.map(|sum| sum / s.weight);
            let square = mean[0] * mean[0] + mean[1] * mean[1];
            if s.off < FEWEST_OFF
                || (s.off as f64) < LEAST_SHARE * s.all as f64
                || square < LEAST_ALIKE * s.square / s.weight
            {
                continue;
            }
            number[k] = self.cells.len();
            let variance = s.variance / s.weight + CELL_STD_PX * CELL_STD_PX;
            self.cells.push(Cell {
                place: [0, 1]
                    .map(|axis: usize| (s.place[axis] / s.weight - self.centre[axis]) / self.size),
                motion: mean.map(|mean| mean / self.size),
                variance: variance / (self.size * self.size),
                thing: self.cells.len(),
                at: k,
            });
        }
        // The lowest number of a group stands for it.
        let mut root: Vec<usize> = (0..self.cells.len()).collect();
        for k in 0..sums.len() {
            if number[k] == usize::MAX {
                continue;
            }
            let (row, column) = (k / columns, k % columns);
            for other_row in row.saturating_sub(1)..=row {
                for other_column in column.saturating_sub(1)..=(column + 1).min(columns - 1) {
                    let other = number[other_row * columns + other_column];
                    let this = number[k];
                    if other < this && alike(&self.cells[this], &self.cells[other], self.size) {
                        let (a, b) = (found(&root, this), found(&root, other));
                        root[a.max(b)] = a.min(b);
                    }
                }
            }
        }
        let mut names = vec![usize::MAX; root.len()];
        for k in 0..root.len() {
            let top = found(&root, k);
            if names[top] == usize::MAX {
                names[top] = self.count;
                self.count += 1;
            }
            self.cells[k].thing = names[top];
        }
        self.drop_single(&mut names);
        self.find_surroundings(sums.len(), columns);
    }

    /// Tell things that are beside one that moves further, and not larger.
    fn find_surroundings(&mut self, cells: usize, columns: usize) {
        let mut grid = vec![usize::MAX; cells];
        let mut sums = vec![(0.0_f64, 0.0_f64); self.count];
        for cell in &self.cells {
            grid[cell.at] = cell.thing;
            let (length, count) = &mut sums[cell.thing];
            *length += cell.motion[0].hypot(cell.motion[1]);
            *count += 1.0;
        }
        self.surrounds = vec![false; self.count];
        for cell in &self.cells {
            let (row, column) = (cell.at / columns, cell.at % columns);
            for other_row in row.saturating_sub(REACH)..=(row + REACH).min(cells / columns - 1) {
                for other_column in column.saturating_sub(REACH)..=(column + REACH).min(columns - 1)
                {
                    let other = grid[other_row * columns + other_column];
                    if other == usize::MAX || other == cell.thing {
                        continue;
                    }
                    let ((length, count), (further, by)) = (sums[cell.thing], sums[other]);
                    self.surrounds[cell.thing] |=
                        further / by > FURTHER * length / count && count < LARGER * by;
                }
            }
        }
    }

    /// Leave out things of one cell: edges of motion, where flow is of neither side.
    fn drop_single(&mut self, names: &mut Vec<usize>) {
        let mut sizes = vec![0_usize; self.count];
        for cell in &self.cells {
            sizes[cell.thing] += 1;
        }
        names.clear();
        names.resize(self.count, usize::MAX);
        self.count = 0;
        for (name, size) in names.iter_mut().zip(&sizes) {
            if *size > 1 {
                *name = self.count;
                self.count += 1;
            }
        }
        self.cells.retain(|cell| sizes[cell.thing] > 1);
        for cell in &mut self.cells {
            cell.thing = names[cell.thing];
        }
    }
}

fn add(sums: &mut Sums, v: &MotionVector, camera: &CameraMotion) {
    let [x, y] = camera.applied(v.x, v.y);
    let motion = [v.x + v.u - x, v.y + v.v - y];
    let common = camera.sigma_px * camera.sigma_px;
    // Beside an edge of motion a covariance has to cover both sides, but the vector is of one of them.
    let largest = v.covariance[0].max(v.covariance[2]);
    let scale = (MOST_STD_PX * MOST_STD_PX / largest).min(1.0);
    let [xx, xy, yy] = v.covariance.map(|part| scale * part);
    let (xx, yy) = (xx.max(0.0) + common, yy.max(0.0) + common);
    let determinant = xx * yy - xy * xy;
    let square = motion[0] * motion[0] + motion[1] * motion[1];
    let chi2 = (yy * motion[0] * motion[0] - 2.0 * xy * motion[0] * motion[1]
        + xx * motion[1] * motion[1])
        / determinant;
    if !(chi2 + square).is_finite() || determinant <= 0.0 {
        return;
    }
    sums.all += 1;
    if chi2 < OFF || square < LEAST_OFF_PX * LEAST_OFF_PX {
        return;
    }
    let variance = f64::midpoint(xx, yy);
    let weight = 1.0 / (variance + CELL_STD_PX * CELL_STD_PX);
    sums.off += 1;
    sums.weight += weight;
    sums.square += weight * square;
    sums.variance += weight * variance;
    for (axis, place) in [v.x + v.u, v.y + v.v].into_iter().enumerate() {
        sums.place[axis] += weight * place;
        sums.motion[axis] += weight * motion[axis];
    }
}

/// Whether two cells may be of one thing: they move alike, or the same way, as do the surroundings of a thing into which
/// the windows of a flow reach.
fn alike(a: &Cell, b: &Cell, size: f64) -> bool {
    let apart = (a.motion[0] - b.motion[0]).hypot(a.motion[1] - b.motion[1]);
    let lengths = [a, b].map(|cell| cell.motion[0].hypot(cell.motion[1]));
    let along = a.motion[0] * b.motion[0] + a.motion[1] * b.motion[1];
    apart < (ALIKE_SHARE * f64::midpoint(lengths[0], lengths[1])).max(ALIKE_PX / size)
        || along > ALIKE_COSINE * lengths[0] * lengths[1]
}

fn found(root: &[usize], mut at: usize) -> usize {
    while root[at] != at {
        at = root[at];
    }
    at
}
