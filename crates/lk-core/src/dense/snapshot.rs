//! What dense flow knows of the frame before, to go on with it elsewhere or later.

use ndarray::ArrayView2;

use crate::error::{Error, Result};
use crate::frame::Plane;
use crate::grey::GreyRange;

use super::DenseFlow;
use super::source::Source;

/// What a [`DenseFlow`] knows of the frame before, to the bit: one of the same options that is given it goes on as the
/// first would have. To make one from what was written somewhere, fill in the fields of a default one.
#[derive(Debug, Clone, PartialEq, Default)]
#[non_exhaustive]
pub struct DenseSnapshot {
    /// Its grey levels times `scale`, smoothed; pixels that do not count have those of what is around them.
    pub frame: Plane,
    /// 1 where the frame is finite and not masked, 0 elsewhere; of no size where all counts.
    pub counts: Plane,
    /// The frame as it came, to be read with another mask; of no size where no mask was given.
    pub raw: Plane,
    /// The power of two.
    pub scale: f32,
    /// The least and the largest grey level that counts, without `scale`.
    pub extremes: Option<[f32; 2]>,
    /// Whether every pixel that is not masked is finite.
    pub all_finite: bool,
}

impl DenseSnapshot {
    fn validate(&self) -> Result<()> {
        let size = size_of(&self.frame);
        for (name, plane) in [("counts", &self.counts), ("raw", &self.raw)] {
            let got = size_of(plane);
            if got != size && got != (0, 0) {
                return Err(Error::shape(
                    name,
                    format!("{got:?}"),
                    format!("the shape of the frame, {size:?}, or nothing"),
                ));
            }
        }
        let scale = self.scale;
        if !(scale > 0.0 && scale.is_normal() && scale.recip().is_normal()) {
            return Err(Error::option("scale", scale, "a power of two"));
        }
        let [low, high] = self.extremes.unwrap_or_default();
        if !(low.is_finite() && high.is_finite() && low <= high) {
            let got = format!("{low}, {high}");
            return Err(Error::option(
                "extremes",
                got,
                "two finite numbers in order",
            ));
        }
        if !self.frame.data().iter().all(|value| value.is_finite()) {
            return Err(Error::option("frame", "NaN or infinity", "finite numbers"));
        }
        Ok(())
    }
}

/// Rows and columns.
fn size_of(plane: &Plane) -> (usize, usize) {
    (plane.height(), plane.width())
}

impl DenseFlow {
    /// What is known of the frame before; `None` before the first one.
    ///
    /// # Errors
    ///
    /// [`Error::Memory`].
    ///
    /// ```
    /// use lk_core::{DenseFlow, DenseHints, DenseOptions, FlowField};
    /// use ndarray::Array2;
    ///
    /// let (first, second) = (Array2::<u8>::zeros((40, 60)), Array2::<u8>::ones((40, 60)));
    /// let mut flow = DenseFlow::new(DenseOptions::default())?;
    /// let mut field = FlowField::default();
    /// flow.update(first.view(), DenseHints::default(), &mut field)?;
    /// let mut other = DenseFlow::new(DenseOptions::default())?;
    /// other.restore(flow.snapshot()?.as_ref())?;
    /// assert!(other.update(second.view(), DenseHints::default(), &mut field)?);
    /// # Ok::<(), lk_core::Error>(())
    /// ```
    pub fn snapshot(&self) -> Result<Option<DenseSnapshot>> {
        let source = &self.next;
        let Some(finest) = source.pyramid.levels().first().filter(|_| self.primed) else {
            return Ok(None);
        };
        let copy = |plane: &Plane| {
            let mut copy = Plane::default();
            copy.copy_of(plane).map(|()| copy)
        };
        let (extremes, all_finite) = source.greys.parts();
        Ok(Some(DenseSnapshot {
            frame: copy(finest)?,
            counts: copy(&source.counts)?,
            raw: copy(&source.raw)?,
            scale: source.scale,
            extremes,
            all_finite,
        }))
    }

    /// Take over what another knew of the frame before; nothing, if it knew of none.
    ///
    /// # Errors
    ///
    /// [`Error::Shape`] or [`Error::Option`] if the snapshot contradicts itself, [`Error::Memory`], those of the execution.
    /// After an error the next frame is a first one.
    pub fn restore(&mut self, snapshot: Option<&DenseSnapshot>) -> Result<()> {
        self.primed = false;
        let Some(snapshot) = snapshot else {
            return Ok(());
        };
        snapshot.validate()?;
        let size = size_of(&snapshot.frame);
        let (levels, execution) = (self.levels(size), self.execution(size.0 * size.1));
        let frame = ArrayView2::from_shape(size, snapshot.frame.data())
            .map_err(|error| Error::shape("frame", error.to_string(), "a whole plane"))?;
        let mut source = Source {
            scale: snapshot.scale,
            greys: GreyRange::of_parts(snapshot.extremes, snapshot.all_finite),
            ..Source::default()
        };
        source.pyramid.rebuild(frame, levels, &execution)?;
        source.counts.copy_of(&snapshot.counts)?;
        source.raw.copy_of(&snapshot.raw)?;
        self.next = source;
        self.primed = true;
        Ok(())
    }
}
