//! Where a picture does not show the background: by its samples pixel by pixel, by mean squares over windows, and without
//! what another light explains.

use std::ops::Range;

use crate::error::Result;
use crate::execution::Execution;
use crate::memory::resize;
use crate::parallel::{RowsMut, even_bands, for_each_band};
use crate::simd::dispatch;

use super::background::Background;
use super::box_filter::{Window, window_means};
use super::components::Runs;
use super::difference_kernels::{Masks, Pixels, Row, Thresholds, least_apart};
use super::local_correlation::{centre, explained_by_light};
use super::morphology::{Morphology, Size};
use super::regions::RegionWork;
use super::runs::next;
use super::shadows::Shadows;
use super::slopes::rows_around;
use super::vote::majority;

/// So many rows around a row are enough for what windows say of it.
const AROUND: usize = 8;
/// What is nowhere else than in the shade, but for this share, is a thing; where a gain explains half it is light.
const BODY: f64 = 0.3;
const LIT: f64 = 0.5;
const THREE: Window = Window { size: 3 };
pub(super) const FIVE: Window = Window { size: 5 };

/// What is compared.
pub(crate) struct Compared<'a> {
    /// In the background's light.
    pub(crate) picture: &'a [f32],
    /// 1 where the picture and the background are both known.
    pub(crate) both: &'a [u8],
    /// Standard deviation of the picture's noise.
    pub(crate) noise: f32,
    /// Whether the camera moves.
    pub(crate) moves: bool,
}

/// The differences, with memory that is kept.
#[derive(Debug, Default)]
pub(crate) struct Difference {
    /// 1 where the picture differs.
    pub(crate) differs: Vec<u8>,
    /// After an update 1 where it differs and light explains it.
    pub(crate) body: Vec<u8>,
    apart: Vec<f32>,
    squares: Vec<f32>,
    three: Vec<f32>,
    strong: Vec<u8>,
    weak: Vec<u8>,
    pub(super) votes: [Vec<u8>; 2],
    seeds: Vec<u8>,
    beside: Vec<u8>,
    pub(super) ratio: Vec<f32>,
    pub(super) shade: Vec<u8>,
    pub(super) lit: Vec<u8>,
    /// What the scene's shadows are like, while it is compared.
    pub(super) shadows: Shadows,
    pub(super) morphology: Morphology,
    regions: RegionWork,
    runs: Runs,
    counts: [Vec<u64>; 2],
}

impl Difference {
    /// Compare a picture with the background.
    pub(crate) fn update(
        &mut self,
        with: &Background,
        of: &Compared<'_>,
        execution: &Execution,
    ) -> Result<()> {
        let size = with.size;
        let pixels = size.0 * size.1;
        for mask in [
            &mut self.differs,
            &mut self.strong,
            &mut self.weak,
            &mut self.seeds,
            &mut self.beside,
            &mut self.shade,
            &mut self.lit,
            &mut self.body,
        ] {
            resize("masks", mask, pixels, 0)?;
        }
        for mask in &mut self.votes {
            resize("masks", mask, pixels, 0)?;
        }
        for plane in [
            &mut self.apart,
            &mut self.squares,
            &mut self.three,
            &mut self.ratio,
        ] {
            resize("differences", plane, pixels, 0.0)?;
        }
        let enough = least_apart(of.noise);
        with.distances(of.picture, enough, &mut self.apart, execution)?;
        self.compare(with, of, execution)?;
        let [strong, weak] = &mut self.votes;
        majority(&self.strong, size, 5, strong, execution)?;
        majority(&self.weak, size, 3, weak, execution)?;
        self.regions
            .grow(weak, strong, size, 1, &mut self.differs)?;
        self.over_windows(of, size, execution)?;
        self.regions
            .grow(&self.beside, &self.seeds, size, 1, &mut self.body)?;
        let mut any = 0;
        for (differs, more) in self.differs.iter_mut().zip(&self.body) {
            *differs |= more;
            any |= *differs;
        }
        if any == 0 {
            self.body.fill(0);
            return Ok(());
        }
        self.without_light(with, of, execution)
    }

    /// Pixel by pixel.
    fn compare(
        &mut self,
        with: &Background,
        of: &Compared<'_>,
        execution: &Execution,
    ) -> Result<()> {
        let (width, height) = with.size;
        let level = execution.simd_level();
        let outputs = Pixels {
            strong: RowsMut::new(&mut self.strong, width),
            weak: RowsMut::new(&mut self.weak, width),
            squares: RowsMut::new(&mut self.squares, width),
        };
        let apart = &self.apart;
        let rows = even_bands(execution, height, [32_768 / width, 16_384 / width]);
        for_each_band(execution, height, rows, outputs, |band, mut part| {
            let (mut gx, mut gy) = (vec![0.0; width], vec![0.0; width]);
            for (local, y) in band.enumerate() {
                let place = y * width..(y + 1) * width;
                let kernel = Row {
                    around: rows_around(&with.median, with.size, y),
                    slopes: [&mut gx, &mut gy],
                    picture: &of.picture[place.clone()],
                    deviation: &with.deviation[place.clone()],
                    age: &with.age[place.clone()],
                    both: &of.both[place.clone()],
                    apart: &apart[place],
                    noise: of.noise,
                    moves: of.moves,
                    strong: part.strong.row_mut(local),
                    weak: part.weak.row_mut(local),
                    squares: part.squares.row_mut(local),
                };
                dispatch(level, kernel);
            }
        })
    }

    fn over_windows(&mut self, of: &Compared<'_>, size: Size, execution: &Execution) -> Result<()> {
        let width = size.0;
        let squares = &self.squares;
        let fill =
            |y: usize, [row]: [&mut [f32]; 1]| row.copy_from_slice(&squares[y * width..][..width]);
        let copy = |local: usize, _, [means]: [&[f32]; 1], to: &mut RowsMut<'_, f32>| {
            to.row_mut(local).copy_from_slice(means);
        };
        window_means(
            size,
            THREE,
            RowsMut::new(&mut self.three, width),
            fill,
            copy,
            execution,
        )?;
        let three = &self.three;
        let level = execution.simd_level();
        let outputs = Masks(
            RowsMut::new(&mut self.seeds, width),
            RowsMut::new(&mut self.beside, width),
        );
        let emit = |local: usize, y: usize, [means]: [&[f32]; 1], to: &mut Masks<'_>| {
            let place = y * width..(y + 1) * width;
            let (seeds, beside) = (to.0.row_mut(local), to.1.row_mut(local));
            let (three, both) = (&three[place.clone()], &of.both[place]);
            dispatch(
                level,
                Thresholds {
                    means,
                    three,
                    both,
                    seeds,
                    beside,
                },
            );
        };
        window_means(size, FIVE, outputs, fill, emit, execution)
    }

    /// Take away what a shadow or a lamp explains beside a thing.
    fn without_light(
        &mut self,
        with: &Background,
        of: &Compared<'_>,
        execution: &Execution,
    ) -> Result<()> {
        let size = with.size;
        let pictures = [&with.median[..], of.picture];
        let centres = pictures.map(centre);
        let mut rows = 0..0;
        self.shadows.next();
        while let Some(next) = rows_with(&self.differs, size, rows.end) {
            rows = next;
            self.shades(with, of, rows.clone(), execution)?;
            self.spread_shades(with, of, rows.clone(), execution)?;
            let place = rows.start * size.0..rows.end * size.0;
            let pictures = pictures.map(|plane| &plane[place.clone()]);
            let size = (size.0, rows.len());
            // Two pictures: the noise of a difference.
            let noise = of.noise * 1.4;
            explained_by_light(
                pictures,
                centres,
                size,
                noise,
                &mut self.lit[place.clone()],
                execution,
            )?;
            // Where the background's texture shows in a shade it is light.
            for (lit, told) in self.lit[place.clone()]
                .iter_mut()
                .zip(&self.votes[1][place])
            {
                *lit |= told;
            }
        }
        let masks = self.differs.iter().zip(&self.shade).zip(&self.lit);
        for (body, ((differs, shade), lit)) in self.strong.iter_mut().zip(masks) {
            *body = differs & (1 - shade) & (1 - lit);
        }
        // Edges of shadows are thin.
        majority(&self.strong, size, 3, &mut self.body, execution)?;
        for (body, other) in self.body.iter_mut().zip(&self.strong) {
            *body &= other;
        }
        self.without_edges_of_shades(size, execution)?;
        self.runs.label(&self.differs, size)?;
        let [bodies, lights] = &mut self.counts;
        self.runs.sum_bytes(&self.body, bodies)?;
        self.runs.sum_bytes(&self.lit, lights)?;
        let regions = self.runs.regions();
        let whole = |label: usize| {
            let area = f64::from(regions[label].area);
            (bodies[label] as f64) < BODY * area && (lights[label] as f64) < LIT * area
        };
        self.runs.paint(whole, 1, &mut self.body);
        std::mem::swap(&mut self.differs, &mut self.body);
        for (differed, differs) in self.body.iter_mut().zip(&self.differs) {
            *differed &= 1 - differs;
        }
        Ok(())
    }
}

/// Rows from `from` on until nothing is set in a mask far around: an even first one, and an even count but at the frame's
/// end, as windows of half the size need them. Those at either end are only what windows over the others reach to.
fn rows_with(mask: &[u8], (width, height): Size, from: usize) -> Option<Range<usize>> {
    let has = |y: usize| next(&mask[y * width..(y + 1) * width], 0, 1) < width;
    let first = (from..height).find(|y| has(*y))?;
    let mut last = first;
    for y in first..height {
        if has(y) {
            last = y;
        } else if y > last + 2 * AROUND + 2 {
            break;
        }
    }
    let start = first.saturating_sub(AROUND).next_multiple_of(2).max(from);
    let end = (last + 1 + AROUND).next_multiple_of(2).min(height);
    Some(start..end)
}
