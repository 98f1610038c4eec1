//! The sums over clusters, a pixel at a time: what [`SumStripe`](super::stripe::SumStripe) is held to.

use super::sums::{CLUSTER, PRODUCTS, Sums};
use super::view::{FEATURES, View};
use crate::frame::Plane;
use crate::shift::filters::{DERIVATIVE, RADIUS, Taps, reversed, taps};

/// The features of one pixel.
type Sample = [f64; FEATURES];

/// The sums over each cluster of the window.
pub(super) fn sums(view: &View<'_>) -> Vec<Sums> {
    let [(left, right), (top, bottom)] = view.pair.window;
    let across = (right - left).div_ceil(CLUSTER);
    let mut clusters = vec![[0.0; PRODUCTS]; across * (bottom - top).div_ceil(CLUSTER)];
    for y in top..bottom {
        for x in left..right {
            if let Some((features, weight)) = view.features([x as isize, y as isize]) {
                let cluster = (y - top) / CLUSTER * across + (x - left) / CLUSTER;
                add(&mut clusters[cluster], &features, weight);
            }
        }
    }
    clusters
}

fn add(sums: &mut Sums, features: &Sample, weight: f64) {
    let mut next = 0;
    for i in 0..FEATURES {
        for j in i..FEATURES {
            sums[next] += weight * features[i] * features[j];
            next += 1;
        }
    }
}

impl View<'_> {
    /// Both frames at a pixel, moved towards each other; `None` outside of what they show.
    fn sample(&self, pixel: [isize; 2], whole: [isize; 2]) -> Option<[f32; 2]> {
        let (half, _) = self.half(pixel, whole);
        let half = half.map(|value| value.clamp(-0.5, 0.5));
        let across = taps(half[0]);
        let down = taps(half[1]);
        let prev = filtered(self.pair.prev, pixel, reversed(across), reversed(down))?;
        let at = std::array::from_fn(|axis| pixel[axis] + whole[axis] - self.pair.origin[axis]);
        let next = filtered(self.pair.next, at, across, down)?;
        Some([prev, next])
    }

    fn weight(&self, pixel: [isize; 2], whole: [isize; 2]) -> f64 {
        let of = |plane: Option<&Plane>, [x, y]: [isize; 2]| {
            plane.map_or(1.0, |plane| f64::from(plane.row(y as usize)[x as usize]))
        };
        let at = std::array::from_fn(|axis| pixel[axis] + whole[axis] - self.pair.origin[axis]);
        of(self.pair.prev_weight, pixel) * of(self.pair.next_weight, at)
    }

    /// The features of a pixel; `None` where it does not count.
    fn features(&self, pixel: [isize; 2]) -> Option<(Sample, f64)> {
        let whole = self.whole(pixel);
        let at = |dx: isize, dy: isize| self.sample([pixel[0] + dx, pixel[1] + dy], whole);
        let mean = |dx: isize, dy: isize| -> Option<f64> {
            let [prev, next] = at(dx, dy)?;
            Some(f64::from(prev + next) / 2.0)
        };
        let (near, far) = (f64::from(DERIVATIVE[3]), f64::from(DERIVATIVE[4]));
        let gx = near * (mean(1, 0)? - mean(-1, 0)?) + far * (mean(2, 0)? - mean(-2, 0)?);
        let gy = near * (mean(0, 1)? - mean(0, -1)?) + far * (mean(0, 2)? - mean(0, -2)?);
        let [prev, next] = at(0, 0)?;
        let weight = self.weight(pixel, whole);
        let (_, [px, py]) = self.half(pixel, whole);
        let light = [1.0, px, py, f64::from(prev + next) / 2.0];
        let motion = [gx, gy, gx * px, gx * py, gy * px, gy * py];
        let mut features = [f64::from(next - prev); FEATURES];
        features[..motion.len()].copy_from_slice(&motion);
        features[motion.len()..][..light.len()].copy_from_slice(&light);
        (weight != 0.0).then_some((features, weight))
    }
}

/// A plane at a pixel, filtered; `None` where the filter does not fit.
fn filtered(plane: &Plane, [x, y]: [isize; 2], across: Taps, down: Taps) -> Option<f32> {
    let radius = RADIUS as isize;
    let inside = |at: isize, size: usize| at >= radius && at + radius < size as isize;
    if !inside(x, plane.width()) || !inside(y, plane.height()) {
        return None;
    }
    let (left, top) = (x as usize - RADIUS, y as usize - RADIUS);
    let mut sum = 0.0;
    for (k, tap) in down.iter().enumerate() {
        let row = &plane.row(top + k)[left..left + 2 * RADIUS + 1];
        let outer = across[0] * row[0] + across[4] * row[4];
        let inner = across[1] * row[1] + across[3] * row[3];
        sum += tap * (outer + inner + across[2] * row[2]);
    }
    Some(sum)
}
