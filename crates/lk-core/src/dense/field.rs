//! The result of dense flow.

use ndarray::{ArrayView, Dimension, Ix2, Ix3, Ix4};

use crate::error::Result;
use crate::frame::Plane;
use crate::memory::zeros;

/// Where every pixel went, and how far that can be trusted. Memory is kept when it is filled again.
///
/// ```
/// use lk_core::ndarray::Array2;
/// use lk_core::{DenseFlow, DenseHints, DenseOptions, FlowField};
///
/// let scene = |x: f32, y: f32| 100.0 + 40.0 * (0.5 * x).sin() + 40.0 * (0.4 * y + 0.1 * x).cos();
/// let frame = |index: f32| {
///     Array2::from_shape_fn((96, 128), |(y, x)| scene(x as f32 - 1.5 * index, y as f32))
/// };
/// let mut estimator = DenseFlow::new(DenseOptions::default())?;
/// let mut field = FlowField::default();
/// for index in 0..3 {
///     // The first frame has none before it.
///     if estimator.update(frame(index as f32).view(), DenseHints::default(), &mut field)? {
///         let measured = field.valid().iter().filter(|valid| **valid).count();
///         assert!(2 * measured > field.width() * field.height());
///         assert!((field.uv_view()[(48, 64, 0)] - 1.5).abs() < 0.1);
///     }
/// }
/// # Ok::<(), lk_core::Error>(())
/// ```
#[derive(Debug, Clone, Default)]
pub struct FlowField {
    pub(super) width: usize,
    pub(super) height: usize,
    pub(super) uv: Vec<f32>,
    pub(super) valid: Vec<bool>,
    pub(super) residual: Vec<f32>,
    /// Empty where it was not asked for.
    pub(super) covariance: Vec<f32>,
    pub(super) gain: Plane,
    pub(super) offset: Plane,
    pub(super) halvings: usize,
}

impl FlowField {
    /// Columns.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Rows.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// u and v of every pixel, row by row, in pixels from `prev` to `next`; NaN where nothing was to be measured.
    #[must_use]
    pub fn uv(&self) -> &[f32] {
        &self.uv
    }

    /// Whether each pixel was measured: enough texture, inside of both pictures, a difference that noise explains.
    #[must_use]
    pub fn valid(&self) -> &[bool] {
        &self.valid
    }

    /// Root mean square difference within the window after motion and light, in grey levels.
    #[must_use]
    pub fn residual(&self) -> &[f32] {
        &self.residual
    }

    /// The covariance of u and v of every pixel, row by row, uu, uv, vu, vv in squared pixels; infinite where the flow is not
    /// valid, NaN where nothing was to be measured. `None` if it was not asked for ([`DenseOptions::covariance`]).
    ///
    /// [`DenseOptions::covariance`]: crate::DenseOptions::covariance
    #[must_use]
    pub fn covariance(&self) -> Option<&[f32]> {
        (self.covariance.len() == 4 * self.valid.len()).then_some(&self.covariance)
    }

    /// [`FlowField::uv`] as an array, (height, width, 2).
    ///
    /// ```
    /// use lk_core::{DenseHints, DenseOptions, dense_flow};
    /// use lk_core::ndarray::Array2;
    ///
    /// let scene = |x: f32, y: f32| 100.0 + 40.0 * (0.5 * x).sin() + 40.0 * (0.4 * y + 0.1 * x).cos();
    /// let prev = Array2::from_shape_fn((48, 64), |(y, x)| scene(x as f32, y as f32));
    /// let next = Array2::from_shape_fn((48, 64), |(y, x)| scene(x as f32 - 1.5, y as f32));
    /// let field = dense_flow(prev.view(), next.view(), DenseHints::default(), &DenseOptions::default())?;
    /// let (uv, valid) = (field.uv_view(), field.valid_view());
    /// assert_eq!((uv.dim(), valid.dim()), ((48, 64, 2), (48, 64)));
    /// assert!(valid[(24, 32)] && (uv[(24, 32, 0)] - 1.5).abs() < 0.1);
    /// # Ok::<(), lk_core::Error>(())
    /// ```
    #[must_use]
    pub fn uv_view(&self) -> ArrayView<'_, f32, Ix3> {
        view(&self.uv, Ix3(self.height, self.width, 2))
    }

    /// [`FlowField::valid`] as an array, (height, width).
    #[must_use]
    pub fn valid_view(&self) -> ArrayView<'_, bool, Ix2> {
        view(&self.valid, Ix2(self.height, self.width))
    }

    /// [`FlowField::residual`] as an array, (height, width).
    #[must_use]
    pub fn residual_view(&self) -> ArrayView<'_, f32, Ix2> {
        view(&self.residual, Ix2(self.height, self.width))
    }

    /// [`FlowField::covariance`] as an array, (height, width, 2, 2).
    #[must_use]
    pub fn covariance_view(&self) -> Option<ArrayView<'_, f32, Ix4>> {
        let shape = Ix4(self.height, self.width, 2, 2);
        self.covariance().map(|covariance| view(covariance, shape))
    }

    /// The covariance as a vector, without a copy; empty if it was not asked for.
    #[must_use]
    pub fn take_covariance(&mut self) -> Vec<f32> {
        std::mem::take(&mut self.covariance)
    }

    /// Gain and offset of the light, `next = gain * prev + offset`, on a grid whose pixel (x, y) sits over pixel
    /// (2^k x, 2^k y) of the frame, and k.
    #[must_use]
    pub fn light(&self) -> (&Plane, &Plane, usize) {
        (&self.gain, &self.offset, self.halvings)
    }

    /// u, v, valid and residual as vectors, without a copy.
    #[must_use]
    pub fn into_vectors(self) -> (Vec<f32>, Vec<bool>, Vec<f32>) {
        (self.uv, self.valid, self.residual)
    }

    /// Take a size; what is measured is unspecified until it is written.
    pub(super) fn resize(&mut self, width: usize, height: usize) -> Result<()> {
        let pixels = width * height;
        if self.valid.len() != pixels {
            // Fresh memory that is zero already costs less than memory that is filled.
            *self = Self::default();
            let (uv, residual) = (zeros("a flow", 2 * pixels)?, zeros("residuals", pixels)?);
            (self.uv, self.residual) = (uv, residual);
            self.valid = zeros("validity", pixels)?;
        }
        (self.width, self.height) = (width, height);
        for (plane, value) in [(&mut self.gain, 1.0), (&mut self.offset, 0.0)] {
            plane.resize(1, 1)?;
            plane.data_mut().fill(value);
        }
        self.halvings = 0;
        Ok(())
    }

    /// Take the size that belongs to the field; what it holds is unspecified until it is written.
    pub(super) fn resize_covariance(&mut self) -> Result<()> {
        let wanted = 4 * self.valid.len();
        if self.covariance.len() != wanted {
            self.covariance = zeros("covariances", wanted)?;
        }
        Ok(())
    }

    /// Nothing is measured.
    pub(super) fn clear(&mut self) {
        self.uv.fill(f32::NAN);
        self.valid.fill(false);
        self.residual.fill(f32::NAN);
        self.covariance.fill(f32::NAN);
    }
}

/// Memory as an array of the shape that it was made for.
fn view<T, D: Dimension>(data: &[T], shape: D) -> ArrayView<'_, T, D> {
    match ArrayView::from_shape(shape, data) {
        Ok(view) => view,
        Err(error) => unreachable!("a field has memory of its own size: {error}"),
    }
}
