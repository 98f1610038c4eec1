//! Outputs that are divided between threads at their rows.

/// Outputs that can be divided at a row, so that each band owns its part.
pub(crate) trait SplitRows: Sized + Send {
    /// The parts above and below `row`.
    fn split_at_row(self, row: usize) -> (Self, Self);
}

/// Rows of equal length in one slice.
#[derive(Debug)]
pub(crate) struct RowsMut<'a, T> {
    /// The rows, one after the other.
    pub(crate) data: &'a mut [T],
    /// Elements from one row to the next.
    pub(crate) stride: usize,
}

impl<'a, T> RowsMut<'a, T> {
    /// View `data` as rows of `stride` elements.
    pub(crate) fn new(data: &'a mut [T], stride: usize) -> Self {
        Self { data, stride }
    }

    /// Row `index` of this part.
    pub(crate) fn row_mut(&mut self, index: usize) -> &mut [T] {
        &mut self.data[index * self.stride..(index + 1) * self.stride]
    }
}

impl<T: Send> SplitRows for RowsMut<'_, T> {
    fn split_at_row(self, row: usize) -> (Self, Self) {
        let (above, below) = self.data.split_at_mut(row * self.stride);
        (Self::new(above, self.stride), Self::new(below, self.stride))
    }
}

/// One row for each even row of what is divided.
#[derive(Debug)]
pub(crate) struct EvenRows<'a, T> {
    rows: RowsMut<'a, T>,
    /// The first row of this part.
    start: usize,
}

impl<'a, T> EvenRows<'a, T> {
    /// All rows, from row 0 on.
    pub(crate) fn new(rows: RowsMut<'a, T>) -> Self {
        Self { rows, start: 0 }
    }

    /// What belongs to the even row `row`, counted from the first one of all.
    pub(crate) fn row_mut(&mut self, row: usize) -> &mut [T] {
        self.rows.row_mut(row / 2 - self.start.div_ceil(2))
    }
}

impl<T: Send> SplitRows for EvenRows<'_, T> {
    fn split_at_row(self, row: usize) -> (Self, Self) {
        let middle = self.start + row;
        let (above, below) = self
            .rows
            .split_at_row(middle.div_ceil(2) - self.start.div_ceil(2));
        (
            Self {
                rows: above,
                start: self.start,
            },
            Self {
                rows: below,
                start: middle,
            },
        )
    }
}

impl SplitRows for () {
    fn split_at_row(self, _row: usize) -> (Self, Self) {
        ((), ())
    }
}

impl<S: SplitRows> SplitRows for Option<S> {
    fn split_at_row(self, row: usize) -> (Self, Self) {
        self.map(|part| part.split_at_row(row)).unzip()
    }
}

macro_rules! split_tuples {
    ($($name:ident)+) => {
        impl<$($name: SplitRows),+> SplitRows for ($($name,)+) {
            #[allow(non_snake_case, reason = "one name serves as type and as variable")]
            fn split_at_row(self, row: usize) -> (Self, Self) {
                let ($($name,)+) = self;
                $(let $name = $name.split_at_row(row);)+
                (($($name.0,)+), ($($name.1,)+))
            }
        }
    };
}
split_tuples!(A B);
split_tuples!(A B C);
split_tuples!(A B C D);
split_tuples!(A B C D E);
