//! What the shade of a thing explains: a picture darker than the background by a share that is alike all around, and the
//! edge between that and the light.

use std::ops::Range;

use crate::error::Result;
use crate::execution::Execution;
use crate::parallel::RowsMut;
use crate::simd::dispatch;

use super::background::Background;
use super::box_filter::{Window, window_means};
use super::difference::{Compared, Difference, FIVE};
use super::difference_kernels::Masks;
use super::morphology::{Element, Size, dilate};
use super::shade_kernels::{Penumbra, Ratio, Shade, Unlike};
use super::shadows::shares;
use super::slopes::rows_around;

/// Windows of a shade differ from the background by so many times what noise makes.
const SHADE_NOISE: f32 = 1.1;
/// The edge of a shadow is at most so wide, in pixels.
const EDGE: usize = 5;
/// What is called the edge of a shade has some of its inside within this window.
const SPREAD: Window = Window { size: 31 };

impl Difference {
    /// A shadow with a sharp edge leaves a line of it: take away what is thin beside a shade.
    pub(super) fn without_edges_of_shades(
        &mut self,
        size: Size,
        execution: &Execution,
    ) -> Result<()> {
        let [thick, near] = &mut self.votes;
        thick.copy_from_slice(&self.body);
        self.morphology
            .open(thick, size, Element::Square(EDGE), execution)?;
        dilate(thick, size, Element::Square(EDGE + 2), near, execution)?;
        for (shade, (differs, lit)) in self
            .shade
            .iter_mut()
            .zip(self.differs.iter().zip(&self.lit))
        {
            *shade = differs & (*shade | lit);
        }
        dilate(
            &self.shade,
            size,
            Element::Square(2 * EDGE + 1),
            thick,
            execution,
        )?;
        for (body, (near, shaded)) in self.body.iter_mut().zip(near.iter().zip(thick.iter())) {
            *body &= near | (1 - shaded);
        }
        Ok(())
    }

    /// The edge of a shade is darker than the background by any share up to that of its inside. What texture tells of these
    /// rows stands in the second mask of votes.
    pub(super) fn spread_shades(
        &mut self,
        with: &Background,
        of: &Compared<'_>,
        rows: Range<usize>,
        execution: &Execution,
    ) -> Result<()> {
        let (width, size) = (with.size.0, (with.size.0, rows.len()));
        let level = execution.simd_level();
        let whole = rows.start * width..rows.end * width;
        let place = |y: usize| y * width..(y + 1) * width;
        let differs = &self.differs[whole.clone()];
        let [core, told] = &mut self.votes;
        let core = &mut core[whole.clone()];
        let masks = told[whole.clone()].iter().zip(differs);
        for (to, (told, differs)) in core.iter_mut().zip(masks) {
            *to = told & differs;
        }
        self.morphology
            .open(core, size, Element::Square(3), execution)?;
        self.shadows.see(core, &self.ratio[whole.clone()]);
        if let Some([low, high]) = self.shadows.inside() {
            let places = self.shade[whole.clone()].iter().zip(differs);
            let places = places.zip(&self.ratio[whole.clone()]);
            for (to, ((shade, differs), ratio)) in core.iter_mut().zip(places) {
                *to |= shade & differs & u8::from(*ratio > low) & u8::from(*ratio < high);
            }
        }
        if !core.contains(&1) {
            return Ok(());
        }
        let (core, ratio) = (&*core, &self.ratio[whole.clone()]);
        let (median, picture) = (&with.median[whole.clone()], &of.picture[whole.clone()]);
        let fill = |y: usize, [weights, shares, squares]: [&mut [f32]; 3]| {
            let from = core[place(y)].iter().zip(&ratio[place(y)]);
            let to = weights.iter_mut().zip(shares).zip(squares);
            for (((weight, share), square), (core, ratio)) in to.zip(from) {
                *weight = f32::from(*core);
                *share = *weight * ratio;
                *square = *share * ratio;
            }
        };
        let outputs = RowsMut::new(&mut self.shade[whole], width);
        let emit = |local: usize, y: usize, means: [&[f32]; 3], to: &mut RowsMut<'_, u8>| {
            let kernel = Penumbra {
                means,
                differs: &differs[place(y)],
                background: &median[place(y)],
                picture: &picture[place(y)],
                noise: of.noise,
                to: to.row_mut(local),
            };
            dispatch(level, kernel);
        };
        window_means(size, SPREAD, outputs, fill, emit, execution)
    }

    /// Where, in some rows, a picture is darker than the background by a share that is alike all around.
    pub(super) fn shades(
        &mut self,
        with: &Background,
        of: &Compared<'_>,
        rows: Range<usize>,
        execution: &Execution,
    ) -> Result<()> {
        let width = with.size.0;
        let size = (width, rows.len());
        let level = execution.simd_level();
        let whole = rows.start * width..rows.end * width;
        let (picture, median) = (&of.picture[whole.clone()], &with.median[whole.clone()]);
        let place = |y: usize| y * width..(y + 1) * width;
        let fill = |y: usize, [a, b]: [&mut [f32]; 2]| {
            a.copy_from_slice(&picture[place(y)]);
            b.copy_from_slice(&median[place(y)]);
        };
        let emit = |local: usize, _, [a, b]: [&[f32]; 2], to: &mut RowsMut<'_, f32>| {
            dispatch(
                level,
                Ratio {
                    a,
                    b,
                    to: to.row_mut(local),
                },
            );
        };
        window_means(
            size,
            FIVE,
            RowsMut::new(&mut self.ratio[whole.clone()], width),
            fill,
            emit,
            execution,
        )?;
        let ratio = &self.ratio[whole.clone()];
        let fill = |y: usize, channels: [&mut [f32]; 4]| {
            let kernel = Unlike {
                picture: rows_around(picture, size, y),
                background: rows_around(median, size, y),
                ratio: &ratio[place(y)],
                to: channels,
            };
            dispatch(level, kernel);
        };
        let noise = SHADE_NOISE * of.noise * of.noise;
        let inside = self.shadows.inside();
        let (believed, learned) = (u8::from(inside.is_some()), shares(inside));
        let age = &with.age[whole.clone()];
        let emit = |local: usize, y: usize, means: [&[f32]; 4], to: &mut Masks<'_>| {
            let kernel = Shade {
                means,
                ratio: &ratio[place(y)],
                noise,
                learned,
                believed,
                age: &age[place(y)],
                to: [to.0.row_mut(local), to.1.row_mut(local)],
            };
            dispatch(level, kernel);
        };
        window_means(
            size,
            FIVE,
            Masks(
                RowsMut::new(&mut self.shade[whole.clone()], width),
                RowsMut::new(&mut self.votes[1][whole], width),
            ),
            fill,
            emit,
            execution,
        )
    }
}
