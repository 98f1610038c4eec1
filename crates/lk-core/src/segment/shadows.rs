//! The share of the light that the shadows of a scene leave: learned where the ground's texture tells a shadow, believed
//! where there is none.

/// Classes of shares from 0 to 1.
const CLASSES: usize = 50;
/// What was seen counts less by this factor from frame to frame.
const KEPT: f32 = 0.97;
/// So many pixels of shadows, in sums over frames, are enough to believe their share.
const ENOUGH: f32 = 600.0;
/// Of them this part lies within so many classes of the commonest.
const TOGETHER: f32 = 0.5;
const WITHIN: usize = 3;
/// Before it is known a shade that no texture tells leaves a share within these: what differs less is a thing like the ground.
const UNLEARNED: [f32; 2] = [0.3, 0.85];
/// Around the learned share; where the edge of a shadow is soft, from there up to this.
const AROUND_SHARE: f32 = 0.08;
const SOFT: f32 = 0.97;

/// What shares were seen.
#[derive(Debug, Clone)]
pub(crate) struct Shadows {
    /// Pixels by the class of their share.
    pub(crate) seen: Vec<f32>,
}

impl Default for Shadows {
    fn default() -> Self {
        Self {
            seen: vec![0.0; CLASSES],
        }
    }
}

impl Shadows {
    /// A frame begins.
    pub(super) fn next(&mut self) {
        for seen in &mut self.seen {
            *seen *= KEPT;
        }
    }

    /// Take the shares of what is surely a shadow.
    pub(super) fn see(&mut self, surely: &[u8], shares: &[f32]) {
        for (_, share) in surely.iter().zip(shares).filter(|(sure, _)| **sure == 1) {
            let class = (share * CLASSES as f32) as usize;
            self.seen[class.min(CLASSES - 1)] += 1.0;
        }
    }

    /// Shares of the inside of shadows, where they are known.
    pub(super) fn inside(&self) -> Option<[f32; 2]> {
        let all: f32 = self.seen.iter().sum();
        let (mut best, mut at) = (0.0, 0);
        for k in 0..CLASSES {
            let around = k.saturating_sub(WITHIN)..(k + WITHIN + 1).min(CLASSES);
            let sum: f32 = self.seen[around].iter().sum();
            if sum > best {
                (best, at) = (sum, k);
            }
        }
        let share = (at as f32 + 0.5) / CLASSES as f32;
        let known = all >= ENOUGH && best >= TOGETHER * all;
        known.then_some([share - AROUND_SHARE, share + AROUND_SHARE])
    }
}

/// Shares of what may be a shade though no texture tells it; `inside` as [`Shadows::inside`] has it.
pub(super) fn shares(inside: Option<[f32; 2]>) -> [f32; 2] {
    inside.map_or(UNLEARNED, |[low, _]| [low, SOFT])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_share_that_most_shadows_leave_is_learned_and_forgotten() {
        let mut shadows = Shadows::default();
        assert_eq!(shadows.inside(), None);
        assert_eq!(shares(None), UNLEARNED);
        let share: Vec<f32> = (0..100).map(|k| 0.57 + 0.0004 * k as f32).collect();
        for _ in 0..10 {
            shadows.next();
            shadows.see(&[1; 100], &share);
            // What is not sure says nothing.
            shadows.see(&[0; 100], &[0.9; 100]);
        }
        let [low, high] = shadows.inside().unwrap();
        assert!(low < 0.57 && high > 0.61 && high - low < 0.2);
        assert_eq!(shares(Some([low, high])), [low, SOFT]);
        for _ in 0..20 {
            shadows.next();
        }
        assert_eq!(shadows.inside(), None);
    }

    #[test]
    fn shares_that_lie_anywhere_are_none() {
        let mut shadows = Shadows::default();
        let anywhere: Vec<f32> = (0..5000).map(|k| k as f32 / 5000.0).collect();
        shadows.see(&[1; 5000], &anywhere);
        assert_eq!(shadows.inside(), None);
    }
}
