//! The outline of what moves where nothing is known behind it: windows of the flow reach over a thing's edge, and what they
//! add looks like the ground beside it.

use crate::error::Result;
use crate::memory::reserve;

use super::morphology::Size;
use super::runs::next;

/// So many pixels of a wrong outline are taken away.
const ROUNDS: usize = 3;
/// A pixel is compared with what is this far around it, inside and outside, of which there are so many pixels.
const REACH: usize = 2;
const FEWEST: f32 = 3.0;
/// Both sides differ by so many deviations of the noise, and the pixel from what is outside by this share of what it differs by
/// from what is inside.
const APART: f32 = 4.0;
const LIKE: f32 = 0.6;

/// Where an outline is looked at, all of one size.
pub(super) struct Outline<'a> {
    pub(super) size: Size,
    /// 1 where the background is known: there it tells.
    pub(super) known: &'a [u8],
    /// 1 where what moved stopped: its outline is that of before.
    pub(super) held: &'a [u8],
    /// 1 where the picture is.
    pub(super) seen: &'a [u8],
    pub(super) picture: &'a [f32],
    pub(super) noise: f32,
}

impl Outline<'_> {
    /// Take away what looks like the outside; `like` is memory that is kept.
    pub(super) fn trim(&self, mask: &mut [u8], like: &mut Vec<usize>) -> Result<()> {
        let (width, height) = self.size;
        for _ in 0..ROUNDS {
            like.clear();
            for y in REACH..height.saturating_sub(REACH) {
                let row = &mask[y * width..(y + 1) * width];
                let mut x = next(row, 0, 1);
                while x < width {
                    let at = y * width + x;
                    let within = x >= REACH && x + REACH < width;
                    if within && (self.known[at] | self.held[at]) == 0 && self.is_like(mask, at) {
                        reserve("an outline", like, 1)?;
                        like.push(at);
                    }
                    x = next(row, x + 1, 1);
                }
            }
            if like.is_empty() {
                return Ok(());
            }
            for at in like.iter() {
                mask[*at] = 0;
            }
        }
        Ok(())
    }

    /// Whether a pixel of a mask is beside its outside, and more like that than like the inside.
    fn is_like(&self, mask: &[u8], at: usize) -> bool {
        let width = self.size.0;
        if mask[at - 1] & mask[at + 1] & mask[at - width] & mask[at + width] == 1 {
            return false;
        }
        let (mut sums, mut counts) = ([0.0f32; 2], [0.0f32; 2]);
        for row in 0..=2 * REACH {
            let start = at + row * width - REACH * width - REACH;
            let places = start..start + 2 * REACH + 1;
            let greys = self.seen[places.clone()]
                .iter()
                .zip(&self.picture[places.clone()]);
            for (column, (mask, (seen, grey))) in mask[places].iter().zip(greys).enumerate() {
                if start + column != at && *seen == 1 {
                    let side = usize::from(*mask);
                    sums[side] += grey;
                    counts[side] += 1.0;
                }
            }
        }
        if counts[0] < FEWEST || counts[1] < FEWEST {
            return false;
        }
        let (outside, inside) = (sums[0] / counts[0], sums[1] / counts[1]);
        let here = self.picture[at];
        (outside - inside).abs() > APART * self.noise
            && (here - outside).abs() < LIKE * (here - inside).abs()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A thing of 8 x 8 pixels on other ground, under a mask that is 2 pixels too wide.
    fn scene(thing: f32, known: u8) -> (Vec<u8>, Vec<u8>) {
        let (size, mut picture, mut mask) = ((20, 20), vec![80.0; 400], vec![0; 400]);
        let mut truth = mask.clone();
        for y in 4..16 {
            for x in 4..16 {
                mask[y * 20 + x] = 1;
                if (6..14).contains(&x) && (6..14).contains(&y) {
                    truth[y * 20 + x] = 1;
                    picture[y * 20 + x] = thing;
                }
            }
        }
        let outline = Outline {
            size,
            known: &[known; 400],
            held: &[0; 400],
            seen: &[1; 400],
            picture: &picture,
            noise: 1.0,
        };
        outline.trim(&mut mask, &mut Vec::new()).unwrap();
        (mask, truth)
    }

    #[test]
    fn what_looks_like_the_ground_beside_it_is_taken_from_a_thing() {
        let (mask, truth) = scene(120.0, 0);
        assert_eq!(mask, truth);
    }

    #[test]
    fn things_like_the_ground_and_known_ground_are_left() {
        for (mask, _) in [scene(83.0, 0), scene(120.0, 1)] {
            assert_eq!(mask.iter().filter(|set| **set == 1).count(), 144);
        }
    }
}
