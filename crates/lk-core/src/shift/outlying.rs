//! Tiles that leave far more than what the displacement rests on: things that move on their own, or most of the window.

use super::gram::{F_GX, F_GY, F_ONE, Gram, OUTLYING};
use super::matrix::inverse;
use super::model::Model;
use super::solution::Others;
use super::solve::Solver;
use super::sums::Tiling;

/// Tiles that move on their own are left out as long as they hold no more than this share of the pixels and of the squared
/// gradients.
const MOST_OUTLYING: f64 = 0.4;
/// More than this share of the pixels is most of the window.
const MOST: f64 = 0.55;
/// A tile that leaves this share of its texture shows nothing of what the other frame does.
const UNMATCHED: f64 = 0.3;

impl Solver {
    /// How much further the tiles would go that leave far more than what the displacement rests on, where they are most of
    /// the window: which of two motions is that of the window cannot be told. Nothing where they are few.
    pub(super) fn others(&self, step: [f64; 2], typical: f64, floor: f64) -> Others {
        let (mut gradient, mut difference) = ([[0.0; 2]; 2], [0.0; 2]);
        let (mut outlying, mut unmatched, mut all) = (0.0, 0.0, 0.0);
        for block in self.grams.iter().filter_map(|(_, block)| block.as_ref()) {
            all += block.count;
            if block.variance().max(floor) > OUTLYING * typical {
                outlying += block.count;
                if block.residual > UNMATCHED * block.texture {
                    unmatched += block.count;
                }
                for i in 0..2 {
                    difference[i] += block.difference[i];
                    for j in 0..2 {
                        gradient[i][j] += block.gradient[i][j];
                        difference[i] += block.gradient[i][j] * step[j];
                    }
                }
            }
        }
        let inverse = (outlying > MOST * all).then(|| inverse(gradient)).flatten();
        Others {
            further: inverse.map_or([0.0; 2], |inverse| {
                inverse.map(|row| -(row[0] * difference[0] + row[1] * difference[1]))
            }),
            unmatched: unmatched > MOST * all,
        }
    }

    /// How far one light for the window leads from the last evaluation where the tiles that move on their own are left out;
    /// `None` where these are so many that they may be what moves as a whole.
    pub(super) fn step_in_one_light(&self, tiling: &Tiling, model: &Model) -> Option<[f64; 2]> {
        let middle = tiling.center();
        let mut kept = Gram::default();
        let (mut pixels, mut gradients) = ([0.0; 2], [0.0; 2]);
        for (index, (tile, block)) in self.grams.iter().enumerate() {
            let stays = block
                .as_ref()
                .is_none_or(|block| block.variance().max(model.floor) <= OUTLYING * self.typical);
            let energy = tile.of(F_GX, F_GX) + tile.of(F_GY, F_GY);
            pixels[usize::from(stays)] += tile.of(F_ONE, F_ONE);
            gradients[usize::from(stays)] += energy;
            if stays {
                kept.add(&tile.moved(tiling.from(index, middle)));
            }
        }
        let few = |[gone, stays]: [f64; 2]| gone <= MOST_OUTLYING * (gone + stays);
        if !few(pixels) || !few(gradients) {
            return None;
        }
        let block = kept.reduce(model.light)?;
        let inverse = inverse(block.gradient)?;
        let [x, y] = block.difference;
        Some([0, 1].map(|axis| -(inverse[axis][0] * x + inverse[axis][1] * y)))
    }
}
