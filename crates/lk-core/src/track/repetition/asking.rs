//! Which points are asked whether their texture repeats: some in all parts of the frame, and those near the ones that do.

use super::{BESIDE, Repetition, State};
use crate::error::Result;
use crate::memory::{replace, resize};
use crate::track::neighbours::Grid;
use crate::track::options::POINTS;
use crate::track::options::TrackedPoint;
use crate::track::problem::Problem;

/// One point of so many is asked first whether any texture repeats, and one in each square of so many windows a side.
const SAMPLE: usize = 10;
const SQUARE: f32 = 2.5;

impl Repetition {
    /// Choose which points are asked first: some of them, in as many parts of the frame as there are.
    pub(super) fn choose_first(
        &mut self,
        problem: &Problem<'_>,
        points: &[[f32; 2]],
        tracks: &[TrackedPoint],
    ) -> Result<()> {
        let side = SQUARE * problem.options.window_side() as f32;
        let (width, height) = problem.size();
        let [columns, rows] = [width, height].map(|length| (length as f32 / side) as usize + 1);
        self.taken.clear();
        resize(POINTS, &mut self.taken, columns * rows, false)?;
        let taken = &mut self.taken;
        let mut due = SAMPLE - 1;
        let states = tracks.iter().zip(points).map(|(track, [x, y])| {
            if !track.is_valid() {
                return State::Known;
            }
            due += 1;
            let taken = &mut taken[(y / side) as usize * columns + (x / side) as usize];
            if due < SAMPLE || *taken {
                return State::Unasked;
            }
            *taken = true;
            due -= SAMPLE;
            State::First
        });
        replace(POINTS, &mut self.states, states)
    }

    /// Ask the points near those on texture that repeats; whether there are any that were not asked.
    pub(super) fn ask_near(
        &mut self,
        problem: &Problem<'_>,
        points: &[[f32; 2]],
        grid: &mut Grid,
    ) -> Result<bool> {
        let others = &self.others;
        grid.fill(problem.size(), points, |index| others[index].count > 0)?;
        let reach = BESIDE * problem.options.window_side() as f32;
        let mut any = false;
        for (state, point) in self.states.iter_mut().zip(points) {
            if *state == State::Unasked {
                let mut near = grid.nearest::<1>(points, *point);
                if near.any(|(distance, _)| distance < reach * reach) {
                    *state = State::Unknown;
                    any = true;
                }
            }
        }
        Ok(any)
    }
}
