//! Windows that are left without a match: each is compared with every place of `next` that it may have moved to.
//!
//! What is small and fast is not seen on levels where it would have moved by a pixel or two, and a picture may hold more
//! motions than phase correlation of its parts shows. Where the windows of a level of at most 200 pixels do not fit,
//! windows of `prev` are sought in `next` by their normalised correlation, which does not mind a gain or an offset of the
//! light. One that is found leads to its neighbours, which are sought near the same displacement; what few windows agree
//! on is chance and is dropped. The flow is taken where it fits better.
//!
//! `docs/explanation/algorithms.md`, section "Large motion".

use crate::error::Result;
use crate::frame::Plane;
use crate::memory::{reserve, resize};
use crate::simd::SimdLevel;

use super::padded_plane::{self, PAD, PaddedPlane};
use super::window_correlation::{NEAR, NOISE, RADIUS, SIDE, Side, Template, variance};

/// Pixels from one window to the next.
const SPACING: usize = 4;
/// A window is lost where its mean squared difference is above this share of its variance: unrelated windows have twice
/// their variance.
const LOST: f32 = 0.5;
/// Windows around one that is sought, where they stand beyond two pixels to the left and above it, and how many of them
/// may fit: a strip that is covered is narrower.
const AROUND: [[usize; 2]; 9] = [
    [2, 2],
    [0, 0],
    [4, 0],
    [0, 4],
    [4, 4],
    [2, 0],
    [0, 2],
    [4, 2],
    [2, 4],
];
const FITTING: usize = 3;
/// Windows that must agree.
const AGREEING: usize = 4;
/// Longest side, in pixels, of a level on which they are sought.
const LONGEST: usize = 200;
/// Most windows that are sought everywhere.
const MOST: usize = 48;

/// What is known of a window.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum State {
    /// It fits, or is not to be sought.
    #[default]
    Kept,
    Lost,
    /// Sought everywhere, in vain.
    Unfound,
    /// Found at this displacement, in pixels of the level.
    Found([i32; 2]),
}

/// What is kept from call to call.
#[derive(Debug, Default)]
pub(super) struct Matching {
    prev: Side,
    next: Side,
    scores: PaddedPlane,
    states: Vec<State>,
    reached: Vec<usize>,
    /// Windows a row, and rows of windows.
    columns: usize,
    rows: usize,
}

impl Matching {
    fn middle(index: usize) -> usize {
        RADIUS + SPACING * index
    }

    /// Mark the windows of `prev` that are lost; whether there are any to seek. `energy` is that of windows of this radius, at
    /// all pixels or at one in each 2 x 2.
    pub(super) fn find_lost(
        &mut self,
        prev: &Plane,
        energy: &PaddedPlane,
        radius: usize,
        weight: Option<&Plane>,
    ) -> Result<bool> {
        let (width, height) = (prev.width(), prev.height());
        if width.min(height) < 2 * SIDE || width.max(height) > LONGEST {
            return Ok(false);
        }
        let count = |size: usize| (size - SIDE) / SPACING + 1;
        (self.columns, self.rows) = (count(width), count(height));
        self.states.clear();
        let windows = self.columns * self.rows;
        resize("windows", &mut self.states, windows, State::Kept)?;
        self.reached.clear();
        reserve("windows", &mut self.reached, windows)?;
        let step = width.div_ceil(energy.width());
        let mut any = false;
        for row in 0..self.rows {
            for column in 0..self.columns {
                let (x, y) = (Self::middle(column), Self::middle(row));
                let is_lost = |[x, y]: [usize; 2]| {
                    let energy = energy.row(y / step)[x / step];
                    energy > NOISE
                        && energy < f32::MAX
                        && energy > LOST * variance(prev, x, y, radius)
                };
                let fits = |[by_x, by_y]: &[usize; 2]| !is_lost([x + by_x - 2, y + by_y - 2]);
                if AROUND
                    .iter()
                    .filter(|by| fits(by))
                    .take(FITTING + 1)
                    .count()
                    > FITTING
                {
                    continue;
                }
                let counts = |plane: &Plane| {
                    (y - RADIUS..y + RADIUS + 1).all(|y| {
                        plane.row(y)[x - RADIUS..x + RADIUS + 1]
                            .iter()
                            .all(|weight| *weight > 0.5)
                    })
                };
                if !weight.is_none_or(counts) {
                    continue;
                }
                self.states[row * self.columns + column] = State::Lost;
                any |= self.is_broad(column, row);
            }
        }
        Ok(any)
    }

    /// Whether a window and three others make a square without one that is kept, up to this window in the order of rows if
    /// those after it are not known: what is covered is lost in strips.
    fn is_broad(&self, column: usize, row: usize) -> bool {
        let is_lost = |column: usize, row: usize| {
            column < self.columns
                && row < self.rows
                && self.states[row * self.columns + column] != State::Kept
        };
        let square = |column: usize, row: usize| {
            is_lost(column, row)
                && is_lost(column + 1, row)
                && is_lost(column, row + 1)
                && is_lost(column + 1, row + 1)
        };
        let rows = row.saturating_sub(1)..row + 1;
        rows.into_iter()
            .any(|row| (column.saturating_sub(1)..column + 1).any(|column| square(column, row)))
    }

    /// Seek what is lost, at most `most` pixels away; whether anything was found.
    pub(super) fn search(
        &mut self,
        [prev, next]: [&Plane; 2],
        most: Option<f32>,
        simd: SimdLevel,
    ) -> Result<bool> {
        self.next.take(next)?;
        self.scores.resize(prev.width(), prev.height())?;
        let (mut sought, mut any, mut both) = (0, false, false);
        for spacing in [8, 4, 2, 1] {
            let first = spacing / 2;
            for row in (first..self.rows).step_by(spacing) {
                for column in (first..self.columns).step_by(spacing) {
                    let index = row * self.columns + column;
                    if self.states[index] != State::Lost
                        || sought == MOST
                        || !self.is_broad(column, row)
                    {
                        continue;
                    }
                    sought += 1;
                    self.states[index] = State::Unfound;
                    let Some(template) = Template::of(prev, [SPACING * column, SPACING * row])
                    else {
                        continue;
                    };
                    let Some(by) = self.next.anywhere(&template, &mut self.scores, most, simd)
                    else {
                        continue;
                    };
                    if !both {
                        self.prev.take(prev)?;
                        both = true;
                    }
                    if self.comes_back(next, &template, by, most, simd) {
                        any |= self.spread(prev, index, by, most, simd);
                    }
                }
            }
        }
        Ok(any)
    }

    /// Whether what a window has become is found where the window was.
    fn comes_back(
        &mut self,
        next: &Plane,
        template: &Template,
        by: [i32; 2],
        most: Option<f32>,
        simd: SimdLevel,
    ) -> bool {
        let there = [0, 1].map(|axis| (template.at[axis] as i32 + by[axis]) as usize);
        let back = Template::of(next, there)
            .and_then(|template| self.prev.anywhere(&template, &mut self.scores, most, simd));
        back.is_some_and(|back| {
            (0..2).all(|axis| (by[axis] + back[axis]).unsigned_abs() as usize <= NEAR)
        })
    }

    /// From window `index`, found at `by`, to those around it; whether enough agree.
    fn spread(
        &mut self,
        prev: &Plane,
        index: usize,
        by: [i32; 2],
        most: Option<f32>,
        simd: SimdLevel,
    ) -> bool {
        self.states[index] = State::Found(by);
        self.reached.clear();
        self.reached.push(index);
        let mut next = 0;
        while let Some(&from) = self.reached.get(next) {
            next += 1;
            let State::Found(by) = self.states[from] else {
                continue;
            };
            let (row, column) = (from / self.columns, from % self.columns);
            for row in row.saturating_sub(1)..(row + 2).min(self.rows) {
                for column in column.saturating_sub(1)..(column + 2).min(self.columns) {
                    let index = row * self.columns + column;
                    if !matches!(self.states[index], State::Lost | State::Unfound) {
                        continue;
                    }
                    let Some(template) = Template::of(prev, [SPACING * column, SPACING * row])
                    else {
                        continue;
                    };
                    let found = self.next.near(&template, &mut self.scores, by, most, simd);
                    if let Some(by) = found {
                        self.states[index] = State::Found(by);
                        self.reached.push(index);
                    }
                }
            }
        }
        if self.reached.len() >= AGREEING {
            return true;
        }
        for index in &self.reached {
            self.states[*index] = State::Unfound;
        }
        false
    }

    /// Write what was found to the flow around each window.
    pub(super) fn write(&self, flow: &mut [PaddedPlane; 2]) {
        for (index, state) in self.states.iter().enumerate() {
            let State::Found(by) = state else {
                continue;
            };
            let (x, y) = (
                Self::middle(index % self.columns),
                Self::middle(index / self.columns),
            );
            for (flow, by) in flow.iter_mut().zip(by) {
                let (width, height) = (flow.width(), flow.height());
                for y in y - SPACING / 2..(y + SPACING / 2).min(height) {
                    let row = flow.padded_mut(y);
                    row[PAD..][x - SPACING / 2..(x + SPACING / 2).min(width)].fill(*by as f32);
                    padded_plane::extend(row, width);
                }
            }
        }
    }
}
