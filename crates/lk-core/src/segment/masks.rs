//! Steps of a decision over whole masks. Slices that are arguments are known to be apart, so that each runs in lanes.

/// Forget what was known where something `hides` it before anything was confirmed in so many frames; such places are warm.
/// `both` is where something is known and seen.
pub(super) fn hide(
    (hides, enough): (&[u8], u8),
    confirmed: &[u8],
    seen: &[u8],
    known: &mut [u8],
    (heat, warm): (&mut [u8], u8),
    both: &mut [u8],
) {
    let from = hides.iter().zip(confirmed).zip(seen);
    let to = known.iter_mut().zip(heat).zip(both);
    for (((known, heat), both), ((hides, confirmed), seen)) in to.zip(from) {
        let hidden = hides & u8::from(*confirmed < enough);
        *known &= 1 - hidden;
        *heat = if hidden == 1 { warm } else { *heat };
        *both = *known & seen;
    }
}

/// What goes to and fro is learned for so many frames before it is compared with.
pub(super) fn learned(flutters: &[u8], (age, old): (&[u8], u8), both: &mut [u8]) {
    for (both, (flutters, age)) in both.iter_mut().zip(flutters.iter().zip(age)) {
        *both &= (1 - flutters) | u8::from(*age >= old);
    }
}

/// What differs, and what moves by its flow or stopped where nothing is known.
pub(super) fn join(
    differs: &[u8],
    by_flow: &[u8],
    stopped: &[u8],
    known: &[u8],
    seen: &[u8],
    to: &mut [u8],
) {
    let places = known.iter().zip(seen);
    let from = differs.iter().zip(by_flow).zip(stopped).zip(places);
    for (to, (((differs, by_flow), stopped), (known, seen))) in to.iter_mut().zip(from) {
        *to = differs | ((by_flow | stopped) & (1 - known) & seen);
    }
}

pub(super) fn without(mask: &[u8], gone: &[u8], to: &mut [u8]) {
    for (to, (mask, gone)) in to.iter_mut().zip(mask.iter().zip(gone)) {
        *to = mask & (1 - gone);
    }
}

/// Count the frames that showed the background, and let nothing be learned where something hides it before `enough` did.
pub(super) fn confirm(
    gone: &[u8],
    both: &[u8],
    (by_flow, hides, enough): (&[u8], &[u8], u8),
    foreground: &[u8],
    away: &mut [u8],
    confirmed: &mut [u8],
) {
    let flow = by_flow.iter().zip(hides);
    let masks = gone.iter().zip(both).zip(flow.zip(foreground));
    let to = away.iter_mut().zip(confirmed);
    for ((away, confirmed), ((gone, both), ((by_flow, hides), foreground))) in to.zip(masks) {
        *away |= hides & u8::from(*confirmed < enough);
        let shown = both & (1 - foreground) & (1 - by_flow);
        let more = confirmed.saturating_add(shown);
        *confirmed = if *gone == 1 { 0 } else { more };
    }
}

/// What goes to and fro is learned whatever it looks like; a shade is not where the background was seen in fewer than so many
/// frames.
pub(super) fn keep_away(flutters: &[u8], shaded: &[u8], (age, old): (&[u8], u8), away: &mut [u8]) {
    let places = flutters.iter().zip(shaded).zip(age);
    for (away, ((flutters, shaded), age)) in away.iter_mut().zip(places) {
        *away = (*away | (shaded & u8::from(*age < old))) & (1 - flutters);
    }
}
