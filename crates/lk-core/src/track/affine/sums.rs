//! The sums over a window that the least squares of an affine warp are made of.
//!
//! Every unknown changes a pixel by one of its derivatives, by its grey level or by 1, times 1, x or y. So all products
//! are a few of those of a pixel times its place: a column of lanes is summed with the powers of y first, and those of x
//! are the same for all of it.

use crate::simd::{EIGHT, Eight, Kernel, Simd};
use crate::track::affine::factor::UNKNOWNS;
use crate::track::affine::template::{Samples, Template, stride};

/// Products of 1, x and y with each other, among 1, x, y, xx, xy, yy.
const PLACES: [[usize; 3]; 3] = [[0, 1, 2], [1, 3, 4], [2, 4, 5]];

/// The sums of some values times 1, x, y, xx, xy, yy.
#[derive(Clone, Copy)]
struct Moments<L>([L; 6]);

impl<L: Eight> Moments<L> {
    #[inline(always)]
    fn zero() -> Self {
        Self([L::zero(); 6])
    }

    /// Add a column of lanes at `x` whose sums with 1, y and yy are these.
    #[inline(always)]
    fn add(&mut self, [plain, y, yy]: [L; 3], x: L) {
        let [one, by_x, by_y, by_xx, by_xy, by_yy] = &mut self.0;
        let across = plain * x;
        *one += plain;
        *by_x += across;
        *by_y += y;
        *by_xx += across * x;
        *by_xy += y * x;
        *by_yy += yy;
    }

    #[inline(always)]
    fn sums(&self) -> [f64; 6] {
        L::sums(&self.0)
    }
}

/// Add `value` times 1, y and yy.
#[inline(always)]
fn add<L: Eight>(sums: &mut [L; 3], value: L, [y, yy]: [L; 2]) {
    sums[0] += value;
    sums[1] += value * y;
    sums[2] += value * yy;
}

/// Sums of the products of what the unknowns change; above the diagonal.
pub(super) struct Square<'a> {
    pub(super) template: &'a Template,
    /// Bits to keep of each pixel, if some do not count.
    pub(super) keep: Option<&'a Samples>,
    /// Whether the lighting model has an unknown.
    pub(super) lit: bool,
}

impl Kernel for Square<'_> {
    type Output = [[f64; UNKNOWNS]; UNKNOWNS];

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> Self::Output {
        let mut sums = [[0.0; UNKNOWNS]; UNKNOWNS];
        self.motion::<S::Eight>(&mut sums);
        if self.lit {
            self.motion_and_light::<S::Eight>(&mut sums);
        }
        self.light::<S::Eight>(&mut sums);
        sums
    }
}

impl Square<'_> {
    /// The lanes of a block that count, in the row that `at` begins in.
    #[inline(always)]
    fn mask<L: Eight>(&self, within: L, at: usize) -> L {
        match self.keep {
            Some(keep) => within.keep(L::load(keep, at)),
            None => within,
        }
    }

    #[inline(always)]
    fn powers<L: Eight>(&self, row: usize) -> [L; 2] {
        let y = L::splat(self.template.y(row));
        [y, y * y]
    }

    /// Of both derivatives with each other.
    #[inline(always)]
    fn motion<L: Eight>(&self, sums: &mut [[f64; UNKNOWNS]; UNKNOWNS]) {
        let Template { window, .. } = self.template;
        let mut moments = [Moments::zero(); 3];
        for block in 0..window.blocks() {
            let mut columns = [[L::zero(); 3]; 3];
            for row in 0..window.height {
                let at = row * stride(window.width) + block * EIGHT;
                let mut across = L::load(&self.template.across, at);
                let mut down = L::load(&self.template.down, at);
                if let Some(keep) = self.keep {
                    let keep = L::load(keep, at);
                    (across, down) = (across.keep(keep), down.keep(keep));
                }
                let powers = self.powers(row);
                add(&mut columns[0], across * across, powers);
                add(&mut columns[1], across * down, powers);
                add(&mut columns[2], down * down, powers);
            }
            let x = self.template.x(block);
            for line in 0..3 {
                moments[line].add(columns[line], x);
            }
        }
        let [across, mixed, down] = moments;
        let (across, mixed, down) = (across.sums(), mixed.sums(), down.sums());
        for (row, places) in PLACES.into_iter().enumerate() {
            for (column, place) in places.into_iter().enumerate() {
                sums[row][column] = across[place];
                sums[row][3 + column] = mixed[place];
                sums[3 + row][3 + column] = down[place];
            }
        }
    }

    /// Of both derivatives with an offset, its slopes, and the grey level.
    #[inline(always)]
    fn motion_and_light<L: Eight>(&self, sums: &mut [[f64; UNKNOWNS]; UNKNOWNS]) {
        let Template { window, .. } = self.template;
        let middle = L::splat(self.template.middle);
        let lines = [&self.template.across, &self.template.down];
        for (first, line) in [0, 3].into_iter().zip(lines) {
            let (mut moments, mut graded) = (Moments::zero(), Moments::zero());
            for block in 0..window.blocks() {
                let (mut plain, mut with_grey) = ([L::zero(); 3], [L::zero(); 3]);
                for row in 0..window.height {
                    let at = row * stride(window.width) + block * EIGHT;
                    let mut value = L::load(line, at);
                    if let Some(keep) = self.keep {
                        value = value.keep(L::load(keep, at));
                    }
                    let powers = self.powers(row);
                    add(&mut plain, value, powers);
                    let grey = L::load(&self.template.grey, at) - middle;
                    let graded = value * grey;
                    with_grey[0] += graded;
                    with_grey[1] += graded * powers[0];
                }
                let x = self.template.x(block);
                moments.add(plain, x);
                graded.add(with_grey, x);
            }
            let (moments, graded) = (moments.sums(), graded.sums());
            for (row, [one, along, down]) in PLACES.into_iter().enumerate() {
                let light = [moments[one], graded[row], moments[along], moments[down]];
                sums[first + row][6..].copy_from_slice(&light);
            }
        }
    }

    /// Of what the lighting changes with itself. The contrast of a window is told without an offset and its slopes too:
    /// these are made for every model.
    #[inline(always)]
    fn light<L: Eight>(&self, sums: &mut [[f64; UNKNOWNS]; UNKNOWNS]) {
        let Template { window, .. } = self.template;
        let middle = L::splat(self.template.middle);
        let (mut places, mut greys) = (Moments::zero(), Moments::zero());
        let mut squared = L::zero();
        for block in 0..window.blocks() {
            let within = self.template.within::<L>(block);
            let (mut ones, mut plain) = ([L::zero(); 3], [L::zero(); 3]);
            for row in 0..window.height {
                let at = row * stride(window.width) + block * EIGHT;
                let mask = self.mask(within, at);
                let grey = (L::load(&self.template.grey, at) - middle).keep(mask);
                let powers = self.powers(row);
                add(&mut ones, L::splat(1.0).keep(mask), powers);
                plain[0] += grey;
                plain[1] += grey * powers[0];
                squared += grey * grey;
            }
            let x = self.template.x(block);
            places.add(ones, x);
            greys.add(plain, x);
        }
        let (places, greys) = (places.sums(), greys.sums());
        let [one, x, y, xx, xy, yy] = places;
        sums[6][6..].copy_from_slice(&[one, greys[0], x, y]);
        sums[7][7..].copy_from_slice(&[squared.sum(), greys[1], greys[2]]);
        sums[8][8..].copy_from_slice(&[xx, xy]);
        sums[9][9] = yy;
    }
}

/// Sums of the difference between samples and a template with what each unknown changes, and squared.
pub(super) struct Project<'a> {
    pub(super) template: &'a Template,
    pub(super) samples: &'a Samples,
    /// Bits to keep of each pixel, if some do not count.
    pub(super) keep: Option<&'a Samples>,
}

impl Kernel for Project<'_> {
    type Output = ([f64; UNKNOWNS], f64);

    #[inline(always)]
    fn run<S: Simd>(self, _: S) -> Self::Output {
        let Template { window, .. } = self.template;
        let middle = S::Eight::splat(self.template.middle);
        // With each derivative times 1, x, y, with 1, the grey level, x, y; squared.
        let mut totals = [S::Eight::zero(); UNKNOWNS + 1];
        for block in 0..window.blocks() {
            let within = self.template.within::<S::Eight>(block);
            let mut sums = [S::Eight::zero(); 8];
            for row in 0..window.height {
                let at = row * stride(window.width) + block * EIGHT;
                let grey = S::Eight::load(&self.template.grey, at);
                let mut difference = (S::Eight::load(self.samples, at) - grey).keep(within);
                if let Some(keep) = self.keep {
                    difference = difference.keep(S::Eight::load(keep, at));
                }
                let y = S::Eight::splat(self.template.y(row));
                let across = difference * S::Eight::load(&self.template.across, at);
                let down = difference * S::Eight::load(&self.template.down, at);
                sums[0] += across;
                sums[1] += across * y;
                sums[2] += down;
                sums[3] += down * y;
                sums[4] += difference;
                sums[5] += difference * y;
                sums[6] += difference * (grey - middle);
                sums[7] += difference * difference;
            }
            let x = self.template.x::<S::Eight>(block);
            let [
                across,
                across_y,
                down,
                down_y,
                plain,
                plain_y,
                graded,
                squared,
            ] = sums;
            let parts = [
                across,
                across * x,
                across_y,
                down,
                down * x,
                down_y,
                plain,
                graded,
                plain * x,
                plain_y,
                squared,
            ];
            for line in 0..=UNKNOWNS {
                totals[line] += parts[line];
            }
        }
        let all = S::Eight::sums(&totals);
        let mut sums = [0.0; UNKNOWNS];
        sums.copy_from_slice(&all[..UNKNOWNS]);
        (sums, all[UNKNOWNS])
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::simd::{SimdLevel, dispatch};
    use crate::track::affine::template::{Differentiate, ROOM};
    use crate::track::patch::Window;

    /// A template of a window, and samples to compare it with, of any values.
    fn filled(window: Window, seed: u32) -> (Box<Template>, Box<Samples>) {
        let value = |index: usize| {
            let mixed = (index as u32 ^ seed).wrapping_mul(2_654_435_761);
            (mixed >> 20) as f32 * 0.05
        };
        let mut samples = Box::new([0.0; ROOM]);
        for (index, sample) in samples.iter_mut().enumerate() {
            *sample = value(index);
        }
        let mut template = Box::new(Template::new());
        let kernel = Differentiate {
            samples: &samples,
            window,
            template: &mut template,
        };
        dispatch(SimdLevel::Baseline, kernel);
        samples.rotate_left(13);
        (template, samples)
    }

    /// What each unknown changes at a pixel.
    fn changes(template: &Template, row: usize, column: usize) -> [f64; UNKNOWNS] {
        let Window { width, height } = template.window;
        let half = 0.5 * width.max(height) as f64;
        let x = (column as f64 - 0.5 * (width as f64 - 1.0)) / half;
        let y = (row as f64 - 0.5 * (height as f64 - 1.0)) / half;
        let at = row * stride(width) + column;
        let across = f64::from(template.across[at]);
        let down = f64::from(template.down[at]);
        let grey = f64::from(template.grey[at]) - f64::from(template.middle);
        [
            across,
            across * x,
            across * y,
            down,
            down * x,
            down * y,
            1.0,
            grey,
            x,
            y,
        ]
    }

    proptest! {
        #[test]
        fn sums_are_those_of_the_definition(
            width in 3usize..40, height in 3usize..40, seed in any::<u32>(), masked in any::<bool>(), lit in any::<bool>(),
        ) {
            let window = Window { width, height };
            let (template, samples) = filled(window, seed);
            let mut keep = Box::new([0.0; ROOM]);
            for (index, keep) in keep.iter_mut().enumerate() {
                *keep = f32::from_bits(if (index * 7 + seed as usize % 5).is_multiple_of(3) { 0 } else { u32::MAX });
            }
            let (mut square, mut largest) = ([[0.0; UNKNOWNS]; UNKNOWNS], [0.0f64; UNKNOWNS]);
            let (mut project, mut squared) = ([0.0; UNKNOWNS], 0.0);
            for row in 0..height {
                for column in 0..width {
                    let at = row * stride(width) + column;
                    if masked && keep[at].to_bits() == 0 {
                        continue;
                    }
                    let changes = changes(&template, row, column);
                    let difference = f64::from(samples[at]) - f64::from(template.grey[at]);
                    squared += difference * difference;
                    for i in 0..UNKNOWNS {
                        project[i] += difference * changes[i];
                        largest[i] += changes[i] * changes[i];
                        for j in i..UNKNOWNS {
                            if lit || j < 6 || i >= 6 {
                                square[i][j] += changes[i] * changes[j];
                            }
                        }
                    }
                }
            }
            let keep = masked.then_some(&*keep);
            for level in SimdLevel::available() {
                let found = dispatch(level, Square { template: &template, keep, lit });
                let (sums, total) = dispatch(level, Project { template: &template, samples: &samples, keep });
                prop_assert!((total - squared).abs() <= 1e-5 * squared);
                for i in 0..UNKNOWNS {
                    let scale = (largest[i] * squared).sqrt();
                    prop_assert!((sums[i] - project[i]).abs() <= 1e-5 * scale, "{} {} {}", i, sums[i], project[i]);
                    for j in 0..UNKNOWNS {
                        let scale = (largest[i] * largest[j]).sqrt();
                        let (got, want) = (found[i][j], square[i][j]);
                        prop_assert!(j < i || (got - want).abs() <= 1e-5 * scale, "{} {} {} {}", i, j, got, want);
                    }
                }
            }
        }
    }
}
