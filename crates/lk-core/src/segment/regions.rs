//! Masks cleaned by their regions: grown from seeds, filled, and rid of what is small.

use std::ops::Range;

use crate::error::Result;
use crate::memory::{reserve, resize};

use super::components::{Neighbours, Region, Run, Runs};
use super::morphology::Size;

/// Runs, sums and marks that are kept from frame to frame.
#[derive(Debug, Default)]
pub(crate) struct RegionWork {
    runs: Runs,
    row: Vec<u8>,
    counts: Vec<u64>,
    outline: Outline,
}

impl RegionWork {
    /// Write those connected regions of what `weak` or `seeds` has that hold `least` seeds or more: a threshold with
    /// hysteresis.
    ///
    /// # Errors
    ///
    /// [`Error::Memory`](crate::Error::Memory).
    pub(crate) fn grow(
        &mut self,
        weak: &[u8],
        seeds: &[u8],
        size: Size,
        least: u64,
        to: &mut [u8],
    ) -> Result<()> {
        self.label_any([weak, seeds, seeds], size)?;
        self.runs.sum_bytes(seeds, &mut self.counts)?;
        self.runs.draw(|label| self.counts[label] >= least, to);
        Ok(())
    }

    /// Write the seeds and what is certain, grown over what is possible too: of the latter only what lies within the
    /// convex hull of a region's certain pixels.
    ///
    /// # Errors
    ///
    /// [`Error::Memory`](crate::Error::Memory).
    pub(crate) fn grow_in_hulls(
        &mut self,
        [certain, possible, seeds]: [&[u8]; 3],
        size: Size,
        to: &mut [u8],
    ) -> Result<()> {
        self.label_any([certain, possible, seeds], size)?;
        self.runs.sum_bytes(seeds, &mut self.counts)?;
        self.runs.keep(|label, _| self.counts[label] > 0)?;
        to.fill(0);
        let spots = |run: &Run| {
            let place = run.place(size.0);
            let here = certain[place.clone()].iter().zip(&seeds[place]);
            here.map(|(a, b)| a | b)
        };
        self.outline.reset(self.runs.regions())?;
        for run in self.runs.runs() {
            let first = spots(run).position(|spot| spot == 1);
            let last = spots(run).rposition(|spot| spot == 1);
            if let (Some(first), Some(last)) = (first, last) {
                self.outline.widen(run, first as u32, last as u32);
            }
        }
        for label in 0..self.runs.regions().len() {
            self.outline.fill_hull(label)?;
        }
        for run in self.runs.runs() {
            let place = run.place(size.0);
            for (to, spot) in to[place.clone()].iter_mut().zip(spots(run)) {
                *to = spot;
            }
            if let Some(inside) = self.outline.inside(run) {
                to[place.start + inside.start..place.start + inside.end].fill(1);
            }
        }
        Ok(())
    }

    /// Set, in place, what is not set and has no way to the border of the frame: holes of at most `most` pixels.
    ///
    /// # Errors
    ///
    /// [`Error::Memory`](crate::Error::Memory).
    pub(crate) fn fill_holes(&mut self, mask: &mut [u8], size: Size, most: u32) -> Result<()> {
        self.runs.label_inverse(mask, size)?;
        let regions = self.runs.regions();
        let hole = |label: usize| {
            let region: &Region = &regions[label];
            region.area <= most && !region.touches_border(size)
        };
        self.runs.paint(hole, 1, mask);
        Ok(())
    }

    /// Take away, in place, the regions of fewer than `least` pixels.
    ///
    /// # Errors
    ///
    /// [`Error::Memory`](crate::Error::Memory).
    pub(crate) fn remove_small(&mut self, mask: &mut [u8], size: Size, least: u32) -> Result<()> {
        self.runs.label(mask, size)?;
        let regions = self.runs.regions();
        self.runs
            .paint(|label| regions[label].area < least, 0, mask);
        Ok(())
    }

    /// Take the regions of what any of three masks has.
    fn label_any(&mut self, [a, b, c]: [&[u8]; 3], size: Size) -> Result<()> {
        let (width, height) = size;
        resize("a row of a mask", &mut self.row, width, 0)?;
        self.runs.begin(size)?;
        for y in 0..height {
            let row = y * width..(y + 1) * width;
            let masks = a[row.clone()].iter().zip(&b[row.clone()]).zip(&c[row]);
            for (to, ((a, b), c)) in self.row.iter_mut().zip(masks) {
                *to = a | b | c;
            }
            self.runs.take_row(y, &self.row[..width], 0)?;
        }
        self.runs.join(Neighbours::Eight)
    }
}

/// First and last columns of each region in each of its rows, and the hull around them.
#[derive(Debug, Default)]
struct Outline {
    /// Where each region's rows begin among `spans`, and its first row.
    starts: Vec<(usize, u32)>,
    /// First and last column; the first is after the last where there is none.
    spans: Vec<(i64, i64)>,
    corners: Vec<(i64, i64)>,
}

impl Outline {
    /// Far beyond any column.
    const NOTHING: (i64, i64) = (1 << 40, -(1 << 40));

    fn reset(&mut self, regions: &[Region]) -> Result<()> {
        self.spans.clear();
        resize("regions", &mut self.starts, regions.len() + 1, (0, 0))?;
        let mut all = 0;
        for (start, region) in self.starts.iter_mut().zip(regions) {
            *start = (all, region.top);
            all += (region.bottom - region.top) as usize;
        }
        self.starts[regions.len()] = (all, 0);
        self.starts.truncate(regions.len() + 1);
        resize("rows of regions", &mut self.spans, all, Self::NOTHING)
    }

    fn at(&self, run: &Run) -> usize {
        let (start, top) = self.starts[run.label as usize];
        start + (run.y - top) as usize
    }

    /// Let the run's region reach from the `first` to the `last` pixel of the run.
    fn widen(&mut self, run: &Run, first: u32, last: u32) {
        let at = self.at(run);
        let span = &mut self.spans[at];
        span.0 = span.0.min(i64::from(run.start + first));
        span.1 = span.1.max(i64::from(run.start + last));
    }

    /// Widen a region's rows to its convex hull.
    fn fill_hull(&mut self, label: usize) -> Result<()> {
        let rows = self.starts[label].0..self.starts[label + 1].0;
        self.bend(rows.clone(), 1)?;
        self.bend(rows, -1)
    }

    /// Move the first columns to the hull where `sign` is 1, the last ones where it is -1.
    fn bend(&mut self, rows: Range<usize>, sign: i64) -> Result<()> {
        self.corners.clear();
        reserve("corners", &mut self.corners, rows.len())?;
        let spans = &mut self.spans[rows];
        for (y, span) in spans
            .iter()
            .enumerate()
            .filter(|(_, span)| span.0 <= span.1)
        {
            let new = (y as i64, if sign == 1 { span.0 } else { -span.1 });
            while let [.., a, b] = self.corners[..] {
                // Where the corner before lies on or beyond the line past it, it is none.
                if (b.1 - a.1) * (new.0 - a.0) < (new.1 - a.1) * (b.0 - a.0) {
                    break;
                }
                self.corners.pop();
            }
            self.corners.push(new);
        }
        for pair in self.corners.windows(2) {
            let [(y0, x0), (y1, x1)] = [pair[0], pair[1]];
            for y in y0 + 1..y1 {
                // Whole pixels within the line.
                let (run, along) = (y1 - y0, (x1 - x0) * (y - y0));
                let x = x0 + (along + run - 1).div_euclid(run);
                let span = &mut spans[y as usize];
                if sign == 1 {
                    span.0 = span.0.min(x);
                } else {
                    span.1 = span.1.max(-x);
                }
            }
        }
        Ok(())
    }

    /// The part of a run that lies within the hull of its region, counted from its start.
    fn inside(&self, run: &Run) -> Option<Range<usize>> {
        let (first, last) = self.spans[self.at(run)];
        let start = first.max(i64::from(run.start)) - i64::from(run.start);
        let end = (last + 1).min(i64::from(run.end)) - i64::from(run.start);
        (start < end).then_some(start as usize..end as usize)
    }
}

#[cfg(test)]
mod tests;
