//! Finds boxes on lanes by place, so that a vehicle on a map with thousands of lights and signs
//! looks at a few.

use std::collections::HashMap;

use nalgebra::Vector3;

/// Side of a cell, metres; more than a vehicle's reach.
const CELL_M: f64 = 32.0;

/// Numbers of boxes by the cell in which their middle lies.
#[derive(Clone, Debug, Default)]
pub(crate) struct BoxGrid(HashMap<(i64, i64), Vec<u32>>);

fn cell(at_m: &Vector3<f64>) -> (i64, i64) {
    (
        (at_m.x / CELL_M).floor() as i64,
        (at_m.y / CELL_M).floor() as i64,
    )
}

impl BoxGrid {
    /// A grid of boxes with these middles, numbered from 0.
    pub fn new(middles_m: impl Iterator<Item = Vector3<f64>>) -> BoxGrid {
        let mut cells: HashMap<(i64, i64), Vec<u32>> = HashMap::new();
        for (number, middle_m) in middles_m.enumerate() {
            cells
                .entry(cell(&middle_m))
                .or_default()
                .push(number as u32);
        }
        BoxGrid(cells)
    }

    /// Every box whose middle is within a cell's side of a place, and some others, by rising
    /// number.
    pub fn near(&self, at_m: &Vector3<f64>) -> Vec<usize> {
        let (x, y) = cell(at_m);
        let mut found: Vec<usize> = (x - 1..=x + 1)
            .flat_map(|x| (y - 1..=y + 1).map(move |y| (x, y)))
            .filter_map(|cell| self.0.get(&cell))
            .flatten()
            .map(|number| *number as usize)
            .collect();
        found.sort_unstable();
        found
    }
}
