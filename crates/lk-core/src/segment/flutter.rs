//! What goes to and fro: leaves, water, a flag. Its flow is motion in every frame and leads nowhere; what is behind it is
//! never seen, and what it shows is the background.

use crate::error::Result;
use crate::execution::Execution;
use crate::memory::resize;

use super::background::moved;
use super::morphology::{Element, Size, dilate};
use super::transform::Map;

/// Directions that are told apart, and how many of them two have between them, at least, that are opposite.
const DIRECTIONS: u8 = 16;
const OPPOSITE: u8 = 6;
/// Tangents of the edges of a quarter's directions: 11.25, 33.75, 56.25 and 78.75 degrees.
const EDGES: [f32; 4] = [0.198_912, 0.668_179, 1.496_606, 5.027_339];
/// Steps of a pace, in a pixel.
const STEPS: f32 = 8.0;
/// A turn that comes more frames after the one before does not go on with it.
const PERIOD: u8 = 25;
/// What went further than this, in pixels, came from elsewhere and does not flutter.
const MOST_PX: u8 = 8;
/// So many turns, one after the other, are no thing that comes after another.
const TURNS: u8 = 3;
/// Places that are looked at together.
const BLOCK: usize = 64;
/// Frames without a turn after which a place flutters no more.
const MEMORY: u8 = 120;
/// What is around a place that flutters does so too, in pixels.
const AROUND: usize = 11;

/// How something moves at a place: which way, how far a frame.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Going {
    /// A direction from 1 on; 0 where nothing moves; [`Self::LEFT`].
    way: u8,
    /// Its length in parts of a pixel.
    pace: u8,
}

impl Going {
    /// Something was just seen to leave this place.
    pub(super) const LEFT: Self = Self { way: 255, pace: 0 };

    /// Whether it is not the default.
    pub(super) fn goes(self) -> bool {
        self.way > 0
    }

    /// Of a motion in pixels.
    pub(super) fn of([u, v]: [f32; 2]) -> Self {
        let (along, across) = (u.abs(), v.abs());
        let quarter = EDGES.iter().filter(|edge| across > **edge * along).count() as u8;
        let half = if u < 0.0 { 8 - quarter } else { quarter };
        let turned = if v < 0.0 {
            (DIRECTIONS - half) % DIRECTIONS
        } else {
            half
        };
        Self {
            way: 1 + turned,
            pace: (STEPS * (u * u + v * v).sqrt()) as u8,
        }
    }
}

/// Where something went to and fro on the canvas.
#[derive(Debug, Clone, Default)]
pub(crate) struct Flutter {
    /// The direction of the last turn or the first one, from 1 on; 0 where there was none.
    way: Vec<u8>,
    /// Frames since the last turn, or since there is a direction.
    since: Vec<u8>,
    /// How far it went since.
    path: Vec<u8>,
    /// Turns, one after the other.
    pub(crate) turns: Vec<u8>,
    /// 1 where something flutters.
    pub(crate) mask: Vec<u8>,
}

impl Flutter {
    pub(crate) fn planes(&self) -> [&Vec<u8>; 5] {
        [&self.way, &self.since, &self.path, &self.turns, &self.mask]
    }

    pub(crate) fn planes_mut(&mut self) -> [&mut Vec<u8>; 5] {
        [
            &mut self.way,
            &mut self.since,
            &mut self.path,
            &mut self.turns,
            &mut self.mask,
        ]
    }

    /// Nothing flutters.
    pub(crate) fn reset(&mut self, pixels: usize) -> Result<()> {
        for plane in self.planes_mut() {
            plane.clear();
            resize("masks", plane, pixels, 0)?;
        }
        Ok(())
    }

    /// See the canvas anew: `map` takes a pixel of it to the old one's.
    pub(crate) fn moved(&mut self, size: Size, map: &Map, execution: &Execution) -> Result<()> {
        for plane in self.planes_mut() {
            moved(plane, size, map, 0, execution)?;
        }
        Ok(())
    }

    /// Take how each place goes, and say whether anything begins to flutter; where is written to `begins` then. `spare` is of
    /// the same size.
    pub(crate) fn update(
        &mut self,
        going: &[Going],
        size: Size,
        [begins, spare]: [&mut Vec<u8>; 2],
        execution: &Execution,
    ) -> Result<bool> {
        let mut turned = 0;
        let states = self.way.chunks_mut(BLOCK).zip(self.since.chunks_mut(BLOCK));
        let more = self
            .path
            .chunks_mut(BLOCK)
            .zip(self.turns.chunks_mut(BLOCK));
        for (((ways, since), (path, turns)), now) in states.zip(more).zip(going.chunks(BLOCK)) {
            // Most blocks have nothing in them, which is seen in lanes.
            let any = ways.iter().fold(0, |any, way| any | way);
            if any | now.iter().fold(0, |any, now| any | now.way) == 0 {
                continue;
            }
            for (at, (way, now)) in ways.iter_mut().zip(now).enumerate() {
                if *way > 0 || now.way > 0 {
                    step([way, &mut since[at], &mut path[at], &mut turns[at]], *now);
                    turned |= turns[at];
                }
            }
        }
        if turned < TURNS {
            // Also where the last one has just ended: few.
            self.mask.fill(0);
            return Ok(false);
        }
        for (to, turns) in begins.iter_mut().zip(&self.turns) {
            *to = u8::from(*turns >= TURNS);
        }
        spare.copy_from_slice(&self.mask);
        dilate(
            begins,
            size,
            Element::Square(AROUND),
            &mut self.mask,
            execution,
        )?;
        for (begins, (before, now)) in begins.iter_mut().zip(spare.iter().zip(&self.mask)) {
            *begins = now & (1 - before);
        }
        Ok(true)
    }
}

/// One place sees something go, or nothing.
#[inline(always)]
fn step([way, since, path, turns]: [&mut u8; 4], now: Going) {
    *since = since.saturating_add(1);
    if now.way > 0 && now.way <= DIRECTIONS {
        let apart = now.way.abs_diff(*way);
        if *way > 0 && apart.min(DIRECTIONS - apart) >= OPPOSITE {
            *turns = if *since <= PERIOD {
                turns.saturating_add(1)
            } else {
                1
            };
            (*way, *since, *path) = (now.way, 0, 0);
        } else if *way == 0 {
            (*way, *since) = (now.way, 0);
        }
        *path = path.saturating_add(now.pace);
        if f32::from(*path) > STEPS * f32::from(MOST_PX) {
            *turns = 0;
        }
    }
    if *since > MEMORY {
        (*way, *since, *path, *turns) = (0, 0, 0, 0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// How many turns a place has that sees motions along x.
    fn turns_of(motions: impl IntoIterator<Item = f32>) -> u8 {
        let (mut way, mut since, mut path, mut turns) = (0, 0, 0, 0);
        for u in motions {
            let now = if u == 0.0 {
                Going::default()
            } else {
                Going::of([u, 0.1])
            };
            step([&mut way, &mut since, &mut path, &mut turns], now);
        }
        turns
    }

    #[test]
    fn directions_are_all_around() {
        for k in 0..DIRECTIONS {
            let angle = f32::from(k) / f32::from(DIRECTIONS) * std::f32::consts::TAU;
            let going = Going::of([3.0 * angle.cos(), 3.0 * angle.sin()]);
            assert_eq!(going.way, k + 1);
            assert!(going.pace.abs_diff(24) <= 1);
        }
        assert_eq!(Going::of([1e9, 0.0]).pace, 255);
    }

    #[test]
    fn leaves_flutter_and_what_passes_does_not() {
        let leaf = (0..40).map(|k| (0.7 * k as f32).sin());
        assert!(turns_of(leaf) >= TURNS);
        // One that goes around.
        let (mut state, mut turns) = ([0; 3], 0);
        for k in 0..40 {
            let [way, since, path] = &mut state;
            let angle = 0.7 * k as f32;
            step(
                [way, since, path, &mut turns],
                Going::of([angle.sin(), angle.cos()]),
            );
        }
        assert!(turns >= TURNS);
        // One thing, and others to and fro behind it, each longer than what leaves swing.
        assert_eq!(turns_of([2.0; 30]), 0);
        let three = (0..30).map(|k| if k / 10 % 2 == 0 { 2.0 } else { -2.0 });
        assert!(turns_of(three) < TURNS);
    }

    #[test]
    fn what_has_come_to_rest_is_forgotten() {
        let leaf = (0..40).map(|k| (0.7 * k as f32).sin());
        assert_eq!(turns_of(leaf.chain([0.0; 130])), 0);
    }

    #[test]
    fn what_begins_is_told_once() {
        let size = (30, 10);
        let execution = Execution::default();
        let mut flutter = Flutter::default();
        flutter.reset(300).unwrap();
        let (mut begins, mut spare) = (vec![0; 300], vec![0; 300]);
        let mut told = 0;
        for k in 0..40 {
            let mut going = vec![Going::default(); 300];
            going[155] = Going::of([(0.7 * k as f32).sin(), 0.0]);
            let work = [&mut begins, &mut spare];
            flutter.update(&going, size, work, &execution).unwrap();
            told += u32::from(begins[155]);
        }
        assert_eq!(told, 1);
        assert_eq!(flutter.mask[155 + AROUND / 2], 1);
        assert_eq!(flutter.mask[155 + AROUND / 2 + 1], 0);
        for _ in 0..130 {
            let nowhere = vec![Going::default(); 300];
            let work = [&mut begins, &mut spare];
            flutter.update(&nowhere, size, work, &execution).unwrap();
        }
        assert_eq!(flutter.mask, vec![0; 300]);
    }
}
