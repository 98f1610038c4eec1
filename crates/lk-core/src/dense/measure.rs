//! One measurement: the flow of a pair of frames that have been read, and what is to be said of it.

use crate::error::Result;
use crate::execution::Execution;
use crate::frame::scale_by;

use super::field::FlowField;
use super::levels::CoarseToFine;
use super::options::{DenseHints, DenseOptions};
use super::source::Source;
use super::windows::Views;
use super::workspace::Workspace;
use super::{chance, covariance, validity, weights};

/// Write to `field` the flow from `prev` to `next`; `prev` may be given the light of `next`.
pub(super) fn measure(
    options: &DenseOptions,
    (prev, next): (&mut Source, &Source),
    memory: &mut Workspace,
    hints: DenseHints<'_>,
    execution: &Execution,
    field: &mut FlowField,
) -> Result<()> {
    let base = &prev.pyramid.levels()[0];
    let (width, height) = (base.width(), base.height());
    field.resize(width, height)?;
    if options.covariance {
        field.resize_covariance()?;
    } else {
        field.covariance = Vec::new();
    }
    if width < 2 || height < 2 {
        field.clear();
        return Ok(());
    }
    let counts = Some(&prev.counts).filter(|plane| plane.width() > 0);
    let masked = hints.mask.is_some() || counts.is_some();
    if masked {
        weights::given(hints.mask, counts, (width, height), &mut memory.given)?;
        weights::pyramid(&memory.given, &prev.pyramid, &mut memory.weights)?;
    }
    let mut descent = CoarseToFine {
        options,
        execution,
        prev: &mut prev.pyramid,
        next: &next.pyramid,
        ranges: [&prev.greys, &next.greys].map(|greys| greys.range(next.scale)),
        weighted: masked,
        first: 0,
        found: false,
        guessing: false,
        short: false,
        judged: false,
        memory: &mut *memory,
    };
    let lit = descent.run(hints)?;
    let weighted = descent.weighted;
    if let Some(halvings) = lit {
        field.gain.copy_of(&memory.light.gain)?;
        field.offset.copy_of(&memory.light.offset)?;
        // A power of two: dividing by it is exact.
        scale_by(field.offset.data_mut(), prev.scale.recip());
        field.halvings = halvings;
    }
    report(
        options,
        (prev, next),
        memory,
        (masked, weighted),
        execution,
        field,
    )
}

/// Write to `field` the flow that is in `memory`, where it is valid, and how far it may be off: `masked` pixels of `prev` are
/// in its `given`, and where windows were `weighted`, clipped pixels count for nothing either.
fn report(
    options: &DenseOptions,
    (prev, next): (&Source, &Source),
    memory: &mut Workspace,
    (masked, weighted): (bool, bool),
    execution: &Execution,
    field: &mut FlowField,
) -> Result<()> {
    let Workspace {
        flow: [u, v],
        halved,
        weights,
        given,
        judged,
        support,
        trend,
        counts,
        near,
        cells,
        ..
    } = memory;
    let input = Views {
        prev: &prev.pyramid.levels()[0],
        next: &next.pyramid.levels()[0],
        u,
        v,
        halved: *halved,
        weight: weighted.then(|| &weights[0]),
    };
    let given = masked.then_some(&*given);
    let bad = if next.counts.width() > 0 {
        weights::near_uncounted(&next.counts, validity::RADIUS, near)?;
        Some(near.as_slice())
    } else {
        None
    };
    validity::mark(
        input,
        (&*judged, &support.fit),
        (given, bad),
        (trend.slopes, prev.scale.recip()),
        field,
        execution,
    )?;
    if let Some(most) = options.max_displacement {
        validity::refuse_longer(field, most);
    }
    chance::clear(field, judged, counts)?;
    if options.covariance {
        let of_recipe = (options.recipe.finest, options.recipe.covariance);
        let of_windows = (&*judged, input.prev);
        covariance::write(field, of_windows, of_recipe, cells, execution)?;
    }
    Ok(())
}
