//! Connected regions of a mask, by runs: what is set next to each other in a row. Where most of a frame stands still
//! there are few runs, and all but the look for them costs nothing.
//!
//! One thread: a row without anything set is read at the speed of memory.

use crate::error::Result;
use crate::memory::{reserve_more, resize};

use super::morphology::Size;
use super::runs::next;
pub(crate) use super::runs::{Region, Run};

/// Which neighbours a pixel is connected with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Neighbours {
    /// Those beside, above and below.
    Four,
    /// Those at the corners too.
    Eight,
}

/// The runs of a mask and its connected regions. Memory is kept from frame to frame.
#[derive(Debug, Default)]
pub(crate) struct Runs {
    size: Size,
    runs: Vec<Run>,
    /// Where each row's runs begin, and where the last one's end.
    rows: Vec<u32>,
    /// While regions are joined: a run that this one belongs with, itself for the first one of a region.
    parents: Vec<u32>,
    regions: Vec<Region>,
}

impl Runs {
    /// Take the regions of `mask`, 0 or 1 a pixel, by eight neighbours, in the order of their first pixels.
    ///
    /// # Errors
    ///
    /// [`Error::Memory`](crate::Error::Memory).
    pub(crate) fn label(&mut self, mask: &[u8], size: Size) -> Result<()> {
        self.find(mask, size, 0, Neighbours::Eight)
    }

    /// Take the regions of what is not set in `mask`, by four neighbours: what eight neighbours of what is set part.
    ///
    /// # Errors
    ///
    /// Those of [`Runs::label`].
    pub(crate) fn label_inverse(&mut self, mask: &[u8], size: Size) -> Result<()> {
        self.find(mask, size, 1, Neighbours::Four)
    }

    fn find(&mut self, mask: &[u8], size: Size, invert: u8, by: Neighbours) -> Result<()> {
        self.begin(size)?;
        for y in 0..size.1 {
            self.take_row(y, &mask[y * size.0..(y + 1) * size.0], invert)?;
        }
        self.join(by)
    }

    /// Forget the runs, and make ready for the rows of a mask.
    pub(crate) fn begin(&mut self, size: Size) -> Result<()> {
        self.size = size;
        self.runs.clear();
        self.rows.clear();
        reserve_more("rows of runs", &mut self.rows, size.1 + 1)?;
        self.rows.push(0);
        Ok(())
    }

    /// Take the runs of row `y` of a mask, the one after the row before. `invert` is 1 for those of what is not set.
    pub(crate) fn take_row(&mut self, y: usize, row: &[u8], invert: u8) -> Result<()> {
        let mut x = 0;
        loop {
            let start = next(row, x, 1 ^ invert);
            if start == row.len() {
                break;
            }
            x = next(row, start + 1, invert);
            reserve_more("runs", &mut self.runs, 1)?;
            self.runs.push(Run {
                y: y as u32,
                start: start as u32,
                end: x as u32,
                label: 0,
            });
        }
        self.rows.push(self.runs.len() as u32);
        Ok(())
    }

    /// Join the runs that were taken to regions.
    pub(crate) fn join(&mut self, by: Neighbours) -> Result<()> {
        self.parents.clear();
        resize("joined runs", &mut self.parents, self.runs.len(), 0)?;
        for (index, parent) in self.parents.iter_mut().enumerate() {
            *parent = index as u32;
        }
        let reach = u32::from(by == Neighbours::Eight);
        for y in 1..self.rows.len().saturating_sub(1) {
            let (mut above, here) = (self.rows[y - 1] as usize, self.rows[y] as usize);
            for at in here..self.rows[y + 1] as usize {
                let run = self.runs[at];
                while above < here && self.runs[above].end + reach <= run.start {
                    above += 1;
                }
                let mut near = above;
                while near < here && self.runs[near].start < run.end + reach {
                    join(&mut self.parents, near as u32, at as u32);
                    near += 1;
                }
            }
        }
        self.number()
    }

    /// Number the regions: a run's parent is never after it, so one pass will do.
    fn number(&mut self) -> Result<()> {
        self.regions.clear();
        for (index, run) in self.runs.iter_mut().enumerate() {
            let parent = self.parents[index] as usize;
            // From here on a parent holds its region's number.
            let label = if parent == index {
                reserve_more("regions", &mut self.regions, 1)?;
                self.regions.push(Region::NOTHING);
                (self.regions.len() - 1) as u32
            } else {
                self.parents[parent]
            };
            self.parents[index] = label;
            run.label = label;
            self.regions[label as usize].add(run);
        }
        Ok(())
    }

    /// All runs, from left to right in each row, from the top down.
    pub(crate) fn runs(&self) -> &[Run] {
        &self.runs
    }

    /// Those of row `y`.
    #[cfg(test)]
    pub(crate) fn row(&self, y: usize) -> &[Run] {
        &self.runs[self.rows[y] as usize..self.rows[y + 1] as usize]
    }

    /// The regions, in the order of their first pixels.
    pub(crate) fn regions(&self) -> &[Region] {
        &self.regions
    }

    /// Sum a plane of bytes, or count the pixels of a mask, over each region.
    ///
    /// # Errors
    ///
    /// [`Error::Memory`](crate::Error::Memory).
    pub(crate) fn sum_bytes(&self, plane: &[u8], sums: &mut Vec<u64>) -> Result<()> {
        sums.clear();
        resize("sums of regions", sums, self.regions.len(), 0)?;
        for run in &self.runs {
            let pixels = &plane[run.place(self.size.0)];
            sums[run.label as usize] += pixels.iter().map(|byte| u64::from(*byte)).sum::<u64>();
        }
        Ok(())
    }

    /// Write the mask of the regions that `keep` is true for, given each one's number.
    pub(crate) fn draw(&self, keep: impl Fn(usize) -> bool, to: &mut [u8]) {
        to.fill(0);
        self.paint(keep, 1, to);
    }

    /// Write `value` over the regions that `choose` is true for, given each one's number.
    pub(crate) fn paint<T: Copy>(&self, choose: impl Fn(usize) -> bool, value: T, to: &mut [T]) {
        for run in &self.runs {
            if choose(run.label as usize) {
                to[run.place(self.size.0)].fill(value);
            }
        }
    }

    /// Write each pixel's region, its number and one, and 0 where there is none.
    #[cfg(test)]
    pub(crate) fn labels(&self, to: &mut [u32]) {
        to.fill(0);
        self.paint_labels(to);
    }

    /// Write the region's number and one over the pixels of each.
    pub(crate) fn paint_labels(&self, to: &mut [u32]) {
        for run in &self.runs {
            to[run.place(self.size.0)].fill(run.label + 1);
        }
    }

    /// Give up the regions that `keep` is false for, and number the others anew, in their order.
    ///
    /// # Errors
    ///
    /// [`Error::Memory`](crate::Error::Memory).
    pub(crate) fn keep(&mut self, keep: impl Fn(usize, &Region) -> bool) -> Result<()> {
        const GONE: u32 = u32::MAX;
        self.parents.clear();
        resize("joined runs", &mut self.parents, self.regions.len(), GONE)?;
        let mut count = 0;
        for index in 0..self.regions.len() {
            let region = self.regions[index];
            if keep(index, &region) {
                self.parents[index] = count;
                self.regions[count as usize] = region;
                count += 1;
            }
        }
        self.regions.truncate(count as usize);
        let mut kept = 0;
        for y in 0..self.rows.len().saturating_sub(1) {
            let row = self.rows[y] as usize..self.rows[y + 1] as usize;
            self.rows[y] = kept as u32;
            for at in row {
                let label = self.parents[self.runs[at].label as usize];
                if label != GONE {
                    self.runs[kept] = Run {
                        label,
                        ..self.runs[at]
                    };
                    kept += 1;
                }
            }
        }
        if let Some(last) = self.rows.last_mut() {
            *last = kept as u32;
        }
        self.runs.truncate(kept);
        Ok(())
    }
}

/// The run that stands for all those that are joined with this one.
fn root(parents: &mut [u32], mut at: u32) -> u32 {
    while parents[at as usize] != at {
        let over = parents[parents[at as usize] as usize];
        parents[at as usize] = over;
        at = over;
    }
    at
}

/// Join two runs: the earlier one stands for both.
fn join(parents: &mut [u32], a: u32, b: u32) {
    let (a, b) = (root(parents, a), root(parents, b));
    parents[a.max(b) as usize] = a.min(b);
}

#[cfg(test)]
pub(crate) mod tests;
