//! Where the windows of the nodes stand.

/// A regular grid of windows.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lattice {
    pub(super) columns: usize,
    pub(super) rows: usize,
    pub(super) first: [usize; 2],
    pub(super) step: usize,
}

impl Lattice {
    /// Nodes.
    pub(super) fn len(&self) -> usize {
        self.columns * self.rows
    }

    /// The first pixel of the window of a node.
    pub(super) fn corner(&self, node: usize) -> [usize; 2] {
        [
            self.first[0] + node % self.columns * self.step,
            self.first[1] + node / self.columns * self.step,
        ]
    }

    /// The node so many columns and rows from another.
    pub(super) fn beside(&self, node: usize, [columns, rows]: [isize; 2]) -> Option<usize> {
        let column = (node % self.columns).checked_add_signed(columns)?;
        let row = (node / self.columns).checked_add_signed(rows)?;
        (column < self.columns && row < self.rows).then_some(row * self.columns + column)
    }
}

/// Parts of a grid along a side, each of which is searched by itself.
const PARTS: usize = 3;

/// Some of `nodes`, spread over the grid: of each of three by three parts the one that is nearest to its middle.
pub(super) fn spaced(nodes: impl Iterator<Item = usize>, lattice: Lattice) -> Vec<usize> {
    let mut best: Vec<Option<(usize, usize)>> = vec![None; PARTS * PARTS];
    for node in nodes {
        let (column, row) = (node % lattice.columns, node / lattice.columns);
        let (x, y) = (column * PARTS / lattice.columns, row * PARTS / lattice.rows);
        let middle = |part: usize, size: usize| (2 * part + 1) * size / (2 * PARTS);
        let across = column.abs_diff(middle(x, lattice.columns));
        let down = row.abs_diff(middle(y, lattice.rows));
        let far = across * across + down * down;
        let part = &mut best[y * PARTS + x];
        if part.is_none_or(|(least, _)| far < least) {
            *part = Some((far, node));
        }
    }
    best.into_iter().flatten().map(|(_, node)| node).collect()
}
