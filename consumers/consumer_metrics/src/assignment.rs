//! Pairs rows with columns, each at most once, so that the sum of the pairs' worths is largest: the
//! Hungarian method (Kuhn, 1955) by shortest augmenting paths (Jonker and Volgenant, 1987).

use std::collections::BTreeMap;

/// What a pair of a row and a column is worth.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Pair {
    pub(crate) row: usize,
    pub(crate) column: usize,
    /// More than zero; pairs that are not listed are worth nothing and are not made.
    pub(crate) worth: f64,
}

/// The pairs of the best assignment, as indices into the list, in its order. Rows and columns that
/// no pair joins are solved apart, so that many of them cost little.
pub(crate) fn best_pairs(pairs: &[Pair]) -> Vec<usize> {
    let mut chosen: Vec<usize> = islands(pairs)
        .into_iter()
        .flat_map(|island| solve(pairs, &island))
        .collect();
    chosen.sort_unstable();
    chosen
}

/// Lists of pairs that share no row and no column with another list.
fn islands(pairs: &[Pair]) -> Vec<Vec<usize>> {
    // Rows are even nodes, columns odd ones.
    let mut parents: BTreeMap<usize, usize> = BTreeMap::new();
    for pair in pairs {
        let row = root(&mut parents, 2 * pair.row);
        let column = root(&mut parents, 2 * pair.column + 1);
        parents.insert(column, row);
    }
    let mut islands: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (at, pair) in pairs.iter().enumerate() {
        let root = root(&mut parents, 2 * pair.row);
        islands.entry(root).or_default().push(at);
    }
    islands.into_values().collect()
}

fn root(parents: &mut BTreeMap<usize, usize>, node: usize) -> usize {
    let mut root = node;
    while let Some(&parent) = parents.get(&root).filter(|&&parent| parent != root) {
        root = parent;
    }
    parents.insert(node, root);
    root
}

/// Solves a list of pairs as a dense table.
fn solve(pairs: &[Pair], island: &[usize]) -> Vec<usize> {
    if let [only] = island {
        return vec![*only];
    }
    let number = |of: fn(&Pair) -> usize| {
        let mut numbers = BTreeMap::new();
        for &at in island {
            let next = numbers.len();
            numbers.entry(of(&pairs[at])).or_insert(next);
        }
        numbers
    };
    let (rows, columns) = (number(|pair| pair.row), number(|pair| pair.column));
    let is_turned = rows.len() > columns.len();
    let (n_few, n_many) = if is_turned {
        (columns.len(), rows.len())
    } else {
        (rows.len(), columns.len())
    };
    let mut costs = vec![0.0; n_few * n_many];
    let mut listed = vec![usize::MAX; n_few * n_many];
    for &at in island {
        let (row, column) = (rows[&pairs[at].row], columns[&pairs[at].column]);
        let cell = if is_turned {
            column * n_many + row
        } else {
            row * n_many + column
        };
        costs[cell] = -pairs[at].worth;
        listed[cell] = at;
    }
    least_costs(&costs, n_few, n_many)
        .into_iter()
        .enumerate()
        .map(|(few, many)| listed[few * n_many + many])
        .filter(|&at| at != usize::MAX)
        .collect()
}

/// The column of each row so that the sum of costs is least; no fewer columns than rows.
fn least_costs(costs: &[f64], n_rows: usize, n_columns: usize) -> Vec<usize> {
    // Entry 0 of rows and columns stands for none, so both count from 1 here.
    let mut row_prices = vec![0.0; n_rows + 1];
    let mut column_prices = vec![0.0; n_columns + 1];
    let mut row_of = vec![0; n_columns + 1];
    for new_row in 1..=n_rows {
        row_of[0] = new_row;
        let mut column = 0;
        let mut slack = vec![f64::INFINITY; n_columns + 1];
        let mut came_from = vec![0; n_columns + 1];
        let mut is_done = vec![false; n_columns + 1];
        while row_of[column] != 0 {
            is_done[column] = true;
            let row = row_of[column];
            let (mut step, mut next) = (f64::INFINITY, 0);
            for other in 1..=n_columns {
                if is_done[other] {
                    continue;
                }
                let cost = costs[(row - 1) * n_columns + other - 1]
                    - row_prices[row]
                    - column_prices[other];
                if cost < slack[other] {
                    (slack[other], came_from[other]) = (cost, column);
                }
                if slack[other] < step {
                    (step, next) = (slack[other], other);
                }
            }
            for other in 0..=n_columns {
                if is_done[other] {
                    row_prices[row_of[other]] += step;
                    column_prices[other] -= step;
                } else {
                    slack[other] -= step;
                }
            }
            column = next;
        }
        while column != 0 {
            row_of[column] = row_of[came_from[column]];
            column = came_from[column];
        }
    }
    let mut columns = vec![0; n_rows];
    for (column, &row) in row_of.iter().enumerate().skip(1) {
        if row != 0 {
            columns[row - 1] = column - 1;
        }
    }
    columns
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(worths: &[&[f64]]) -> Vec<Pair> {
        let mut pairs = Vec::new();
        for (row, worths) in worths.iter().enumerate() {
            for (column, &worth) in worths.iter().enumerate() {
                if worth > 0.0 {
                    pairs.push(Pair { row, column, worth });
                }
            }
        }
        pairs
    }

    /// The largest sum by trying everything.
    fn largest(pairs: &[Pair]) -> f64 {
        let Some((first, rest)) = pairs.split_first() else {
            return 0.0;
        };
        let free: Vec<_> = rest
            .iter()
            .filter(|pair| pair.row != first.row && pair.column != first.column)
            .copied()
            .collect();
        largest(rest).max(first.worth + largest(&free))
    }

    #[test]
    fn the_best_single_pair_may_stand_aside() {
        let pairs = table(&[&[0.9, 0.8], &[0.8, 0.0]]);
        assert_eq!(best_pairs(&pairs), [1, 2]);
        assert!(best_pairs(&[]).is_empty());
    }

    #[test]
    fn no_other_choice_is_worth_more() {
        let mut random = fastrand::Rng::with_seed(8);
        for _ in 0..500 {
            let (n_rows, n_columns) = (random.usize(1..5), random.usize(1..5));
            let mut pairs = Vec::new();
            for row in 0..n_rows {
                for column in 0..n_columns {
                    if random.f64() < 0.6 {
                        let worth = random.f64() + 1e-3;
                        pairs.push(Pair { row, column, worth });
                    }
                }
            }
            let chosen = best_pairs(&pairs);
            let sum: f64 = chosen.iter().map(|&at| pairs[at].worth).sum();
            assert!((sum - largest(&pairs)).abs() < 1e-12, "{pairs:?}");
            for of in [|pair: &Pair| pair.row, |pair: &Pair| pair.column] {
                let mut taken: Vec<_> = chosen.iter().map(|&at| of(&pairs[at])).collect();
                taken.sort_unstable();
                taken.dedup();
                assert_eq!(taken.len(), chosen.len());
            }
        }
    }
}
