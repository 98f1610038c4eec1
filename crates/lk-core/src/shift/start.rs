//! Where to start: candidates from phase correlation at a coarse level, judged by how well the frames then agree.

use super::refine::Pair;
use crate::error::Result;
use crate::frame::Plane;
use crate::phase::{fast_length, phase_correlation};

/// Peaks of the correlation surface that are tried.
const PEAKS: usize = 6;
/// The least share of the window that both frames must show.
const MIN_SHARE: f64 = 0.08;

/// The whole-pixel displacement, within `limit`, at which the pair agrees best; `None` if the frames share too little
/// at every displacement tried.
pub(super) fn best_start(pair: Pair<'_>, limit: [f64; 2]) -> Result<Option<[isize; 2]>> {
    let size = [
        fast_length(pair.prev.width().max(pair.next.width())),
        fast_length(pair.prev.height().max(pair.next.height())),
    ];
    let columns = pair.window[0].0..pair.window[0].1;
    let rows = pair.window[1].0..pair.window[1].1;
    let prev = tapered(pair.prev, pair.prev_weight, columns, rows, size);
    let next = tapered(
        pair.next,
        pair.next_weight,
        0..pair.next.width(),
        0..pair.next.height(),
        size,
    );
    let surface = phase_correlation(&prev, &next)?;
    let within = |d: [isize; 2]| {
        (d[0].unsigned_abs() as f64) <= limit[0] && (d[1].unsigned_abs() as f64) <= limit[1]
    };
    let mut best: Option<(f64, [isize; 2])> = None;
    let mut consider = |d: [isize; 2]| {
        if within(d)
            && let Some(score) = score(pair, d)
            && best.is_none_or(|(found, _)| score > found)
        {
            best = Some((score, d));
            true
        } else {
            false
        }
    };
    consider([0, 0]);
    for peak in peaks(&surface) {
        for wrap_y in [0, size[1] as isize] {
            for wrap_x in [0, size[0] as isize] {
                consider([
                    peak[0] as isize - wrap_x + pair.origin[0],
                    peak[1] as isize - wrap_y + pair.origin[1],
                ]);
            }
        }
    }
    let Some((mut score_here, mut here)) = best else {
        return Ok(None);
    };
    for _ in 0..8 {
        let mut improved = false;
        let centre = here;
        for (dx, dy) in [
            (-1, 0),
            (1, 0),
            (0, -1),
            (0, 1),
            (-1, -1),
            (1, 1),
            (-1, 1),
            (1, -1),
        ] {
            let d = [centre[0] + dx, centre[1] + dy];
            if within(d)
                && let Some(found) = score(pair, d)
                && found > score_here
            {
                (score_here, here) = (found, d);
                improved = true;
            }
        }
        if !improved {
            break;
        }
    }
    Ok(Some(here))
}

/// The highest local maxima of the surface, the highest first.
fn peaks(surface: &Plane) -> Vec<[usize; 2]> {
    let (width, height) = (surface.width(), surface.height());
    let mut found: Vec<(f32, [usize; 2])> = Vec::new();
    for y in 0..height {
        let rows = [
            surface.row((y + height - 1) % height),
            surface.row(y),
            surface.row((y + 1) % height),
        ];
        for x in 0..width {
            let value = rows[1][x];
            let columns = [(x + width - 1) % width, x, (x + 1) % width];
            if rows
                .iter()
                .all(|row| columns.iter().all(|column| row[*column] <= value))
            {
                found.push((value, [x, y]));
            }
        }
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.cmp(&b.1)));
    found.truncate(PEAKS);
    found.into_iter().map(|(_, at)| at).collect()
}

/// The part of `plane` in `columns` and `rows`, its mean taken out and faded to zero at its border, padded to `size`.
fn tapered(
    plane: &Plane,
    weight: Option<&Plane>,
    columns: std::ops::Range<usize>,
    rows: std::ops::Range<usize>,
    size: [usize; 2],
) -> Plane {
    let mut result = Plane::new(size[0], size[1]);
    let (mut sum, mut count) = (0.0f64, 0.0f64);
    for y in rows.clone() {
        for x in columns.clone() {
            let w = f64::from(weight.map_or(1.0, |plane| plane.row(y)[x]));
            sum += w * f64::from(plane.row(y)[x]);
            count += w;
        }
    }
    let mean = (sum / count.max(1.0)) as f32;
    let fade = |index: usize, length: usize| {
        let border = (length as f32 / 4.0).max(1.0);
        let distance = (index as f32 + 0.5).min(length as f32 - index as f32 - 0.5);
        if distance >= border {
            1.0
        } else {
            0.5 - 0.5 * (std::f32::consts::PI * distance / border).cos()
        }
    };
    let across: Vec<f32> = columns
        .clone()
        .map(|x| fade(x - columns.start, columns.len()))
        .collect();
    for y in rows.clone() {
        let down = fade(y - rows.start, rows.len());
        for x in columns.clone() {
            let w = weight.map_or(1.0, |plane| plane.row(y)[x]);
            result.row_mut(y)[x] = w * down * across[x - columns.start] * (plane.row(y)[x] - mean);
        }
    }
    result
}

/// How surely the frames agree at displacement `d`: the correlation coefficient, by Fisher's transform, times the root
/// of the pixels that it rests on.
fn score(pair: Pair<'_>, d: [isize; 2]) -> Option<f64> {
    let columns = shared(pair.window[0], pair.next.width(), d[0] - pair.origin[0])?;
    let rows = shared(pair.window[1], pair.next.height(), d[1] - pair.origin[1])?;
    let window = (pair.window[0].1 - pair.window[0].0) * (pair.window[1].1 - pair.window[1].0);
    let mut sums = [0.0f64; 6];
    for y in rows {
        let other_y = (y as isize + d[1] - pair.origin[1]) as usize;
        let start = (columns.start as isize + d[0] - pair.origin[0]) as usize;
        let a = &pair.prev.row(y)[columns.clone()];
        let b = &pair.next.row(other_y)[start..start + a.len()];
        let wa = pair.prev_weight.map(|plane| &plane.row(y)[columns.clone()]);
        let wb = pair
            .next_weight
            .map(|plane| &plane.row(other_y)[start..start + a.len()]);
        let mut lanes = [0.0f32; 6];
        for x in 0..a.len() {
            let w = wa.map_or(1.0, |row| row[x]) * wb.map_or(1.0, |row| row[x]);
            let (p, n) = (a[x], b[x]);
            lanes[0] += w;
            lanes[1] += w * p;
            lanes[2] += w * n;
            lanes[3] += w * p * p;
            lanes[4] += w * p * n;
            lanes[5] += w * n * n;
        }
        for (sum, lane) in sums.iter_mut().zip(lanes) {
            *sum += f64::from(lane);
        }
    }
    let [count, p, n, pp, pn, nn] = sums;
    if count < (MIN_SHARE * window as f64).max(9.0) {
        return None;
    }
    let (pp, pn, nn) = (pp - p * p / count, pn - p * n / count, nn - n * n / count);
    let correlation = pn / (pp * nn).sqrt().max(1e-9);
    Some(correlation.clamp(-0.999, 0.999).atanh() * count.sqrt())
}

fn shared(window: (usize, usize), length: usize, offset: isize) -> Option<std::ops::Range<usize>> {
    let start = (window.0 as isize).max(-offset);
    let end = (window.1 as isize).min(length as isize - offset);
    (start < end).then_some(start as usize..end as usize)
}
